//! The hardest push that a robot withstands by its traction.

use super::{BallSpin, LinearModel, LoadMap, SpatialModel, WheelLoad, WheelSpin};
use ballbot_base::params::Params;
use nalgebra::Vector3;
use std::f64::consts::TAU;

/// Number of directions of a lean that are compared.
const DIRECTIONS: usize = 72;

/// Largest horizontal impulse at the body's center of mass, N·s, after which the capture point ϑ + ϑ̇/λ of the upright
/// robot is within the lean that it can hold in the worst direction. Derived in `docs/scenarios.md`.
pub fn capture_impulse(params: &Params) -> f64 {
    let level = params.on_level_floor();
    let linear = LinearModel::new(&level);
    let upright = level.to_balance_frame();
    let model = SpatialModel::new(&level, WheelSpin::Absolute, BallSpin::Free);
    let jump = model.velocity_jump(&upright, &Vector3::x(), &level.body_com());
    Hold::of(&level, &linear).lean * linear.toppling_squared().sqrt() / jump.fixed_rows::<3>(2).norm()
}

/// How a robot on a level floor holds a small lean, in the worst direction.
pub(super) struct Hold {
    /// The largest torque of a wheel, over the lean, N·m/rad.
    pub torque: f64,
    /// The largest lean, rad: no wheel slips, with the loads of the upright robot, and no motor exceeds its limit.
    pub lean: f64,
}

impl Hold {
    pub fn of(level: &Params, linear: &LinearModel) -> Self {
        let map = LoadMap::new(level);
        let torques = linear.turning_torques();
        let mut worst = Self { torque: 0.0, lean: f64::INFINITY };
        for k in 0..DIRECTIONS {
            let azimuth = TAU * k as f64 / DIRECTIONS as f64;
            let per_lean = torques * (-linear.toppling_squared() * Vector3::new(-azimuth.sin(), azimuth.cos(), 0.0));
            worst.torque = worst.torque.max(per_lean.amax());
            worst.lean = worst.lean.min(holdable(level, &map, &per_lean));
        }
        worst
    }
}

/// Lean at which a wheel slips or a motor is at its limit under the torques `per_lean` (N·m/rad) that hold it, rad.
fn holdable(params: &Params, map: &LoadMap, per_lean: &Vector3<f64>) -> f64 {
    let of = |wheel: &WheelLoad| wheel.per_torque.iter().zip(per_lean).map(|(k, torque)| k * torque).sum::<f64>();
    let friction = params.wheel_dynamic_friction;
    let mut least = params.max_wheel_torque / per_lean.amax();
    for (load, traction) in map.loads.iter().zip(&map.tractions) {
        for sign in [1.0, -1.0] {
            // f + s Δf = ± μ (N + s ΔN)
            let growth = sign * of(traction) - friction * of(load);
            let reserve = friction * load.at_rest - sign * traction.at_rest;
            if growth > 0.0 {
                least = least.min(reserve / growth);
            }
        }
    }
    least
}
