//! Robots without a task: the basis of tasks that are a stage of the caller.

use super::shared::{FALLS, fallen};
use super::start::task_fields;
use super::{Rows, Sensed, Step, Task, Terms};
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

impl Task for Bare {
    const NAME: &'static str = "bare";
    const ID: &'static str = "ballbot/Bare-v0";
    const SUMMARY: &'static str = "Robots without a task: neither rows nor rewards.";
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
    fn observe<L: Lane>(&self, _: &Sensed<'_, L>, _: &Memory<'_, L>, _: &mut impl Rows<L>) {}

    #[inline(always)]
    fn terminate<L: Lane>(&self, step: &Step<'_, L>) -> L {
        fallen(step, self.fall_tilt)
    }

    #[inline(always)]
    fn success<L: Lane>(&self, step: &Step<'_, L>, _: L::Mask, _: &mut Memory<'_, L>) -> L::Mask {
        step.tilt.lt(step.tilt)
    }

    #[inline(always)]
    fn reward<L: Lane>(&self, _: &Step<'_, L>, _: L::Mask, _: &Memory<'_, L>, _: &mut impl Terms<L>) {}
}
