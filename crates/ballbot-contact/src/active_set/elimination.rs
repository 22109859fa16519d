//! Elimination of floor and wheel joints from the equations of the wheel rows, and the solution of these equations.

use super::conditions::Conditions;
use super::modes::{FloorMode, JointModes, WheelModes};
use crate::delassus::Delassus;
use ballbot_base::lanes::{Lane, Value};
use ballbot_base::wheels::{WheelMatrix, Wheels};

/// Residuals of the wheel rows as affine functions of the wheel impulses.
#[derive(Clone, Copy)]
pub struct System<L> {
    pub normal_normal: WheelMatrix<L>,
    pub normal_drive: WheelMatrix<L>,
    pub drive_normal: WheelMatrix<L>,
    pub drive_drive: WheelMatrix<L>,
    /// Residuals of the normal rows without impulses.
    pub normals: Wheels<L>,
    /// Residuals of the drive rows without impulses.
    pub drives: Wheels<L>,
}

impl<L: Lane> System<L> {
    /// Impulses for given modes: closed and sticking rows have zero residual, open rows have zero impulse, and a
    /// slipping row has a slope times its load.
    #[inline(always)]
    pub fn solve(&self, modes: &WheelModes<L>) -> (Wheels<L>, Wheels<L>) {
        let WheelModes { closed, slips, slopes } = modes;
        // The branch skips only selections, so it changes no bits.
        if !L::any(slips[0] | slips[1] | slips[2]) {
            let Self { normal_normal, normal_drive, drive_normal, drive_drive, normals, drives } = self;
            return block_solution([normal_normal, normal_drive, drive_normal, drive_drive], [-*normals, -*drives]);
        }
        let zero = self.normals[0].zero();
        let one = zero.splat(1.0);
        let unit = Wheels([Wheels([one, zero, zero]), Wheels([zero, one, zero]), Wheels([zero, zero, one])]);
        let none = Wheels::all(Wheels::zero(zero));
        let (nn, nd) = (&self.normal_normal, &self.normal_drive);
        let (dn, dd) = (&self.drive_normal, &self.drive_drive);
        let held = |mask: L::Mask, residual: L| L::select(mask, -residual, zero);
        let a = rows_of::<L>(closed, nn, &unit);
        let b = rows_of::<L>(closed, nd, &none);
        let c = rows_of::<L>(slips, &unit.scaled(-*slopes), dn);
        let d = rows_of::<L>(slips, &unit, dd);
        let p = Wheels::from_fn(|i| held(closed[i], self.normals[i]));
        let q = Wheels::from_fn(|i| held(!slips[i], self.drives[i]));
        block_solution([&a, &b, &c, &d], [p, q])
    }

    /// Residuals of the normal and drive rows for given impulses.
    #[inline(always)]
    pub fn residuals(&self, normals: Wheels<L>, drives: Wheels<L>) -> (Wheels<L>, Wheels<L>) {
        (
            self.normals + self.normal_normal.times(normals) + self.normal_drive.times(drives),
            self.drives + self.drive_normal.times(normals) + self.drive_drive.times(drives),
        )
    }
}

/// The rows of `yes` where the mask is true, of `no` elsewhere.
#[inline(always)]
fn rows_of<L: Lane>(mask: &Wheels<L::Mask>, yes: &WheelMatrix<L>, no: &WheelMatrix<L>) -> WheelMatrix<L> {
    let row = Wheels::select;
    Wheels([row(mask[0], yes[0], no[0]), row(mask[1], yes[1], no[1]), row(mask[2], yes[2], no[2])])
}

/// Solution (x, y) of a x + b y = p and c x + d y = q.
#[inline(always)]
fn block_solution<L: Lane>([a, b, c, d]: [&WheelMatrix<L>; 4], [p, q]: [Wheels<L>; 2]) -> (Wheels<L>, Wheels<L>) {
    let inverse = a.inverse();
    let effect = inverse.times_matrix(b);
    let alone = inverse.times(p);
    let complement = d.minus(&c.times_matrix(&effect));
    let y = complement.inverse().times(q - c.times(alone));
    (alone - effect.times(y), y)
}

/// Couplings of one floor row with the wheel rows.
#[derive(Clone, Copy)]
struct Coupling<L> {
    normals: Wheels<L>,
    drives: Wheels<L>,
    residual: L,
}

impl<L: Lane> Coupling<L> {
    /// Impulse that brings the row to rest, over its mass.
    #[inline(always)]
    fn at_rest(&self, normals: Wheels<L>, drives: Wheels<L>) -> L {
        -(self.residual + self.normals.dot(normals) + self.drives.dot(drives))
    }

    #[inline(always)]
    fn times(&self, factor: L) -> Self {
        Self { normals: self.normals * factor, drives: self.drives * factor, residual: self.residual }
    }

    #[inline(always)]
    fn plus(&self, other: &Self, factor: L) -> Self {
        Self {
            normals: self.normals.plus(other.normals, factor),
            drives: self.drives.plus(other.drives, factor),
            residual: self.residual,
        }
    }

    /// `self` where the mask is true, no coupling elsewhere.
    #[inline(always)]
    fn only(&self, mask: L::Mask) -> Self {
        let none = Wheels::zero(self.residual);
        Self {
            normals: Wheels::select(mask, self.normals, none),
            drives: Wheels::select(mask, self.drives, none),
            residual: self.residual,
        }
    }
}

/// The ball on the floor.
pub struct Floor<L> {
    /// Rows along the normal, x and y.
    rows: [Coupling<L>; 3],
    /// Equations of the wheel rows with a sticking ball.
    sticking: System<L>,
    wheels: System<L>,
}

impl<L: Lane> Floor<L> {
    #[inline(always)]
    pub fn new<V: Value<L>>(conditions: &Conditions<L, V>, wheels: System<L>) -> Self {
        let Delassus { floor_normal, floor_drive, ball_mass, floor_compliance_inverse, .. } = conditions.delassus;
        let like = conditions.friction.floor;
        let (normal, tangent) = (ball_mass.at(like), floor_compliance_inverse.at(like));
        let row = |k: usize| Coupling {
            normals: floor_normal[k],
            drives: floor_drive[k],
            residual: conditions.residuals.floor[k],
        };
        let rows = [row(0), row(1), row(2)];
        let effects = [rows[0].times(normal), rows[1].times(tangent), rows[2].times(tangent)];
        Self { sticking: eliminated(&wheels, &effects, &rows), rows, wheels }
    }

    /// Equations of the wheel rows with the floor in a given mode.
    #[inline(always)]
    pub fn eliminated<V: Value<L>>(&self, conditions: &Conditions<L, V>, mode: &FloorMode<L>) -> System<L> {
        // Lanes that stick have the same bits in both branches: the effects are the couplings times the masses.
        if !L::any(mode.slips | !mode.closed) {
            return self.sticking;
        }
        let like = conditions.friction.floor;
        let [z, x, y] = self.rows;
        let [dx, dy] = mode.direction;
        let along = x.times(dx).plus(&y, dy);
        let slope = L::select(mode.slips, like, like.zero());
        let tangent = conditions.delassus.floor_compliance_inverse.at(like) * mode.share;
        let effects = [
            z.plus(&along, slope).times(conditions.delassus.ball_mass.at(like)).only(mode.closed),
            x.plus(&along, -dx).times(tangent).only(mode.closed),
            y.plus(&along, -dy).times(tangent).only(mode.closed),
        ];
        eliminated(&self.wheels, &effects, &self.rows)
    }

    /// Impulses that bring each floor row to rest for given wheel impulses.
    #[inline(always)]
    pub fn trial<V: Value<L>>(&self, delassus: &Delassus<L, V>, normals: Wheels<L>, drives: Wheels<L>) -> [L; 3] {
        let like = normals[0];
        let (normal, tangent) = (delassus.ball_mass.at(like), delassus.floor_compliance_inverse.at(like));
        let [z, x, y] = &self.rows;
        [
            z.at_rest(normals, drives) * normal,
            x.at_rest(normals, drives) * tangent,
            y.at_rest(normals, drives) * tangent,
        ]
    }
}

/// Equations of the wheel rows after elimination of floor rows with the given effects.
#[inline(always)]
fn eliminated<L: Lane>(wheels: &System<L>, [e, f, g]: &[Coupling<L>; 3], [z, x, y]: &[Coupling<L>; 3]) -> System<L> {
    let (effect_normals, effect_drives) = ([e.normals, f.normals, g.normals], [e.drives, f.drives, g.drives]);
    let (row_normals, row_drives) = ([z.normals, x.normals, y.normals], [z.drives, x.drives, y.drives]);
    let residuals = [z.residual, x.residual, y.residual];
    System {
        normal_normal: minus_outers(&wheels.normal_normal, &effect_normals, &row_normals),
        normal_drive: minus_outers(&wheels.normal_drive, &effect_normals, &row_drives),
        drive_normal: minus_outers(&wheels.drive_normal, &effect_drives, &row_normals),
        drive_drive: minus_outers(&wheels.drive_drive, &effect_drives, &row_drives),
        normals: minus_each(wheels.normals, &effect_normals, residuals),
        drives: minus_each(wheels.drives, &effect_drives, residuals),
    }
}

/// Difference matrix − Σ column · row.
#[inline(always)]
fn minus_outers<L: Lane>(matrix: &WheelMatrix<L>, columns: &[Wheels<L>; 3], rows: &[Wheels<L>; 3]) -> WheelMatrix<L> {
    let [a, b, c] = *columns;
    matrix.minus_outer(a, rows[0]).minus_outer(b, rows[1]).minus_outer(c, rows[2])
}

/// Difference vector − Σ column · factor.
#[inline(always)]
fn minus_each<L: Lane>(vector: Wheels<L>, columns: &[Wheels<L>; 3], factors: [L; 3]) -> Wheels<L> {
    vector.plus(columns[0], -factors[0]).plus(columns[1], -factors[1]).plus(columns[2], -factors[2])
}

/// The wheel joints: joint impulses as affine functions of the impulses of the wheel rows.
pub struct Joints<L> {
    /// Angular impulses at zero wheel impulses.
    alone: Wheels<L>,
    /// Decrease per normal impulse.
    normals: WheelMatrix<L>,
    /// Decrease per drive impulse.
    drives: WheelMatrix<L>,
}

impl<L: Lane> Joints<L> {
    #[inline(always)]
    pub fn new<const JOINTS: bool, V: Value<L>>(conditions: &Conditions<L, V>, modes: &JointModes<L>) -> Self {
        let like = conditions.friction.floor;
        let (zero, one) = (like.zero(), like.splat(1.0));
        if !JOINTS {
            let none = Wheels::zero(zero);
            return Self { alone: none, normals: Wheels::all(none), drives: Wheels::all(none) };
        }
        let Delassus { joint_normal, joint_drive, joint_joint, .. } = conditions.delassus;
        let JointModes { sticks, dry } = modes;
        // A moving joint: impulse + viscous · rate = dry. A sticking joint: rate = 0.
        let factor = |i: usize| L::select(sticks[i], one, conditions.joint_friction.viscous);
        let own = |i: usize| L::select(sticks[i], zero, one);
        let (f, o) = (Wheels::from_fn(factor), Wheels::from_fn(own));
        let mut matrix = joint_joint.scaled(f);
        matrix[0][0] += o[0];
        matrix[1][1] += o[1];
        matrix[2][2] += o[2];
        let rest = |i: usize| f[i].neg_mul_add(conditions.residuals.joints[i], dry[i] * o[i]);
        let inverse = matrix.inverse();
        Self {
            alone: inverse.times(Wheels::from_fn(rest)),
            normals: inverse.times_matrix(&joint_normal.scaled(f)),
            drives: inverse.times_matrix(&joint_drive.scaled(f)),
        }
    }

    #[inline(always)]
    pub fn eliminated<V>(&self, delassus: &Delassus<L, V>, system: &System<L>) -> System<L> {
        let n = delassus.joint_normal.transposed();
        let d = delassus.joint_drive.transposed();
        System {
            normal_normal: system.normal_normal.minus(&n.times_matrix(&self.normals)),
            normal_drive: system.normal_drive.minus(&n.times_matrix(&self.drives)),
            drive_normal: system.drive_normal.minus(&d.times_matrix(&self.normals)),
            drive_drive: system.drive_drive.minus(&d.times_matrix(&self.drives)),
            normals: system.normals + n.times(self.alone),
            drives: system.drives + d.times(self.alone),
        }
    }

    /// Angular impulses of the joints for given wheel impulses.
    #[inline(always)]
    pub fn impulses(&self, normals: Wheels<L>, drives: Wheels<L>) -> Wheels<L> {
        self.alone - self.normals.times(normals) - self.drives.times(drives)
    }
}
