//! What every model of the robot can do, from the planar equations to the rigid-body engine.

use crate::error::Result;
use crate::params::Params;
use crate::state::{Contacts, State};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Friction of the three wheel joints.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct JointDynamics {
    /// N·m/(rad/s).
    pub viscous_friction: f64,
    /// Dry friction, N·m.
    pub coulomb_friction: f64,
}

impl JointDynamics {
    /// The friction that the parameters give.
    pub fn of(params: &Params) -> Self {
        Self { viscous_friction: params.wheel_viscous_friction, coulomb_friction: params.wheel_coulomb_friction }
    }
}

/// A simulated robot. Implementations trust their input; [`crate::Ballbot`] checks it.
pub trait Model: Send + Sync {
    /// The robot's parameters.
    fn params(&self) -> &Params;

    /// Time step, s.
    fn sim_dt(&self) -> f64;

    /// Starts anew from `state` at time zero; a reset model is equal to a new one, to the last bit.
    ///
    /// # Errors
    /// [`crate::Error::Inconsistent`] or [`crate::Error::OutOfRange`] if the model cannot represent the state.
    fn reset(&mut self, state: &State) -> Result<()>;

    /// Advances by one time step with constant motor torques, N·m.
    fn step(&mut self, wheel_torques: &[f64; 3]);

    /// Simulated time since the reset, s.
    fn time(&self) -> f64;

    /// The present state.
    fn state(&self) -> State;

    /// Contact forces of the last step. Right after a reset, models with contacts of their own have none yet; the
    /// closed-form ones give those of the present state without torque.
    fn contacts(&self) -> Contacts;

    /// Whether the body or a wheel touches the floor; the closed-form models have no floor for them.
    fn bot_on_floor(&self) -> bool {
        false
    }

    /// Kinetic energy plus the body's potential energy above the ball centre's resting height plus the ball's, J.
    fn energy(&self) -> f64;

    /// False once a step met numbers that are not finite; the state is then the last one that was, but for
    /// [`crate::sim::RigidMotion`], whose engine keeps parts of what it met.
    fn healthy(&self) -> bool;

    /// Checks that the model can represent a state, with the errors of [`Model::reset`].
    ///
    /// # Errors
    /// As [`Model::reset`].
    fn accepts(&self, state: &State) -> Result<()>;

    /// Applies an impulse (inertial frame, N·s) to the body at `point` (body frame, m), at once or over the next step.
    fn push(&mut self, impulse: &Vector3<f64>, point: &Vector3<f64>);

    /// Friction of the wheel joints.
    fn joint_dynamics(&self) -> JointDynamics;

    /// Changes the friction of the wheel joints.
    fn set_joint_dynamics(&mut self, dynamics: JointDynamics);

    /// Everything that the future depends on, as bytes for [`Model::load`].
    fn save(&self) -> Vec<u8>;

    /// Continues from bytes that [`Model::save`] gave, of a model of the same kind, parameters and time step.
    ///
    /// # Errors
    /// [`crate::Error::Decode`] if the bytes are not that.
    fn load(&mut self, bytes: &[u8]) -> Result<()>;
}
