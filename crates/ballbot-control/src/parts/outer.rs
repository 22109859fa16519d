//! Limits of the speed and lean commands from deviations of position and velocity.

use super::riccati::rows;
use crate::Constants;
use ballbot_base::lanes::Lane;
use ballbot_models::linear::{INPUTS, STATES};
use nalgebra::DMatrix;

/// The outer loop of a gain: position deviations command a speed, position and velocity deviations command a lean. Both
/// are limited as vectors.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Outer {
    /// Speed with the same torques as a position deviation.
    speed: [[f64; 2]; 2],
    /// Lean about x and y with the same torques as deviations of position and velocity (x, y, v_x, v_y).
    lean: [[f64; 4]; 2],
    max_lean: f64,
    max_speed: f64,
}

/// Indices of position and velocity among the states.
const MOVING: [usize; 4] = [0, 1, 5, 6];

impl Outer {
    pub(crate) fn new(gain: &DMatrix<f64>, [max_lean, max_speed]: [f64; 2]) -> Self {
        let columns = |first: usize| gain.columns(first, 2).into_owned();
        let moving = DMatrix::from_fn(INPUTS, 4, |i, j| gain[(i, MOVING[j])]);
        let (lean, speed) = (equal_torques(columns(2), &moving), equal_torques(columns(5), &columns(0)));
        Self { speed: rows(&speed, 0), lean: rows(&lean, 0), max_lean, max_speed }
    }

    /// Adds the speed per position (2 × 2), the lean per position and velocity (2 × 4) and their largest lengths.
    pub(crate) fn add_to(&self, constants: Constants) -> Constants {
        let constants = constants.matrix("speed_per_position", &self.speed).matrix("lean_per_motion", &self.lean);
        constants.number("max_lean", self.max_lean).number("max_speed", self.max_speed)
    }

    /// Limits the deviations of position and velocity. Returns their remaining fractions, 1 without limiting.
    #[inline(always)]
    pub(crate) fn clip<L: Lane>(&self, x: &mut [L; STATES]) -> [L; 2] {
        let [[a, b], [c, d]] = self.speed;
        let speeds = [x[1].mul_add_all(b, x[0] * a), x[1].mul_add_all(d, x[0] * c)];
        let slower = share_within(speeds, self.max_speed);
        x[0] = x[0] * slower;
        x[1] = x[1] * slower;
        let less = share_within([lean(&self.lean[0], x), lean(&self.lean[1], x)], self.max_lean);
        for place in MOVING {
            x[place] = x[place] * less;
        }
        [slower * less, less]
    }
}

/// The lean command about an axis from deviations of position and velocity.
#[inline(always)]
fn lean<L: Lane>(row: &[f64; 4], x: &[L; STATES]) -> L {
    let [a, b, c, d] = MOVING;
    x[d].mul_add_all(row[3], x[c].mul_add_all(row[2], x[b].mul_add_all(row[1], x[a] * row[0])))
}

/// Deviations with the same torques as others: under `gain` the torques of `other`, in the least-squares sense.
pub(crate) fn equal_torques(gain: DMatrix<f64>, other: &DMatrix<f64>) -> DMatrix<f64> {
    let size = (gain.ncols(), other.ncols());
    // A zero gain commands nothing.
    gain.svd(true, true).solve(other, f64::MIN_POSITIVE).unwrap_or_else(|_| DMatrix::zeros(size.0, size.1))
}

/// The fraction of a vector that has length `longest`, at most 1.
#[inline(always)]
pub(crate) fn share_within<L: Lane>([x, y]: [L; 2], longest: f64) -> L {
    let (bound, length) = (x.splat(longest), x.mul_add(x, y.squared()).sqrt());
    L::select(bound.lt(length), bound / length, x.splat(1.0))
}
