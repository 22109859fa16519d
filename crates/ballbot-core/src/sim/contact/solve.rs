//! Impulses of the rows by projected Gauss-Seidel on their Delassus matrix.

use super::constants::Constants;
use super::rows::Rows;
use super::types::PerRow;
use crate::lanes::Lane;

/// Sweeps of one step at least; they start from the last step's impulses.
pub const SWEEPS: usize = 4;

/// Sweeps of one step at most: impacts, hard pushes and wheels that begin to slip take more.
pub const MOST_SWEEPS: usize = 60;

/// How fast the load that bounds a wheel's friction follows the load, in a sweep. Friction of slipping wheels pushes ball
/// and body sideways and so changes the loads of the others by more than itself: bounded by the load at once, it would
/// swing from sweep to sweep, and farther each time.
const LOAD_FILTER: f64 = 0.33;

/// Friction coefficients in this step.
#[derive(Clone, Copy)]
pub struct Friction<L> {
    pub wheels: [L; 3],
    pub floor: L,
}

/// Joint friction over one step.
#[derive(Clone, Copy)]
pub struct JointFriction<L> {
    /// Largest dry impulse.
    pub dry: L,
    /// Viscous impulse for each rad/s.
    pub viscous: L,
}

impl<L: Lane> JointFriction<L> {
    #[inline(always)]
    pub fn new(c: &Constants<L>) -> Self {
        Self { dry: c.joint_dry_impulse, viscous: c.joint_viscous_impulse }
    }

    /// Whether any robot has any.
    #[inline(always)]
    pub fn any(&self) -> bool {
        let zero = self.dry.zero();
        L::any(zero.lt(self.dry) | zero.lt(self.viscous))
    }
}

/// What an impulse of one row does to the velocity of another: the upper triangle in blocks of three.
///
/// The floor's rows and each other's tangent share only the ball, whose inertia is the same in all directions, so they
/// do not couple; joints do not couple with the floor.
pub struct Delassus<L> {
    normal_normal: [[L; 3]; 3],
    normal_drive: [[L; 3]; 3],
    drive_drive: [[L; 3]; 3],
    /// Floor row (normal, x, y), wheel.
    floor_normal: [[L; 3]; 3],
    floor_drive: [[L; 3]; 3],
    joint_normal: [[L; 3]; 3],
    joint_drive: [[L; 3]; 3],
    joint_joint: [[L; 3]; 3],
    normal_inverse: [L; 3],
    drive_inverse: [L; 3],
    floor_diagonal: [L; 3],
    floor_inverse: [L; 2],
}

impl<L: Lane> Delassus<L> {
    #[inline(always)]
    pub fn new<const JOINTS: bool>(c: &Constants<L>, rows: &Rows<L>) -> Self {
        let zero = rows.floor_gap.zero();
        let none = [[zero; 3]; 3];
        let one = zero.splat(1.0);
        let linear = c.body_mass_inverse + c.ball_mass_inverse;
        let spin = c.wheel_surface_compliance;

        let (mut nn, mut nd, mut dd) = (none, none, none);
        for i in 0..3 {
            let normal = rows.normal_arms[i].scaled_by(c.body_inertia_inverse);
            let drive = rows.drive_arms[i].scaled_by(c.body_inertia_inverse);
            nn[i][i] = normal.dot(rows.normal_arms[i]) + linear;
            nd[i][i] = normal.dot(rows.drive_arms[i]);
            let own_spin = rows.spin_shares[i].squared() * spin;
            dd[i][i] = drive.dot(rows.drive_arms[i]) + own_spin + (linear + c.ball_surface_compliance);
            for j in 0..3 {
                if j > i {
                    nn[i][j] = rows.normals[i].dot(rows.normals[j]).mul_add(linear, normal.dot(rows.normal_arms[j]));
                    nn[j][i] = nn[i][j];
                    let moved = rows.drives[i].dot(rows.drives[j]).mul_add(linear, drive.dot(rows.drive_arms[j]));
                    dd[i][j] = rows.turns[i].dot(rows.turns[j]).mul_add(c.ball_surface_compliance, moved);
                    dd[j][i] = dd[i][j];
                }
                if j != i {
                    nd[i][j] = rows.normals[i].dot(rows.drives[j]).mul_add(linear, normal.dot(rows.drive_arms[j]));
                }
            }
        }

        let (mut zn, mut zd) = (none, none);
        let ball = -c.ball_mass_inverse;
        for i in 0..3 {
            let (n, d, u) = (rows.normals[i], rows.drives[i], rows.turns[i]);
            zn[0][i] = n.z * ball;
            zn[1][i] = n.x * ball;
            zn[2][i] = n.y * ball;
            zd[0][i] = d.z * ball;
            zd[1][i] = u.y.mul_add(c.ball_surface_compliance, d.x * ball);
            zd[2][i] = u.x.mul_add(-c.ball_surface_compliance, d.y * ball);
        }

        let (mut jn, mut jd, mut jj) = (none, none, none);
        if JOINTS {
            for i in 0..3 {
                let u = c.u(i).scaled_by(c.body_inertia_inverse);
                for j in 0..3 {
                    jn[i][j] = u.dot(rows.normal_arms[j]);
                    jd[i][j] = u.dot(rows.drive_arms[j]);
                    jj[i][j] = u.dot(c.u(j));
                }
                jd[i][i] = rows.spin_shares[i].mul_add(c.wheel_rim_ratio, jd[i][i]);
                jj[i][i] = jj[i][i] + c.wheel_inertia_inverse;
            }
        }

        let tangent = c.ball_mass_inverse + c.ball_surface_compliance;
        Self {
            normal_inverse: [one / nn[0][0], one / nn[1][1], one / nn[2][2]],
            drive_inverse: [one / dd[0][0], one / dd[1][1], one / dd[2][2]],
            normal_normal: nn,
            normal_drive: nd,
            drive_drive: dd,
            floor_normal: zn,
            floor_drive: zd,
            joint_normal: jn,
            joint_drive: jd,
            joint_joint: jj,
            floor_diagonal: [c.ball_mass_inverse, tangent, tangent],
            floor_inverse: [one / c.ball_mass_inverse, one / tangent],
        }
    }

    /// Adds to the residuals what impulses do to them.
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
    fn add_floor(&self, k: usize, impulse: L, r: &mut PerRow<L>) {
        r.floor[k] = impulse.mul_add(self.floor_diagonal[k], r.floor[k]);
        for j in 0..3 {
            r.normals[j] = self.floor_normal[k][j].mul_add(impulse, r.normals[j]);
            r.drives[j] = self.floor_drive[k][j].mul_add(impulse, r.drives[j]);
        }
    }

    #[inline(always)]
    fn add_normal<const JOINTS: bool>(&self, k: usize, impulse: L, r: &mut PerRow<L>) {
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
    fn add_drive<const JOINTS: bool>(&self, k: usize, impulse: L, r: &mut PerRow<L>) {
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
    fn add_joint(&self, k: usize, impulse: L, r: &mut PerRow<L>) {
        for j in 0..3 {
            r.joints[j] = self.joint_joint[k][j].mul_add(impulse, r.joints[j]);
            r.normals[j] = self.joint_normal[k][j].mul_add(impulse, r.normals[j]);
            r.drives[j] = self.joint_drive[k][j].mul_add(impulse, r.drives[j]);
        }
    }

    /// Robots of which the wheels' impulses changed much from one sweep to the next.
    #[inline(always)]
    pub fn unsettled(c: &Constants<L>, old: &PerRow<L>, new: &PerRow<L>) -> L::Mask {
        let mut change = new.floor[0].zero();
        for k in 0..3 {
            let (normal, drive) = (new.normals[k] - old.normals[k], new.drives[k] - old.drives[k]);
            change = normal.mul_add(normal, drive.mul_add(drive, change));
        }
        c.settled_squared.lt(change)
    }

    /// Improves the impulses of all rows once, each within what its contact can do, and keeps the residuals up to date.
    #[inline(always)]
    pub fn sweep<const JOINTS: bool>(
        &self,
        friction: &Friction<L>,
        joint_friction: &JointFriction<L>,
        normal_estimate: &mut [L; 3],
        impulses: &mut PerRow<L>,
        r: &mut PerRow<L>,
    ) {
        let zero = friction.floor.zero();
        self.sweep_floor(friction.floor, impulses, r);
        for k in 0..3 {
            let new = r.normals[k].neg_mul_add(self.normal_inverse[k], impulses.normals[k]).max(zero);
            let change = new - impulses.normals[k];
            impulses.normals[k] = new;
            self.add_normal::<JOINTS>(k, change, r);
        }
        for (k, normal_estimate) in normal_estimate.iter_mut().enumerate() {
            *normal_estimate = (impulses.normals[k] - *normal_estimate).mul_add_all(LOAD_FILTER, *normal_estimate);
            let limit = friction.wheels[k] * *normal_estimate;
            let stick = r.drives[k].neg_mul_add(self.drive_inverse[k], impulses.drives[k]);
            let new = stick.min(limit).max(-limit);
            let change = new - impulses.drives[k];
            impulses.drives[k] = new;
            self.add_drive::<JOINTS>(k, change, r);
        }
        if JOINTS {
            for k in 0..3 {
                let own = self.joint_joint[k][k];
                let stick = impulses.joints[k] - r.joints[k] / own;
                let dry = stick.min(joint_friction.dry).max(-joint_friction.dry);
                let softness = joint_friction.viscous * own;
                // Zero is added for its sign: beside a robot with friction, one without keeps its plain zero.
                let new = (softness / (softness + 1.0)).mul_add(stick - dry, dry) + 0.0;
                let change = new - impulses.joints[k];
                impulses.joints[k] = new;
                self.add_joint(k, change, r);
            }
        }
    }

    #[inline(always)]
    fn sweep_floor(&self, friction: L, impulses: &mut PerRow<L>, r: &mut PerRow<L>) {
        let zero = friction.zero();
        let [normal, tangent] = self.floor_inverse;
        let new = r.floor[0].mul_add(-normal, impulses.floor[0]).max(zero);
        let change = new - impulses.floor[0];
        impulses.floor[0] = new;
        self.add_floor(0, change, r);

        let x = r.floor[1].mul_add(-tangent, impulses.floor[1]);
        let y = r.floor[2].mul_add(-tangent, impulses.floor[2]);
        let [x, y] = in_disc([x, y], friction * new);
        let (dx, dy) = (x - impulses.floor[1], y - impulses.floor[2]);
        impulses.floor[1] = x;
        impulses.floor[2] = y;
        self.add_floor(1, dx, r);
        self.add_floor(2, dy, r);
    }
}

/// The pair, drawn to the rim of the disc of radius `limit` where it is outside.
#[inline(always)]
pub fn in_disc<L: Lane>([x, y]: [L; 2], limit: L) -> [L; 2] {
    let squared = x.mul_add(x, y.squared());
    let outside = limit.squared().lt(squared);
    // Roots and divisions are slow, slip on the floor is rare, and lanes inside keep their bits either way.
    if !L::any(outside) {
        return [x, y];
    }
    let scale = L::select(outside, limit / squared.sqrt(), limit.splat(1.0));
    [x * scale, y * scale]
}
