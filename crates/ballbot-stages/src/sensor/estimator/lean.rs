//! Equilibrium lean of a robot that differs from its parameters.

use ballbot_base::constants::Constants;
use ballbot_base::lanes::{Heading, Lane, Rotation, Vec3};
use ballbot_base::params::Params;

/// A slow observer of the lean bias.
///
/// Angular momentum about the ball's floor contact does not contain the motor torques: with the lean λ of the line from
/// the ball's center to the center of mass, small, d v̇ + c λ̈ = K (λ − λ₀), where λ₀ ≠ 0 for a center of mass that
/// differs from the parameters, a slope or a steady horizontal force. λ₀ is the low-pass of λ − m',
/// m = (d v + c λ̇) / K. Its state is z = λ₀ + m / T, so that nothing is differentiated.
#[derive(Clone, Debug)]
pub struct LeanObserver {
    /// Unit vector from the ball's center to the center of mass, body frame.
    com: [f64; 3],
    /// d / K, s²/m.
    rolling: f64,
    /// c / K along the axes x and y of the body, s².
    leaning: [f64; 2],
    /// 1 / T, 1/s.
    per_time: f64,
    /// Fraction of the distance to its target that z covers in a step.
    share: f64,
}

impl LeanObserver {
    /// The observer of the robot of `params` with the time constant `time`, advanced every `dt`, s.
    pub fn new(params: &Params, time: f64, dt: f64) -> Self {
        let (height, radius) = (params.body_com().norm(), params.ball_radius);
        let moment = params.body_mass * height;
        let mass = params.ball_mass + params.body_mass + params.ball_inertia / (radius * radius);
        let weight = moment * params.gravity;
        let [about_x, about_y, _] = params.body_inertia;
        Self {
            com: params.com_direction().into(),
            rolling: (mass * radius + moment) / weight,
            leaning: [about_y, about_x].map(|inertia| (inertia + moment * (height + radius)) / weight),
            per_time: 1.0 / time,
            share: -(-dt / time).exp_m1(),
        }
    }

    /// Adds its numbers.
    pub(super) fn add_to(&self, constants: Constants) -> Constants {
        constants
            .vector("com", &self.com)
            .number("rolling", self.rolling)
            .vector("leaning", &self.leaning)
            .number("per_time", self.per_time)
            .number("lean_share", self.share)
    }

    /// The state of an observer whose bias is zero.
    #[inline(always)]
    pub fn start<L: Lane>(
        &self,
        rotation: &Rotation<L>,
        heading: &Heading<L>,
        velocity: [L; 2],
        rate: Vec3<L>,
    ) -> [L; 2] {
        let [x, y] = self.momentum(rotation, heading, velocity, rate);
        [x * self.per_time, y * self.per_time]
    }

    /// Advances the state by a step and returns the lean bias, heading frame, rad: positive towards +x and +y.
    #[inline(always)]
    pub fn advance<L: Lane>(
        &self,
        z: &mut [L; 2],
        rotation: &Rotation<L>,
        heading: &Heading<L>,
        velocity: [L; 2],
        rate: Vec3<L>,
    ) -> [L; 2] {
        let [mx, my] = self.momentum(rotation, heading, velocity, rate);
        let com = rotation.apply(Vec3::new(mx.splat(self.com[0]), mx.splat(self.com[1]), mx.splat(self.com[2])));
        let [lean_x, lean_y] = heading.of(com.x, com.y);
        let turning = rotation.rows[2].dot(rate);
        let (per_time, share) = (self.per_time, self.share);
        // The heading frame turns.
        let towards = [turning.mul_add(my, lean_x), turning.neg_mul_add(mx, lean_y)];
        z[0] = (towards[0] - mx.mul_add_all(-per_time, z[0])).mul_add_all(share, z[0]);
        z[1] = (towards[1] - my.mul_add_all(-per_time, z[1])).mul_add_all(share, z[1]);
        [mx.mul_add_all(-per_time, z[0]), my.mul_add_all(-per_time, z[1])]
    }

    /// m, heading frame, s.
    #[inline(always)]
    fn momentum<L: Lane>(
        &self,
        rotation: &Rotation<L>,
        heading: &Heading<L>,
        velocity: [L; 2],
        rate: Vec3<L>,
    ) -> [L; 2] {
        let [vx, vy] = heading.of(velocity[0], velocity[1]);
        let inertial = rotation.apply(rate);
        // λ̇ = Ω × e3, horizontal.
        let [lx, ly] = heading.of(inertial.y, -inertial.x);
        [lx.mul_add_all(self.leaning[0], vx * self.rolling), ly.mul_add_all(self.leaning[1], vy * self.rolling)]
    }
}
