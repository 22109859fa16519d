//! Laws of the rows: which impulse answers a trial impulse, and its derivative.

use super::rows::{DRIVE, FLOOR, JOINT, NORMAL, ROLLER, ROWS, TORQUE, load, partner};
use crate::lanes::Lane;

/// Bounds of friction in a step.
#[derive(Clone, Copy)]
pub struct Bounds<L> {
    /// Friction coefficient of the floor.
    pub floor: L,
    /// Friction coefficients of the wheels along their drive directions.
    pub wheels: [L; 3],
    /// The same along their free directions.
    pub rollers: [L; 3],
    /// Coefficient of rolling friction over the ball's radius.
    pub rolling: L,
    /// Coefficient of spinning friction over the ball's radius.
    pub spinning: L,
    /// Largest impulse of dry friction of a joint, at the rim of its wheel, N·s.
    pub dry: L,
    /// Impulse of viscous friction of a joint per speed of the rim, kg.
    pub viscous: L,
}

/// The impulse of each row as a function of its trial impulse z, linearized at a present one:
/// own · z + cross · z of its partner + share · impulse of its load + constant.
pub struct Laws<L> {
    pub own: [L; ROWS],
    pub cross: [L; ROWS],
    pub share: [L; ROWS],
    pub constant: [L; ROWS],
}

impl<L: Lane> Laws<L> {
    /// Laws of `rows` at the trial impulses `z`; `masses` of the rows, kg. A disc's are those of its first row.
    #[inline(always)]
    pub fn at(bounds: &Bounds<L>, z: &[L; ROWS], masses: &[L; ROWS], rows: &[usize]) -> Self {
        const X: usize = FLOOR + 1;
        const SPIN: usize = TORQUE + 2;
        let zero = bounds.floor.zero();
        let mut laws = Self { own: [zero; ROWS], cross: [zero; ROWS], share: [zero; ROWS], constant: [zero; ROWS] };
        for &row in rows {
            match row {
                FLOOR | NORMAL..DRIVE => laws.own[row] = L::select(zero.lt(z[row]), zero.splat(1.0), zero),
                X => laws.disc(row, bounds.floor, z),
                TORQUE => laws.disc(row, bounds.rolling, z),
                SPIN => laws.interval(row, bounds.spinning, z),
                ROLLER..JOINT => laws.interval(row, bounds.rollers[row - ROLLER], z),
                DRIVE..ROWS => laws.interval(row, bounds.wheels[row - DRIVE], z),
                JOINT..FLOOR => laws.joint(row, bounds, z, masses),
                _ => (),
            }
        }
        laws
    }

    /// Friction of a row and the next one within a disc of `coefficient` times the load. The direction of friction that
    /// slides is linearized.
    #[inline(always)]
    fn disc(&mut self, row: usize, coefficient: L, z: &[L; ROWS]) {
        let (x, y) = (z[row], z[row + 1]);
        let (zero, one) = (x.zero(), x.splat(1.0));
        let limit = coefficient * loaded(row, z, zero);
        let squared = x.mul_add(x, y.squared());
        let sticks = zero.lt(limit) & squared.le(limit.squared());
        let inverse = one / squared.sqrt().max(x.splat(f64::MIN_POSITIVE));
        let (ex, ey, across) = (x * inverse, y * inverse, limit * inverse);
        self.own[row] = L::select(sticks, one, across * ey * ey);
        self.own[row + 1] = L::select(sticks, one, across * ex * ex);
        self.cross[row] = L::select(sticks, zero, -(across * ex * ey));
        self.cross[row + 1] = self.cross[row];
        self.share[row] = L::select(sticks, zero, coefficient * ex);
        self.share[row + 1] = L::select(sticks, zero, coefficient * ey);
    }

    /// Friction of a row of at most `coefficient` times the load.
    #[inline(always)]
    fn interval(&mut self, row: usize, coefficient: L, z: &[L; ROWS]) {
        let zero = coefficient.zero();
        let limit = coefficient * loaded(row, z, zero);
        let sticks = zero.lt(limit) & z[row].abs().le(limit);
        self.own[row] = L::select(sticks, zero.splat(1.0), zero);
        self.share[row] = L::select(sticks, zero, L::select(z[row].lt(zero), -coefficient, coefficient));
    }

    /// Dry and viscous friction of a joint.
    #[inline(always)]
    fn joint(&mut self, row: usize, bounds: &Bounds<L>, z: &[L; ROWS], masses: &[L; ROWS]) {
        let (zero, one) = (bounds.dry.zero(), bounds.dry.splat(1.0));
        let sticks = zero.lt(bounds.dry) & z[row].abs().le(bounds.dry);
        // impulse + viscous · speed = ± dry, with the speed (impulse − z) / mass.
        let stiffness = bounds.viscous / masses[row];
        let moving = stiffness / (stiffness + one);
        let dry = L::select(z[row].lt(zero), -bounds.dry, bounds.dry);
        self.own[row] = L::select(sticks, one, moving);
        self.constant[row] = L::select(sticks, zero, dry * (one - moving));
    }

    /// The impulse of a row at the trial impulses of these laws.
    #[inline(always)]
    pub fn impulse(&self, row: usize, z: &[L; ROWS]) -> L {
        let mut impulse = self.own[row].mul_add(z[row], self.constant[row]);
        if let Some(other) = partner(row) {
            impulse = self.cross[row].mul_add(z[other], impulse);
        }
        if let Some(normal) = load(row) {
            impulse = self.share[row].mul_add(z[normal].max(impulse.zero()), impulse);
        }
        impulse
    }
}

/// Load of a row at the trial impulses; zero for a row without load.
#[inline(always)]
fn loaded<L: Lane>(row: usize, z: &[L; ROWS], zero: L) -> L {
    match load(row) {
        Some(normal) => z[normal].max(zero),
        None => zero,
    }
}
