//! Fuzz target of the URDF reader. Any text must give valid parameters or an error, without panic, hang or excessive
//! memory.
//!
//! An input is the URDF of the bot followed by `<!--ball-->` and the URDF of the ball. Without the mark it is the URDF
//! of only the bot, and the ball is the shipped one.
#![no_main]

use ballbot_core::Error;
use ballbot_core::urdf::params_from_urdf_text;
use libfuzzer_sys::fuzz_target;

const BALL: &str = include_str!("../../assets/ball.urdf");
const MARK: &str = "<!--ball-->";

fuzz_target!(|text: &str| {
    let (bot, ball) = text.split_once(MARK).unwrap_or((text, BALL));
    match params_from_urdf_text(bot, ball) {
        Ok(params) => params.validate().expect("a robot was read that cannot exist"),
        Err(Error::Urdf { file, reason }) => assert!(!file.is_empty() && !reason.is_empty()),
        Err(other) => panic!("not an error of a URDF: {other:?}"),
    }
});
