//! Controllers on all robots of a batch, without a caller in the loop.

use super::batch::Batch;
use super::buffers::StepBuffers;
use super::drawn_law::Design;
use super::pieces::pieces;
use crate::control::Controller;
use crate::task::ACTION_LEN;
use ballbot_base::error::{Result, check};
use ballbot_base::interrupt::Watch;
use ballbot_base::setpoint::Setpoint;
use std::sync::{Mutex, PoisonError};

/// A controller on all robots of a batch, as [`Batch::control`] and [`Batch::step_under`] take it.
#[derive(Clone, Copy)]
pub struct Under<'a> {
    /// The controller; its memory of a robot is reset with each episode, and when another controller is used.
    pub controller: &'a dyn Controller,
    /// One setpoint per environment; `None` takes the task's setpoints.
    pub setpoints: Option<&'a [Setpoint]>,
    /// Whether the controller gets the true states even where the task observes estimates, as a teacher does.
    pub privileged: bool,
}

impl<'a> Under<'a> {
    /// A controller that gets what the task observes, with the setpoints of the task.
    pub fn new(controller: &'a dyn Controller) -> Self {
        Self { controller, setpoints: None, privileged: false }
    }
}

impl Batch {
    /// Writes the actions of a controller on every robot, n × 3, in [-1, 1]: the torque of an action is a limit of the
    /// controller. It gets the states that the task observes: with [`super::Observation::Sensors`] these are
    /// [`Batch::estimate`].
    ///
    /// # Errors
    /// [`crate::Error::Length`] for slices of the wrong length; [`crate::Error::OutOfRange`] if the controller and the
    /// batch have different sampling rates; [`crate::Error::Interrupted`] as in [`Batch::step`].
    pub fn control(&mut self, under: &Under<'_>, actions: &mut [f32]) -> Result<()> {
        self.control_by(under, None, actions)
    }

    /// [`Batch::control`] with a controller for each robot as events have sampled it, in place of the controller: the
    /// design for its parameters and the delay of its motors, about its equilibrium on its floor, and with the friction of
    /// its joints fed forward. A robot has another design when it has changed.
    ///
    /// # Errors
    /// As [`Batch::control`]; [`crate::Error::Inconsistent`] if there is no design for a robot.
    pub fn control_drawn(&mut self, under: &Under<'_>, design: &Design, actions: &mut [f32]) -> Result<()> {
        self.control_by(under, Some(design), actions)
    }

    fn control_by(&mut self, under: &Under<'_>, design: Option<&Design>, actions: &mut [f32]) -> Result<()> {
        self.check_control(under, actions.len())?;
        let setpoints = under.setpoints.unwrap_or_default();
        let mut watch = Watch::new();
        let mut first = 0;
        for (chunk, actions) in self.chunks.iter_mut().zip(actions.chunks_mut(self.width * ACTION_LEN)) {
            if let Err(stop) = watch.check() {
                // The controller's memory of some robots has advanced.
                self.interrupted = true;
                return Err(stop);
            }
            let n = actions.len() / ACTION_LEN;
            let setpoints = setpoints.get(first..first + n).unwrap_or_default();
            match design {
                Some(design) => {
                    chunk.control_drawn(under.controller.id(), design, setpoints, under.privileged, actions)?;
                }
                None => chunk.control(under.controller, setpoints, under.privileged, actions),
            }
            first += n;
        }
        Ok(())
    }

    /// One control step under a controller: [`Batch::control`], then [`Batch::step`] with its actions, which remain in
    /// `actions`.
    ///
    /// # Errors
    /// As [`Batch::control`] and [`Batch::step`].
    pub fn step_under(&mut self, under: &Under<'_>, actions: &mut [f32], buffers: &mut StepBuffers<'_>) -> Result<()> {
        self.check_control(under, actions.len())?;
        self.check_buffers(buffers)?;
        self.check_running()?;
        if self.staged.is_some() {
            self.control(under, actions)?;
            zero_where_not_finite(actions);
            return self.step(actions, buffers);
        }
        let Under { controller, setpoints, privileged } = *under;
        let setpoints = setpoints.unwrap_or_default();
        let (autoreset, width) = (self.autoreset, self.width);
        let stop = self.stop()?;
        let step = |chunks: &mut [Box<dyn super::env::chunk::Chunk>], actions: &mut [f32], first: usize, buffers| {
            let mut rest: StepBuffers<'_> = buffers;
            let mut watch = Watch::new();
            for (k, (chunk, actions)) in chunks.iter_mut().zip(actions.chunks_mut(width * ACTION_LEN)).enumerate() {
                if stop.look(&mut watch) {
                    return;
                }
                let n = actions.len() / ACTION_LEN;
                let from = first + k * width;
                chunk.control(controller, setpoints.get(from..from + n).unwrap_or_default(), privileged, actions);
                zero_where_not_finite(actions);
                let (now, later) = rest.split(n);
                rest = later;
                chunk.step(autoreset, actions, now);
            }
        };
        if self.helpers.count() == 0 {
            step(&mut self.chunks, actions, 0, buffers.reborrow());
            return self.finish(&stop);
        }
        let per_piece = self.chunks_per_piece();
        let shares = pieces(&mut self.chunks, per_piece, width, buffers.reborrow());
        let work = shares.zip(actions.chunks_mut(per_piece * width * ACTION_LEN)).enumerate();
        let work = Mutex::new(work);
        self.helpers.share(|| {
            let next = || work.lock().unwrap_or_else(PoisonError::into_inner).next();
            while let Some((k, ((chunks, share), actions))) = next() {
                step(chunks, actions, k * per_piece * width, share);
            }
        })?;
        drop(work);
        self.finish(&stop)
    }

    fn check_control(&self, under: &Under<'_>, actions: usize) -> Result<()> {
        self.expect_len("actions", actions, self.len() * ACTION_LEN)?;
        if let Some(setpoints) = under.setpoints {
            self.expect_len("setpoints", setpoints.len(), self.len())?;
            setpoints.iter().try_for_each(Setpoint::validate)?;
        }
        let control_dt = self.control_dt();
        check(
            "control_dt of the controller",
            under.controller.control_dt(),
            format_args!("the control_dt of the batch, {control_dt} s"),
            |dt| (dt - control_dt).abs() <= 1e-9 * control_dt,
        )?;
        Ok(())
    }
}

/// For a diverged robot a controller may return no finite number; the robot is reset, not stepped.
fn zero_where_not_finite(actions: &mut [f32]) {
    actions.iter_mut().filter(|a| !a.is_finite()).for_each(|a| *a = 0.0);
}
