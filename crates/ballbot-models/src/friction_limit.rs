//! Limit of the motor torques by the friction between wheels and ball.

use super::{BallSpin, SpatialModel, WheelSpin};
use ballbot_base::kinematics::TorqueMap;
use ballbot_base::params::Params;
use ballbot_base::state::Contacts;
use ballbot_base::wheels::{WHEELS, Wheels};
use nalgebra::{Matrix2, Vector2, Vector3, Vector6};
use std::f64::consts::TAU;

/// Number of tested directions of a tilt torque on a symmetric robot. The limit changes by less than 2 % between neighbors.
const DIRECTIONS: u32 = 48;

/// Largest torque of any wheel for a tilt torque in the worst direction, N·m, at which no wheel slips, for a robot in
/// equilibrium on a level floor; at most the motors' limit. The reaction of the motors unloads some wheels, so the
/// result is well below μ N r_w with the loads N at rest. Derived in `docs/derivations.md`, "Largest torque".
pub fn traction_torque(params: &Params) -> f64 {
    let model = SpatialModel::new(&params.on_level_floor(), WheelSpin::Absolute, BallSpin::Free);
    let attitude = params.to_balance_frame();
    let contacts = |torques: Wheels<f64>| model.contacts(&attitude, &Vector6::zeros(), torques);
    let at_rest = contacts(Wheels::default());
    let tilting = |x: f64, y: f64| {
        let axis = attitude.inverse_transform_vector(&Vector3::new(x, y, 0.0));
        model.wheels().torques_on_body(&axis, TorqueMap::Consistent).column()
    };
    let limit = |torques: Vector3<f64>| {
        let torques = torques / torques.amax();
        slip_scale(params, &at_rest, &contacts(Wheels::of_column(torques)))
    };
    if !params.is_symmetric() {
        let worst = extreme_torques(&tilting(1.0, 0.0), &tilting(0.0, 1.0));
        return worst.into_iter().flatten().map(limit).fold(params.max_wheel_torque, f64::min);
    }
    (0..DIRECTIONS)
        .map(|k| {
            let angle = TAU * f64::from(k) / f64::from(DIRECTIONS);
            limit(tilting(angle.cos(), angle.sin()))
        })
        .fold(params.max_wheel_torque, f64::min)
}

/// The corners of the set of torques x s + y t with no torque above 1: two wheels are at ±1 there. Slip is a linear
/// condition on the torques, so the first wheel slips at a corner.
fn extreme_torques(x: &Vector3<f64>, y: &Vector3<f64>) -> [Option<Vector3<f64>>; 12] {
    std::array::from_fn(|k| {
        let (i, j) = [(0, 1), (1, 2), (2, 0)][k / 4];
        let at = Vector2::new(if k & 1 == 0 { 1.0 } else { -1.0 }, if k & 2 == 0 { 1.0 } else { -1.0 });
        let shares = Matrix2::new(x[i], y[i], x[j], y[j]).lu().solve(&at)?;
        let torques = x * shares[0] + y * shares[1];
        // If a third wheel is above 1, the corner belongs to another pair; the margin is for rounding.
        (torques.amax() <= 1.0 + 1e-9).then_some(torques)
    })
}

/// Factor on the torques of `driven` at which the first wheel slips. Loads and tractions are linear in the torques.
fn slip_scale(params: &Params, at_rest: &Contacts, driven: &Contacts) -> f64 {
    let friction = params.wheel_dynamic_friction;
    (0..WHEELS)
        .map(|i| {
            let load = at_rest.wheel_normal_forces[i];
            let change = driven.wheel_normal_forces[i] - load;
            // |s f| = μ (N + s ΔN)
            let slope = driven.wheel_tractions[i].abs() - friction * change;
            if slope > 0.0 { friction * load / slope } else { f64::INFINITY }
        })
        .fold(f64::INFINITY, f64::min)
}
