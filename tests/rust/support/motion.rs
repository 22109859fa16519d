//! Resets and single steps of a bare model.

use ballbot_core::{Model, Result, State, Wheels};

pub trait Motion: Model {
    /// Restarts from `state` if the model accepts it.
    fn reset(&mut self, state: &State) -> Result<()> {
        self.accepts(state)?;
        self.place(state);
        Ok(())
    }

    /// Advances by one time step.
    fn step(&mut self, wheel_torques: impl Into<Wheels<f64>>) {
        self.advance(wheel_torques.into(), 1);
    }
}

impl<M: Model + ?Sized> Motion for M {}
