//! Steps whose motion is simulated by another engine.

use super::batch::Batch;
use super::buffers::StepBuffers;
use super::pieces::pieces;
use crate::robot::ModelKind;
use crate::task::ACTION_LEN;
use ballbot_base::error::{Error, Result, check};
use ballbot_base::interrupt::Stop;
use ballbot_base::state::State;

/// Input of an external engine, as [`Batch::step_with`] provides it.
pub struct Outside {
    /// States before the motion, one per robot.
    pub states: Vec<State>,
    /// Push on the body of each robot over the first time step: an impulse, N·s, and its moment about the
    /// center of mass, N·m·s, both in the inertial frame.
    pub pushes: Vec<[f64; 6]>,
}

impl Batch {
    /// Checks that no force acts and no rider leans, which another engine does not simulate.
    fn require_no_force(&self) -> Result<()> {
        if self.chunks[0].has_riders() {
            let reason = "riders lean in the task, but another engine moves no payload".to_owned();
            return Err(Error::Inconsistent(reason));
        }
        match self.places().position(|(chunk, i)| self.chunks[chunk].has_force(i)) {
            None => Ok(()),
            Some(i) => {
                let reason = format!("a force acts on robot {i}, but another engine takes pushes only");
                Err(Error::Inconsistent(reason))
            }
        }
    }

    /// [`Batch::step`] with an external motion: the task still computes commands, rewards, observations and episode
    /// ends.
    ///
    /// `motion` gets the robots after the events of the step and returns their states at the end of the step. A state
    /// that is not finite or out of bounds ends the episode as diverged. Contact forces are unknown, as is contact of
    /// the body with the floor; actuator options have no effect.
    ///
    /// # Errors
    /// As [`Batch::step`], in one thread; [`Error::Inconsistent`] for a model without slip, which cannot hold every
    /// state, for a task whose riders lean, and for a robot under a force of [`Batch::apply_force`] or an
    /// event. Errors of `motion`, [`Error::Length`] unless there is one state per robot, and [`Error::OutOfRange`] for
    /// a quaternion without unit length: these interrupt the step, and all environments must be reset.
    pub fn step_with<E: From<Error>>(
        &mut self,
        actions: &[f32],
        buffers: &mut StepBuffers<'_>,
        motion: impl FnOnce(&Outside) -> std::result::Result<Vec<State>, E>,
    ) -> std::result::Result<(), E> {
        self.check_actions(actions)?;
        self.check_buffers(buffers)?;
        self.check_running()?;
        if let model @ (ModelKind::Planar | ModelKind::Spatial) = self.model() {
            let reason = format!("the model {} cannot hold a state with slip: take contact or rigid", model.name());
            return Err(Error::Inconsistent(reason).into());
        }
        self.require_no_force()?;
        let (autoreset, width) = (self.autoreset, self.width);
        self.interrupted = true;
        self.chunks.iter_mut().for_each(|chunk| chunk.begin_step(autoreset));
        self.require_no_force()?;
        let pushes = self.places().map(|(chunk, i)| self.chunks[chunk].pending_push(i)).collect();
        let before = Outside { states: self.states().collect(), pushes };
        let after = motion(&before)?;
        self.expect_len("states", after.len(), self.len())?;
        for (i, state) in after.iter().enumerate() {
            for (name, turn) in [("ball", &state.ball_quaternion), ("body", &state.body_quaternion)] {
                let length = turn.quaternion().norm();
                // A state that is not finite has diverged.
                if length.is_finite() {
                    check(format_args!("length of {name}_quaternion of robot {i}"), length, "1 within 1e-6", |l| {
                        (l - 1.0).abs() <= 1e-6
                    })?;
                }
            }
        }
        let actions = actions.chunks(width * ACTION_LEN);
        for ((chunk, actions), states) in self.chunks.iter_mut().zip(actions).zip(after.chunks(width)) {
            chunk.advance_to(autoreset, actions, states);
        }
        if self.staged.is_some() {
            return Ok(self.conclude_staged(buffers, &Stop::default())?);
        }
        for (chunk, share) in pieces(&mut self.chunks, 1, width, buffers.reborrow()) {
            chunk[0].finish(autoreset, None, share);
        }
        self.interrupted = false;
        Ok(())
    }
}
