//! Parameters and visuals of a ballbot from two URDFs: one of the bot (body and wheels), one of the ball.
//!
//! Names of links and joints are free. The bot has three continuous (or revolute) joints, one per wheel, in document
//! order. Links fixed to the root are part of the body. Links fixed to a wheel are part of the wheel. The z axis of the
//! root frame is along the mast; its origin is at any height. The ball center is the point of the mast from which three
//! wheels touch one ball. Radius and center of a wheel are taken from the largest sphere or coaxial cylinder around its
//! axle, among collision shapes if there is one, else among visual shapes.
//!
//! Gravity, friction coefficients and the friction of the ball on the floor are not in a URDF and keep the defaults of
//! [`Params`]. Position limits of the wheel joints are not read; [`motors_from_urdf`] reads their velocity limit.
//!
//! A center of mass off the mast, products of inertia and wheels at different azimuths and zeniths are kept. Deviations
//! from a symmetric robot below 1e-6 (m, or relative) count as rounding of the file. Rejected, with value and limit:
//! wheels that do not all touch one ball centered on the mast, wheels that are not identical, an axle that is not
//! `-u_i` (see [`ballbot_base::kinematics`]).

#![warn(clippy::print_stdout, clippy::print_stderr, clippy::unwrap_used)]

mod ball;
mod bot;
mod checked;
mod mass;
mod motors;
mod numbers;
mod placement;
mod shape;
mod tree;
mod visual;
mod wheel;

pub use motors::{motors_from_urdf, motors_from_urdf_text};
pub use visual::{Visual, VisualLink, VisualShape, visuals_from_urdf, visuals_from_urdf_text};

use ballbot_base::error::Result;
use ballbot_base::params::Params;
use checked::{invalid_file, read_file};
use std::path::Path;

/// Parameters of the ballbot described by the files `bot` and `ball`.
///
/// # Errors
/// [`ballbot_base::Error::Io`] for a file that cannot be read; the errors of [`params_from_urdf_text`], with the name
/// of the file.
pub fn params_from_urdf(bot: &Path, ball: &Path) -> Result<Params> {
    read_params((&bot.display().to_string(), &read_file(bot)?), (&ball.display().to_string(), &read_file(ball)?))
}

/// Parameters of the ballbot described by the texts `bot` and `ball`.
///
/// # Errors
/// [`ballbot_base::Error::Urdf`] for malformed text, for a bot or a ball outside this module's assumptions, and for parameters
/// that [`Params::validate`] rejects.
pub fn params_from_urdf_text(bot: &str, ball: &str) -> Result<Params> {
    read_params(("bot URDF", bot), ("ball URDF", ball))
}

/// Parameters from the (label, text) of both URDFs.
fn read_params((bot_label, bot): (&str, &str), (ball_label, ball): (&str, &str)) -> Result<Params> {
    let ball = ball::Ball::read(ball).map_err(invalid_file(ball_label))?;
    let bot = bot::Bot::read(bot, ball.radius).map_err(invalid_file(bot_label))?;
    let mut fields: Vec<(&str, &[f64])> = vec![
        ("ball_mass", std::slice::from_ref(&ball.mass)),
        ("ball_inertia", std::slice::from_ref(&ball.inertia)),
        ("ball_radius", std::slice::from_ref(&ball.radius)),
    ];
    fields.extend(bot.fields());
    Params::from_fields(fields).map_err(|e| invalid_file(&format!("{bot_label} and {ball_label}"))(e.to_string()))
}
