//! Traction and motor torque that a motion requires of a robot.

use crate::Setpoint;
use crate::parts::lean_planes::LeanPlanes;
use ballbot_base::params::Params;
use ballbot_models::{LoadMap, WheelLoad};
use nalgebra::Rotation2;

/// Loads, friction and motors of the wheels.
#[derive(Clone, Debug)]
pub(super) struct Traction {
    map: LoadMap,
    friction: f64,
    max_torque: f64,
}

impl Traction {
    pub(super) fn new(params: &Params) -> Self {
        let friction = params.wheel_dynamic_friction;
        Self { map: LoadMap::new(params), friction, max_torque: params.max_wheel_torque }
    }

    /// Largest fraction of the friction limit, load or torque of a wheel in the motion of a setpoint. `turning` is the
    /// acceleration of the heading, rad/s².
    pub(super) fn demand(&self, planes: &LeanPlanes, setpoint: &Setpoint, turning: f64) -> f64 {
        let into_heading = Rotation2::new(-setpoint.yaw);
        let per_lean = planes.planes.map(|plane| plane.acceleration);
        let lean = into_heading * setpoint.acceleration;
        let lean = [lean.x / per_lean[0], lean.y / per_lean[1]];
        let rate = into_heading * setpoint.jerk;
        let rate = [rate.x / per_lean[0], rate.y / per_lean[1]];
        let snap = into_heading * setpoint.snap;
        let toppling = planes.planes.map(|plane| plane.toppling_squared());
        let forward = [snap.x / per_lean[0] - toppling[0] * lean[0], snap.y / per_lean[1] - toppling[1] * lean[1]];
        let torques = planes.wheel_torques(forward, turning);
        // Leaning towards y turns about −x.
        let tilt = [-lean[1], lean[0]];
        let squared = rate[0].mul_add(rate[0], rate[1] * rate[1]);
        let of = |wheel: &WheelLoad| {
            let tilted = wheel.per_tilt[0].mul_add(tilt[0], wheel.per_tilt[1] * tilt[1]);
            let driven: f64 = wheel.per_torque.iter().zip(torques).map(|(per, torque)| per * torque).sum();
            wheel.per_rate_squared.mul_add(squared, wheel.at_rest + tilted + driven)
        };
        let motors = torques.iter().fold(0.0_f64, |most, torque| most.max(torque.abs() / self.max_torque));
        self.map.loads.iter().zip(&self.map.tractions).fold(motors, |most, (load, traction)| {
            let load = of(load);
            let share = if load > 0.0 { of(traction).abs() / (self.friction * load) } else { f64::INFINITY };
            most.max(share)
        })
    }
}
