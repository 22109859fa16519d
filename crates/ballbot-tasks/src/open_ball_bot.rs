//! The task of OpenBallBot-RL (Salehi, "Reinforcement Learning for Ballbot Navigation in Uneven Terrain", arXiv 2505.18417,
//! 2025): go far in one direction over random hills without a fall.

use super::shared::{action_rows, body_rows, velocity_rows};
use super::start::{starts_and_falls, task_fields};
use super::{Metric, Metrics, Moment, Row, Rows, Sensed, Step, Task, Term, Terms};
use ballbot_base::error::Result;
use ballbot_base::fields::Limit;
use ballbot_base::lanes::{Heading, Lane, Memory};
use ballbot_base::params::Params;
use ballbot_base::setpoint::Setpoint;
use ballbot_base::terrain::Terrain;
use ballbot_base::wheels::Wheels;
use nalgebra::Vector2;
use std::sync::Arc;

task_fields! {
    fall 20.0, tilt 2.0;
    /// Options of the OpenBallBot task. SI units and radians. Tilts are from the equilibrium.
    pub struct OpenBallBot {
        /// Speed in the direction of travel that a classical controller is to keep.
        pub speed: f64 = 0.5, "m/s", Limit::from(0.0).to(10.0);
        /// Acceleration to that speed.
        pub acceleration: f64 = 0.3, "m/s²", Limit::above(0.0).to(1e6);
    }
}

/// Memory: distance of the ball, m; the time, s; position and speed of a controller's setpoint.
const TRAVELLED: usize = 0;
const TIME: usize = 1;
const SETPOINT: usize = 2;
const SETPOINT_SPEED: usize = 4;

/// Time step of the published rewards, s: the published rewards are sums over steps of this length.
const PUBLISHED_DT: f64 = 0.002;

/// 95th percentile of the slope of the published terrains, rad, and the wavelength, m, that gives this slope with
/// heights within 0.1 m.
const SLOPE: f64 = 0.272;
const WAVELENGTH: f64 = 0.8;

impl Task for OpenBallBot {
    const NAME: &'static str = "openballbot";
    const ID: &'static str = "ballbot/OpenBallBot-v0";
    const SUMMARY: &'static str = "Go along the inertial y axis over random hills without a fall.";
    const MAX_EPISODE_STEPS: usize = 800;
    const REWARD_THRESHOLD: Option<f64> = Some(85.5);
    const SUCCESS: &'static str = "not terminated";
    const ANYWHERE: bool = true;
    const HAS_TERRAIN: bool = true;
    const MEMORY: usize = SETPOINT_SPEED + 1;

    fn validate(&self, params: &Params) -> Result<()> {
        self.starts().validate(params)
    }

    starts_and_falls!();

    fn terrain(&self, _: &Params) -> Result<Option<Arc<Terrain>>> {
        let parameters = [("slope", SLOPE), ("wavelength", WAVELENGTH), ("tiles", 5.0), ("tile", 24.0)];
        Terrain::shared("hills", 0, &parameters).map(Some)
    }

    fn commanded(&self, moment: &Moment<'_>, memory: &mut [f64]) {
        let ball = moment.state.ball_position;
        memory[SETPOINT..SETPOINT + 2].copy_from_slice(&[ball.x, ball.y]);
    }

    fn setpoint(&self, memory: &[f64]) -> Setpoint {
        Setpoint {
            position: Vector2::new(memory[SETPOINT], memory[SETPOINT + 1]),
            velocity: Vector2::new(0.0, memory[SETPOINT_SPEED]),
            ..Setpoint::default()
        }
    }

    #[inline(always)]
    fn observe<L: Lane>(&self, sensed: &Sensed<'_, L>, _: &Memory<'_, L>, rows: &mut impl Rows<L>) {
        let heading = Heading::new(sensed.state.body_quaternion);
        body_rows(sensed, rows);
        velocity_rows(sensed, &heading, rows);
        rows.row(Row::new("direction of travel, heading x", "", 1.0, 1.0), heading.sin);
        rows.row(Row::new("direction of travel, heading y", "", 1.0, 1.0), heading.cos);
        action_rows(sensed, rows);
    }

    #[inline(always)]
    fn advance<L: Lane>(&self, step: &Step<'_, L>, memory: &mut Memory<'_, L>) {
        let dt = step.control_dt;
        memory.set(TRAVELLED, memory.get(TRAVELLED) + step.state.ball_velocity.y * dt);
        memory.set(TIME, memory.get(TIME) + dt);
        let speed = memory.get(SETPOINT_SPEED);
        let speed = (speed + self.acceleration * dt).min(speed.splat(self.speed));
        memory.set(SETPOINT_SPEED, speed);
        memory.set(SETPOINT + 1, memory.get(SETPOINT + 1) + speed * dt);
    }

    #[inline(always)]
    fn success<L: Lane>(&self, _: &Step<'_, L>, terminated: L::Mask, _: &mut Memory<'_, L>) -> L::Mask {
        !terminated
    }

    #[inline(always)]
    fn reward<L: Lane>(&self, step: &Step<'_, L>, terminated: L::Mask, _: &Memory<'_, L>, terms: &mut impl Terms<L>) {
        let zero = step.tilt.zero();
        let steps = zero.splat(step.control_dt / PUBLISHED_DT);
        let Wheels([a, b, c]) = step.action;
        let action = a.squared() + b.squared() + c.squared();
        terms.term(
            Term::reward("progress", 0.01, "velocity along the inertial y axis in m/s, for each 2 ms"),
            step.state.ball_velocity.y * steps,
        );
        terms.term(
            Term::reward("alive", 0.02, "1 for each 2 ms, unless the step ends in a fall"),
            L::select(terminated, zero, steps),
        );
        terms.term(Term::cost("action", 1e-4, "squared norm of the action, for each 2 ms"), action * steps);
    }

    fn measure(&self, memory: &[f64], _: f64, metrics: &mut impl Metrics) {
        metrics.metric(
            Metric::new("speed", "m/s", "mean velocity of the ball along the inertial y axis"),
            memory[TRAVELLED] / memory[TIME],
        );
    }
}
