//! Fuzz target of the reader of STL meshes. Any bytes must give a shape or an error, without panic, hang or memory in
//! excess of the file's size.
#![no_main]

use ballbot_core::Error;
use ballbot_core::render::Shape;
use libfuzzer_sys::fuzz_target;
use nalgebra::Vector3;

fuzz_target!(|contents: &[u8]| {
    match Shape::stl(contents, &Vector3::repeat(0.001)) {
        Ok(Shape::Mesh(_)) => (),
        Ok(other) => panic!("an STL gave {other:?}"),
        Err(Error::Decode { reason, .. }) => assert!(!reason.is_empty()),
        Err(other) => panic!("not an error of a mesh: {other:?}"),
    }
});
