//! The ground that the robots of a batch stand on.

use super::batch::Batch;
use crate::error::Result;
use crate::kinematics::Omniwheels;
use crate::state::State;
use crate::terrain::Terrain;
use std::sync::Arc;

impl Batch {
    /// The terrain; `None` for level ground.
    pub fn terrain(&self) -> Option<&Arc<Terrain>> {
        self.ground.as_ref().map(|ground| ground.terrain())
    }

    /// Level of the tile that the present episode of environment `index` began on; 0 for terrains without tiles.
    ///
    /// # Errors
    /// As [`Batch::state`].
    pub fn level(&self, index: usize) -> Result<usize> {
        let (chunk, i) = self.locate(index)?;
        Ok(self.chunks[chunk].level(i))
    }

    /// A state on level ground of the robot of environment `index`, at the same place of the ground here, as starts are
    /// moved: the ball touches it and rolls with the same horizontal velocity, and the static lean there is added to the
    /// tilt. The same state on level ground.
    ///
    /// # Errors
    /// [`crate::Error::Inconsistent`] if there is no such environment, [`crate::Error::OutOfRange`] for a state that cannot be.
    pub fn on_ground(&self, index: usize, start: &State) -> Result<State> {
        let params = self.params(index)?;
        start.validate()?;
        Ok(match &self.ground {
            Some(ground) => ground.adapted(params, &Omniwheels::new(params), start),
            None => start.clone(),
        })
    }
}
