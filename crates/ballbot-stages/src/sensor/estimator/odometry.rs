//! Motion of the ball from encoders and gyroscope.

use ballbot_base::constants::Constants;
use ballbot_base::error::{Error, Result};
use ballbot_base::lanes::{Lane, Rotation, Vec3};
use ballbot_base::params::Params;
use ballbot_base::wheels::Wheels;

/// The map between wheel rates and ball rate of a robot whose wheels and ball do not slip:
/// ψ̇ = k U (Rᵀ ω − Ω), with the rows u_i of U, the gear ratio k, the ball rate ω (inertial frame) and the body rate Ω (body
/// frame). Wheels at any zenith and azimuth.
#[derive(Clone, Debug)]
pub struct Odometry {
    /// Rows k u_i.
    pub(super) rows: Wheels<[f64; 3]>,
    /// Rows of U⁻¹ / k.
    inverse: [[f64; 3]; 3],
    /// m.
    pub(super) ball_radius: f64,
}

impl Odometry {
    /// The map of the robot of `params`.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] if the wheels do not drive the ball about every axis.
    pub fn new(params: &Params) -> Result<Self> {
        let driven = params.drive_matrix() * params.gear_ratio();
        let inverse = driven.try_inverse().ok_or_else(|| {
            Error::Inconsistent(format!(
                "wheel_azimuths = {:?}, wheel_zeniths = {:?}: the wheels do not drive the ball about every axis",
                params.wheel_azimuths,
                params.wheel_zeniths().0
            ))
        })?;
        let rows = |m: &nalgebra::Matrix3<f64>| [0, 1, 2].map(|i| [0, 1, 2].map(|j| m[(i, j)]));
        Ok(Self { rows: Wheels(rows(&driven)), inverse: rows(&inverse), ball_radius: params.ball_radius })
    }

    /// Adds the wheel rates per rate of the ball relative to the body, their inverse, and the radius of the ball.
    pub(super) fn add_to(&self, constants: Constants) -> Constants {
        constants
            .matrix("wheels_of_ball", &self.rows.0)
            .matrix("ball_of_wheels", &self.inverse)
            .number("ball_radius", self.ball_radius)
    }

    /// Angular velocity of the ball relative to the body, body frame, rad/s.
    #[inline(always)]
    pub fn relative_rate<L: Lane>(&self, wheel_rates: Wheels<L>) -> Vec3<L> {
        product(&self.inverse, wheel_rates.0).into()
    }

    /// Angular velocity of the ball, inertial frame, rad/s: R (U⁻¹ ψ̇ / k + Ω). Its z component is the spin.
    #[inline(always)]
    pub fn ball_rate<L: Lane>(&self, rotation: &Rotation<L>, body_rate: Vec3<L>, wheel_rates: Wheels<L>) -> Vec3<L> {
        rotation.apply(self.relative_rate(wheel_rates) + body_rate)
    }

    /// Velocity of the center of a ball that rolls with the angular velocity `ball_rate`, m/s: r_k (ω_y, −ω_x).
    #[inline(always)]
    pub fn velocity<L: Lane>(&self, ball_rate: Vec3<L>) -> [L; 2] {
        [ball_rate.y * self.ball_radius, ball_rate.x * -self.ball_radius]
    }

    /// Angular velocity of a ball that rolls with `velocity` (m/s) and has `spin` (rad/s), inertial frame, rad/s.
    #[inline(always)]
    pub fn rolling_rate<L: Lane>(&self, velocity: [L; 2], spin: L) -> Vec3<L> {
        let inverse = 1.0 / self.ball_radius;
        Vec3::new(velocity[1] * -inverse, velocity[0] * inverse, spin)
    }

    /// Wheel rates of a ball with the angular velocity `ball_rate` (inertial frame), rad/s.
    #[inline(always)]
    pub fn wheel_rates<L: Lane>(&self, rotation: &Rotation<L>, body_rate: Vec3<L>, ball_rate: Vec3<L>) -> Wheels<L> {
        let Vec3 { x, y, z } = rotation.apply_transposed(ball_rate) - body_rate;
        Wheels(product(&self.rows.0, [x, y, z]))
    }
}

#[inline(always)]
fn product<L: Lane>(rows: &[[f64; 3]; 3], [x, y, z]: [L; 3]) -> [L; 3] {
    let [[a, b, c], [d, e, f], [g, h, i]] = *rows;
    [
        z.mul_add_all(c, y.mul_add_all(b, x * a)),
        z.mul_add_all(f, y.mul_add_all(e, x * d)),
        z.mul_add_all(i, y.mul_add_all(h, x * g)),
    ]
}
