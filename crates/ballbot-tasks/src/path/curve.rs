//! Closed curves as sums of harmonics, over lanes.

use ballbot_base::lanes::{Lane, Memory, sin_cos_of_step};

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

    /// Curvature vector, 1/m.
    #[inline(always)]
    pub(super) fn curvature(&self) -> [L; 2] {
        let squared = self.length().squared();
        let [tx, ty] = self.tangent();
        let along = self.second[0].mul_add(tx, self.second[1] * ty);
        [(self.second[0] - along * tx) / squared, (self.second[1] - along * ty) / squared]
    }
}
