//! What the wheels' friction lets the motors do.

use super::{BallSpin, SpatialModel, WheelSpin};
use crate::params::Params;
use crate::state::Contacts;
use nalgebra::{UnitQuaternion, Vector3, Vector6};
use std::f64::consts::TAU;

/// Directions of a tilt torque that are tried; the limit changes by less than 2 % between neighbors.
const DIRECTIONS: u32 = 48;

/// The largest torque of any wheel, N·m, that the upright robot at rest can exert for a tilt torque in the worst
/// direction before a wheel slips (or the motors reach their limit). The motors' reaction unloads some wheels as it loads
/// others, so this is well below μ N r_w with the loads N at rest.
pub fn traction_torque(params: &Params) -> f64 {
    let model = SpatialModel::new(params, WheelSpin::Absolute, BallSpin::Free);
    let contacts = |torques: &Vector3<f64>| model.contacts(&UnitQuaternion::identity(), &Vector6::zeros(), torques);
    let at_rest = contacts(&Vector3::zeros());
    (0..DIRECTIONS)
        .map(|k| {
            let angle = TAU * f64::from(k) / f64::from(DIRECTIONS);
            let tilting = Vector3::new(angle.cos(), angle.sin(), 0.0);
            let torques = model.wheels().wheel_torques(&tilting, crate::kinematics::TorqueMap::Consistent);
            let torques = torques / torques.amax();
            slip_scale(params, &at_rest, &contacts(&torques))
        })
        .fold(params.max_wheel_torque, f64::min)
}

/// How often the torques of `driven` fit until a wheel slips: loads and tractions are linear in the torques.
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
