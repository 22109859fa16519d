//! One vertical plane of the predictive controller: the sampled model with the regulator.

use crate::parts::lean_planes::{LeanPlanes, PLACES};
use crate::parts::riccati;
use ballbot_base::error::Result;
use ballbot_base::lanes::Lane;
use ballbot_base::params::Params;
use nalgebra::DMatrix;

/// x⁺ = A x + b u of one vertical plane with x = (y, θ, ẏ, θ̇), and u = −k x + v / √s. The position does not affect the
/// other states: the first column of A is a column of the identity.
#[derive(Clone, Debug)]
pub(super) struct Plane {
    /// A without its first column.
    a: [[f64; 3]; 4],
    b: [f64; 4],
    k: [f64; 4],
    /// 1/√s, rad/s²: v adds s v² to the cost of the regulator.
    pub(super) scale: f64,
}

impl Plane {
    /// The plane of x (`axis` 0) or y, sampled every `dt` seconds, with the costs of states and wheel torques.
    pub(super) fn new(
        axis: usize,
        params: &Params,
        planes: &LeanPlanes,
        dt: f64,
        [q, r]: [&DMatrix<f64>; 2],
    ) -> Result<Self> {
        let (a, b) = planes.sampled(axis, params, dt);
        let torques = DMatrix::from_column_slice(3, 1, planes.driven(axis).as_slice());
        let cost = |i: usize| q[(PLACES[axis][i], PLACES[axis][i])];
        let q = DMatrix::from_fn(4, 4, |i, j| if i == j { cost(i) } else { 0.0 });
        let r = torques.transpose() * r * &torques;
        let regulator = riccati::solve(&a, &b, &q, &r)?;
        let s = r[0] + (b.transpose() * &regulator.cost * &b)[0];
        Ok(Self {
            a: riccati::rows(&a, 1),
            b: std::array::from_fn(|i| b[i]),
            k: std::array::from_fn(|i| regulator.gain[i]),
            scale: s.sqrt().recip(),
        })
    }

    /// u for a state and an input v.
    #[inline(always)]
    pub(super) fn input<L: Lane>(&self, [y, lean, velocity, rate]: [L; 4], v: L) -> L {
        let [ky, kl, kv, kr] = self.k;
        let moving = velocity.mul_add_all(-kv, y * -ky);
        let leaning = rate.mul_add_all(-kr, lean * -kl);
        v.mul_add_all(self.scale, moving + leaning)
    }

    /// The state one stage later.
    #[inline(always)]
    pub(super) fn next<L: Lane>(&self, [y, lean, velocity, rate]: [L; 4], u: L) -> [L; 4] {
        let mut next = [y, y.zero(), y.zero(), y.zero()];
        for (([l, v, r], b), next) in self.a.iter().zip(self.b).zip(&mut next) {
            let free = rate.mul_add_all(*r, velocity.mul_add_all(*v, lean.mul_add_all(*l, *next)));
            *next = u.mul_add_all(b, free);
        }
        next
    }

    /// The derivative of a function with respect to the input of a stage, from the derivative with respect to the next
    /// state.
    #[inline(always)]
    pub(super) fn by_input<L: Lane>(&self, [y, lean, velocity, rate]: [L; 4]) -> L {
        let [by, bl, bv, br] = self.b;
        rate.mul_add_all(br, velocity.mul_add_all(bv, lean.mul_add_all(bl, y * by)))
    }

    /// The derivative with respect to the state of a stage, from the derivatives with respect to the next state and to
    /// u.
    #[inline(always)]
    pub(super) fn by_state<L: Lane>(&self, after: [L; 4], by_input: L) -> [L; 4] {
        let mut by_state = [after[0], by_input.zero(), by_input.zero(), by_input.zero()];
        for (row, after) in self.a.iter().zip(after) {
            for (factor, by_state) in row.iter().zip(&mut by_state[1..]) {
                *by_state = after.mul_add_all(*factor, *by_state);
            }
        }
        for (by_state, k) in by_state.iter_mut().zip(self.k) {
            *by_state = by_input.mul_add_all(-k, *by_state);
        }
        by_state
    }
}
