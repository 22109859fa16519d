//! Detection of slipping wheels.

use super::EstimatorOptions;
use ballbot_base::constants::Constants;
use ballbot_base::lanes::{Lane, Vec3};
use ballbot_base::params::Params;
use ballbot_base::wheels::Wheels;

/// Largest change of a wheel rate in a step that friction allows without slip.
///
/// With the robot upright at rest, wheel i presses on the ball with the load N_i and drives it with at most μ_s N_i.
/// About the ball's lowest point the forces have at most the torque r_k Σ N_i (sin α_i + 2 μ_s cos(α_i / 2)), less r_k
/// N_P sin α_i for the loads N_P by a preload, whose moment the preload cancels. It turns the rolling ball with the inertia
/// J_k + M_k r_k²; about the vertical at most r_k Σ μ_s N_i sin α_i, with J_k.
/// Without the body's own rotation, a wheel rate follows the ball by k √(cos² α_i + tan² γ) and k sin α_i, with the angle γ
/// of the rollers.
///
/// A rate is the difference of two angles over dt, and its change the difference of two rates that share an angle: with
/// the angle error σ the change has the deviation √6 σ / dt. Its margin is as many deviations as for two wheels that disagree.
#[derive(Clone, Debug)]
pub struct JumpLimit {
    /// rad/s.
    change: Wheels<f64>,
}

impl JumpLimit {
    /// Limits of the robot of `params` with readings every `dt` seconds; `jump_gate` times what friction allows, since
    /// loads in motion differ from loads at rest.
    pub fn new(params: &Params, options: &EstimatorOptions, dt: f64) -> Self {
        let friction = params.wheel_static_friction.max(params.wheel_dynamic_friction);
        let (mut rolling, mut spinning) = (0.0, 0.0);
        let (loads, preloads) = (params.equilibrium_wheel_loads(), params.preload_wheel_loads());
        for ((load, preload), zenith) in loads.into_iter().zip(preloads).zip(params.wheel_zeniths()) {
            rolling += load * (zenith.sin() + 2.0 * friction * (0.5 * zenith).cos()) - preload * zenith.sin();
            spinning += load * friction * zenith.sin();
        }
        let radius = params.ball_radius;
        rolling *= radius / (params.ball_mass * radius).mul_add(radius, params.ball_inertia);
        spinning *= radius / params.ball_inertia;
        let scale = options.jump_gate * params.gear_ratio() * dt;
        let incline = params.roller_angle.tan();
        let margin = options.slip_gate * 6.0_f64.sqrt() * options.encoder_noise / dt;
        Self {
            change: params
                .wheel_zeniths()
                .map(|zenith| scale * (zenith.cos().hypot(incline) * rolling + zenith.sin().abs() * spinning) + margin),
        }
    }

    /// Adds the largest change of each wheel.
    pub(super) fn add_to(&self, constants: Constants) -> Constants {
        constants.vector("largest_change", self.change.as_slice())
    }

    /// Whether the rate of wheel `i` changes by more in a step. `change` is the change of the rate, `turning` the part
    /// due to the body's own rotation, both rad/s.
    #[inline(always)]
    pub fn exceeded<L: Lane>(&self, i: usize, change: L, turning: L) -> L::Mask {
        change.splat(self.change[i]).lt((change - turning).abs())
    }
}

/// Wheel rates due to the body's own rotation at `rate` (body frame, rad/s): −k u_i · Ω.
#[inline(always)]
pub fn by_turning<L: Lane>(row: &[f64; 3], rate: Vec3<L>) -> L {
    -rate.z.mul_add_all(row[2], rate.y.mul_add_all(row[1], rate.x * row[0]))
}
