//! A model of the robot in motion: what every rung of the ladder of models can do.

use crate::error::Result;
use crate::params::Params;
use crate::state::{Contacts, State};
use crate::terrain::Ground;
use nalgebra::Vector3;
use std::sync::Arc;

/// A simulated robot. Implementations trust their input; [`crate::Ballbot`] checks it.
pub trait Model: Send + Sync {
    /// The robot's parameters.
    fn params(&self) -> &Params;

    /// Replaces the parameters (valid ones). The motion goes on if the geometry is the same; otherwise the robot is placed at
    /// rest upright, at time zero.
    ///
    /// # Errors
    /// [`crate::Error::Inconsistent`] if the model cannot simulate such a robot; the old one is kept.
    fn set_params(&mut self, params: &Params) -> Result<()>;

    /// Puts the robot on other ground, level without one, at rest upright at time zero.
    ///
    /// # Errors
    /// [`crate::Error::Inconsistent`] if the model cannot simulate it; the old one is kept.
    fn set_ground(&mut self, ground: Option<&Arc<Ground>>) -> Result<()>;

    /// Time step, s.
    fn sim_dt(&self) -> f64;

    /// Starts anew from an accepted `state` at time zero; a reset model is equal to a new one, to the last bit.
    fn place(&mut self, state: &State);

    /// Advances by `steps` time steps with constant motor torques, N·m.
    fn advance(&mut self, wheel_torques: &[f64; 3], steps: usize);

    /// Simulated time since the reset, s.
    fn time(&self) -> f64;

    /// The present state.
    fn state(&self) -> State;

    /// Contact forces of the last step. Right after a reset, `contact` and `rigid` return zeros; the closed-form models
    /// return those of the present state without torque.
    fn contacts(&self) -> Contacts;

    /// Whether the body or a wheel touches the floor; always false for `planar` and `spatial`, which have no such contact.
    fn bot_on_floor(&self) -> bool {
        false
    }

    /// Kinetic energy plus the body's potential energy above the ball center's resting height plus the ball's, J.
    fn energy(&self) -> f64;

    /// False once a step met numbers that are not finite; the state is then the last finite one, except in
    /// `rigid`, whose engine keeps parts of the step that failed.
    fn healthy(&self) -> bool;

    /// Checks that the model can represent a state.
    ///
    /// # Errors
    /// [`crate::Error::Inconsistent`] or [`crate::Error::OutOfRange`] if it cannot.
    fn accepts(&self, state: &State) -> Result<()>;

    /// Applies an impulse (inertial frame, N·s) to the body at `point` (body frame, m), at once or over the next step.
    fn push(&mut self, impulse: &Vector3<f64>, point: &Vector3<f64>);

    /// What pushes have yet to do: an impulse on the body, N·s, and its moment about the center of mass, N·m·s, both in the
    /// inertial frame. Zeros where they act at once.
    fn pending_push(&self) -> [f64; 6] {
        [0.0; 6]
    }

    /// Appends everything that the future depends on, for [`Model::load`].
    fn save(&self) -> Vec<u8>;

    /// Continues from bytes that [`Model::save`] gave, of a model of the same kind, parameters and time step.
    ///
    /// # Errors
    /// [`crate::Error::Decode`] if the bytes are not that.
    fn load(&mut self, bytes: &[u8]) -> Result<()>;
}

/// Whether two robots have the same shape, so that a state of one is a state of the other.
pub fn same_geometry(a: &Params, b: &Params) -> bool {
    a.ball_radius == b.ball_radius
        && a.wheel_radius == b.wheel_radius
        && a.wheel_zenith == b.wheel_zenith
        && a.wheel_azimuths == b.wheel_azimuths
        && a.wheel_zenith_offsets == b.wheel_zenith_offsets
        && a.body_com_height == b.body_com_height
        && a.body_com_offset == b.body_com_offset
}
