//! Contacts that a balancing robot does not have: its bot against the floor, its ball against the body.
//!
//! They are rare, so they are left out of the rows and of the lanes: a robot that has one is stepped by itself, by sweeps
//! over these contacts, on the velocities themselves, in turns with the rows' sweeps.

use super::constants::Constants;
use super::phases::{self, Start};
use super::rows::{Rows, allowance};
use super::solve::{Delassus, Friction, JointFriction, in_disc};
use super::state::{ContactState, Torques};
use super::types::{PerRow, Velocities};
use crate::lanes::{Lane, Rotation, Scalar, Value, Vec3};

/// Sweeps while such a contact is near; they start from nothing.
const SWEEPS: usize = 20;

/// Wheels, then three points of each rim of the body's cylinder, one of them the lowest.
const POINTS: usize = 9;

/// Distance at which a contact counts as near, m, besides what a step may cover.
const CONTACT_MARGIN: f64 = 2e-3;

/// How far the ball's center may be from where it belongs, in ball radii, before the body's cylinder can be in its way.
const MAX_CENTER_OFFSET: f64 = 0.02;

/// Robots that need the contacts of this module in this step.
#[inline(always)]
pub fn near<L: Lane, V: Value<L>>(c: &Constants<V>, start: &Start<L>, token: L::Token, push: &[L::Cell; 6]) -> L::Mask {
    let (pose, v) = (&start.pose, &start.velocities);
    let zero = pose.ball.x.zero();
    let up = start.rotation.rows[2];
    let wheels =
        (up.dot(c.wheel_center(0, zero))).min(up.dot(c.wheel_center(1, zero))).min(up.dot(c.wheel_center(2, zero)));
    let rim = up.z.neg_mul_add(up.z, zero.splat(1.0)).max(zero).sqrt() * c.body_radius.at(zero);
    let cylinder = (up.z * c.body_bottom.at(zero)).min(up.z * c.body_top.at(zero)) - rim;
    let lowest = pose.body.z + (wheels - c.wheel_radius.at(zero)).min(cylinder);
    let (speed, rate) = (v.body, v.body_rate);
    let [px, py, pz, ax, ay, az] = push;
    let impulse = Vec3::<L>::load_parts(token, [px, py, pz]);
    let angular_impulse = Vec3::<L>::load_parts(token, [ax, ay, az]);
    let pushed = (impulse.x.abs() + impulse.y.abs() + impulse.z.abs()) * c.body_mass_inverse.at(zero);
    let turned = (angular_impulse.x.abs() + angular_impulse.y.abs() + angular_impulse.z.abs())
        * c.reach_inverse_inertia.at(zero);
    let fastest = (rate.x.abs() + rate.y.abs() + rate.z.abs())
        .mul_add(c.reach.at(zero), speed.x.abs() + speed.y.abs() + speed.z.abs());
    let fastest = fastest + (pushed + turned);
    let offset = start.rows.ball_in_body + Vec3::new(zero, zero, c.com_height.at(zero));
    let limit = c.ball_radius.at(zero) * MAX_CENTER_OFFSET;
    lowest.lt(fastest.mul_add(c.sim_dt.at(zero), zero.splat(CONTACT_MARGIN)))
        | limit.squared().lt(offset.norm_squared())
}

/// One step of a robot that [`near`] has named.
#[inline(always)]
pub fn step(c: &Constants<f64>, state: &mut ContactState<f64>, torques: &Torques<f64>) {
    let start = Start::new(c, Scalar, state);
    let free = phases::free_velocities(c, Scalar, state, &start, torques);
    let mut contacts = Contacts {
        c,
        rows: &start.rows,
        delassus: Delassus::new::<true>(c, &start.rows),
        friction: phases::friction(c, &start.rows, &start.velocities),
        joint_friction: JointFriction::new(c, 0.0),
        impulses: state.impulses(Scalar),
        free,
    };
    let on_floor = contacts.solve(&mut points(c, &start), &mut BallOnBody::new(c, &start));
    let on_floor = if on_floor { 1.0 } else { 0.0 };
    phases::finish::<f64, f64, true>(c, Scalar, state, &start, (contacts.free, contacts.impulses), on_floor);
}

/// A robot's rows, and its velocities without their impulses but with those of the contacts of this module.
struct Contacts<'a> {
    c: &'a Constants<f64>,
    rows: &'a Rows<f64>,
    delassus: Delassus<f64, f64>,
    friction: Friction<f64>,
    joint_friction: JointFriction<f64>,
    impulses: PerRow<f64>,
    free: Velocities<f64>,
}

impl Contacts<'_> {
    /// Impulses of these contacts and of the rows, in turns; whether the bot touches the floor.
    #[inline(always)]
    fn solve(&mut self, points: &mut [Point; POINTS], ball: &mut BallOnBody) -> bool {
        let c = self.c;
        let mut normal_estimate = self.impulses.normals;
        for _ in 0..SWEEPS {
            let mut now = self.free;
            self.rows.apply::<true, f64>(c, &self.impulses, &mut now);
            for point in points.iter_mut() {
                point.sweep(c, self.friction.floor, [&mut now, &mut self.free]);
            }
            ball.sweep(c, [&mut now, &mut self.free]);
            let mut residuals = self.rows.residuals(c, &now);
            self.delassus.sweep::<true>(
                &self.friction,
                &self.joint_friction,
                &mut normal_estimate,
                &mut self.impulses,
                &mut residuals,
            );
        }
        points.iter().any(|point| point.impulses[0] > 0.0 || point.gap <= 0.0)
    }
}

/// A row of a point of the bot on the floor: what it measures of the bot's velocities.
#[derive(Clone, Copy)]
struct Row {
    /// Inertial frame.
    direction: Vec3<f64>,
    /// Body frame.
    arm: Vec3<f64>,
    /// The wheel that the point is of, and the share of its spin, m.
    spin: Option<(usize, f64)>,
    /// 1 / (what a unit impulse does to it).
    inverse: f64,
}

impl Row {
    #[inline(always)]
    fn new(c: &Constants<f64>, direction: Vec3<f64>, arm: Vec3<f64>, spin: Option<(usize, f64)>) -> Self {
        let angular = arm.scaled_by(c.body_inertia_inverse).dot(arm);
        let spin_part = spin.map_or(0.0, |(_, share)| share * share / c.wheel_inertia);
        Self { direction, arm, spin, inverse: 1.0 / (c.body_mass_inverse + angular + spin_part) }
    }

    /// Of a point fixed to the body, along an inertial axis.
    #[inline(always)]
    fn of_body(c: &Constants<f64>, rotation: &Rotation<f64>, arm: Vec3<f64>, axis: usize) -> Self {
        Self::new(c, unit(axis), arm.cross(rotation.rows[axis]), None)
    }

    /// Of the lowest point of wheel `i`, which turns about its axle with its own spin, not the body's.
    #[inline(always)]
    fn of_wheel(c: &Constants<f64>, rotation: &Rotation<f64>, i: usize, axis: usize) -> Self {
        let u = c.u(i, 0.0);
        let across = rotation.rows[2].cross(rotation.rows[axis]);
        let along = across.dot(u);
        let arm = c.wheel_center(i, 0.0).cross(rotation.rows[axis]) - (across - u * along) * c.wheel_radius;
        Self::new(c, unit(axis), arm, Some((i, along * c.wheel_radius)))
    }

    /// What a unit impulse of another row of the same point, across it, does to this one.
    #[inline(always)]
    fn coupling(&self, c: &Constants<f64>, other: &Self) -> f64 {
        let spin_part = self.spin.zip(other.spin).map_or(0.0, |((_, a), (_, b))| a * b / c.wheel_inertia);
        self.arm.scaled_by(c.body_inertia_inverse).dot(other.arm) + spin_part
    }

    #[inline(always)]
    fn speed(&self, v: &Velocities<f64>) -> f64 {
        let spin_part = self.spin.map_or(0.0, |(i, share)| share * v.spins[i]);
        self.direction.dot(v.body) + self.arm.dot(v.body_rate) + spin_part
    }

    #[inline(always)]
    fn push(&self, c: &Constants<f64>, impulse: f64, v: &mut Velocities<f64>) {
        v.body = v.body.plus(self.direction, impulse * c.body_mass_inverse);
        v.body_rate += self.arm.scaled_by(c.body_inertia_inverse) * impulse;
        if let Some((i, share)) = self.spin {
            v.spins[i] += share * impulse / c.wheel_inertia;
        }
    }
}

/// The inertial axis 0 x, 1 y or 2 z.
#[inline(always)]
fn unit(axis: usize) -> Vec3<f64> {
    let mut values = [0.0; 3];
    values[axis] = 1.0;
    values.into()
}

/// A point of the bot over the floor.
struct Point {
    gap: f64,
    /// Normal, x, y; likewise the impulses.
    rows: [Row; 3],
    /// 1 / (the most that a unit impulse along the floor does to the velocity along it).
    tangent_inverse: f64,
    impulses: [f64; 3],
}

/// The inertial axes of a point's rows.
const AXES: [usize; 3] = [2, 0, 1];

#[inline(always)]
fn points(c: &Constants<f64>, start: &Start<f64>) -> [Point; POINTS] {
    let rotation = &start.rotation;
    let height = |arm: Vec3<f64>| start.pose.body.z + rotation.rows[2].dot(arm);
    let wheel = |i: usize| {
        let gap = height(c.wheel_center(i, 0.0)) - c.wheel_radius;
        Point::new(c, gap, AXES.map(|axis| Row::of_wheel(c, rotation, i, axis)))
    };
    let lowest = lowest_direction(rotation);
    let rim = |end: f64, third: u32| {
        let angle = lowest + std::f64::consts::TAU * f64::from(third) / 3.0;
        let arm = Vec3::new(c.body_radius * angle.cos(), c.body_radius * angle.sin(), end);
        Point::new(c, height(arm), AXES.map(|axis| Row::of_body(c, rotation, arm, axis)))
    };
    std::array::from_fn(|k| match k {
        0..3 => wheel(k),
        3..6 => rim(c.body_bottom, k as u32 - 3),
        _ => rim(c.body_top, k as u32 - 6),
    })
}

/// Where, seen along the mast, down is: an azimuth in the body frame; 0 where the mast is vertical.
#[inline(always)]
fn lowest_direction(rotation: &Rotation<f64>) -> f64 {
    let up = rotation.rows[2];
    if up.x.hypot(up.y) < 1e-6 { 0.0 } else { (-up.y).atan2(-up.x) }
}

impl Point {
    #[inline(always)]
    fn new(c: &Constants<f64>, gap: f64, rows: [Row; 3]) -> Self {
        let [_, x, y] = &rows;
        // The larger eigenvalue of the pair's matrix: one number for both axes, or friction would not oppose the slip.
        let (xx, yy, xy) = (1.0 / x.inverse, 1.0 / y.inverse, x.coupling(c, y));
        let largest = 0.5 * (xx + yy) + (0.5 * (xx - yy)).hypot(xy);
        Self { gap, tangent_inverse: 1.0 / largest, rows, impulses: [0.0; 3] }
    }

    /// Improves the impulses of this point and changes both sets of velocities by them.
    #[inline(always)]
    fn sweep(&mut self, c: &Constants<f64>, friction: f64, velocities: [&mut Velocities<f64>; 2]) {
        let [now, free] = velocities;
        let [normal, x, y] = &self.rows;
        let approach = normal.speed(now) + allowance(c, self.gap);
        let pressed = (self.impulses[0] - approach * normal.inverse).max(0.0);
        for v in [&mut *now, &mut *free] {
            normal.push(c, pressed - self.impulses[0], v);
        }
        let stick = [
            self.impulses[1] - x.speed(now) * self.tangent_inverse,
            self.impulses[2] - y.speed(now) * self.tangent_inverse,
        ];
        let held = in_disc(stick, friction * pressed);
        for v in [now, free] {
            x.push(c, held[0] - self.impulses[1], v);
            y.push(c, held[1] - self.impulses[2], v);
        }
        self.impulses = [pressed, held[0], held[1]];
    }
}

/// The ball against the body's cylinder, without friction.
struct BallOnBody {
    gap: f64,
    /// From the body to the ball, inertial frame.
    normal: Vec3<f64>,
    /// Body frame.
    arm: Vec3<f64>,
    inverse: f64,
    impulse: f64,
}

impl BallOnBody {
    #[inline(always)]
    fn new(c: &Constants<f64>, start: &Start<f64>) -> Self {
        let ball = start.rows.ball_in_body;
        let radial = ball.x.hypot(ball.y);
        let share = if radial > c.body_radius { c.body_radius / radial } else { 1.0 };
        let nearest = Vec3::new(ball.x * share, ball.y * share, ball.z.clamp(c.body_bottom, c.body_top));
        let offset = ball - nearest;
        let distance = offset.norm_squared().sqrt();
        // A center inside the cylinder leaves by its lower end, where it came from.
        let normal = if distance > 0.0 { offset * distance.recip() } else { -unit(2) };
        let arm = normal.cross(nearest);
        let angular = arm.scaled_by(c.body_inertia_inverse).dot(arm);
        Self {
            gap: distance - c.ball_radius,
            normal: start.rotation.apply(normal),
            arm,
            inverse: 1.0 / (angular + c.body_mass_inverse + c.ball_mass_inverse),
            impulse: 0.0,
        }
    }

    #[inline(always)]
    fn sweep(&mut self, c: &Constants<f64>, velocities: [&mut Velocities<f64>; 2]) {
        let [now, free] = velocities;
        let opening = self.normal.dot(now.ball - now.body) + self.arm.dot(now.body_rate);
        let pressed = (self.impulse - (opening + allowance(c, self.gap)) * self.inverse).max(0.0);
        let change = pressed - self.impulse;
        for v in [now, free] {
            v.ball = v.ball.plus(self.normal, change * c.ball_mass_inverse);
            v.body = v.body.plus(self.normal, -change * c.body_mass_inverse);
            v.body_rate += self.arm.scaled_by(c.body_inertia_inverse) * change;
        }
        self.impulse = pressed;
    }
}
