//! Robots without a task: the basis of tasks that are a stage of the caller.

use super::start::{starts_and_falls, task_fields};
use super::{Rows, Sensed, Step, Task, Terms};
use ballbot_base::error::Result;
use ballbot_base::lanes::{Lane, Memory};
use ballbot_base::params::Params;

task_fields! {
    fall 180.0, tilt 5.0;
    /// Options of robots without a task. SI units and radians. Tilts are from the equilibrium.
    pub struct Bare {}
}

impl Task for Bare {
    const NAME: &'static str = "bare";
    const ID: &'static str = "ballbot/Bare-v0";
    const SUMMARY: &'static str = "Robots without a task: neither rows nor rewards.";
    const ANYWHERE: bool = true;

    fn validate(&self, params: &Params) -> Result<()> {
        self.starts().validate(params)
    }

    starts_and_falls!();

    #[inline(always)]
    fn observe<L: Lane>(&self, _: &Sensed<'_, L>, _: &Memory<'_, L>, _: &mut impl Rows<L>) {}

    #[inline(always)]
    fn success<L: Lane>(&self, step: &Step<'_, L>, _: L::Mask, _: &mut Memory<'_, L>) -> L::Mask {
        step.tilt.lt(step.tilt)
    }

    #[inline(always)]
    fn reward<L: Lane>(&self, _: &Step<'_, L>, _: L::Mask, _: &Memory<'_, L>, _: &mut impl Terms<L>) {}
}
