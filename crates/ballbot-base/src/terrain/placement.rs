//! Robots placed on the ground.

use super::Ground;
use crate::error::{Error, Result};
use crate::kinematics::Omniwheels;
use crate::params::Params;
use crate::state::{State, attitude};
use nalgebra::{UnitQuaternion, Vector2, Vector3};

impl Ground {
    /// A robot at rest with its ball on the ground, the ball's center above x and y, m, turned to the heading `yaw`,
    /// rad. `tilt` is the rotation vector (x, y) of its tilt from the equilibrium on level ground, rad; `None` is the
    /// static lean: uphill by asin(M r_k sin γ / (M_b l)) on a slope γ.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] for a slope on which no lean holds the robot.
    pub fn at_rest(&self, params: &Params, x: f64, y: f64, yaw: f64, tilt: Option<Vector2<f64>>) -> Result<State> {
        let (center, normal) = self.ball_center(params, x, y);
        let tilt = tilt.map_or_else(|| static_lean(params, &normal, [x, y]), Ok)?;
        let body_quaternion = attitude(tilt, yaw) * params.to_balance_frame();
        Ok(State { ball_position: center, body_position: center, body_quaternion, ..State::upright(params) })
    }

    /// A start on level ground moved to the same place on this ground: the ball touches the ground and rolls with the
    /// same horizontal velocity, and the local static lean is added to the tilt. If no lean holds the robot, none is
    /// added.
    pub fn adapted(&self, params: &Params, wheels: &Omniwheels, start: &State) -> State {
        let [x, y, _] = start.ball_position.into();
        let (center, normal) = self.ball_center(params, x, y);
        let lean = static_lean(params, &normal, [x, y]).unwrap_or_default();
        let body_quaternion = UnitQuaternion::from_scaled_axis(lean.push(0.0)) * start.body_quaternion;
        let level = start.ball_velocity;
        let rise = -(normal.x * level.x + normal.y * level.y) / normal.z;
        let velocity = level + Vector3::z() * rise;
        let rolling = |normal: &Vector3<f64>, velocity: &Vector3<f64>| normal.cross(velocity) / params.ball_radius;
        let spin = start.ball_angular_velocity - rolling(&Vector3::z(), &level);
        let rate = rolling(&normal, &velocity) + spin;
        let moved = center - start.ball_position;
        State {
            ball_position: center,
            ball_velocity: velocity,
            ball_angular_velocity: rate,
            body_position: start.body_position + moved,
            body_velocity: start.body_velocity + velocity - level,
            body_quaternion,
            wheel_speeds: wheels.wheel_speeds(&body_quaternion, &rate, &start.body_angular_velocity),
            ..start.clone()
        }
    }
}

/// A robot upright at rest with its ball on the ground above the origin; on level ground if `None`.
pub fn upright_on(ground: Option<&Ground>, params: &Params) -> State {
    let upright = State::upright(params);
    let Some(ground) = ground else { return upright };
    let (center, _) = ground.ball_center(params, 0.0, 0.0);
    State { ball_position: center, body_position: center, ..upright }
}

/// Rotation vector of the static lean of a robot on ground with this normal.
///
/// # Errors
/// [`Error::Inconsistent`] for a slope on which no lean holds the robot.
pub fn static_lean(params: &Params, normal: &Vector3<f64>, [x, y]: [f64; 2]) -> Result<Vector2<f64>> {
    let sine = normal.xy().norm();
    if sine == 0.0 {
        return Ok(Vector2::zeros());
    }
    let share =
        (params.ball_mass + params.body_mass) * params.ball_radius / (params.body_mass * params.body_com().norm());
    if share * sine > 1.0 {
        return Err(Error::Inconsistent(format!(
            "no lean holds the robot at x = {x} m, y = {y} m: the slope is {:.3} rad, the steepest on which it balances {:.3} rad",
            sine.asin(),
            share.recip().asin()
        )));
    }
    // The normal leans downhill; the mast leans the other way.
    let downhill = Vector2::new(normal.x, normal.y) / sine;
    Ok(Vector2::new(downhill.y, -downhill.x) * (share * sine).asin())
}
