//! Derivatives of a robot's motion.

use super::{Ballbot, ModelKind};
use ballbot_base::error::{Error, Result};
use ballbot_base::memory::require_memory;
use ballbot_base::wheels::Wheels;
use ballbot_contact::ContactMotion;
use ballbot_gradients::{Differentiated, Jacobian, Parameter, bytes_of};

impl Ballbot {
    /// Derivatives of the next `steps` time steps, at least one, under constant motor torques, N·m, with respect to the
    /// state, the torques and `parameters`. The robot does not move.
    ///
    /// # Errors
    /// As [`Ballbot::step`]; [`Error::Inconsistent`] for other models than `contact`, for a parameter without derivative,
    /// for a bot that touches the floor, and for derivatives that are not finite.
    pub fn jacobian(
        &self,
        wheel_torques: impl Into<Wheels<f64>>,
        steps: usize,
        parameters: &[Parameter],
    ) -> Result<Jacobian> {
        let wheel_torques = self.checked(wheel_torques.into())?;
        require_memory("the derivatives", 1, bytes_of(parameters.len(), true))?;
        self.differentiated(parameters, self.params().has_losses())?.advance(wheel_torques, steps)
    }

    /// [`Ballbot::jacobian`] of successive motions, each of `steps` time steps under its torques: each begins where the one
    /// before has ended.
    ///
    /// # Errors
    /// As [`Ballbot::jacobian`]; [`Error::Memory`].
    pub fn jacobians(
        &self,
        wheel_torques: &[Wheels<f64>],
        steps: usize,
        parameters: &[Parameter],
    ) -> Result<Vec<Jacobian>> {
        let has_losses = self.params().has_losses();
        require_memory("the derivatives", wheel_torques.len(), bytes_of(parameters.len(), has_losses))?;
        let mut robot = self.differentiated(parameters, has_losses)?;
        wheel_torques.iter().map(|torques| robot.advance(self.checked(*torques)?, steps)).collect()
    }

    /// The robot, as it moves next.
    pub(crate) fn differentiated(&self, parameters: &[Parameter], with_loads: bool) -> Result<Differentiated> {
        let Some(motion) = self.model.as_any().downcast_ref::<ContactMotion>() else {
            return Err(Error::Inconsistent(match self.kind {
                ModelKind::Rigid => {
                    "the model 'rigid' has no derivatives, because its contacts are solved by iteration; \
                     use 'contact'"
                        .into()
                }
                kind => format!("the model '{kind}' has no derivatives; use 'contact'"),
            }));
        };
        if let Some(reason) = self.diverged() {
            return Err(Error::Diverged { time: self.time(), reason });
        }
        let (constants, memory) = (motion.constants(), motion.memory().clone());
        Differentiated::new(self.params(), constants, memory, self.ground(), parameters, with_loads)
    }
}
