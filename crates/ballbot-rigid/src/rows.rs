//! The contacts of the ball as rows: wheels, floor, and the dry friction of the wheel joints.
//!
//! Vectors are in body axes, where the mass matrix of the bot is constant. A row has a velocity J ν that its impulse
//! changes: a gap's rate, a slip, a joint's rate.

use super::bot::{Bot, Coordinates, join, split};
use super::solve::{Coupling, FLOOR, JOINT, ROWS, TRACTION};
use ballbot_base::params::Params;
use ballbot_base::wheels::Wheels;
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

/// Smallest sine of the angle between axle and contact normal at which a wheel drives the ball.
const MIN_AXLE_SINE: f64 = 1e-3;

/// Radii of ball and wheels, m, and mass and inertia of the ball.
pub struct Parts {
    pub ball_radius: f64,
    pub wheel_radius: f64,
    /// Angle of the rollers' axes, rad.
    pub roller_angle: f64,
    pub ball_mass: f64,
    pub ball_inertia: f64,
}

/// The moving parts at the start of a step, in body axes.
pub struct Motion {
    /// Ball center from the root, m.
    pub ball: Vector3<f64>,
    pub velocities: Velocities,
    /// Gap between ball and floor, m.
    pub floor_gap: f64,
    /// Two tangents and the normal of the floor.
    pub floor_axes: [Vector3<f64>; 3],
    /// The normal in the inertial frame.
    pub floor_normal: Vector3<f64>,
    /// From the inertial frame to body axes.
    pub to_body: Matrix3<f64>,
}

/// Velocities or changes of velocity: of the bot, and linear and angular velocity of the ball, body axes.
#[derive(Clone, Copy)]
pub struct Velocities {
    pub bot: Coordinates,
    pub ball: [Vector3<f64>; 2],
}

impl Velocities {
    pub fn zeros() -> Self {
        Self { bot: Coordinates::zeros(), ball: [Vector3::zeros(); 2] }
    }

    /// Sum of this and `share` times `other`.
    pub fn plus(&self, other: &Self, share: f64) -> Self {
        Self { bot: self.bot + other.bot * share, ball: [0, 1].map(|i| self.ball[i] + other.ball[i] * share) }
    }
}

/// Contact of a wheel and the ball, body axes.
pub struct WheelContact {
    /// Unit vector from the ball center to the wheel center.
    pub normal: Vector3<f64>,
    /// Drive direction in the plane of contact, along the axis of the roller, unit vector.
    pub drive: Vector3<f64>,
    /// Gap between the surfaces, m; negative for an overlap.
    pub gap: f64,
    /// Change of the gap with the angle of the wheel, m/rad.
    slope: f64,
    /// Velocity of the wheel's surface relative to the ball's along the drive direction, m/s.
    pub slip: f64,
    /// Acceleration of the gap and of the slip at constant velocities: J̇ ν, m/s².
    curvature: [f64; 2],
    /// Rate of the drive row per joint rate, m.
    rim: f64,
    /// Speed of the rim along normal × drive per joint rate, m.
    pub free_rim: f64,
}

impl WheelContact {
    /// Contact of a wheel at its nominal radius.
    pub fn new(parts: &Parts, bot: &Bot, motion: &Motion, i: usize) -> Self {
        let (center, axle) = (&bot.centers[i], &bot.axles[i]);
        let [velocity, rate, joints] = split(&motion.velocities.bot);
        let [ball_velocity, ball_rate] = &motion.velocities.ball;
        let apart = center - motion.ball;
        let distance = apart.norm();
        let normal = apart / distance;
        // u × p = d with the axle along −u.
        let across = normal.cross(axle);
        let sine = across.norm();
        let drives = sine > MIN_AXLE_SINE;
        let mut drive = if drives { across / sine } else { Vector3::zeros() };

        let spin = axle * joints[i];
        let wheel_rate = rate + spin;
        let relative = velocity + rate.cross(center) - ball_velocity;
        let surface =
            relative - wheel_rate.cross(&normal) * parts.wheel_radius - ball_rate.cross(&normal) * parts.ball_radius;
        let normal_rate = (relative - normal * normal.dot(&relative)) / distance;
        let turning = normal_rate.cross(axle) + normal.cross(&rate.cross(axle));
        let mut drive_rate = if drives { (turning - drive * drive.dot(&turning)) / sine } else { Vector3::zeros() };
        let (mut rim, mut free_rim) = (parts.wheel_radius * sine, 0.0);
        if parts.roller_angle != 0.0 {
            let (sin, cos) = parts.roller_angle.sin_cos();
            drive_rate = drive_rate * cos + (normal_rate.cross(&drive) + normal.cross(&drive_rate)) * sin;
            drive = drive * cos + normal.cross(&drive) * sin;
            (rim, free_rim) = (rim * cos, -rim * sin);
        }
        let centripetal = rate.cross(&rate.cross(center));
        let of_wheel = wheel_rate.cross(&normal_rate) + rate.cross(&spin).cross(&normal);
        let of_surface =
            centripetal - of_wheel * parts.wheel_radius - ball_rate.cross(&normal_rate) * parts.ball_radius;
        Self {
            slip: drive.dot(&surface),
            curvature: [
                normal_rate.dot(&relative) + normal.dot(&centripetal),
                drive_rate.dot(&surface) + drive.dot(&of_surface),
            ],
            rim,
            free_rim,
            gap: distance - parts.ball_radius - parts.wheel_radius,
            slope: 0.0,
            normal,
            drive,
        }
    }

    /// The contact of a wheel whose rim has the ripple of `params`, at its angle and encoder rate.
    pub fn with_ripple(mut self, params: &Params, i: usize, angle: f64, rate: f64, dt: f64) -> Self {
        let (amplitude, count) = (0.5 * params.roller_ripple, params.roller_count);
        let (sin, cos) = count.mul_add(angle, params.roller_phases[i]).sin_cos();
        let depth = amplitude * (1.0 - cos);
        self.gap += depth;
        self.slope = amplitude * count * sin;
        // Half of the change: velocities are at the middles of steps, between which the slope changes.
        let bend = 0.5 * amplitude * cos * (count * rate).powi(2);
        // However far a wheel turns in a step, its rim ends within its range of depths.
        let turning = self.slope * rate;
        let [to_crest, to_notch] = [0.0, 2.0 * amplitude].map(|end| ((end - depth) / dt - turning) / dt);
        self.curvature[0] += bend.max(to_crest).min(to_notch);
        self
    }

    /// Force on root and torque on root and joint of unit impulses along normal and drive direction, and the arm of the
    /// drive impulse on the ball.
    fn wrenches(&self, parts: &Parts, bot: &Bot, i: usize) -> [(Coordinates, Vector3<f64>); 2] {
        let center = &bot.centers[i];
        let joint = |arm: f64| Vector3::ith(i, arm);
        let point = center - self.normal * parts.wheel_radius;
        [
            (join(&[self.normal, center.cross(&self.normal), joint(self.slope)]), Vector3::zeros()),
            (
                join(&[self.drive, point.cross(&self.drive), joint(self.rim)]),
                self.normal.cross(&self.drive) * parts.ball_radius,
            ),
        ]
    }
}

/// The rows of a step: force directions on bot and ball.
pub struct Rows {
    bot: SMatrix<f64, 9, ROWS>,
    ball_force: SMatrix<f64, 3, ROWS>,
    ball_torque: SMatrix<f64, 3, ROWS>,
    active: usize,
}

impl Rows {
    /// The rows of the contacts, and of the joints if `joints`.
    pub fn new(parts: &Parts, bot: &Bot, motion: &Motion, contacts: &Wheels<WheelContact>, joints: bool) -> Self {
        let mut rows = Self {
            bot: SMatrix::zeros(),
            ball_force: SMatrix::zeros(),
            ball_torque: SMatrix::zeros(),
            active: if joints { ROWS } else { JOINT },
        };
        for (i, contact) in contacts.iter().enumerate() {
            let [(normal, _), (drive, arm)] = contact.wrenches(parts, bot, i);
            rows.bot.set_column(i, &normal);
            rows.bot.set_column(TRACTION + i, &drive);
            rows.ball_force.set_column(i, &-contact.normal);
            rows.ball_force.set_column(TRACTION + i, &-contact.drive);
            rows.ball_torque.set_column(TRACTION + i, &-arm);
            rows.bot[(6 + i, JOINT + i)] = 1.0;
        }
        let [x, y, z] = motion.floor_axes;
        for (k, direction) in [z, x, y].into_iter().enumerate() {
            rows.ball_force.set_column(FLOOR + k, &direction);
            rows.ball_torque.set_column(FLOOR + k, &(z.cross(&direction) * -parts.ball_radius));
        }
        rows
    }

    /// Velocity of each row.
    pub fn speeds(&self, velocities: &Velocities) -> SVector<f64, ROWS> {
        let [ball_velocity, ball_rate] = &velocities.ball;
        self.bot.tr_mul(&velocities.bot) + self.ball_force.tr_mul(ball_velocity) + self.ball_torque.tr_mul(ball_rate)
    }

    /// Change of the velocity of each row per impulse of each row: J M⁻¹ Jᵀ.
    pub fn coupling(&self, parts: &Parts, bot: &Bot) -> Coupling {
        let mut coupling = Coupling::zeros();
        for a in 0..self.active {
            // The floor acts only on the ball.
            let of_bot = !(FLOOR..JOINT).contains(&a);
            let moved = if of_bot { bot.mass_inverse * self.bot.column(a) } else { Coordinates::zeros() };
            let push = self.ball_force.column(a) / parts.ball_mass;
            let turn = self.ball_torque.column(a) / parts.ball_inertia;
            for b in a..self.active {
                let mut sum = self.ball_force.column(b).dot(&push) + self.ball_torque.column(b).dot(&turn);
                if of_bot && !(FLOOR..JOINT).contains(&b) {
                    sum += self.bot.column(b).dot(&moved);
                }
                coupling[(a, b)] = sum;
                coupling[(b, a)] = sum;
            }
        }
        coupling
    }

    /// Rows from this index on are absent.
    pub fn active(&self) -> usize {
        self.active
    }

    /// Generalized impulse on the bot.
    pub fn on_bot(&self, impulses: &SVector<f64, ROWS>) -> Coordinates {
        self.bot * impulses
    }

    /// Impulse and angular impulse of the wheels on the ball, body axes.
    pub fn on_ball(&self, impulses: &SVector<f64, ROWS>) -> [Vector3<f64>; 2] {
        let wheels = impulses.fixed_rows::<FLOOR>(0);
        [self.ball_force, self.ball_torque].map(|arms| arms.fixed_columns::<FLOOR>(0) * wheels)
    }
}

/// Velocities that the rows must compensate over a step of `dt`, in addition to the velocities of the parts.
///
/// A gap may close within the step, an overlap recovers at the rate `erp`. J̇ ν makes the velocities meet the
/// constraints at the end of the step, so that the loads include their centripetal part from the first step on.
pub fn biases(contacts: &Wheels<WheelContact>, floor_gap: f64, erp: f64, fastest: f64, dt: f64) -> SVector<f64, ROWS> {
    let closing = |gap: f64| if gap > 0.0 { gap / dt } else { (gap * erp).max(-fastest) };
    let mut biases = SVector::zeros();
    for (i, contact) in contacts.iter().enumerate() {
        biases[i] = closing(contact.gap) + contact.curvature[0] * dt;
        biases[TRACTION + i] = contact.curvature[1] * dt;
    }
    biases[FLOOR] = closing(floor_gap);
    biases
}
