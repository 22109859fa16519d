//! The horizontal external force, from the observer of the equilibrium.
//!
//! At rest a horizontal force F on the body is in balance with the floor's friction, so with the torque of the motors alone:
//! τ₀ = −F r_w in a vertical plane of a robot with one wheel, wherever F acts. So û₀, the lean acceleration by the motors in
//! equilibrium, is proportional to F whatever its height, and a center of mass that is off, which is balanced by the lean
//! θ̂₀ alone, does not change it. A slope does: its weight along the floor is such a force.
//!
//! The correction of û₀ by the deviation of the velocities from their prediction is a first-order filter of the generalized
//! momentum that the model does not explain: the momentum observer of De Luca and Mattone (ICRA 2005; Haddadin, De Luca and
//! Albu-Schäffer, IEEE Transactions on Robotics 33(6), 2017) for the linear model of the plane. Derived in `docs/laws.md`.

use super::lean_planes::LeanPlane;
use ballbot_base::params::Params;
use ballbot_models::{BallSpin, SpatialModel, WheelSpin};
use nalgebra::Vector3;

/// Horizontal force in the plane of x (`axis` 0) or y per û₀, N·s²/rad.
pub(crate) fn per_acceleration(axis: usize, params: &Params, plane: &LeanPlane) -> f64 {
    let level = params.on_level_floor();
    let model = SpatialModel::new(&level, WheelSpin::Absolute, BallSpin::Free);
    // The attitude in equilibrium.
    let attitude = level.to_balance_frame();
    let direction = if axis == 0 { Vector3::x() } else { Vector3::y() };
    // Accelerations by a force of 1 N.
    let moved = model.velocity_jump(&attitude, &direction, &level.body_com());
    let turned = attitude * Vector3::new(moved[2], moved[3], moved[4]);
    let (ball, lean) = if axis == 0 { (moved[0], turned.y) } else { (moved[1], -turned.x) };
    // θ₀ = −w/g and u₀ = −λ² θ₀ − w_θ, with w the acceleration of y + ℓ θ.
    let equilibrium = -plane.lever.mul_add(lean, ball) / plane.acceleration;
    (-plane.toppling_squared() * equilibrium - lean).recip()
}
