//! The covariance of the estimation error, in lanes.

use ballbot_base::lanes::{Lane, Memory, Vec3};
use ballbot_base::wheels::{WheelMatrix, Wheels};

/// Attitude (3), gyroscope bias (3), velocity (2), ball spin (1).
pub const STATES: usize = 9;
/// First index of the bias.
pub const BIAS: usize = 3;
/// First index of the velocity.
pub const VELOCITY: usize = 6;
/// Index of the spin.
pub const SPIN: usize = 8;
/// Numbers of the upper triangle.
pub const NUMBERS: usize = STATES * (STATES + 1) / 2;

/// Effect of a step on the estimation error.
pub struct Transition<L> {
    /// Effect of an error of the body rate on attitude (3) and velocity (2).
    pub rate: [Vec3<L>; 5],
    /// Change of the velocity due to a tilt error: specific force along the vertical times the time step, m/s.
    pub pull: L,
}

/// Variances that a step adds.
pub struct StepNoise<L> {
    /// Of the body rate, (rad/s)².
    pub rate: f64,
    /// Of the bias, (rad/s)².
    pub bias: [f64; 3],
    /// Of the velocity, (m/s)².
    pub velocity: L,
    /// Of the spin, (rad/s)².
    pub spin: f64,
}

/// A symmetric matrix with all its elements stored.
#[derive(Clone, Copy)]
pub struct Covariance<L> {
    pub(super) rows: [[L; STATES]; STATES],
}

impl<L: Lane> Covariance<L> {
    /// A diagonal matrix of variances.
    #[inline(always)]
    pub fn diagonal(variances: [L; STATES]) -> Self {
        let mut rows = [[variances[0].zero(); STATES]; STATES];
        for (i, variance) in variances.into_iter().enumerate() {
            rows[i][i] = variance;
        }
        Self { rows }
    }

    /// Reads [`NUMBERS`] numbers from `first` on.
    #[inline(always)]
    pub fn load(memory: &Memory<'_, L>, first: usize) -> Self {
        let mut out = Self { rows: [[memory.get(first); STATES]; STATES] };
        let mut at = first;
        for i in 0..STATES {
            for j in i..STATES {
                out.rows[i][j] = memory.get(at);
                out.rows[j][i] = out.rows[i][j];
                at += 1;
            }
        }
        out
    }

    /// Writes what [`Covariance::load`] reads.
    #[inline(always)]
    pub fn store(&self, memory: &mut Memory<'_, L>, first: usize) {
        let mut at = first;
        for (i, row) in self.rows.iter().enumerate() {
            for &number in &row[i..] {
                memory.set(at, number);
                at += 1;
            }
        }
    }

    /// P ← F P Fᵀ + Q.
    #[inline(always)]
    pub fn advance(&mut self, transition: &Transition<L>, noise: &StepNoise<L>) {
        let mut half = self.rows;
        for row in &mut half {
            // P is symmetric: its rows are its columns.
            *row = transition.apply(row);
        }
        for i in 0..STATES {
            let mut column = half[0];
            for j in 0..STATES {
                column[j] = half[j][i];
            }
            self.rows[i] = transition.apply(&column);
        }
        let driven = [0, 1, 2, VELOCITY, VELOCITY + 1];
        for (a, i) in driven.into_iter().enumerate() {
            for (b, j) in driven.into_iter().enumerate() {
                let product = transition.rate[a].dot(transition.rate[b]);
                self.rows[i][j] = product.mul_add_all(noise.rate, self.rows[i][j]);
            }
        }
        for i in 0..3 {
            self.rows[BIAS + i][BIAS + i] = self.rows[BIAS + i][BIAS + i] + noise.bias[i];
        }
        for i in 0..2 {
            self.rows[VELOCITY + i][VELOCITY + i] += noise.velocity;
        }
        self.rows[SPIN][SPIN] = self.rows[SPIN][SPIN] + noise.spin;
    }

    /// Product with the transposed row of a measurement: P hᵀ.
    #[inline(always)]
    pub fn times(&self, row: &[L; STATES]) -> [L; STATES] {
        let mut out = [row[0].zero(); STATES];
        for (out, own) in out.iter_mut().zip(&self.rows) {
            *out = dot(own, row);
        }
        out
    }

    /// P ← P − G S⁻¹ Gᵀ for the columns `g` of G = P Hᵀ + C.
    #[inline(always)]
    pub fn reduce(&mut self, g: &Wheels<[L; STATES]>, inverse: &WheelMatrix<L>) {
        for i in 0..STATES {
            let gain = inverse.times(Wheels([g[0][i], g[1][i], g[2][i]]));
            for (j, ((&a, &b), &c)) in g[0].iter().zip(&g[1]).zip(&g[2]).enumerate().skip(i) {
                let less = gain.dot(Wheels([a, b, c]));
                self.rows[i][j] -= less;
                self.rows[j][i] = self.rows[i][j];
            }
        }
    }
}

impl<L: Lane> Transition<L> {
    /// F x.
    #[inline(always)]
    pub fn apply(&self, x: &[L; STATES]) -> [L; STATES] {
        let bias = Vec3::new(x[BIAS], x[BIAS + 1], x[BIAS + 2]);
        let mut out = *x;
        for i in 0..3 {
            out[i] = x[i] + self.rate[i].dot(bias);
        }
        out[VELOCITY] = self.pull.mul_add(x[1], x[VELOCITY]) + self.rate[3].dot(bias);
        out[VELOCITY + 1] = self.pull.neg_mul_add(x[0], x[VELOCITY + 1]) + self.rate[4].dot(bias);
        out
    }
}

/// Sum of products.
#[inline(always)]
pub fn dot<L: Lane>(a: &[L; STATES], b: &[L; STATES]) -> L {
    let mut sum = a[0] * b[0];
    for i in 1..STATES {
        sum = a[i].mul_add(b[i], sum);
    }
    sum
}
