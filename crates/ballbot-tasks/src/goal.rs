//! The goal task: go to points on the floor, and stay there.

use super::shared::{action_rows, alive, body_rows, bounded_error, effort, squared_norm, velocity_rows};
use super::start::{check_range, drawn_steps, in_range, starts_and_falls, task_fields};
use super::{Geometry, Metric, Metrics, Moment, Row, Rows, Sensed, Step, Task, Term, Terms};
use ballbot_base::error::{Result, check};
use ballbot_base::fields::Limit;
use ballbot_base::lanes::{Heading, Lane, Memory};
use ballbot_base::params::Params;
use ballbot_base::setpoint::Setpoint;
use ballbot_models::fastest_move;
use nalgebra::Vector2;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

task_fields! {
    fall 30.0, tilt 5.0;
    /// Options of the goal task. SI units and radians. Tilts are from the equilibrium.
    pub struct Goal {
        /// Smallest and largest distance of a goal from the ball, uniform, in any direction.
        pub goal_distance: [f64; 2] = [0.5, 2.0], "m", Limit::from(0.0).to(100.0);
        /// Shortest and longest time from one goal to the next, uniform.
        pub goal_seconds: [f64; 2] = [6.0, 10.0], "s", Limit::above(0.0).to(1e9);
        /// Distance within which the ball is at its goal.
        pub goal_radius: f64 = 0.02, "m", Limit::from(1e-6).to(10.0);
        /// Deceleration a of the approach that costs nothing, with the speed d / (`approach_time` + √(d / 2a)) at distance d.
        pub approach_acceleration: f64 = 0.6, "m/s²", Limit::above(0.0).to(100.0);
        /// Time constant of the end of that approach.
        pub approach_time: f64 = 0.25, "s", Limit::above(0.0).to(100.0);
        /// How long the ball must have been at its goal when the next goal is given.
        pub hold_seconds: f64 = 1.0, "s", Limit::from(0.0).to(1e9);
    }
}

/// Memory: the goal, the steps since it was given, the last consecutive steps at the goal, the time of the fastest move
/// there, goals that are over, goals held, and the sum over held goals of the time divided by the time of the fastest
/// move.
const GOAL: [usize; 2] = [0, 1];
const SINCE: usize = 2;
const HELD: usize = 3;
const FASTEST: usize = 4;
const OVER: usize = 5;
const REACHED: usize = 6;
const TIMES: usize = 7;

/// Distance to which the observed vector to the goal is shortened, m.
const HORIZON: f64 = 1.0;

impl Task for Goal {
    const NAME: &'static str = "goal";
    const ID: &'static str = "ballbot/Goal-v0";
    const SUMMARY: &'static str = "Go to points on the floor, and stay there.";
    const MAX_EPISODE_STEPS: usize = 2000;
    const REWARD_THRESHOLD: Option<f64> = Some(1450.0);
    const SUCCESS: &'static str =
        "not terminated, and every goal held within `goal_radius` for the last `hold_seconds` of its time";
    const GEOMETRY: Option<Geometry> = Some(Geometry::Point);
    const COMMAND: &'static [Row] =
        &[Row::new("goal, inertial x", "m", 1e4, 1.0), Row::new("goal, inertial y", "m", 1e4, 1.0)];
    const MEMORY: usize = 8;

    fn validate(&self, params: &Params) -> Result<()> {
        check_range("goal_distance", self.goal_distance)?;
        check_range("goal_seconds", self.goal_seconds)?;
        let shortest = self.goal_seconds[0];
        check("hold_seconds", self.hold_seconds, format_args!("at most goal_seconds[0] = {shortest}"), |s| {
            s <= shortest
        })?;
        self.starts().validate(params)
    }

    starts_and_falls!();

    fn command(&self, moment: &Moment<'_>, rng: &mut ChaCha8Rng, memory: &mut [f64]) -> f64 {
        let distance = in_range(rng, self.goal_distance);
        let (sin, cos) = (TAU * rng.random::<f64>()).sin_cos();
        let ball = moment.state.ball_position;
        memory[GOAL[0]] = distance.mul_add(cos, ball.x);
        memory[GOAL[1]] = distance.mul_add(sin, ball.y);
        drawn_steps(self.goal_seconds, moment.control_dt, rng)
    }

    fn commanded(&self, moment: &Moment<'_>, memory: &mut [f64]) {
        if self.counts(memory, moment.control_dt) {
            self.conclude(memory, moment.control_dt);
        }
        let ball = moment.state.ball_position;
        let distance = (memory[GOAL[0]] - ball.x).hypot(memory[GOAL[1]] - ball.y);
        memory[SINCE] = 0.0;
        memory[HELD] = 0.0;
        memory[FASTEST] = fastest_move(moment.params, distance).max(moment.control_dt);
    }

    fn setpoint(&self, memory: &[f64]) -> Setpoint {
        Setpoint { position: Vector2::new(memory[GOAL[0]], memory[GOAL[1]]), ..Setpoint::default() }
    }

    #[inline(always)]
    fn observe<L: Lane>(&self, sensed: &Sensed<'_, L>, memory: &Memory<'_, L>, rows: &mut impl Rows<L>) {
        let heading = Heading::new(sensed.state.body_quaternion);
        let position = sensed.state.ball_position;
        let [x, y] = heading.of(memory.get(GOAL[0]) - position.x, memory.get(GOAL[1]) - position.y);
        let distance = squared_norm([x, y]).sqrt();
        let shortened = x.splat(HORIZON) / distance.max(x.splat(HORIZON));
        body_rows(sensed, rows);
        rows.row(Row::new("goal from the ball, at most 1 m, heading x", "m", 1.0, 0.1), x * shortened);
        rows.row(Row::new("goal from the ball, at most 1 m, heading y", "m", 1.0, 0.1), y * shortened);
        rows.row(Row::new("distance of the goal", "m", 10.0, 1.0), distance);
        velocity_rows(sensed, &heading, rows);
        action_rows(sensed, rows);
    }

    #[inline(always)]
    fn advance<L: Lane>(&self, step: &Step<'_, L>, memory: &mut Memory<'_, L>) {
        let distance = squared_norm(Self::to_goal(step, memory));
        let near = distance.le(distance.splat(self.goal_radius * self.goal_radius));
        memory.set(SINCE, memory.get(SINCE) + 1.0);
        memory.set(HELD, L::select(near, memory.get(HELD) + 1.0, distance.zero()));
    }

    #[inline(always)]
    fn success<L: Lane>(&self, step: &Step<'_, L>, terminated: L::Mask, memory: &mut Memory<'_, L>) -> L::Mask {
        let (held, since, over) = (memory.get(HELD), memory.get(SINCE), memory.get(OVER));
        let is_held = held.splat(self.hold_steps(step.control_dt)).le(held);
        // A goal that was given shortly before the end had no time.
        let is_new = since.lt(since.splat(self.goal_seconds[0] / step.control_dt)) & over.zero().lt(over);
        !terminated & (is_held | is_new) & over.le(memory.get(REACHED))
    }

    #[inline(always)]
    fn reward<L: Lane>(
        &self,
        step: &Step<'_, L>,
        terminated: L::Mask,
        memory: &Memory<'_, L>,
        terms: &mut impl Terms<L>,
    ) {
        let to_goal = Self::to_goal(step, memory);
        let squared = squared_norm(to_goal);
        let distance = squared.sqrt();
        // Far away the speed of a constant deceleration, near the goal proportional to the distance.
        let pace = squared.splat(1.0) / ((distance / (2.0 * self.approach_acceleration)).sqrt() + self.approach_time);
        let velocity = step.state.ball_velocity;
        let excess = [velocity.x - to_goal[0] * pace, velocity.y - to_goal[1] * pace];
        alive(terminated, 1.0, step.tilt, terms);
        terms.term(
            Term::cost("approach", 0.4, "e² / (e² + (0.3 m/s)²), e the ball velocity minus the approach velocity"),
            bounded_error(squared_norm(excess), 0.3),
        );
        terms.term(Term::cost("distance", 0.2, "d / (d + 0.5 m)"), distance / (distance + 0.5));
        terms.term(Term::cost("position", 0.2, "d² / (d² + (0.05 m)²)"), bounded_error(squared, 0.05));
        effort(step, terms);
    }

    fn measure(&self, memory: &[f64], control_dt: f64, metrics: &mut impl Metrics) {
        let mut ended = [0.0; Self::MEMORY];
        ended.copy_from_slice(memory);
        if self.counts(memory, control_dt) {
            self.conclude(&mut ended, control_dt);
        }
        metrics.metric(
            Metric::new("goals_held", "", "fraction of the goals at which the ball was when the next goal was given"),
            ended[REACHED] / ended[OVER],
        );
        metrics.metric(
            Metric::new("time_ratio", "", "mean time to these goals, relative to the fastest flat move there"),
            ended[TIMES] / ended[REACHED],
        );
    }
}

impl Goal {
    /// `hold_seconds` in control steps.
    fn hold_steps(&self, control_dt: f64) -> f64 {
        (self.hold_seconds / control_dt).round().max(1.0)
    }

    /// Whether the current goal counts: it is held, or there was time for it.
    fn counts(&self, memory: &[f64], control_dt: f64) -> bool {
        memory[HELD] >= self.hold_steps(control_dt) || memory[SINCE] + 0.5 >= self.goal_seconds[0] / control_dt
    }

    /// Counts the current goal.
    fn conclude(&self, memory: &mut [f64], control_dt: f64) {
        memory[OVER] += 1.0;
        if memory[HELD] >= self.hold_steps(control_dt) {
            memory[REACHED] += 1.0;
            memory[TIMES] += (memory[SINCE] - memory[HELD] + 1.0) * control_dt / memory[FASTEST];
        }
    }

    /// Vector from the ball to the goal, m.
    #[inline(always)]
    fn to_goal<L: Lane>(step: &Step<'_, L>, memory: &Memory<'_, L>) -> [L; 2] {
        let position = step.state.ball_position;
        [memory.get(GOAL[0]) - position.x, memory.get(GOAL[1]) - position.y]
    }
}
