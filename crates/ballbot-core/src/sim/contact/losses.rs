//! The rows of a robot with rolling, spinning or roller friction, for [`crate::sim::losses`].
//!
//! Rates of the ball and of the joints are in the units of the other rows: speeds of the ball's surface and of the rims.

use super::constants::{Constants, at3};
use super::delassus::Delassus;
use super::friction::{Friction, JointFriction};
use super::phases::Start;
use super::rows::Rows;
use super::types::{PerRow, Velocities};
use crate::lanes::{Lane, Value, Vec3};
use crate::sim::losses::{Bounds, DRIVE, FLOOR, JOINT, NORMAL, Present, Problem, ROLLER, ROWS, TORQUE};

/// The free directions of the wheels.
pub struct Rollers<L> {
    /// Drive directions, inertial frame: the ball's rate about them moves its surface along the free directions.
    drives: [Vec3<L>; 3],
    /// Free directions, inertial frame.
    directions: [Vec3<L>; 3],
    /// Factors of the body rate, principal frame, m.
    arms: [Vec3<L>; 3],
}

impl<L: Lane> Rollers<L> {
    #[inline(always)]
    pub fn new<V: Value<L>>(c: &Constants<V>, start: &Start<L>) -> Self {
        let rows = &start.rows;
        let mut arms = rows.turns;
        for (i, arm) in arms.iter_mut().enumerate() {
            let center = c.wheel_center(i, rows.floor_gap);
            let direction = start.rotation.apply_transposed(rows.turns[i]);
            let drive = start.rotation.apply_transposed(rows.drives[i]);
            *arm = center.cross(direction).plus(drive, c.wheel_radius.at(rows.floor_gap));
        }
        Self { drives: rows.drives, directions: rows.turns, arms }
    }

    /// Speed of wheel `i` along its free direction relative to the ball's surface.
    #[inline(always)]
    fn speed<V: Value<L>>(&self, c: &Constants<V>, v: &Velocities<L>, i: usize) -> L {
        let body = self.directions[i].dot(v.body - v.ball) + self.arms[i].dot(v.body_rate);
        self.drives[i].dot(v.ball_rate).mul_add(c.ball_radius.at(body), body)
    }

    /// Friction coefficient of each wheel along its free direction, at most that along its drive direction.
    #[inline(always)]
    fn friction<V: Value<L>>(&self, c: &Constants<V>, v: &Velocities<L>, friction: &Friction<L>) -> [L; 3] {
        let mut out = friction.wheels;
        for (i, coefficient) in out.iter_mut().enumerate() {
            let speed = self.speed(c, v, i).abs();
            let own = speed.mul_add(c.roller_friction_slope.at(speed), c.roller_friction.at(speed));
            *coefficient = own.min(*coefficient);
        }
        out
    }
}

/// What the sweeps beside rare contacts need of a robot with losses.
pub struct Lossy<'a, L> {
    pub problem: &'a Problem<L>,
    pub rollers: &'a Rollers<L>,
    /// Impulses of the ball's rates and the rollers before the sweeps.
    pub extra: [[L; 3]; 2],
}

/// Speeds of all rows at the velocities, less what the gaps allow.
#[inline(always)]
pub fn speeds<L: Lane, V: Value<L>>(
    c: &Constants<V>,
    rows: &Rows<L>,
    rollers: &Rollers<L>,
    v: &Velocities<L>,
) -> [L; ROWS] {
    let [a, b, d] = [rollers.speed(c, v, 0), rollers.speed(c, v, 1), rollers.speed(c, v, 2)];
    let rate = v.ball_rate * c.ball_radius.at(a);
    let PerRow { floor, normals, drives, joints } = rows.residuals(c, v);
    let rim = c.wheel_radius.at(a);
    let joints = [joints[0] * rim, joints[1] * rim, joints[2] * rim];
    joined([[rate.x, rate.y, rate.z], [a, b, d], joints, floor, normals, drives])
}

/// The conditions of a step, with the speeds of the rows without impulses.
#[inline(always)]
pub fn problem<L: Lane, V: Value<L>>(
    c: &Constants<V>,
    start: &Start<L>,
    rollers: &Rollers<L>,
    delassus: &Delassus<L, V>,
    (friction, joints): (&Friction<L>, &JointFriction<L>),
    residuals: [L; ROWS],
) -> Problem<L> {
    let zero = friction.floor.zero();
    let inverse = c.wheel_radius_inverse.at(zero);
    let bounds = Bounds {
        floor: friction.floor,
        wheels: friction.wheels,
        rollers: rollers.friction(c, &start.velocities, friction),
        rolling: c.rolling_friction.at(zero),
        spinning: c.spinning_friction.at(zero),
        dry: joints.dry * inverse,
        viscous: joints.viscous * inverse * inverse,
    };
    let rates = L::any(zero.lt(bounds.rolling) | zero.lt(bounds.spinning));
    let [a, b, d] = bounds.rollers;
    let present = Present::new(rates, L::any(zero.lt(a) | zero.lt(b) | zero.lt(d)), joints.any());
    let static_impulse = c.static_wheel_load.at(zero) * c.sim_dt.at(zero);
    Problem::new(coupling(c, &start.rows, rollers, delassus), residuals, bounds, present, static_impulse)
}

#[inline(always)]
fn coupling<L: Lane, V: Value<L>>(
    c: &Constants<V>,
    rows: &Rows<L>,
    rollers: &Rollers<L>,
    delassus: &Delassus<L, V>,
) -> [[L; ROWS]; ROWS] {
    let zero = rows.floor_gap.zero();
    let surface = c.ball_surface_compliance.at(zero);
    let linear = c.relative_mass_inverse.at(zero);
    let rim = c.wheel_radius.at(zero);
    let mut w = [[zero; ROWS]; ROWS];
    for k in 0..3 {
        let tangent = if k == 0 { c.ball_mass_inverse } else { c.floor_compliance };
        w[FLOOR + k][FLOOR + k] = tangent.at(zero);
        w[TORQUE + k][TORQUE + k] = surface;
        for i in 0..3 {
            put(&mut w, FLOOR + k, NORMAL + i, delassus.floor_normal[k][i]);
            put(&mut w, FLOOR + k, DRIVE + i, delassus.floor_drive[k][i]);
            put(&mut w, NORMAL + k, DRIVE + i, delassus.normal_drive[k][i]);
            put(&mut w, JOINT + k, NORMAL + i, delassus.joint_normal[k][i] * rim);
            put(&mut w, JOINT + k, DRIVE + i, delassus.joint_drive[k][i] * rim);
            w[NORMAL + k][NORMAL + i] = delassus.normal_normal[k][i];
            w[DRIVE + k][DRIVE + i] = delassus.drive_drive[k][i];
            w[JOINT + k][JOINT + i] = delassus.joint_joint[k][i] * rim * rim;
        }
    }
    // The floor's friction along x turns the ball about −y, that along y about x.
    put(&mut w, TORQUE + 1, FLOOR + 1, -surface);
    put(&mut w, TORQUE, FLOOR + 2, surface);
    let mass_inverse = c.ball_mass_inverse.at(zero);
    for i in 0..3 {
        let (drive, turn) = (rows.drives[i] * surface, rows.turns[i] * -surface);
        let moved = rollers.arms[i].scaled_by(at3(c.body_inertia_inverse, zero));
        let (direction, push) = (rollers.directions[i], rollers.directions[i] * -mass_inverse);
        for (k, (drive, turn)) in [(drive.x, turn.x), (drive.y, turn.y), (drive.z, turn.z)].into_iter().enumerate() {
            put(&mut w, TORQUE + k, ROLLER + i, drive);
            put(&mut w, TORQUE + k, DRIVE + i, turn);
        }
        put(&mut w, ROLLER + i, FLOOR, push.z);
        put(&mut w, ROLLER + i, FLOOR + 1, push.x - drive.y);
        put(&mut w, ROLLER + i, FLOOR + 2, push.y + drive.x);
        for j in 0..3 {
            let normal = direction.dot(rows.normals[j]).mul_add(linear, moved.dot(rows.normal_arms[j]));
            put(&mut w, ROLLER + i, NORMAL + j, normal);
            let along = direction.dot(rows.drives[j]).mul_add(linear, moved.dot(rows.drive_arms[j]));
            put(&mut w, ROLLER + i, DRIVE + j, along - drive.dot(rows.turns[j]));
            let across = direction.dot(rollers.directions[j]).mul_add(linear, moved.dot(rollers.arms[j]));
            w[ROLLER + i][ROLLER + j] = across + drive.dot(rows.drives[j]);
            put(&mut w, ROLLER + i, JOINT + j, moved.dot(c.u(j, zero)) * rim);
        }
    }
    w
}

#[inline(always)]
fn put<L: Copy>(w: &mut [[L; ROWS]; ROWS], row: usize, column: usize, value: L) {
    w[row][column] = value;
    w[column][row] = value;
}

/// The impulses of all rows; `extra` are those of the ball's rates and the rollers.
#[inline(always)]
pub fn all_impulses<L: Lane, V: Value<L>>(c: &Constants<V>, own: &PerRow<L>, extra: &[[L; 3]; 2]) -> [L; ROWS] {
    let inverse = c.wheel_radius_inverse.at(own.floor[0]);
    let joints = [own.joints[0] * inverse, own.joints[1] * inverse, own.joints[2] * inverse];
    joined([extra[0], extra[1], joints, own.floor, own.normals, own.drives])
}

/// The inverse of [`all_impulses`].
#[inline(always)]
pub fn parted<L: Lane, V: Value<L>>(c: &Constants<V>, all: &[L; ROWS]) -> (PerRow<L>, [[L; 3]; 2]) {
    let three = |first: usize| [all[first], all[first + 1], all[first + 2]];
    let rim = c.wheel_radius.at(all[0]);
    let joints = [all[JOINT] * rim, all[JOINT + 1] * rim, all[JOINT + 2] * rim];
    let own = PerRow { floor: three(FLOOR), normals: three(NORMAL), drives: three(DRIVE), joints };
    (own, [three(TORQUE), three(ROLLER)])
}

/// Applies the impulses of the ball's rates and the rollers to the velocities.
#[inline(always)]
pub fn apply<L: Lane, V: Value<L>>(
    c: &Constants<V>,
    rollers: &Rollers<L>,
    [torque, along]: &[[L; 3]; 2],
    v: &mut Velocities<L>,
) {
    let like = v.ball.x;
    let mut bot_impulse = Vec3::zero(like);
    let mut body_angular_impulse = bot_impulse;
    let mut ball_angular_impulse = Vec3::from(*torque);
    for (i, &impulse) in along.iter().enumerate() {
        bot_impulse = bot_impulse.plus(rollers.directions[i], impulse);
        body_angular_impulse = body_angular_impulse.plus(rollers.arms[i], impulse);
        ball_angular_impulse = ball_angular_impulse.plus(rollers.drives[i], impulse);
    }
    v.ball = v.ball.plus(bot_impulse, -c.ball_mass_inverse.at(like));
    v.ball_rate = v.ball_rate.plus(ball_angular_impulse, c.ball_rim_ratio.at(like));
    v.body = v.body.plus(bot_impulse, c.body_mass_inverse.at(like));
    v.body_rate += body_angular_impulse.scaled_by(at3(c.body_inertia_inverse, like));
}

/// Rows in the order of the problem, three at a time.
#[inline(always)]
fn joined<L: Copy>(groups: [[L; 3]; 6]) -> [L; ROWS] {
    let mut out = [groups[0][0]; ROWS];
    for (out, group) in out.chunks_exact_mut(3).zip(groups) {
        out.copy_from_slice(&group);
    }
    out
}

/// Difference of two pairs of triples.
#[inline(always)]
pub fn less<L: Lane>([a, b]: &[[L; 3]; 2], [c, d]: &[[L; 3]; 2]) -> [[L; 3]; 2] {
    [[a[0] - c[0], a[1] - c[1], a[2] - c[2]], [b[0] - d[0], b[1] - d[1], b[2] - d[2]]]
}
