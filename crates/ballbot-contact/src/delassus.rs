//! The Delassus matrix of the rows.

use super::constants::{Constants, at3};
use super::rows::Rows;
use super::types::PerRow;
use ballbot_base::lanes::{Group, Lane, Value, Vec3};
use ballbot_base::wheels::{WHEELS, WheelMatrix, Wheels};

/// Delassus matrix: change of the velocity of each row per impulse of each row, in blocks of three rows.
///
/// The rows of the floor act only on the ball, whose inertia is isotropic, so they do not couple with each other.
/// Joints do not couple with the floor.
pub struct Delassus<L, V> {
    pub normal_normal: WheelMatrix<L>,
    pub normal_drive: WheelMatrix<L>,
    pub drive_drive: WheelMatrix<L>,
    /// Couplings by floor row (normal, x, y) and wheel.
    pub floor_normal: [Wheels<L>; 3],
    pub floor_drive: [Wheels<L>; 3],
    pub joint_normal: WheelMatrix<L>,
    pub joint_drive: WheelMatrix<L>,
    pub joint_joint: WheelMatrix<L>,
    pub normal_inverse: Wheels<L>,
    pub drive_inverse: Wheels<L>,
    pub ball_mass: V,
    ball_mass_inverse: V,
    floor_compliance: V,
    pub floor_compliance_inverse: V,
}

impl<L: Lane, V: Value<L>> Delassus<L, V> {
    #[inline(always)]
    pub fn new<const JOINTS: bool, const RIPPLE: bool>(c: &Constants<V>, rows: &Rows<L>) -> Self {
        let zero = rows.floor_gap.zero();
        let none = Wheels::zero(zero);
        let one = zero.splat(1.0);
        let linear = c.relative_mass_inverse.at(zero);
        let ball_surface = c.ball_surface_compliance.at(zero);
        let inertia_inverse = at3(c.body_inertia_inverse, zero);

        let pairs = Couplings {
            rows,
            normal: Wheels([
                rows.normal_arms[0].scaled_by(inertia_inverse),
                rows.normal_arms[1].scaled_by(inertia_inverse),
                rows.normal_arms[2].scaled_by(inertia_inverse),
            ]),
            drive: Wheels([
                rows.drive_arms[0].scaled_by(inertia_inverse),
                rows.drive_arms[1].scaled_by(inertia_inverse),
                rows.drive_arms[2].scaled_by(inertia_inverse),
            ]),
            linear,
            ball_surface,
            own_drive: c.drive_compliance.at(zero),
            wheel_surface: c.wheel_surface_compliance.at(zero),
            wheel_rim_ratio: c.wheel_rim_ratio.at(zero),
            wheel_inertia_inverse: c.wheel_inertia_inverse.at(zero),
        };
        // Written out, because the compiler keeps nested loops over pairs as loops over arrays in memory.
        let (n01, n02, n12) = (pairs.normals(0, 1), pairs.normals(0, 2), pairs.normals(1, 2));
        let nn = Wheels([
            Wheels([pairs.own_normal::<RIPPLE>(0), n01, n02]),
            Wheels([n01, pairs.own_normal::<RIPPLE>(1), n12]),
            Wheels([n02, n12, pairs.own_normal::<RIPPLE>(2)]),
        ]);
        let nd = Wheels([
            Wheels([pairs.own_mixed::<RIPPLE>(0), pairs.mixed(0, 1), pairs.mixed(0, 2)]),
            Wheels([pairs.mixed(1, 0), pairs.own_mixed::<RIPPLE>(1), pairs.mixed(1, 2)]),
            Wheels([pairs.mixed(2, 0), pairs.mixed(2, 1), pairs.own_mixed::<RIPPLE>(2)]),
        ]);
        let (d01, d02, d12) = (pairs.drives(0, 1), pairs.drives(0, 2), pairs.drives(1, 2));
        let dd = Wheels([
            Wheels([pairs.own_drive(0), d01, d02]),
            Wheels([d01, pairs.own_drive(1), d12]),
            Wheels([d02, d12, pairs.own_drive(2)]),
        ]);

        let (mut zn, mut zd) = ([none; 3], [none; 3]);
        let ball = -c.ball_mass_inverse.at(zero);
        for i in 0..WHEELS {
            let (n, d, u) = (rows.normals[i], rows.drives[i], rows.turns[i]);
            zn[0][i] = n.z * ball;
            zn[1][i] = n.x * ball;
            zn[2][i] = n.y * ball;
            zd[0][i] = d.z * ball;
            zd[1][i] = u.y.mul_add(ball_surface, d.x * ball);
            zd[2][i] = u.x.mul_add(-ball_surface, d.y * ball);
        }

        let (mut jn, mut jd, mut jj) = (Wheels::all(none), Wheels::all(none), Wheels::all(none));
        if JOINTS {
            for i in 0..WHEELS {
                let u = c.u(i, zero).scaled_by(inertia_inverse);
                for j in 0..WHEELS {
                    jn[i][j] = u.dot(rows.normal_arms[j]);
                    jd[i][j] = u.dot(rows.drive_arms[j]);
                    jj[i][j] = u.dot(c.u(j, zero));
                }
                jd[i][i] = rows.spin_shares[i].mul_add(c.wheel_rim_ratio.at(zero), jd[i][i]);
                jj[i][i] += c.wheel_inertia_inverse.at(zero);
                if RIPPLE {
                    let with_rim = rows.ripple.slopes[i].mul_add(c.wheel_inertia_inverse.at(zero), jn[i][i]);
                    jn[i][i] = rows.ripple.select(with_rim, jn[i][i]);
                }
            }
        }

        Self {
            normal_inverse: Wheels([one / nn[0][0], one / nn[1][1], one / nn[2][2]]),
            drive_inverse: Wheels([one / dd[0][0], one / dd[1][1], one / dd[2][2]]),
            normal_normal: nn,
            normal_drive: nd,
            drive_drive: dd,
            floor_normal: zn,
            floor_drive: zd,
            joint_normal: jn,
            joint_drive: jd,
            joint_joint: jj,
            ball_mass: c.ball_mass,
            ball_mass_inverse: c.ball_mass_inverse,
            floor_compliance: c.floor_compliance,
            floor_compliance_inverse: c.floor_compliance_inverse,
        }
    }

    /// Adds the effect of `impulses` to the residuals.
    #[inline(always)]
    pub fn add_effect<const JOINTS: bool>(&self, impulses: &PerRow<L>, residuals: &mut PerRow<L>) {
        for k in 0..3 {
            self.add_floor(k, impulses.floor[k], residuals);
        }
        for k in 0..3 {
            self.add_normal::<JOINTS>(k, impulses.normals[k], residuals);
        }
        for k in 0..3 {
            self.add_drive::<JOINTS>(k, impulses.drives[k], residuals);
        }
        if JOINTS {
            for k in 0..3 {
                self.add_joint(k, impulses.joints[k], residuals);
            }
        }
    }

    #[inline(always)]
    pub fn add_floor(&self, k: usize, impulse: L, r: &mut PerRow<L>) {
        let compliance = if k == 0 { self.ball_mass_inverse } else { self.floor_compliance };
        r.floor[k] = impulse.mul_add(compliance.at(impulse), r.floor[k]);
        for j in 0..3 {
            r.normals[j] = self.floor_normal[k][j].mul_add(impulse, r.normals[j]);
            r.drives[j] = self.floor_drive[k][j].mul_add(impulse, r.drives[j]);
        }
    }

    #[inline(always)]
    pub fn add_normal<const JOINTS: bool>(&self, k: usize, impulse: L, r: &mut PerRow<L>) {
        for j in 0..3 {
            r.normals[j] = self.normal_normal[k][j].mul_add(impulse, r.normals[j]);
            r.drives[j] = self.normal_drive[k][j].mul_add(impulse, r.drives[j]);
            r.floor[j] = self.floor_normal[j][k].mul_add(impulse, r.floor[j]);
            if JOINTS {
                r.joints[j] = self.joint_normal[j][k].mul_add(impulse, r.joints[j]);
            }
        }
    }

    #[inline(always)]
    pub fn add_drive<const JOINTS: bool>(&self, k: usize, impulse: L, r: &mut PerRow<L>) {
        for j in 0..3 {
            r.drives[j] = self.drive_drive[k][j].mul_add(impulse, r.drives[j]);
            r.normals[j] = self.normal_drive[j][k].mul_add(impulse, r.normals[j]);
            r.floor[j] = self.floor_drive[j][k].mul_add(impulse, r.floor[j]);
            if JOINTS {
                r.joints[j] = self.joint_drive[j][k].mul_add(impulse, r.joints[j]);
            }
        }
    }

    #[inline(always)]
    pub fn add_joint(&self, k: usize, impulse: L, r: &mut PerRow<L>) {
        for j in 0..3 {
            r.joints[j] = self.joint_joint[k][j].mul_add(impulse, r.joints[j]);
            r.normals[j] = self.joint_normal[k][j].mul_add(impulse, r.normals[j]);
            r.drives[j] = self.joint_drive[k][j].mul_add(impulse, r.drives[j]);
        }
    }
}

impl Delassus<f64, f64> {
    /// The matrix by rows, in the order of [`PerRow`].
    #[inline(always)]
    pub fn rows(&self) -> PerRow<[f64; PerRow::<f64>::LEN]> {
        let (normal_drive, floor_normal, floor_drive) = (&self.normal_drive, &self.floor_normal, &self.floor_drive);
        let (joint_normal, joint_drive) = (self.joint_normal.transposed(), self.joint_drive.transposed());
        let drive_normal = normal_drive.transposed();
        let of_floor = |k: usize| {
            let mut own = [0.0; 3];
            own[k] = if k == 0 { self.ball_mass_inverse } else { self.floor_compliance };
            joined([own, floor_normal[k].0, floor_drive[k].0, [0.0; 3]])
        };
        let column = |of_floor: &[Wheels<f64>; 3], i: usize| [of_floor[0][i], of_floor[1][i], of_floor[2][i]];
        PerRow {
            floor: [of_floor(0), of_floor(1), of_floor(2)],
            normals: Wheels::from_fn(|i| {
                joined([column(floor_normal, i), self.normal_normal[i].0, normal_drive[i].0, joint_normal[i].0])
            }),
            drives: Wheels::from_fn(|i| {
                joined([column(floor_drive, i), drive_normal[i].0, self.drive_drive[i].0, joint_drive[i].0])
            }),
            joints: Wheels::from_fn(|i| {
                joined([[0.0; 3], self.joint_normal[i].0, self.joint_drive[i].0, self.joint_joint[i].0])
            }),
        }
    }
}

#[inline(always)]
fn joined(parts: [[f64; 3]; 4]) -> [f64; PerRow::<f64>::LEN] {
    std::array::from_fn(|i| parts[i / 3][i % 3])
}

impl<L, V> Delassus<L, V> {
    /// The matrix with `f` applied to each number, and `constant` to each constant.
    #[inline(always)]
    pub fn map<U>(&self, mut f: impl FnMut(&L) -> U, constant: impl Fn(&V) -> U) -> Delassus<U, U> {
        let f = &mut f;
        Delassus {
            normal_normal: Group::map(&self.normal_normal, f),
            normal_drive: Group::map(&self.normal_drive, f),
            drive_drive: Group::map(&self.drive_drive, f),
            floor_normal: Group::map(&self.floor_normal, f),
            floor_drive: Group::map(&self.floor_drive, f),
            joint_normal: Group::map(&self.joint_normal, f),
            joint_drive: Group::map(&self.joint_drive, f),
            joint_joint: Group::map(&self.joint_joint, f),
            normal_inverse: Group::map(&self.normal_inverse, f),
            drive_inverse: Group::map(&self.drive_inverse, f),
            ball_mass: constant(&self.ball_mass),
            ball_mass_inverse: constant(&self.ball_mass_inverse),
            floor_compliance: constant(&self.floor_compliance),
            floor_compliance_inverse: constant(&self.floor_compliance_inverse),
        }
    }
}

/// Elements of the Delassus matrix among the wheels' rows.
struct Couplings<'a, L: Lane> {
    rows: &'a Rows<L>,
    /// Normal arms divided by the inertia of the body.
    normal: Wheels<Vec3<L>>,
    /// Drive arms divided by the inertia of the body.
    drive: Wheels<Vec3<L>>,
    linear: L,
    ball_surface: L,
    own_drive: L,
    wheel_surface: L,
    wheel_rim_ratio: L,
    wheel_inertia_inverse: L,
}

impl<L: Lane> Couplings<'_, L> {
    #[inline(always)]
    fn own_normal<const RIPPLE: bool>(&self, i: usize) -> L {
        let of_body = self.normal[i].dot(self.rows.normal_arms[i]) + self.linear;
        if !RIPPLE {
            return of_body;
        }
        let ripple = &self.rows.ripple;
        ripple.select(ripple.slopes[i].squared().mul_add(self.wheel_inertia_inverse, of_body), of_body)
    }

    #[inline(always)]
    fn normals(&self, i: usize, j: usize) -> L {
        let moved = self.normal[i].dot(self.rows.normal_arms[j]);
        self.rows.normals[i].dot(self.rows.normals[j]).mul_add(self.linear, moved)
    }

    #[inline(always)]
    fn own_mixed<const RIPPLE: bool>(&self, i: usize) -> L {
        let of_body = self.normal[i].dot(self.rows.drive_arms[i]);
        if !RIPPLE {
            return of_body;
        }
        let ripple = &self.rows.ripple;
        let of_spin = self.rows.spin_shares[i] * self.wheel_rim_ratio;
        ripple.select(ripple.slopes[i].mul_add(of_spin, of_body), of_body)
    }

    #[inline(always)]
    fn mixed(&self, i: usize, j: usize) -> L {
        let moved = self.normal[i].dot(self.rows.drive_arms[j]);
        self.rows.normals[i].dot(self.rows.drives[j]).mul_add(self.linear, moved)
    }

    #[inline(always)]
    fn own_drive(&self, i: usize) -> L {
        let own_spin = self.rows.spin_shares[i].squared() * self.wheel_surface;
        self.drive[i].dot(self.rows.drive_arms[i]) + own_spin + self.own_drive
    }

    #[inline(always)]
    fn drives(&self, i: usize, j: usize) -> L {
        let moved = self.drive[i].dot(self.rows.drive_arms[j]);
        let moved = self.rows.drives[i].dot(self.rows.drives[j]).mul_add(self.linear, moved);
        self.rows.turns[i].dot(self.rows.turns[j]).mul_add(self.ball_surface, moved)
    }
}
