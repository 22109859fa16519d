//! Derivatives of a robot's motion.

use super::{Ballbot, ModelKind};
use crate::models::{PlanarMotion, SpatialMotion};
use ballbot_base::error::{Error, Result};
use ballbot_base::memory::require_memory;
use ballbot_base::wheels::Wheels;
use ballbot_contact::ContactMotion;
use ballbot_gradients::{Coordinates, Differentiable, Differentiated, Jacobian, Parameter, WithoutSlip, bytes_of};

impl ModelKind {
    /// The states of derivatives, of robots with or without losses.
    pub(crate) fn coordinates(self, has_losses: bool) -> Coordinates {
        match self {
            Self::Planar | Self::Spatial => Coordinates::WithoutSlip,
            Self::Contact | Self::Rigid => Coordinates::of_contact(has_losses),
        }
    }
}

impl Ballbot {
    /// Derivatives of the next `steps` time steps, at least one, under constant motor torques, N·m, with respect to the
    /// state, the torques and `parameters`. The robot does not move.
    ///
    /// # Errors
    /// As [`Ballbot::step`]; [`Error::Inconsistent`] for the model `rigid`, for models without slip on a terrain, for a
    /// parameter without derivative, for a bot that touches the floor, and for derivatives that are not finite.
    pub fn jacobian(
        &self,
        wheel_torques: impl Into<Wheels<f64>>,
        steps: usize,
        parameters: &[Parameter],
    ) -> Result<Jacobian> {
        let wheel_torques = self.checked(wheel_torques.into())?;
        let coordinates = self.derivative_coordinates();
        require_memory("the derivatives", 1, bytes_of(coordinates, 1, parameters.len()))?;
        self.differentiated(parameters, coordinates)?.advance(wheel_torques, steps)
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
        let coordinates = self.derivative_coordinates();
        require_memory("the derivatives", wheel_torques.len(), bytes_of(coordinates, 1, parameters.len()))?;
        let mut robot = self.differentiated(parameters, coordinates)?;
        wheel_torques.iter().map(|torques| robot.advance(self.checked(*torques)?, steps)).collect()
    }

    /// The states of [`Ballbot::jacobian`].
    pub fn derivative_coordinates(&self) -> Coordinates {
        self.kind.coordinates(self.params().has_losses())
    }

    /// The robot, as it moves next.
    pub(crate) fn differentiated(
        &self,
        parameters: &[Parameter],
        coordinates: Coordinates,
    ) -> Result<Box<dyn Differentiable>> {
        if let Some(reason) = self.diverged() {
            return Err(Error::Diverged { time: self.time(), reason });
        }
        let model = self.model.as_any();
        if let Some(motion) = model.downcast_ref::<ContactMotion>() {
            let (constants, memory) = (motion.constants(), motion.memory().clone());
            let (params, ground) = (self.params(), self.ground());
            return Ok(Box::new(Differentiated::new(params, constants, memory, ground, parameters, coordinates)?));
        }
        if self.kind != ModelKind::Rigid && self.ground.is_some() {
            return Err(Error::Inconsistent(format!(
                "the model '{}' has no derivatives on a terrain; use 'contact', or params.floor_tilt",
                self.kind
            )));
        }
        self.params().require_no_payload("derivatives of motions")?;
        self.params().require_still_floor("derivatives of motions")?;
        if let Some(motion) = model.downcast_ref::<SpatialMotion>() {
            return Ok(Box::new(WithoutSlip::new(motion, parameters)));
        }
        if let Some(motion) = model.downcast_ref::<PlanarMotion>() {
            return Ok(Box::new(WithoutSlip::new(motion, parameters)));
        }
        Err(Error::Inconsistent(
            "the model 'rigid' has no derivatives, because its contacts are solved by iteration; use 'contact'".into(),
        ))
    }
}
