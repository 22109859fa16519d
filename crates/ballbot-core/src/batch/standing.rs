//! The ground that the robots of a batch stand on.

use super::batch::Batch;
use ballbot_base::error::Result;
use ballbot_base::kinematics::Omniwheels;
use ballbot_base::state::State;
use ballbot_base::terrain::Terrain;
use std::sync::Arc;

impl Batch {
    /// The terrain; `None` for level ground.
    pub fn terrain(&self) -> Option<&Arc<Terrain>> {
        self.ground.as_ref().map(|ground| ground.terrain())
    }

    /// Level of the tile that the current episode of environment `index` began on; 0 for terrains without tiles.
    ///
    /// # Errors
    /// As [`Batch::state`].
    pub fn level(&self, index: usize) -> Result<usize> {
        let (chunk, i) = self.locate(index)?;
        Ok(self.chunks[chunk].level(i))
    }

    /// Moves a state on level ground of the robot of environment `index` to the same place on its ground, as starts are
    /// moved: the ball touches the ground and rolls with the same horizontal velocity, and the static lean there is
    /// added to the tilt. On level ground the state is unchanged.
    ///
    /// # Errors
    /// [`crate::Error::Inconsistent`] if there is no such environment, [`crate::Error::OutOfRange`] for an invalid
    /// state.
    pub fn on_ground(&self, index: usize, start: &State) -> Result<State> {
        let params = self.params(index)?;
        start.validate()?;
        Ok(match &self.ground {
            Some(ground) => ground.adapted(params, &Omniwheels::new(params), start),
            None => start.clone(),
        })
    }
}
