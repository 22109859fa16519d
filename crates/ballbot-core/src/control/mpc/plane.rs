//! One vertical plane of the predictive controller: the sampled model under the regulator.

use super::super::lean_planes::LeanPlanes;
use super::super::riccati;
use crate::error::Result;
use crate::lanes::Lane;
use crate::models::linear::STATES;
use nalgebra::{DMatrix, SMatrix};

/// Places of (y, θ, ẏ, θ̇) of a plane among the states of the linear model, and the sign of the lean among the tilts.
const PLACES: [[usize; 4]; 2] = [[0, 3, 5, 8], [1, 2, 6, 7]];
const SIGNS: [[f64; 4]; 2] = [[1.0; 4], [1.0, -1.0, 1.0, -1.0]];

/// x⁺ = A x + b u of one vertical plane with x = (y, θ, ẏ, θ̇), and u = −k x + v / √s. The position does not act on
/// the others: the first column of A is that of the identity.
#[derive(Clone, Debug)]
pub(super) struct Plane {
    /// A without its first column.
    a: [[f64; 3]; 4],
    b: [f64; 4],
    k: [f64; 4],
    /// 1/√s, rad/s²: s v² is what v adds to the cost of the regulator.
    pub(super) scale: f64,
}

impl Plane {
    /// The plane of x (`axis` 0) or y of the linear model, sampled, with the costs of its states and torques.
    pub(super) fn new(
        axis: usize,
        planes: &LeanPlanes,
        a: &SMatrix<f64, STATES, STATES>,
        b: &SMatrix<f64, STATES, 3>,
        [q, r]: [&DMatrix<f64>; 2],
    ) -> Result<Self> {
        let (places, signs) = (PLACES[axis], SIGNS[axis]);
        let mut one = [0.0; 2];
        one[axis] = 1.0;
        let torques = DMatrix::from_column_slice(3, 1, &planes.wheel_torques(one, 0.0));
        let entry = |i: usize, j: usize| signs[i] * signs[j] * a[(places[i], places[j])];
        let moved = DMatrix::from_column_slice(STATES, 3, b.as_slice()) * &torques;
        let driven = |i: usize| signs[i] * moved[places[i]];
        let plane_a = DMatrix::from_fn(4, 4, entry);
        let plane_b = DMatrix::from_fn(4, 1, |i, _| driven(i));
        let plane_q = DMatrix::from_fn(4, 4, |i, j| signs[i] * signs[j] * q[(places[i], places[j])]);
        let plane_r = torques.transpose() * r * &torques;
        let regulator = riccati::solve(&plane_a, &plane_b, &plane_q, &plane_r)?;
        let s = plane_r[0] + (plane_b.transpose() * &regulator.cost * &plane_b)[0];
        Ok(Self {
            a: std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j + 1))),
            b: std::array::from_fn(driven),
            k: std::array::from_fn(|i| regulator.gain[i]),
            scale: s.sqrt().recip(),
        })
    }

    /// u of a state and an input v.
    #[inline(always)]
    pub(super) fn input<L: Lane>(&self, [y, lean, velocity, rate]: [L; 4], v: L) -> L {
        let [ky, kl, kv, kr] = self.k;
        let moving = velocity.mul_add_all(-kv, y * -ky);
        let leaning = rate.mul_add_all(-kr, lean * -kl);
        v.mul_add_all(self.scale, moving + leaning)
    }

    /// The state a stage later.
    #[inline(always)]
    pub(super) fn next<L: Lane>(&self, [y, lean, velocity, rate]: [L; 4], u: L) -> [L; 4] {
        let mut next = [y, y.zero(), y.zero(), y.zero()];
        for i in 0..4 {
            let [l, v, r] = self.a[i];
            next[i] = u.mul_add_all(self.b[i], rate.mul_add_all(r, velocity.mul_add_all(v, lean.mul_add_all(l, next[i]))));
        }
        next
    }

    /// The derivative of a function with respect to the input of a stage, from that with respect to the state after it.
    #[inline(always)]
    pub(super) fn by_input<L: Lane>(&self, [y, lean, velocity, rate]: [L; 4]) -> L {
        let [by, bl, bv, br] = self.b;
        rate.mul_add_all(br, velocity.mul_add_all(bv, lean.mul_add_all(bl, y * by)))
    }

    /// The derivative with respect to the state of a stage, from that with respect to the state after it and to u.
    #[inline(always)]
    pub(super) fn by_state<L: Lane>(&self, after: [L; 4], by_input: L) -> [L; 4] {
        let mut by_state = [after[0], by_input.zero(), by_input.zero(), by_input.zero()];
        for j in 1..4 {
            let column = [self.a[0][j - 1], self.a[1][j - 1], self.a[2][j - 1], self.a[3][j - 1]];
            for (factor, after) in column.into_iter().zip(after) {
                by_state[j] = after.mul_add_all(factor, by_state[j]);
            }
        }
        for (by_state, k) in by_state.iter_mut().zip(self.k) {
            *by_state = by_input.mul_add_all(-k, *by_state);
        }
        by_state
    }
}
