//! Reads a ballbot from two URDFs: one of the bot (body and wheels), one of the ball.
//!
//! Names of links and joints do not matter, the mechanics do. The bot has three continuous (or revolute) joints, its
//! wheels in the order of the document; whatever hangs on the root by fixed joints is part of the body, whatever hangs
//! on a wheel by fixed joints is part of the wheel. The root frame has z along the mast, at any height on it: the ball
//! center is where three wheels touch one ball centered on the mast. A wheel's radius and center come from the largest
//! sphere or coaxial cylinder around its axle, among the collision shapes if there is one, else among the visual ones.
//!
//! A URDF says nothing about gravity, the friction coefficients and the ball's friction on the floor: those are the
//! defaults of [`Params`]. Position and velocity limits of the wheel joints are not read.
//!
//! The simulated robot is symmetric about its mast where the models need it. What breaks that is refused, with the
//! value and the limit: a center of mass off the mast, principal axes of inertia that are not those of the root frame,
//! wheels that differ, an axle that is not `-u_i` (see [`crate::kinematics`]).

mod ball;
mod bot;
mod checked;
mod mass;
mod numbers;
mod placement;
mod shape;
mod tree;
mod visual;
mod wheel;

pub use visual::{Visual, VisualLink, VisualShape, visuals_from_urdf};

use crate::error::Result;
use crate::params::Params;
use checked::{read_file, refuse};
use std::path::Path;

/// Parameters of the ballbot described by the files `bot` and `ball`.
///
/// # Errors
/// [`crate::Error::Io`] for a file that cannot be read; those of [`params_from_urdf_text`], naming the file.
pub fn params_from_urdf(bot: &Path, ball: &Path) -> Result<Params> {
    read_params((&bot.display().to_string(), &read_file(bot)?), (&ball.display().to_string(), &read_file(ball)?))
}

/// Parameters of the ballbot described by the texts `bot` and `ball`.
///
/// # Errors
/// [`crate::Error::Urdf`] for malformed text, or text that does not describe a bot or a ball this simulator can represent;
/// what [`Params::validate`] finds is such an error too.
pub fn params_from_urdf_text(bot: &str, ball: &str) -> Result<Params> {
    read_params(("bot URDF", bot), ("ball URDF", ball))
}

/// Parameters from the (label, text) of both URDFs.
fn read_params((bot_label, bot): (&str, &str), (ball_label, ball): (&str, &str)) -> Result<Params> {
    let ball = ball::Ball::read(ball).map_err(refuse(ball_label))?;
    let bot = bot::Bot::read(bot, ball.radius).map_err(refuse(bot_label))?;
    let mut fields: Vec<(&str, &[f64])> = vec![
        ("ball_mass", std::slice::from_ref(&ball.mass)),
        ("ball_inertia", std::slice::from_ref(&ball.inertia)),
        ("ball_radius", std::slice::from_ref(&ball.radius)),
    ];
    fields.extend(bot.fields());
    Params::from_fields(fields).map_err(|e| refuse(&format!("{bot_label} and {ball_label}"))(e.to_string()))
}
