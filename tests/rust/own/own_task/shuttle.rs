//! The shuttle task: follow a commanded ball velocity that changes every few seconds, on a round track.

use ballbot_core::control::Setpoint;
use ballbot_core::fields::Limit;
use ballbot_core::kinematics::Omniwheels;
use ballbot_core::lanes::{Lane, Memory};
use ballbot_core::task::{Moment, Row, Rows, Sensed, Step, Task, Term, Terms};
use ballbot_core::{Error, Params, Result, State, Wheels};
use nalgebra::Vector2;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

ballbot_core::fields! {
    /// Options of the shuttle task. SI units and radians.
    pub struct Shuttle {
        /// Largest commanded speed.
        pub speed: f64 = 0.3, "m/s", Limit::POSITIVE.to(2.0);
        /// Control steps from one command to the next.
        pub interval: f64 = 200.0, "", Limit::from(1.0);
        /// Radius of the track, on which the ball must stay.
        pub track: f64 = 3.0, "m", Limit::POSITIVE;
        /// Largest first tilt about each axis; below `fall_tilt`.
        pub reset_tilt: [f64; 2] = [0.05, 0.02], "rad", Limit::NOT_NEGATIVE;
        /// Tilt above which the episode is terminated.
        pub fall_tilt: f64 = 0.3, "rad", Limit::POSITIVE.to(1.0);
        /// Velocity error below which a step counts as tracked.
        pub tracked_error: f64 = 0.1, "m/s", Limit::POSITIVE;
    }
}

/// Memory: the commanded velocity, and the steps tracked in the episode.
const COMMAND: [usize; 2] = [0, 1];
const TRACKED: usize = 2;

impl Shuttle {
    /// Squared velocity error, (m/s)².
    #[inline(always)]
    fn error_squared<L: Lane>(&self, step: &Step<'_, L>, memory: &Memory<'_, L>) -> L {
        let velocity = step.state.ball_velocity;
        let (x, y) = (velocity.x - memory.get(COMMAND[0]), velocity.y - memory.get(COMMAND[1]));
        x.mul_add(x, y.squared())
    }
}

impl Task for Shuttle {
    const NAME: &'static str = "shuttle";
    const ID: &'static str = "ballbot/Shuttle-v0";
    const SUMMARY: &'static str = "Follow a commanded ball velocity.";
    const MAX_EPISODE_STEPS: usize = 600;
    const TERMINATIONS: &'static [(&'static str, &'static str)] =
        &[("tilt", "the tilt exceeds `fall_tilt`"), ("off_track", "the ball is farther than `track` from the origin")];
    const SUCCESS: &'static str = "not terminated, and half of the steps so far tracked within `tracked_error`";
    const MEMORY: usize = 3;

    fn validate(&self, _: &Params) -> Result<()> {
        match self.reset_tilt.iter().find(|tilt| **tilt >= self.fall_tilt) {
            None => Ok(()),
            Some(tilt) => Err(Error::OutOfRange {
                name: "reset_tilt".into(),
                value: *tilt,
                limit: format!("below fall_tilt = {}", self.fall_tilt),
            }),
        }
    }

    fn extreme_starts(&self, params: &Params) -> Vec<State> {
        let [x, y] = self.reset_tilt;
        [[x, y], [-x, y], [x, -y], [-x, -y]].map(|tilt| State::tilted(params, tilt.into(), 0.0)).into()
    }

    fn start(&self, params: &Params, _: &Omniwheels, rng: &mut ChaCha8Rng) -> State {
        let tilt = self.reset_tilt.map(|most| most * (2.0 * rng.random::<f64>() - 1.0));
        State::tilted(params, tilt.into(), 0.0)
    }

    fn command(&self, _: &Moment<'_>, rng: &mut ChaCha8Rng, memory: &mut [f64]) -> f64 {
        let (sin, cos) = (TAU * rng.random::<f64>()).sin_cos();
        let speed = self.speed * rng.random::<f64>();
        memory[COMMAND[0]] = speed * cos;
        memory[COMMAND[1]] = speed * sin;
        self.interval
    }

    fn setpoint(&self, memory: &[f64]) -> Setpoint {
        Setpoint { velocity: Vector2::new(memory[COMMAND[0]], memory[COMMAND[1]]), ..Setpoint::default() }
    }

    #[inline(always)]
    fn observe<L: Lane>(&self, sensed: &Sensed<'_, L>, memory: &Memory<'_, L>, rows: &mut impl Rows<L>) {
        let state = sensed.state;
        let up = state.body_quaternion.rotation().rows[2];
        let rate = state.body_angular_velocity;
        rows.row(Row::new("vertical, body x", "", 1.0, 0.1), up.x);
        rows.row(Row::new("vertical, body y", "", 1.0, 0.1), up.y);
        rows.row(Row::new("vertical, body z", "", 1.0, 0.1), up.z);
        rows.row(Row::new("body rate about body x", "rad/s", 20.0, 1.0), rate.x);
        rows.row(Row::new("body rate about body y", "rad/s", 20.0, 1.0), rate.y);
        rows.row(Row::new("ball velocity, inertial x", "m/s", 5.0, 0.2), state.ball_velocity.x);
        rows.row(Row::new("ball velocity, inertial y", "m/s", 5.0, 0.2), state.ball_velocity.y);
        rows.row(Row::new("commanded velocity, inertial x", "m/s", 5.0, 0.2), memory.get(COMMAND[0]));
        rows.row(Row::new("commanded velocity, inertial y", "m/s", 5.0, 0.2), memory.get(COMMAND[1]));
    }

    #[inline(always)]
    fn terminate<L: Lane>(&self, step: &Step<'_, L>) -> L {
        let zero = step.tilt.zero();
        let p = step.state.ball_position;
        let off_track = zero.splat(self.track * self.track).lt(p.x.mul_add(p.x, p.y.squared()));
        let fallen = zero.splat(self.fall_tilt).lt(step.tilt);
        L::select(fallen, zero.splat(1.0), L::select(off_track, zero.splat(2.0), zero))
    }

    #[inline(always)]
    fn success<L: Lane>(&self, step: &Step<'_, L>, terminated: L::Mask, memory: &mut Memory<'_, L>) -> L::Mask {
        let zero = step.tilt.zero();
        let bound = zero.splat(self.tracked_error * self.tracked_error);
        let change = L::select(self.error_squared(step, memory).le(bound), zero.splat(1.0), zero.splat(-1.0));
        let tracked = memory.get(TRACKED) + change;
        memory.set(TRACKED, tracked);
        !terminated & zero.le(tracked)
    }

    #[inline(always)]
    fn reward<L: Lane>(
        &self,
        step: &Step<'_, L>,
        terminated: L::Mask,
        memory: &Memory<'_, L>,
        terms: &mut impl Terms<L>,
    ) {
        let one = step.tilt.splat(1.0);
        let tracking = one / (self.error_squared(step, memory) / (self.speed * self.speed) + 1.0);
        let Wheels([a, b, c]) = step.action;
        let tracking = L::select(terminated, one.zero(), tracking);
        terms.term(Term::reward("tracking", 1.0, "1 / (1 + (velocity error / speed)²), 0 in a fall"), tracking);
        terms.term(Term::cost("tilt", 0.5, "(tilt / fall_tilt)²"), (step.tilt / self.fall_tilt).squared());
        terms.term(Term::cost("action", 0.01, "squared action"), a.squared() + b.squared() + c.squared());
    }
}
