//! A PD of the position that commands a lean, above second-order lean dynamics.

use super::lean_planes::{LeanPlane, LeanPlanes, Leaning};
use super::outer::share_within;
use ballbot_base::lanes::Lane;

/// Second-order dynamics ẍ + δ ẋ + σ x = 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SecondOrder {
    /// δ = 2 ζ ω, 1/s.
    pub(crate) damping: f64,
    /// σ = ω², 1/s².
    pub(crate) stiffness: f64,
}

impl SecondOrder {
    /// With natural frequency `frequency` (rad/s) and damping ratio `ratio`.
    pub(crate) fn new(frequency: f64, ratio: f64) -> Self {
        Self { damping: 2.0 * ratio * frequency, stiffness: frequency * frequency }
    }

    /// (σ, δ).
    pub(crate) fn gains(&self) -> [f64; 2] {
        [self.stiffness, self.damping]
    }

    /// ẍ = −σ x − δ ẋ.
    #[inline(always)]
    pub(crate) fn returning<L: Lane>(&self, x: L, rate: L) -> L {
        x.mul_add_all(-self.stiffness, rate * -self.damping)
    }
}

/// A PD of the flat output z = y + ℓ θ in each plane, which obeys z̈ = g θ: θ_ref = −(k_z z + k_v ż). Its speed and
/// lean commands are limited as vectors.
///
/// With lean dynamics θ̈ = σ (θ_ref − θ) − δ θ̇ it has the two required poles (derived in `docs/laws.md`).
#[derive(Clone, Copy, Debug)]
pub(crate) struct PositionLoop {
    /// k_z and k_v of each plane.
    gains: [[f64; 2]; 2],
    /// ℓ of each plane.
    levers: [f64; 2],
    max_lean: f64,
    max_speed: f64,
}

impl PositionLoop {
    /// The loop with two poles of natural frequency `bandwidth` (over λ) and damping ratio `damping`, above leans with
    /// the dynamics `lean`.
    pub(crate) fn new(
        planes: &LeanPlanes,
        lean: SecondOrder,
        [bandwidth, damping]: [f64; 2],
        [max_lean, max_speed]: [f64; 2],
    ) -> Self {
        let frequency = bandwidth * planes.toppling_rate();
        let SecondOrder { damping: c1, stiffness: c0 } = SecondOrder::new(frequency, damping);
        let planes = &planes.planes;
        // The other two poles: s⁴ + δ s³ + σ s² + ... = (s² + c₁ s + c₀)(s² + p₁ s + p₀).
        let p1 = lean.damping - c1;
        let p0 = lean.stiffness - c1 * p1 - c0;
        let gains = |plane: &LeanPlane| {
            let per_lean = plane.acceleration * lean.stiffness;
            [c0 * p0 / per_lean, (c1 * p0 + c0 * p1) / per_lean]
        };
        Self { gains: planes.each_ref().map(gains), levers: planes.map(|plane| plane.lever), max_lean, max_speed }
    }

    /// θ_ref of each plane minus the lean of the setpoint's motion, rad.
    #[inline(always)]
    pub(crate) fn lean<L: Lane>(&self, deviation: &Leaning<L>) -> [L; 2] {
        let Leaning { position, velocity, lean, rate } = deviation;
        let [[ax, bx], [ay, by]] = self.gains;
        let speeds = [
            lean[0].mul_add_all(self.levers[0], position[0]) * (ax / bx),
            lean[1].mul_add_all(self.levers[1], position[1]) * (ay / by),
        ];
        let slower = share_within(speeds, self.max_speed);
        let moving =
            [rate[0].mul_add_all(self.levers[0], velocity[0]), rate[1].mul_add_all(self.levers[1], velocity[1])];
        let commanded = [speeds[0].mul_add(slower, moving[0]) * -bx, speeds[1].mul_add(slower, moving[1]) * -by];
        let less = share_within(commanded, self.max_lean);
        [commanded[0] * less, commanded[1] * less]
    }

    /// k of θ_ref = −k (y, θ, ẏ, θ̇) without limiting.
    pub(crate) fn feedback(&self, axis: usize) -> [f64; 4] {
        let ([position, velocity], lever) = (self.gains[axis], self.levers[axis]);
        [position, position * lever, velocity, velocity * lever]
    }
}
