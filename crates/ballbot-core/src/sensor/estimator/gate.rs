//! Which wheels slip.

use crate::lanes::{Lane, Vec3};
use crate::params::Params;

/// Largest change of a wheel rate in a step that friction allows a wheel that does not slip.
///
/// With the robot upright at rest, wheel i presses on the ball with the load N_i and drives it with at most μ_s N_i. About
/// the ball's lowest point the forces have at most the torque r_k Σ N_i (sin α_i + 2 μ_s cos(α_i / 2)), which turns the
/// rolling ball with the inertia J_k + M_k r_k²; about the vertical at most r_k Σ μ_s N_i sin α_i, with J_k. A wheel rate
/// without the body's own turning follows the ball by k cos α_i and k sin α_i.
#[derive(Clone, Debug)]
pub struct JumpLimit {
    /// rad/s².
    acceleration: [f64; 3],
}

impl JumpLimit {
    /// `multiple` of the limit of the robot of `params`: loads in motion differ from those at rest.
    pub fn new(params: &Params, multiple: f64) -> Self {
        let friction = params.wheel_static_friction.max(params.wheel_dynamic_friction);
        let (mut rolling, mut spinning) = (0.0, 0.0);
        for (load, zenith) in params.equilibrium_wheel_loads().into_iter().zip(params.wheel_zeniths()) {
            rolling += load * (zenith.sin() + 2.0 * friction * (0.5 * zenith).cos());
            spinning += load * friction * zenith.sin();
        }
        let radius = params.ball_radius;
        rolling *= radius / (params.ball_mass * radius).mul_add(radius, params.ball_inertia);
        spinning *= radius / params.ball_inertia;
        let scale = multiple * params.gear_ratio();
        Self {
            acceleration: params
                .wheel_zeniths()
                .map(|zenith| scale * (zenith.cos().abs() * rolling + zenith.sin().abs() * spinning)),
        }
    }

    /// Whether the rate of wheel `i` changes by more in `dt` seconds. `change` is that of the rate, `turning` that of the
    /// rate by the body's own turning, both rad/s.
    #[inline(always)]
    pub fn exceeded<L: Lane>(&self, i: usize, change: L, turning: L, dt: f64) -> L::Mask {
        let limit = change.splat(self.acceleration[i] * dt);
        limit.lt((change - turning).abs())
    }
}

/// Wheel rates by the body's own turning at `rate` (body frame, rad/s): −k u_i · Ω.
#[inline(always)]
pub fn by_turning<L: Lane>(row: &[f64; 3], rate: Vec3<L>) -> L {
    -rate.z.mul_add_all(row[2], rate.y.mul_add_all(row[1], rate.x * row[0]))
}
