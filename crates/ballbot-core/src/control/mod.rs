//! Controllers: from a [`State`] and a [`Setpoint`] to wheel torques. They never see an engine.

mod lqr;
mod pid;
pub mod riccati;

pub use lqr::{Lqr, LqrWeights};
pub use pid::{Pid, PidGains};

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

/// Share of the load at rest that a controller counts on, since loads vary as the robot moves.
const TRACTION_SHARE: f64 = 0.8;

/// The torque that a wheel can be counted on to pass to the ball: 0.8 of μ N r_w with the load N at rest upright, or the
/// motors' limit if that is lower, N·m. Beyond it a wheel slips, and a controller that expects grip falls.
pub fn traction_torque(params: &Params) -> f64 {
    let slip = params.wheel_dynamic_friction * params.static_wheel_load() * params.wheel_radius;
    (TRACTION_SHARE * slip).min(params.max_wheel_torque)
}
