//! Controllers: from a [`State`] and a [`Setpoint`] to wheel torques. They never see an engine.

mod lqr;
mod pid;
pub mod riccati;

pub use lqr::{Lqr, LqrWeights};
pub use pid::{Pid, PidGains};

use crate::error::{Result, check};
use crate::models::traction_torque;
use crate::params::Params;
use crate::state::State;
use nalgebra::{Vector2, Vector3};

/// What a controller is asked to bring about.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Setpoint {
    /// Where the ball should be on the floor, inertial frame, m.
    pub position: Vector2<f64>,
    /// How fast the ball should move, inertial frame, m/s.
    pub velocity: Vector2<f64>,
    /// Heading, rad.
    pub yaw: f64,
    /// Tilt components about the heading frame's x and y axes, rad; for controllers of tilt alone.
    pub tilt: Vector2<f64>,
}

/// A feedback law sampled every `control_dt`.
pub trait Controller: Send + Sync {
    /// Time between two calls of [`Controller::wheel_torques`], s.
    fn control_dt(&self) -> f64;

    /// Forgets the past.
    fn reset(&mut self);

    /// Motor torques for the next `control_dt`, N·m.
    fn wheel_torques(&mut self, state: &State, setpoint: &Setpoint) -> [f64; 3];
}

/// Scales torques down together to within ±`limit`, which keeps their direction; NaN passes through.
fn saturate(torques: Vector3<f64>, limit: f64) -> Vector3<f64> {
    let largest = torques.amax();
    if largest > limit {
        // The scaled torque may round to just above the limit.
        (torques * (limit / largest)).map(|torque| torque.clamp(-limit, limit))
    } else {
        torques
    }
}

/// A limit of wheel torques, if it is positive and within the motors'.
fn check_max_torque(max_torque: f64, motor_torque: f64) -> Result<f64> {
    let limit = format!("above 0 and at most params.max_wheel_torque = {motor_torque} N·m");
    check("max_torque", max_torque, limit, |t| t > 0.0 && t <= motor_torque)
}

/// Share of the robot's traction that a controller uses by default: the rest is for tilts and rates that are not zero.
const TRACTION_SHARE: f64 = 0.9;

/// The limit of wheel torques that controllers keep by default: 0.9 of [`traction_torque`], N·m. Beyond it a wheel slips,
/// and a controller that expects grip falls.
pub fn default_max_torque(params: &Params) -> f64 {
    TRACTION_SHARE * traction_torque(params)
}
