//! Robots without a task: the basis of tasks outside the core.

use super::shared::{FALLS, action_rows, fallen};
use super::start::task_fields;
use super::{Row, Rows, Sensed, Step, Task, Term, Terms};
use ballbot_base::error::Result;
use ballbot_base::kinematics::Omniwheels;
use ballbot_base::lanes::{Lane, Memory};
use ballbot_base::params::Params;
use ballbot_base::state::State;
use rand_chacha::ChaCha8Rng;

task_fields! {
    fall 180.0, tilt 5.0;
    /// Options of robots without a task. SI units and radians. Tilts are from the equilibrium.
    pub struct Bare {}
}

/// Bound of rows that have no other bound.
const ANY: f32 = 1e9;

impl Task for Bare {
    const NAME: &'static str = "bare";
    const ID: &'static str = "ballbot/Bare-v0";
    const SUMMARY: &'static str = "Robots without a task, of which all is observed.";
    const TERMINATIONS: &'static [(&'static str, &'static str)] = FALLS;
    const ANYWHERE: bool = true;

    fn validate(&self, params: &Params) -> Result<()> {
        self.starts().validate(params)
    }

    fn extreme_starts(&self, params: &Params) -> Vec<State> {
        self.starts().extremes(params)
    }

    fn start(&self, params: &Params, wheels: &Omniwheels, rng: &mut ChaCha8Rng) -> State {
        self.starts().draw(params, wheels, rng)
    }

    #[inline(always)]
    fn observe<L: Lane>(&self, sensed: &Sensed<'_, L>, _: &Memory<'_, L>, rows: &mut impl Rows<L>) {
        let state = sensed.state;
        let up = state.body_quaternion.rotation().rows[2];
        let (rate, spin) = (state.body_angular_velocity, state.ball_angular_velocity);
        let (position, velocity) = (state.ball_position, state.ball_velocity);
        let q = state.body_quaternion;
        let ([w0, w1, w2], [a0, a1, a2]) = (state.wheel_speeds, state.wheel_angles);
        rows.row(Row::new("gravity direction, body x", "", 1.0, 1.0), -up.x);
        rows.row(Row::new("gravity direction, body y", "", 1.0, 1.0), -up.y);
        rows.row(Row::new("gravity direction, body z", "", 1.0, 1.0), -up.z);
        rows.row(Row::new("body rate about body x", "rad/s", ANY, 1.0), rate.x);
        rows.row(Row::new("body rate about body y", "rad/s", ANY, 1.0), rate.y);
        rows.row(Row::new("body rate about body z", "rad/s", ANY, 1.0), rate.z);
        rows.row(Row::new("wheel speed 0", "rad/s", ANY, 1.0), w0);
        rows.row(Row::new("wheel speed 1", "rad/s", ANY, 1.0), w1);
        rows.row(Row::new("wheel speed 2", "rad/s", ANY, 1.0), w2);
        rows.row(Row::new("wheel angle 0", "rad", ANY, 1.0), a0);
        rows.row(Row::new("wheel angle 1", "rad", ANY, 1.0), a1);
        rows.row(Row::new("wheel angle 2", "rad", ANY, 1.0), a2);
        rows.row(Row::new("ball position, inertial x", "m", ANY, 1.0), position.x);
        rows.row(Row::new("ball position, inertial y", "m", ANY, 1.0), position.y);
        rows.row(Row::new("ball position, inertial z", "m", ANY, 1.0), position.z);
        rows.row(Row::new("ball velocity, inertial x", "m/s", ANY, 1.0), velocity.x);
        rows.row(Row::new("ball velocity, inertial y", "m/s", ANY, 1.0), velocity.y);
        rows.row(Row::new("ball velocity, inertial z", "m/s", ANY, 1.0), velocity.z);
        rows.row(Row::new("ball rate about inertial x", "rad/s", ANY, 1.0), spin.x);
        rows.row(Row::new("ball rate about inertial y", "rad/s", ANY, 1.0), spin.y);
        rows.row(Row::new("ball rate about inertial z", "rad/s", ANY, 1.0), spin.z);
        rows.row(Row::new("body quaternion w", "", 1.0, 1.0), q.w);
        rows.row(Row::new("body quaternion x", "", 1.0, 1.0), q.v.x);
        rows.row(Row::new("body quaternion y", "", 1.0, 1.0), q.v.y);
        rows.row(Row::new("body quaternion z", "", 1.0, 1.0), q.v.z);
        action_rows(sensed, rows);
    }

    #[inline(always)]
    fn terminate<L: Lane>(&self, step: &Step<'_, L>) -> L {
        fallen(step, self.fall_tilt)
    }

    #[inline(always)]
    fn success<L: Lane>(&self, step: &Step<'_, L>, _: L::Mask, _: &mut Memory<'_, L>) -> L::Mask {
        step.tilt.lt(step.tilt)
    }

    #[inline(always)]
    fn reward<L: Lane>(&self, step: &Step<'_, L>, _: L::Mask, _: &Memory<'_, L>, terms: &mut impl Terms<L>) {
        terms.term(Term::reward("none", 0.0, "0"), step.tilt.zero());
    }
}
