//! The rows of a robot with rolling, spinning or roller friction, for [`crate::sim::losses`].
//!
//! Vectors are in body axes, as in `rows`. Rates of the ball and of the joints are in the units of the other rows: speeds
//! of the ball's surface and of the rims.

use super::bot::{Bot, Coordinates, join};
use super::rows::{Motion, Parts, Rows, Velocities, WheelContact};
use super::solve::{
    Coupling, FLOOR as PLAIN_FLOOR, Impulses, JOINT as PLAIN_JOINT, Limits, ROWS as PLAIN_ROWS, Settling,
};
use crate::lanes::run_one;
use crate::params::Params;
use crate::sim::losses::{Bounds, FLOOR, JOINT, NORMAL, Present, Problem, ROLLER, ROWS, TORQUE};
use nalgebra::{SMatrix, SVector, Vector3};

/// Number of rows besides those of robots without losses: three rates of the ball, three wheels along their free
/// directions.
const EXTRA: usize = 6;

/// Impulses of these rows, N·s.
pub type Extra = SVector<f64, EXTRA>;

/// The rows besides those of robots without losses: force directions on bot and ball.
pub struct LossRows {
    bot: SMatrix<f64, 9, EXTRA>,
    ball_force: SMatrix<f64, 3, EXTRA>,
    ball_torque: SMatrix<f64, 3, EXTRA>,
    /// Friction coefficients of the rollers.
    rollers: [f64; 3],
}

/// Where a row of a robot without losses is among all rows.
fn place(row: usize) -> usize {
    match row {
        0..PLAIN_FLOOR => NORMAL + row,
        PLAIN_FLOOR..PLAIN_JOINT => FLOOR + row - PLAIN_FLOOR,
        _ => JOINT + row - PLAIN_JOINT,
    }
}

/// Speed of a row of a robot without losses among all rows, per speed of its own.
fn scale(parts: &Parts, row: usize) -> f64 {
    if row < PLAIN_JOINT { 1.0 } else { parts.wheel_radius }
}

impl LossRows {
    /// The rows at the start of a step, and the rollers' friction at the speeds then, at most `limits` of the wheels.
    pub fn new(
        (params, parts): (&Params, &Parts),
        bot: &Bot,
        motion: &Motion,
        contacts: &[WheelContact; 3],
        limits: &Limits,
    ) -> Self {
        let mut rows = Self {
            bot: SMatrix::zeros(),
            ball_force: SMatrix::zeros(),
            ball_torque: SMatrix::zeros(),
            rollers: limits.wheels,
        };
        for (i, contact) in contacts.iter().enumerate() {
            rows.ball_torque.set_column(TORQUE + i, &(motion.to_body.column(i) * parts.ball_radius));
            let free = contact.normal.cross(&contact.drive);
            let point = bot.centers[i] - contact.normal * parts.wheel_radius;
            rows.bot.set_column(ROLLER + i, &join(&[free, point.cross(&free), Vector3::zeros()]));
            rows.ball_force.set_column(ROLLER + i, &-free);
            rows.ball_torque.set_column(ROLLER + i, &(contact.drive * parts.ball_radius));
        }
        let speeds = rows.speeds(&motion.velocities);
        for (i, friction) in rows.rollers.iter_mut().enumerate() {
            let speed = speeds[ROLLER + i].abs();
            *friction = (params.roller_friction + params.roller_friction_slope * speed).min(*friction);
        }
        rows
    }

    fn speeds(&self, velocities: &Velocities) -> Extra {
        let [ball_velocity, ball_rate] = &velocities.ball;
        self.bot.tr_mul(&velocities.bot) + self.ball_force.tr_mul(ball_velocity) + self.ball_torque.tr_mul(ball_rate)
    }

    /// Generalized impulse on the bot.
    pub fn on_bot(&self, impulses: &Extra) -> Coordinates {
        self.bot * impulses
    }

    /// Impulse and angular impulse on the ball, body axes.
    pub fn on_ball(&self, impulses: &Extra) -> [Vector3<f64>; 2] {
        [self.ball_force * impulses, self.ball_torque * impulses]
    }

    /// The impulses of a step: those of `plain`, the rows of robots without losses with their `coupling` and `residual`
    /// speeds, from `start`, and of these rows at the `velocities` without impulses.
    pub fn solve(
        &self,
        (params, parts, bot): (&Params, &Parts, &Bot),
        (plain, coupling, residual): (&Rows, &Coupling, &Impulses),
        (limits, dt): (&Limits, f64),
        velocities: &Velocities,
        start: &Impulses,
    ) -> (Impulses, Extra, Settling) {
        let mut w = [[0.0; ROWS]; ROWS];
        let mut residuals = [0.0; ROWS];
        let mut warm = [0.0; ROWS];
        for a in 0..PLAIN_ROWS {
            let unit = scale(parts, a);
            residuals[place(a)] = residual[a] * unit;
            warm[place(a)] = start[a] / unit;
            for b in 0..PLAIN_ROWS {
                w[place(a)][place(b)] = coupling[(a, b)] * unit * scale(parts, b);
            }
        }
        let moved = bot.mass_inverse * self.bot;
        let (push, turn) = (self.ball_force / parts.ball_mass, self.ball_torque / parts.ball_inertia);
        let own = self.bot.tr_mul(&moved) + self.ball_force.tr_mul(&push) + self.ball_torque.tr_mul(&turn);
        let crossed = plain.speeds_of(&moved, &push, &turn);
        let speeds = self.speeds(velocities);
        for k in 0..EXTRA {
            residuals[k] = speeds[k];
            for j in 0..EXTRA {
                w[k][j] = own[(k, j)];
            }
            for b in 0..PLAIN_ROWS {
                w[k][place(b)] = crossed[(b, k)] * scale(parts, b);
                w[place(b)][k] = w[k][place(b)];
            }
        }
        let bounds = Bounds {
            floor: limits.floor,
            wheels: limits.wheels,
            rollers: self.rollers,
            rolling: params.floor_rolling_friction / parts.ball_radius,
            spinning: params.floor_spinning_friction / parts.ball_radius,
            dry: limits.joint / parts.wheel_radius,
            // Rapier's joints have it.
            viscous: 0.0,
        };
        let rates = bounds.rolling > 0.0 || bounds.spinning > 0.0;
        let present = Present::new(rates, self.rollers.iter().any(|&friction| friction > 0.0), limits.joint > 0.0);
        let problem = Problem::new(w, residuals, bounds, present, params.static_wheel_load() * dt);
        let solution = run_one(
            #[inline(always)]
            || problem.solution(&warm, true),
        );
        let all = solution.impulses;
        let plain = Impulses::from_fn(|row, _| all[place(row)] * scale(parts, row));
        let settling = if solution.unsolved { Settling::Unsolved } else { Settling::AtOnce };
        (plain, Extra::from_fn(|row, _| all[row]), settling)
    }
}
