//! Derivatives of a robot's motion.

use super::{Ballbot, ModelKind};
use ballbot_base::error::{Error, Result};
use ballbot_base::wheels::Wheels;
use ballbot_contact::ContactMotion;
use ballbot_gradients::{Jacobian, Parameter, differentiate};

impl Ballbot {
    /// Derivatives of the next `steps` time steps under constant motor torques, N·m, with respect to the state, the
    /// torques and `parameters`: names of [`Params`](crate::Params), each for all its elements, or of one element, as
    /// `body_com_offset[0]`. The robot does not move.
    ///
    /// # Errors
    /// As [`Ballbot::step`]; [`Error::OutOfRange`] for zero steps; [`Error::UnknownName`] for an unknown parameter;
    /// [`Error::Inconsistent`] for the models `rigid`, `spatial` and `planar`, for a parameter without derivative, and
    /// for derivatives that are not finite.
    pub fn jacobian(
        &self,
        wheel_torques: impl Into<Wheels<f64>>,
        steps: usize,
        parameters: &[Parameter],
    ) -> Result<Jacobian> {
        let wheel_torques = self.checked(wheel_torques.into())?;
        let Some(motion) = self.model.as_any().downcast_ref::<ContactMotion>() else {
            return Err(Error::Inconsistent(match self.kind {
                ModelKind::Rigid => {
                    "the model 'rigid' has no derivatives: its contact solver iterates a fixed number of times; \
                     use 'contact', whose contacts are solved exactly"
                        .into()
                }
                kind => format!("the model '{kind}' has no derivatives yet; use 'contact'"),
            }));
        };
        if let Some(reason) = self.diverged() {
            return Err(Error::Diverged { time: self.time(), reason });
        }
        let (constants, memory) = (motion.constants(), motion.memory());
        differentiate(self.params(), constants, memory, self.ground(), wheel_torques, steps, parameters)
    }
}
