//! A discrete linear-quadratic regulator of position, tilt and heading, for any robot.

use super::riccati::{self, Regulator};
use super::{Controller, Setpoint, check_max_torque, default_max_torque, saturate};
use crate::error::{Result, positive};
use crate::models::LinearModel;
use crate::models::linear::{INPUTS, STATES};
use crate::params::Params;
use crate::state::State;
use nalgebra::{DMatrix, SMatrix, SVector, Vector3};
use std::f64::consts::{PI, TAU};

/// Deviations that cost the same (Bryson's rule): each state and input is weighed by one over its square.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LqrWeights {
    /// m.
    pub position: f64,
    /// m/s.
    pub velocity: f64,
    /// rad.
    pub tilt: f64,
    /// rad/s.
    pub tilt_rate: f64,
    /// rad.
    pub yaw: f64,
    /// rad/s.
    pub yaw_rate: f64,
    /// N·m.
    pub torque: f64,
}

impl Default for LqrWeights {
    fn default() -> Self {
        Self { position: 0.15, velocity: 0.4, tilt: 0.1, tilt_rate: 1.0, yaw: 0.5, yaw_rate: 2.0, torque: 0.2 }
    }
}

/// τ = −K x in the heading frame, scaled down together where a wheel would slip.
#[derive(Clone, Debug)]
pub struct Lqr {
    gain: SMatrix<f64, INPUTS, STATES>,
    regulator: Regulator,
    control_dt: f64,
    max_torque: f64,
}

impl Lqr {
    /// A regulator with the default weights, its torques within [`default_max_torque`].
    ///
    /// # Errors
    /// As [`Lqr::with_weights`].
    pub fn new(params: &Params, control_dt: f64) -> Result<Self> {
        Self::with_weights(params, control_dt, &LqrWeights::default(), default_max_torque(params))
    }

    /// A regulator from the linear model of `params`, discretised at `control_dt` (s); no wheel torque exceeds
    /// `max_torque` (N·m).
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] for a number that is not positive, [`crate::Error::Riccati`] if there is no solution.
    pub fn with_weights(params: &Params, control_dt: f64, weights: &LqrWeights, max_torque: f64) -> Result<Self> {
        params.validate()?;
        positive("control_dt", control_dt)?;
        check_max_torque(max_torque, params.max_wheel_torque)?;
        let w = weights;
        let names = ["position", "velocity", "tilt", "tilt_rate", "yaw", "yaw_rate", "torque"];
        let values = [w.position, w.velocity, w.tilt, w.tilt_rate, w.yaw, w.yaw_rate, w.torque];
        for (name, value) in names.iter().zip(values) {
            positive(name, value)?;
        }
        let deviations = [
            w.position,
            w.position,
            w.tilt,
            w.tilt,
            w.yaw,
            w.velocity,
            w.velocity,
            w.tilt_rate,
            w.tilt_rate,
            w.yaw_rate,
        ];
        let q = DMatrix::from_fn(STATES, STATES, |i, j| if i == j { deviations[i].powi(-2) } else { 0.0 });
        let r = DMatrix::identity(INPUTS, INPUTS) * w.torque.powi(-2);
        let (a, b) = LinearModel::new(params).discretize(control_dt);
        let a = DMatrix::from_column_slice(STATES, STATES, a.as_slice());
        let b = DMatrix::from_column_slice(STATES, INPUTS, b.as_slice());
        let regulator = riccati::solve(&a, &b, &q, &r)?;
        let gain = SMatrix::from_column_slice(regulator.gain.as_slice());
        Ok(Self { gain, regulator, control_dt, max_torque })
    }

    /// The Riccati solution behind the gains.
    pub fn regulator(&self) -> &Regulator {
        &self.regulator
    }

    /// Deviation from the setpoint in the linear model's coordinates.
    pub fn deviation(state: &State, setpoint: &Setpoint) -> SVector<f64, STATES> {
        let position = state.to_heading(state.ball_position.xy() - setpoint.position);
        let velocity = state.to_heading(state.ball_velocity.xy() - setpoint.velocity);
        let tilt = state.to_heading(state.tilt_components());
        let yaw = (state.yaw() - setpoint.yaw + PI).rem_euclid(TAU) - PI;
        let rate = state.body_angular_velocity;
        SVector::from([position.x, position.y, tilt.x, tilt.y, yaw, velocity.x, velocity.y, rate.x, rate.y, rate.z])
    }
}

impl Controller for Lqr {
    fn control_dt(&self) -> f64 {
        self.control_dt
    }

    fn reset(&mut self) {}

    fn wheel_torques(&mut self, state: &State, setpoint: &Setpoint) -> [f64; 3] {
        let torques: Vector3<f64> = -self.gain * Self::deviation(state, setpoint);
        saturate(torques, self.max_torque).into()
    }
}
