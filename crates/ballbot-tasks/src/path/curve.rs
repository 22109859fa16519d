//! Closed curves as sums of harmonics, over lanes.

use ballbot_base::lanes::{Lane, Memory, sin_cos_of_step};
use nalgebra::Vector2;

/// Harmonics of a curve.
pub(super) const HARMONICS: usize = 3;

/// Numbers of a curve: for x, then for y, the coefficients of cosine and sine of each harmonic, m.
pub(super) const NUMBERS: usize = 4 * HARMONICS;

/// Minimum length of a derivative, m: a curve that is a point does not move.
const LEAST_LENGTH: f64 = 1e-3;

/// A curve p(φ), closed after φ = 2π.
#[derive(Clone, Copy)]
pub(super) struct Curve<L> {
    coefficients: [[[L; 2]; HARMONICS]; 2],
}

/// A phase φ as its cosine and sine.
#[derive(Clone, Copy)]
pub(super) struct Phase<L> {
    pub cos: L,
    pub sin: L,
}

/// A point of a curve with its derivatives by the phase, m.
pub(super) struct Point<L> {
    pub position: [L; 2],
    pub first: [L; 2],
    pub second: [L; 2],
}

impl<L: Lane> Curve<L> {
    /// The curve stored in a memory from index `first` on.
    #[inline(always)]
    pub(super) fn load(memory: &Memory<'_, L>, first: usize) -> Self {
        let mut coefficients = [[[memory.splat(0.0); 2]; HARMONICS]; 2];
        for (axis, harmonics) in coefficients.iter_mut().enumerate() {
            for (k, pair) in harmonics.iter_mut().enumerate() {
                let place = first + 2 * (HARMONICS * axis + k);
                *pair = [memory.get(place), memory.get(place + 1)];
            }
        }
        Self { coefficients }
    }

    /// The point at a phase, from the curve's center.
    #[inline(always)]
    pub(super) fn at(&self, phase: Phase<L>) -> Point<L> {
        let zero = phase.cos.zero();
        let mut point = Point { position: [zero; 2], first: [zero; 2], second: [zero; 2] };
        let mut multiple = phase;
        for k in 0..HARMONICS {
            let order = (k + 1) as f64;
            for axis in 0..2 {
                let [cosine, sine] = self.coefficients[axis][k];
                let value = cosine.mul_add(multiple.cos, sine * multiple.sin);
                let turned = sine.mul_add(multiple.cos, -(cosine * multiple.sin));
                point.position[axis] += value;
                point.first[axis] = turned.mul_add_all(order, point.first[axis]);
                point.second[axis] = value.mul_add_all(-order * order, point.second[axis]);
            }
            multiple = multiple.plus(phase);
        }
        point
    }

    /// The phase after a distance along the curve, m: a midpoint step.
    #[inline(always)]
    pub(super) fn after(&self, phase: Phase<L>, way: L) -> Phase<L> {
        let half = phase.turned(way * 0.5 / self.at(phase).length());
        phase.turned(way / self.at(half).length())
    }
}

impl Curve<f64> {
    /// The first four derivatives by time of a point that moves along the curve with a speed (m/s) and a constant
    /// tangential acceleration (m/s²).
    pub(super) fn motion(&self, phase: Phase<f64>, speed: f64, acceleration: f64) -> [Vector2<f64>; 4] {
        let Point { first, second, .. } = self.at(phase);
        let [third, fourth] = self.higher(phase);
        let (f1, f2): (Vector2<_>, Vector2<_>) = (first.into(), second.into());
        // The length of the first derivative, and its derivatives by the phase.
        let length = f1.norm().max(LEAST_LENGTH);
        let l1 = f1.dot(&f2) / length;
        let l2 = (f2.norm_squared() + f1.dot(&third) - l1 * l1) / length;
        let l3 = (3.0 * f2.dot(&third) + f1.dot(&fourth) - 3.0 * l1 * l2) / length;
        // Derivatives of the phase by the distance along the curve.
        let a1 = length.recip();
        let a2 = -l1 * a1.powi(3);
        let a3 = (3.0 * l1 * l1 - length * l2) * a1.powi(5);
        let a4 = (10.0 * length * l1 * l2 - length * length * l3 - 15.0 * l1.powi(3)) * a1.powi(7);
        // Derivatives of the position by the distance.
        let p1 = f1 * a1;
        let p2 = f2 * (a1 * a1) + f1 * a2;
        let p3 = third * a1.powi(3) + f2 * (3.0 * a1 * a2) + f1 * a3;
        let p4 = fourth * a1.powi(4) + third * (6.0 * a1 * a1 * a2) + f2 * (3.0 * a2 * a2 + 4.0 * a1 * a3) + f1 * a4;
        let (v, a) = (speed, acceleration);
        [
            p1 * v,
            p2 * (v * v) + p1 * a,
            p3 * v.powi(3) + p2 * (3.0 * v * a),
            p4 * v.powi(4) + p3 * (6.0 * v * v * a) + p2 * (3.0 * a * a),
        ]
    }

    /// Third and fourth derivative by the phase, m.
    fn higher(&self, phase: Phase<f64>) -> [Vector2<f64>; 2] {
        let (mut third, mut fourth) = (Vector2::zeros(), Vector2::zeros());
        let mut multiple = phase;
        for k in 0..HARMONICS {
            let order = (k + 1) as f64;
            for axis in 0..2 {
                let [cosine, sine] = self.coefficients[axis][k];
                third[axis] -= order.powi(3) * (sine * multiple.cos - cosine * multiple.sin);
                fourth[axis] += order.powi(4) * (cosine * multiple.cos + sine * multiple.sin);
            }
            multiple = multiple.plus(phase);
        }
        [third, fourth]
    }
}

impl<L: Lane> Phase<L> {
    /// Sum of both.
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        Self {
            cos: self.cos.mul_add(other.cos, -(self.sin * other.sin)),
            sin: self.sin.mul_add(other.cos, self.cos * other.sin),
        }
    }

    /// The phase increased by an angle, up to 1 rad.
    #[inline(always)]
    fn turned(self, angle: L) -> Self {
        let (sin, cos) = sin_cos_of_step(angle);
        let Self { cos, sin } = self.plus(Self { cos, sin });
        // Keeps the length 1 over repeated rotations.
        let correction = (cos.squared() + sin.squared()).mul_add_all(-0.5, cos.splat(1.5));
        Self { cos: cos * correction, sin: sin * correction }
    }
}

impl<L: Lane> Point<L> {
    /// Length of the first derivative, m.
    #[inline(always)]
    pub(super) fn length(&self) -> L {
        let [x, y] = self.first;
        x.mul_add(x, y.squared()).sqrt().max(x.splat(LEAST_LENGTH))
    }

    /// Unit tangent.
    #[inline(always)]
    pub(super) fn tangent(&self) -> [L; 2] {
        let length = self.length();
        [self.first[0] / length, self.first[1] / length]
    }
}
