//! Any text in the place of the two URDFs is a robot that can exist, or an error: never a panic, a hang or a flood of memory.
//!
//! An input is the bot's URDF, then the ball's from the first `<!--ball-->` on. Without that mark it is the bot's, on the
//! shipped ball.
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
