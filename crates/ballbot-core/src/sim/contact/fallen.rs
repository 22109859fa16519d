//! Contacts that a balancing robot does not have: its bot against the floor, its ball against the body.
//!
//! They are rare, so they are left out of the rows and solved by sweeps of their own, in turns with the rows' sweeps, on
//! the velocities themselves. Robots that have none of these contacts keep the impulses of the rows' own solution.

use super::constants::Constants;
use super::rows::{PerRow, Rows, Velocities, allowance};
use super::solve::{Delassus, Friction, JointFriction, in_disc};
use super::step::Pose;
use crate::lanes::{Lane, Rotation, Vec3};

/// Sweeps while such a contact is near; they start from nothing.
const SWEEPS: usize = 20;

/// Wheels, then three points of each rim of the body's cylinder, one of them the lowest.
const POINTS: usize = 9;

/// Distance at which a contact counts as near, m, besides what a step may cover.
const NEAR: f64 = 2e-3;

/// How far the ball's centre may be from where it belongs, in ball radii, before the body's cylinder can be in its way.
const OUT_OF_PLACE: f64 = 0.02;

/// Robots that need the contacts of this module in this step.
#[inline(always)]
pub fn near<L: Lane>(
    c: &Constants,
    pose: &Pose<L>,
    rotation: &Rotation<L>,
    v: &Velocities<L>,
    rows: &Rows<L>,
) -> L::Mask {
    let zero = pose.ball.x.zero();
    let up = rotation.rows[2];
    let wheel = |i: usize| up.dot(Vec3::splat(zero, &c.wheel_centers[i]));
    let wheels = wheel(0).min(wheel(1)).min(wheel(2)) - c.wheel_radius;
    let rim = up.z.neg_mul_add(up.z, zero.splat(1.0)).max(zero).sqrt() * c.body_radius;
    let cylinder = (up.z * c.body_bottom).min(up.z * c.body_top) - rim;
    let lowest = pose.body.z + wheels.min(cylinder);
    let sum = |v: Vec3<L>| v.x.abs() + v.y.abs() + v.z.abs();
    let covered = sum(v.body_rate).mul_add_all(c.reach, sum(v.body)) * c.sim_dt;
    let offset = rows.ball_in_body + Vec3::splat(zero, &[0.0, 0.0, c.com_height]);
    let limit = OUT_OF_PLACE * c.ball_radius;
    lowest.lt(covered + NEAR) | zero.splat(limit * limit).lt(offset.norm_squared())
}

/// A row of a point of the bot on the floor: what it measures of the bot's velocities.
#[derive(Clone, Copy)]
struct Row<L> {
    /// Inertial frame.
    direction: Vec3<L>,
    /// Body frame.
    arm: Vec3<L>,
    /// Share of the wheel's spin, m.
    spin: L,
    /// 1 / (what a unit impulse does to it).
    inverse: L,
}

/// A point of the bot over the floor.
#[derive(Clone, Copy)]
struct Point<L> {
    gap: L,
    wheel: Option<usize>,
    /// Normal, x, y.
    rows: [Row<L>; 3],
}

/// The ball against the body's cylinder.
struct BallOnBody<L> {
    gap: L,
    /// From the body to the ball, inertial frame.
    normal: Vec3<L>,
    arm: Vec3<L>,
    inverse: L,
}

pub struct Contacts<L> {
    points: [Point<L>; POINTS],
    ball: BallOnBody<L>,
}

/// What the sweeps found.
pub struct Solved<L> {
    pub impulses: PerRow<L>,
    /// Velocities that the contacts of this module make, before the rows' impulses.
    pub free: Velocities<L>,
    /// 1 where the bot touches the floor, else 0.
    pub on_floor: L,
}

impl<L: Lane> Contacts<L> {
    #[inline(always)]
    pub fn new(c: &Constants, pose: &Pose<L>, rotation: &Rotation<L>, rows: &Rows<L>) -> Self {
        let like = pose.ball.x;
        let height = |arm: Vec3<L>| pose.body.z + rotation.rows[2].dot(arm);
        let wheel = |i: usize| {
            let center = Vec3::splat(like, &c.wheel_centers[i]);
            Point {
                gap: height(center) - c.wheel_radius,
                wheel: Some(i),
                rows: [2, 0, 1].map(
                    #[inline(always)]
                    |axis| wheel_row(c, rotation, center, i, axis),
                ),
            }
        };
        let [east, north] = lowest_direction(rotation);
        let rim = |end: f64, third: usize| {
            let (sin, cos) = [(0.0, 1.0), (0.75_f64.sqrt(), -0.5), (-(0.75_f64.sqrt()), -0.5)][third];
            let x = north.mul_add_all(-sin, east * cos) * c.body_radius;
            let y = east.mul_add_all(sin, north * cos) * c.body_radius;
            let arm = Vec3::new(x, y, like.splat(end));
            Point {
                gap: height(arm),
                wheel: None,
                rows: [2, 0, 1].map(
                    #[inline(always)]
                    |axis| body_row(c, rotation, arm, axis),
                ),
            }
        };
        let (bottom, top) = (c.body_bottom, c.body_top);
        Self {
            points: [
                wheel(0),
                wheel(1),
                wheel(2),
                rim(bottom, 0),
                rim(bottom, 1),
                rim(bottom, 2),
                rim(top, 0),
                rim(top, 1),
                rim(top, 2),
            ],
            ball: BallOnBody::new(c, rotation, rows.ball_in_body),
        }
    }

    /// Impulses of these contacts and of the rows, in turns.
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "everything that a step knows bears on it")]
    pub fn solve<const JOINTS: bool>(
        &self,
        c: &Constants,
        rows: &Rows<L>,
        delassus: &Delassus<L>,
        friction: &Friction<L>,
        joint_friction: &JointFriction<L>,
        free: &Velocities<L>,
        mut impulses: PerRow<L>,
    ) -> Solved<L> {
        let zero = friction.floor.zero();
        let mut free = *free;
        let mut on_points = [[zero; 3]; POINTS];
        let mut on_ball = zero;
        for _ in 0..SWEEPS {
            let mut now = free;
            rows.apply::<JOINTS>(c, &impulses, &mut now);
            for (point, total) in self.points.iter().zip(&mut on_points) {
                point.sweep(c, friction.floor, total, [&mut now, &mut free]);
            }
            self.ball.sweep(c, &mut on_ball, [&mut now, &mut free]);
            let mut residuals = rows.residuals(c, &now);
            delassus.sweep::<JOINTS>(friction, joint_friction, &mut impulses, &mut residuals);
        }
        let mut touches = zero.lt(zero);
        for (point, total) in self.points.iter().zip(&on_points) {
            touches = touches | zero.lt(total[0]) | point.gap.le(zero);
        }
        Solved { impulses, free, on_floor: L::select(touches, zero.splat(1.0), zero) }
    }
}

impl<L: Lane> Point<L> {
    /// Improves the impulses of this point and changes both sets of velocities by them.
    #[inline(always)]
    fn sweep(&self, c: &Constants, friction: L, total: &mut [L; 3], velocities: [&mut Velocities<L>; 2]) {
        let [now, free] = velocities;
        let [normal, x, y] = &self.rows;
        let approach = normal.speed(now, self.wheel) + allowance(c, self.gap);
        let new = approach.neg_mul_add(normal.inverse, total[0]).max(approach.zero());
        for v in [&mut *now, &mut *free] {
            normal.push(c, new - total[0], v, self.wheel);
        }
        total[0] = new;
        let stick = |row: &Row<L>, old: L, now: &Velocities<L>| row.speed(now, self.wheel).neg_mul_add(row.inverse, old);
        let held = in_disc([stick(x, total[1], now), stick(y, total[2], now)], friction * new);
        for v in [now, free] {
            x.push(c, held[0] - total[1], v, self.wheel);
            y.push(c, held[1] - total[2], v, self.wheel);
        }
        [total[1], total[2]] = held;
    }
}

impl<L: Lane> Row<L> {
    #[inline(always)]
    fn speed(&self, v: &Velocities<L>, wheel: Option<usize>) -> L {
        let body = self.direction.dot(v.body) + self.arm.dot(v.body_rate);
        wheel.map_or(body, |i| self.spin.mul_add(v.spins[i], body))
    }

    #[inline(always)]
    fn push(&self, c: &Constants, impulse: L, v: &mut Velocities<L>, wheel: Option<usize>) {
        v.body = v.body.plus(self.direction, impulse * c.body_mass_inverse);
        v.body_rate += self.arm.scaled_by(&c.body_inertia_inverse) * impulse;
        if let Some(i) = wheel {
            v.spins[i] = self.spin.mul_add(impulse * c.wheel_inertia.recip(), v.spins[i]);
        }
    }
}

/// The inertial axis `axis` (0 x, 1 y, 2 z).
#[inline(always)]
fn axis_vector<L: Lane>(like: L, axis: usize) -> Vec3<L> {
    let mut unit = [0.0; 3];
    unit[axis] = 1.0;
    Vec3::splat(like, &unit)
}

#[inline(always)]
fn body_row<L: Lane>(c: &Constants, rotation: &Rotation<L>, arm: Vec3<L>, axis: usize) -> Row<L> {
    let zero = arm.x.zero();
    let direction = axis_vector(zero, axis);
    row(c, direction, arm.cross(rotation.rows[axis]), zero)
}

/// Row of the lowest point of wheel `i`, which turns about its axle with its own spin, not the body's.
#[inline(always)]
fn wheel_row<L: Lane>(c: &Constants, rotation: &Rotation<L>, center: Vec3<L>, i: usize, axis: usize) -> Row<L> {
    let like = center.x;
    let u = Vec3::splat(like, &c.u[i]);
    let across = rotation.rows[2].cross(rotation.rows[axis]);
    let along = across.dot(u);
    let arm = center.cross(rotation.rows[axis]) - (across - u * along) * like.splat(c.wheel_radius);
    row(c, axis_vector(like, axis), arm, along * c.wheel_radius)
}

#[inline(always)]
fn row<L: Lane>(c: &Constants, direction: Vec3<L>, arm: Vec3<L>, spin: L) -> Row<L> {
    let turning = arm.scaled_by(&c.body_inertia_inverse).dot(arm);
    let effect = spin.squared().mul_add_all(c.wheel_inertia.recip(), turning) + c.body_mass_inverse;
    Row { direction, arm, spin, inverse: spin.splat(1.0) / effect }
}

/// Where, seen along the mast, down is: a unit vector of the body's xy plane; x where the mast is vertical.
#[inline(always)]
fn lowest_direction<L: Lane>(rotation: &Rotation<L>) -> [L; 2] {
    let up = rotation.rows[2];
    let squared = up.x.mul_add(up.x, up.y.squared());
    let vertical = squared.lt(squared.splat(1e-12));
    let one = squared.splat(1.0);
    let inverse = one / L::select(vertical, one, squared).sqrt();
    [L::select(vertical, one, -up.x * inverse), L::select(vertical, squared.zero(), -up.y * inverse)]
}

impl<L: Lane> BallOnBody<L> {
    #[inline(always)]
    fn new(c: &Constants, rotation: &Rotation<L>, ball: Vec3<L>) -> Self {
        let zero = ball.x.zero();
        let one = zero.splat(1.0);
        let radial = ball.x.mul_add(ball.x, ball.y.squared()).sqrt();
        let within = radial.min(zero.splat(c.body_radius));
        let share = within / radial.max(zero.splat(f64::MIN_POSITIVE));
        let (bottom, top) = (zero.splat(c.body_bottom), zero.splat(c.body_top));
        let nearest = Vec3::new(ball.x * share, ball.y * share, ball.z.max(bottom).min(top));
        let offset = ball - nearest;
        let distance = offset.norm_squared().sqrt();
        // A centre inside the cylinder leaves by its lower end, where it came from.
        let inside = distance.le(zero);
        let down = Vec3::splat(zero, &[0.0, 0.0, -1.0]);
        let normal = Vec3::select(inside, down, offset * (one / L::select(inside, one, distance)));
        let arm = normal.cross(nearest);
        let turning = arm.scaled_by(&c.body_inertia_inverse).dot(arm);
        Self {
            gap: distance - c.ball_radius,
            normal: rotation.apply(normal),
            arm,
            inverse: one / (turning + (c.body_mass_inverse + c.ball_mass_inverse)),
        }
    }

    #[inline(always)]
    fn sweep(&self, c: &Constants, total: &mut L, velocities: [&mut Velocities<L>; 2]) {
        let [now, free] = velocities;
        let approach =
            self.normal.dot(now.ball - now.body) + self.arm.dot(now.body_rate) + allowance(c, self.gap);
        let new = approach.neg_mul_add(self.inverse, *total).max(approach.zero());
        let change = new - *total;
        for v in [now, free] {
            v.ball = v.ball.plus(self.normal, change * c.ball_mass_inverse);
            v.body = v.body.plus(self.normal, change * -c.body_mass_inverse);
            v.body_rate += self.arm.scaled_by(&c.body_inertia_inverse) * change;
        }
        *total = new;
    }
}
