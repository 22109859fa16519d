//! Limit of the motor torques from the friction between wheels and ball.

use super::{BallSpin, SpatialModel, WheelSpin};
use crate::kinematics::TorqueMap;
use crate::params::Params;
use crate::state::Contacts;
use nalgebra::{Vector3, Vector6};
use std::f64::consts::TAU;

/// Number of tested directions of a tilt torque. The limit changes by less than 2 % between neighbors.
const DIRECTIONS: u32 = 48;

/// Largest torque of any wheel for a tilt torque in the worst direction, N·m, at which no wheel of the robot in
/// equilibrium slips; at most the limit of the motors. The reaction of the motors unloads some wheels, so the result is well
/// below μ N r_w with the loads N at rest. Derived in `docs/derivations.md`, "Largest torque".
pub fn traction_torque(params: &Params) -> f64 {
    let model = SpatialModel::new(params, WheelSpin::Absolute, BallSpin::Free);
    let attitude = params.to_balance_frame();
    let contacts = |torques: &Vector3<f64>| model.contacts(&attitude, &Vector6::zeros(), torques);
    let at_rest = contacts(&Vector3::zeros());
    (0..DIRECTIONS)
        .map(|k| {
            let angle = TAU * f64::from(k) / f64::from(DIRECTIONS);
            let tilting = attitude.inverse_transform_vector(&Vector3::new(angle.cos(), angle.sin(), 0.0));
            let torques = model.wheels().torques_on_body(&tilting, TorqueMap::Consistent);
            let torques = torques / torques.amax();
            slip_scale(params, &at_rest, &contacts(&torques))
        })
        .fold(params.max_wheel_torque, f64::min)
}

/// Factor on the torques of `driven` at which the first wheel slips. Loads and tractions are linear in the torques.
fn slip_scale(params: &Params, at_rest: &Contacts, driven: &Contacts) -> f64 {
    let friction = params.wheel_dynamic_friction;
    (0..3)
        .map(|i| {
            let load = at_rest.wheel_normal_forces[i];
            let change = driven.wheel_normal_forces[i] - load;
            // |s f| = μ (N + s ΔN)
            let slope = driven.wheel_tractions[i].abs() - friction * change;
            if slope > 0.0 { friction * load / slope } else { f64::INFINITY }
        })
        .fold(f64::INFINITY, f64::min)
}
