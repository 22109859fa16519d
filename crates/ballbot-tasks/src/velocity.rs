//! The velocity task: follow a commanded velocity of the ball and rate of the heading.

use super::heading_motion::{self, HeadingMotion};
use super::shared::{action_rows, alive, body_rows, bounded_error, effort, squared_norm, velocity_rows};
use super::start::{check_range, drawn_steps, in_disc, starts_and_falls, task_fields};
use super::{Geometry, Metric, Metrics, Moment, Row, Rows, Sensed, Step, Task, Term, Terms};
use ballbot_base::error::{Result, check};
use ballbot_base::fields::Limit;
use ballbot_base::lanes::{Heading, Lane, Memory};
use ballbot_base::params::Params;
use ballbot_base::setpoint::Setpoint;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

task_fields! {
    fall 30.0, tilt 5.0;
    /// Options of the velocity task. SI units and radians. Tilts are from the equilibrium.
    pub struct Velocity {
        /// Largest commanded speed; uniform over the disc, in the heading frame.
        pub speed: f64 = 0.5, "m/s", Limit::from(0.0).to(10.0), scaled;
        /// Largest commanded rate of the heading; uniform within ± this.
        pub yaw_rate: f64 = 1.0, "rad/s", Limit::from(0.0).to(10.0), scaled;
        /// Fraction of zero commands.
        pub standing: f64 = 0.1, "", Limit::from(0.0).to(1.0);
        /// Shortest and longest time from one command to the next, uniform.
        pub command_seconds: [f64; 2] = [3.0, 8.0], "s", Limit::above(0.0).to(1e9), scaled;
        /// The motion that a controller tracks follows the command with three poles at minus this value.
        pub smoothing: f64 = 3.5, "1/s", Limit::above(0.0).to(1e3), scaled;
        /// Time after a command from which its errors are counted.
        pub settling: f64 = 2.5, "s", Limit::from(0.0).to(1e9), scaled;
        /// Error of the velocity that costs half of `velocity`, and of `velocity_precision`.
        pub velocity_scales: [f64; 2] = [0.2, 0.04], "m/s", Limit::from(1e-6).to(10.0), scaled;
        /// Error of the heading's rate that costs half of `yaw_rate`, and of `yaw_rate_precision`.
        pub yaw_rate_scales: [f64; 2] = [0.5, 0.1], "rad/s", Limit::from(1e-6).to(10.0), scaled;
        /// Largest root mean square of the settled errors of the velocity in a success.
        pub success_velocity: f64 = 0.02, "m/s", Limit::above(0.0).to(10.0), scaled;
        /// Largest root mean square of the settled errors of the heading's rate in a success.
        pub success_yaw_rate: f64 = 0.05, "rad/s", Limit::above(0.0).to(10.0), scaled;
    }
}

/// Memory: the command, the steps since it, sums of the squared settled errors with their count, and the smoothed
/// commanded motion, [`HeadingMotion`].
const COMMAND: usize = 0;
const SINCE: usize = 3;
const VELOCITY_ERRORS: usize = 4;
const YAW_RATE_ERRORS: usize = 5;
const SETTLED: usize = 6;
pub(super) const POSITION: usize = 7;
pub(super) const MOTION: usize = 9;

impl Task for Velocity {
    const NAME: &'static str = "velocity";
    const ID: &'static str = "ballbot/Velocity-v0";
    const SUMMARY: &'static str = "Follow a commanded velocity of the ball and rate of the heading.";
    const MAX_EPISODE_STEPS: usize = 2000;
    const REWARD_THRESHOLD: Option<f64> = Some(1700.0);
    const ANYWHERE: bool = true;
    const SUCCESS: &'static str =
        "not terminated, and the settled errors within `success_velocity` and `success_yaw_rate`";
    const GEOMETRY: Option<Geometry> = Some(Geometry::Velocity);
    const COMMAND: &'static [Row] = &[
        Row::new("commanded velocity, heading x", "m/s", 10.0, 0.2),
        Row::new("commanded velocity, heading y", "m/s", 10.0, 0.2),
        Row::new("commanded rate of the heading", "rad/s", 10.0, 0.5),
    ];
    const MEMORY: usize = POSITION + heading_motion::LEN;

    fn validate(&self, params: &Params) -> Result<()> {
        check_range("command_seconds", self.command_seconds)?;
        let longest = self.command_seconds[1];
        check("settling", self.settling, format_args!("below command_seconds[1] = {longest}"), |s| s < longest)?;
        self.starts().validate(params)
    }

    starts_and_falls!();

    fn command(&self, moment: &Moment<'_>, rng: &mut ChaCha8Rng, memory: &mut [f64]) -> f64 {
        let velocity = in_disc(rng, self.speed);
        let yaw_rate = self.yaw_rate * (2.0 * rng.random::<f64>() - 1.0);
        let moving = if rng.random::<f64>() < self.standing { 0.0 } else { 1.0 };
        memory[COMMAND..COMMAND + 3].copy_from_slice(&[velocity.x * moving, velocity.y * moving, yaw_rate * moving]);
        drawn_steps(self.command_seconds, moment.control_dt, rng)
    }

    fn commanded(&self, moment: &Moment<'_>, memory: &mut [f64]) {
        memory[SINCE] = 0.0;
        HeadingMotion(POSITION).begin(moment, memory);
    }

    /// The smoothed commanded motion.
    fn setpoint(&self, memory: &[f64]) -> Setpoint {
        HeadingMotion(POSITION).setpoint(memory, memory[COMMAND + 2], |i, velocity, first, second| {
            third_derivative(self.smoothing, memory[COMMAND + i], velocity, first, second)
        })
    }

    #[inline(always)]
    fn observe<L: Lane>(&self, sensed: &Sensed<'_, L>, memory: &Memory<'_, L>, rows: &mut impl Rows<L>) {
        let heading = Heading::new(sensed.state.body_quaternion);
        let velocity = sensed.state.ball_velocity;
        let [vx, vy] = heading.of(velocity.x, velocity.y);
        let [x, y, yaw_rate] = memory.get3(COMMAND);
        let up = sensed.state.body_quaternion.rotation().rows[2];
        let turning = up.dot(sensed.state.body_angular_velocity);
        body_rows(sensed, rows);
        velocity_rows(sensed, &heading, rows);
        rows.row(Self::COMMAND[0], x);
        rows.row(Self::COMMAND[1], y);
        rows.row(Self::COMMAND[2], yaw_rate);
        rows.row(Row::new("error of the velocity, heading x", "m/s", 10.0, 0.1), x - vx);
        rows.row(Row::new("error of the velocity, heading y", "m/s", 10.0, 0.1), y - vy);
        rows.row(Row::new("error of the heading's rate", "rad/s", 10.0, 0.2), yaw_rate - turning);
        action_rows(sensed, rows);
    }

    #[inline(always)]
    fn advance<L: Lane>(&self, step: &Step<'_, L>, memory: &mut Memory<'_, L>) {
        let dt = step.control_dt;
        let since = memory.get(SINCE) + 1.0;
        memory.set(SINCE, since);
        let settled = since.splat(self.settling / dt).lt(since);
        let (one, zero) = (since.splat(1.0), since.zero());
        let [velocity, yaw_rate] = self.squared_errors(step, memory);
        memory.set(VELOCITY_ERRORS, memory.get(VELOCITY_ERRORS) + L::select(settled, velocity, zero));
        memory.set(YAW_RATE_ERRORS, memory.get(YAW_RATE_ERRORS) + L::select(settled, yaw_rate, zero));
        memory.set(SETTLED, memory.get(SETTLED) + L::select(settled, one, zero));

        let [x, y, rate] = memory.get3(COMMAND);
        HeadingMotion(POSITION).advance(
            memory,
            rate,
            dt,
            #[inline(always)]
            |i, velocity, first, second| {
                third_derivative(self.smoothing, if i == 0 { x } else { y }, velocity, first, second)
            },
        );
    }

    #[inline(always)]
    fn success<L: Lane>(&self, _: &Step<'_, L>, terminated: L::Mask, memory: &mut Memory<'_, L>) -> L::Mask {
        let settled = memory.get(SETTLED);
        let [velocity, yaw_rate] = [self.success_velocity, self.success_yaw_rate];
        !terminated
            & settled.zero().lt(settled)
            & memory.get(VELOCITY_ERRORS).le(settled * (velocity * velocity))
            & memory.get(YAW_RATE_ERRORS).le(settled * (yaw_rate * yaw_rate))
    }

    #[inline(always)]
    fn reward<L: Lane>(
        &self,
        step: &Step<'_, L>,
        terminated: L::Mask,
        memory: &Memory<'_, L>,
        terms: &mut impl Terms<L>,
    ) {
        let [velocity, yaw_rate] = self.squared_errors(step, memory);
        let ([coarse, fine], [slow, exact]) = (self.velocity_scales, self.yaw_rate_scales);
        alive(terminated, 1.0, step.tilt, terms);
        terms.term(
            Term::cost("velocity", 0.4, "e² / (e² + velocity_scales[0]²), e the error of the velocity"),
            bounded_error(velocity, coarse),
        );
        terms.term(
            Term::cost("velocity_precision", 0.25, "e² / (e² + velocity_scales[1]²)"),
            bounded_error(velocity, fine),
        );
        terms.term(
            Term::cost("yaw_rate", 0.15, "e² / (e² + yaw_rate_scales[0]²), e the error of the heading's rate"),
            bounded_error(yaw_rate, slow),
        );
        terms.term(
            Term::cost("yaw_rate_precision", 0.1, "e² / (e² + yaw_rate_scales[1]²)"),
            bounded_error(yaw_rate, exact),
        );
        effort(step, terms);
    }

    fn measure(&self, memory: &[f64], _: f64, metrics: &mut impl Metrics) {
        let mean = |sum: usize| (memory[sum] / memory[SETTLED]).sqrt();
        metrics.metric(
            Metric::new("velocity_error", "m/s", "root mean square of the settled errors of the velocity"),
            mean(VELOCITY_ERRORS),
        );
        metrics.metric(
            Metric::new("yaw_rate_error", "rad/s", "root mean square of the settled errors of the heading's rate"),
            mean(YAW_RATE_ERRORS),
        );
    }
}

/// Third derivative of a velocity that follows its command with three poles at −`p`.
#[inline(always)]
pub(super) fn third_derivative<L: Lane>(p: f64, command: L, velocity: L, first: L, second: L) -> L {
    (command - velocity) * (p * p * p) - first * (3.0 * p * p) - second * (3.0 * p)
}

impl Velocity {
    /// Squared errors of velocity, (m/s)², and of the rate of the heading, (rad/s)².
    #[inline(always)]
    fn squared_errors<L: Lane>(&self, step: &Step<'_, L>, memory: &Memory<'_, L>) -> [L; 2] {
        let velocity = step.state.ball_velocity;
        let [vx, vy] = Heading::new(step.state.body_quaternion).of(velocity.x, velocity.y);
        let [x, y, rate] = memory.get3(COMMAND);
        let turning = step.up.dot(step.state.body_angular_velocity);
        [squared_norm([vx - x, vy - y]), (turning - rate).squared()]
    }
}
