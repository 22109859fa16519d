//! Truncated Taylor series in time: a value and its first four derivatives.

use std::ops::{Add, Mul, Sub};

/// Number of terms.
const TERMS: usize = 5;

/// Coefficients c_k of Σ c_k (t − t₀)^k.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Jet([f64; TERMS]);

impl Jet {
    pub(super) fn constant(value: f64) -> Self {
        Self([value, 0.0, 0.0, 0.0, 0.0])
    }

    /// The time itself.
    pub(super) fn time(t: f64) -> Self {
        Self([t, 1.0, 0.0, 0.0, 0.0])
    }

    pub(super) fn value(&self) -> f64 {
        self.0[0]
    }

    /// The derivative of order `k`, up to 4.
    pub(super) fn derivative(&self, k: usize) -> f64 {
        const FACTORIALS: [f64; TERMS] = [1.0, 1.0, 2.0, 6.0, 24.0];
        self.0[k] * FACTORIALS[k]
    }

    /// Σ a_k u^k of this series u, from the highest coefficient down.
    pub(super) fn polynomial(&self, coefficients: &[f64]) -> Self {
        coefficients.iter().rev().fold(Self::default(), |sum, a| sum * *self + Self::constant(*a))
    }

    /// Sine and cosine.
    pub(super) fn sin_cos(&self) -> (Self, Self) {
        let (mut sin, mut cos) = (Self::constant(self.0[0].sin()), Self::constant(self.0[0].cos()));
        for k in 1..TERMS {
            // k s_k = Σ j a_j c_{k−j}, from s' = a' c.
            let sum = |other: &Self| (1..=k).map(|j| j as f64 * self.0[j] * other.0[k - j]).sum::<f64>() / k as f64;
            let (next_sin, next_cos) = (sum(&cos), -sum(&sin));
            sin.0[k] = next_sin;
            cos.0[k] = next_cos;
        }
        (sin, cos)
    }
}

impl Add for Jet {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self(std::array::from_fn(|k| self.0[k] + other.0[k]))
    }
}

impl Sub for Jet {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + other * -1.0
    }
}

impl Mul for Jet {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        Self(std::array::from_fn(|k| (0..=k).map(|j| self.0[j] * other.0[k - j]).sum()))
    }
}

impl Mul<f64> for Jet {
    type Output = Self;
    fn mul(self, factor: f64) -> Self {
        Self(self.0.map(|c| c * factor))
    }
}
