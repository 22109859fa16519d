//! The balance task: keep the robot upright and the ball at the setpoint.

use super::shared::{action_rows, alive, body_rows, bounded_error, effort, squared_norm, velocity_rows};
use super::start::{starts_and_falls, task_fields};
use super::{Row, Rows, Sensed, Step, Task, Term, Terms};
use ballbot_base::error::Result;
use ballbot_base::fields::Limit;
use ballbot_base::lanes::{Heading, Lane, Memory};
use ballbot_base::params::Params;
use ballbot_base::setpoint::Setpoint;
use std::f64::consts::PI;

task_fields! {
    fall 20.0, tilt 5.0;
    /// Options of the balance task. SI units and radians. Tilts are from the equilibrium: of the line from the ball's center
    /// to the body's center of mass, which is the mast of a symmetric robot.
    pub struct Balance {
        /// Where the ball should be.
        pub setpoint: [f64; 2] = [0.0; 2], "m", Limit::from(-1e4).to(1e4);
        /// The end of the episode over which success is judged.
        pub success_window: f64 = 2.0, "s", Limit::from(0.0).to(1e9);
        /// Largest tilt from the equilibrium in that window.
        pub success_tilt: f64 = 1.0_f64.to_radians(), "rad", Limit::above(0.0).to(PI);
        /// Largest distance of the ball from the setpoint in that window.
        pub success_radius: f64 = 0.1, "m", Limit::from(1e-12).to(1e6);
    }
}

/// Rate about the mast that costs half the maximum, rad/s.
const YAW_RATE_SCALE: f64 = 0.02;

/// Consecutive steps so far within the bounds of success.
const GOOD_STEPS: usize = 0;

impl Task for Balance {
    const NAME: &'static str = "balance";
    const ID: &'static str = "ballbot/Balance-v0";
    const SUMMARY: &'static str = "Keep a ballbot upright with its ball at the setpoint.";
    const REWARD_THRESHOLD: Option<f64> = Some(950.0);
    const SUCCESS: &'static str = "not terminated, and over the last `success_window` tilt within `success_tilt` and ball within `success_radius`";
    const MEMORY: usize = 1;

    fn validate(&self, params: &Params) -> Result<()> {
        self.starts().validate(params)
    }

    starts_and_falls!();

    fn setpoint(&self, _: &[f64]) -> Setpoint {
        Setpoint { position: self.setpoint.into(), ..Setpoint::default() }
    }

    #[inline(always)]
    fn observe<L: Lane>(&self, sensed: &Sensed<'_, L>, _: &Memory<'_, L>, rows: &mut impl Rows<L>) {
        // Nothing depends on the position of the setpoint or the heading of the robot.
        let heading = Heading::new(sensed.state.body_quaternion);
        let position = sensed.state.ball_position;
        let [x, y] = heading.of(position.x - self.setpoint[0], position.y - self.setpoint[1]);
        body_rows(sensed, rows);
        rows.row(Row::new("ball position from the setpoint, heading x", "m", 10.0, 0.1), x);
        rows.row(Row::new("ball position from the setpoint, heading y", "m", 10.0, 0.1), y);
        velocity_rows(sensed, &heading, rows);
        action_rows(sensed, rows);
    }

    #[inline(always)]
    fn success<L: Lane>(&self, step: &Step<'_, L>, terminated: L::Mask, memory: &mut Memory<'_, L>) -> L::Mask {
        let zero = step.tilt.zero();
        let near = self.distance_squared(step).le(zero.splat(self.success_radius * self.success_radius));
        let good = !terminated & near & step.tilt.le(zero.splat(self.success_tilt));
        let good_steps = L::select(good, memory.get(GOOD_STEPS) + 1.0, zero);
        memory.set(GOOD_STEPS, good_steps);
        // The last step is always in the window.
        let window = (self.success_window / step.control_dt).round().max(1.0);
        !terminated & zero.splat(window).le(good_steps)
    }

    #[inline(always)]
    fn reward<L: Lane>(&self, step: &Step<'_, L>, terminated: L::Mask, _: &Memory<'_, L>, terms: &mut impl Terms<L>) {
        let position = "d² / (d² + success_radius²), d the distance of the ball from the setpoint";
        self.reward_of(step, terminated, position, terms);
    }
}

impl Balance {
    /// The reward, with the formula of its term for the position.
    #[inline(always)]
    pub(super) fn reward_of<L: Lane>(
        &self,
        step: &Step<'_, L>,
        terminated: L::Mask,
        position: &'static str,
        terms: &mut impl Terms<L>,
    ) {
        let one = step.tilt.splat(1.0);
        let velocity = step.state.ball_velocity;
        alive(terminated, 1.0, one, terms);
        terms.term(
            Term::cost("tilt", 1.0, "(tilt / fall_tilt)², at most 1"),
            (step.tilt / self.fall_tilt).squared().min(one),
        );
        terms.term(
            Term::cost("position", 0.5, position),
            bounded_error(self.distance_squared(step), self.success_radius),
        );
        terms.term(
            Term::cost("velocity", 0.2, "squared ball speed in m/s, at most 1"),
            squared_norm([velocity.x, velocity.y]).min(one),
        );
        terms.term(
            Term::cost("yaw_rate", 0.0, "w² / (w² + 0.02²), w the body rate about the mast in rad/s"),
            bounded_error(step.state.body_angular_velocity.z.squared(), YAW_RATE_SCALE),
        );
        effort(step, terms);
    }

    /// Squared distance of the ball from the setpoint, m².
    #[inline(always)]
    pub(super) fn distance_squared<L: Lane>(&self, step: &Step<'_, L>) -> L {
        let position = step.state.ball_position;
        squared_norm([position.x - self.setpoint[0], position.y - self.setpoint[1]])
    }
}
