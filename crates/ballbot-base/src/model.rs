//! A model of the moving robot: the interface of every rung of the ladder of models.

use crate::error::{Error, Result};
use crate::force::HeldForce;
use crate::params::Params;
use crate::payload::{Deflection, PAYLOADS};
use crate::state::{Contacts, State};
use crate::terrain::Ground;
use crate::wheels::Wheels;
use nalgebra::Vector3;
use std::any::Any;
use std::sync::Arc;

/// A simulated robot. Implementations trust their input; `Ballbot` checks it.
pub trait Model: Send + Sync {
    /// The model, for code of one kind of model.
    fn as_any(&self) -> &dyn Any;

    /// The robot's parameters.
    fn params(&self) -> &Params;

    /// Replaces the parameters (valid ones). The motion continues if the geometry is the same; otherwise the robot is
    /// placed upright at rest, at time zero.
    ///
    /// # Errors
    /// [`crate::Error::Inconsistent`] if the model cannot simulate such a robot; the old parameters are kept.
    fn set_params(&mut self, params: &Params) -> Result<()>;

    /// Puts the robot upright at rest on another ground (level if `None`), at time zero.
    ///
    /// # Errors
    /// [`crate::Error::Inconsistent`] if the model cannot simulate it; the old ground is kept.
    fn set_ground(&mut self, ground: Option<&Arc<Ground>>) -> Result<()>;

    /// Time step, s.
    fn sim_dt(&self) -> f64;

    /// Restarts from an accepted `state` at time zero; a reset model is equal to a new one, to the last bit.
    fn place(&mut self, state: &State);

    /// Advances by `steps` time steps with constant motor torques, N·m.
    fn advance(&mut self, wheel_torques: Wheels<f64>, steps: usize);

    /// Simulated time since the reset, s.
    fn time(&self) -> f64;

    /// The present state.
    fn state(&self) -> State;

    /// Contact forces of the last step. Right after a reset, `contact` and `rigid` return zeros; the closed-form models
    /// return the forces of the present state without torque.
    fn contacts(&self) -> Contacts;

    /// Whether the body or a wheel touches the floor; always false for `planar` and `spatial`, which have no such contact.
    fn bot_on_floor(&self) -> bool {
        false
    }

    /// Whether the ball, the body or a wheel touches an obstacle.
    fn on_obstacle(&self) -> bool {
        false
    }

    /// Kinetic energy plus potential energies of body and ball, the body's above the ball center's resting height, J.
    fn energy(&self) -> f64;

    /// False after a step with non-finite numbers. The state is then the last finite state, except in `rigid`, whose
    /// engine keeps parts of the failed step.
    fn healthy(&self) -> bool;

    /// Checks that the model can represent a state.
    ///
    /// # Errors
    /// [`crate::Error::Inconsistent`] or [`crate::Error::OutOfRange`] otherwise.
    fn accepts(&self, state: &State) -> Result<()>;

    /// Applies an impulse (inertial frame, N·s) to the body at `point` (body frame, m), at once or over the next step.
    fn push(&mut self, impulse: &Vector3<f64>, point: &Vector3<f64>);

    /// Remaining effect of pushes: an impulse on the body, N·s, and its moment about the center of mass, N·m·s, both in
    /// the inertial frame. Zero in models in which pushes act at once.
    fn pending_push(&self) -> [f64; 6] {
        [0.0; 6]
    }

    /// Replaces the external force on the body, which acts in the coming time steps.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] if the model simulates none.
    fn hold_force(&mut self, _: &HeldForce<f64>) -> Result<()> {
        Err(Error::Inconsistent(
            "the model 'planar' has no force over time: use 'spatial', 'contact' or 'rigid'".into(),
        ))
    }

    /// The external force, as it acts next.
    fn held_force(&self) -> HeldForce<f64> {
        HeldForce::default()
    }

    /// Moves the rest of a payload's springs to a valid offset from its place, body axes, m, until another or a reset. Of no
    /// effect without that payload.
    fn move_payload(&mut self, _index: usize, _offset: [f64; 3]) {}

    /// Deflections of the payloads from their places; zeros without a payload.
    fn payloads(&self) -> [Deflection<f64>; PAYLOADS] {
        Default::default()
    }

    /// Replaces the deflections of the payloads, which [`crate::params::Params::validate_deflections`] accepts; no effect without
    /// a payload.
    fn set_payloads(&mut self, _: &[Deflection<f64>; PAYLOADS]) {}

    /// Appends everything that determines the future motion, for [`Model::load`].
    fn save(&self) -> Vec<u8>;

    /// Continues from bytes of [`Model::save`] from a model of the same kind, parameters and time step.
    ///
    /// # Errors
    /// [`crate::Error::Decode`] for any other bytes.
    fn load(&mut self, bytes: &[u8]) -> Result<()>;
}

/// Whether two robots have the same shape, so that a state of either is valid for the other.
pub fn same_geometry(a: &Params, b: &Params) -> bool {
    a.ball_radius == b.ball_radius
        && a.wheel_radius == b.wheel_radius
        && a.wheel_zenith == b.wheel_zenith
        && a.wheel_azimuths == b.wheel_azimuths
        && a.wheel_zenith_offsets == b.wheel_zenith_offsets
        && a.roller_angle == b.roller_angle
        && (a.body_com() == b.body_com() || differ_in_payload(a, b))
}

/// Whether the bodies without their payloads have the same CoM, within rounding.
fn differ_in_payload(a: &Params, b: &Params) -> bool {
    if !a.has_payload() && !b.has_payload() {
        return false;
    }
    let [a, b] = [a, b].map(|params| params.without_payloads().body_com());
    (a - b).norm() <= 1e-9 * a.norm()
}
