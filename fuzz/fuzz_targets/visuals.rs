//! Fuzz target of the visual elements of URDFs. Any text must give shapes of positive finite size or an error.
//!
//! Inputs are shared with the target `urdf`.
#![no_main]

use ballbot_core::Error;
use ballbot_core::urdf::{VisualShape, visuals_from_urdf_text};
use libfuzzer_sys::fuzz_target;

const BALL: &str = include_str!("../../assets/ball.urdf");
const MARK: &str = "<!--ball-->";

fuzz_target!(|text: &str| {
    let (bot, ball) = text.split_once(MARK).unwrap_or((text, BALL));
    match visuals_from_urdf_text(bot, ball) {
        Ok(visuals) => {
            for visual in visuals {
                assert!(visual.pose.to_homogeneous().iter().all(|x| x.is_finite()));
                let sizes = match visual.shape {
                    VisualShape::Sphere(radius) => vec![radius],
                    VisualShape::Cylinder(radius, length) => vec![radius, length],
                    VisualShape::Cuboid(size) | VisualShape::Mesh(_, size) => size.as_slice().to_vec(),
                };
                assert!(sizes.iter().all(|x| x.is_finite() && *x > 0.0), "a shape of size {sizes:?}");
            }
        }
        Err(Error::Urdf { file, reason }) => assert!(!file.is_empty() && !reason.is_empty()),
        Err(other) => panic!("not an error of a URDF: {other:?}"),
    }
});
