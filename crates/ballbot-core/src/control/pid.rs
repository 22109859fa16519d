//! The paper's controller (section III-A): a PID with filtered derivative on each tilt component.

use super::{Controller, Setpoint, check_max_torque, default_max_torque, saturate};
use crate::error::{Result, check, positive};
use crate::kinematics::{Omniwheels, TorqueMap};
use crate::params::Params;
use crate::state::State;
use nalgebra::{Vector2, Vector3};

/// Gains of C(s) = k_p + k_i / s + k_d N s / (s + N), from tilt error to virtual torque.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PidGains {
    /// k_p, N·m/rad.
    pub proportional: f64,
    /// k_i, N·m/(rad·s).
    pub integral: f64,
    /// k_d, N·m·s/rad.
    pub derivative: f64,
    /// N, rad/s.
    pub filter_coefficient: f64,
}

impl PidGains {
    /// The paper's gains (section III-A).
    pub const PAPER: Self = Self { proportional: 20.39, integral: 56.57, derivative: 1.34, filter_coefficient: 327.0 };
}

/// Two PID controllers, about the x and y axes of the heading frame. It controls tilt alone: nothing holds the ball's
/// position or the heading.
#[derive(Clone, Debug)]
pub struct Pid {
    wheels: Omniwheels,
    map: TorqueMap,
    gains: PidGains,
    control_dt: f64,
    max_torque: f64,
    motor_torque: f64,
    integral: Vector2<f64>,
    /// The derivative filter's state; it starts at the first error, so that a start away from the setpoint is no step.
    filtered: Option<Vector2<f64>>,
}

impl Pid {
    /// A PID for `params`, sampled every `control_dt` seconds, its wheel torques within [`default_max_torque`].
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] for gains that are negative or not finite, or a `control_dt` that is not positive.
    pub fn new(params: &Params, control_dt: f64, gains: PidGains, map: TorqueMap) -> Result<Self> {
        params.validate()?;
        positive("control_dt", control_dt)?;
        for (name, gain) in
            [("proportional", gains.proportional), ("integral", gains.integral), ("derivative", gains.derivative)]
        {
            check(name, gain, ">= 0", |g| g >= 0.0)?;
        }
        positive("filter_coefficient", gains.filter_coefficient)?;
        Ok(Self {
            wheels: Omniwheels::new(params),
            map,
            gains,
            control_dt,
            max_torque: default_max_torque(params),
            motor_torque: params.max_wheel_torque,
            integral: Vector2::zeros(),
            filtered: None,
        })
    }

    /// The same with another limit of the wheel torques, N·m.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] for a limit that is not positive, or above the motors'.
    pub fn with_max_torque(mut self, max_torque: f64) -> Result<Self> {
        self.max_torque = check_max_torque(max_torque, self.motor_torque)?;
        Ok(self)
    }

    /// Virtual torques (τ_x, τ_y) for a tilt error in the heading frame, before any limit, N·m.
    pub fn virtual_torques(&mut self, error: Vector2<f64>) -> Vector2<f64> {
        let g = self.gains;
        let filtered = self.filtered.get_or_insert(error);
        let derivative = (error - *filtered) * (g.derivative * g.filter_coefficient);
        // Exact for an error held over the sample.
        *filtered += (error - *filtered) * (1.0 - (-g.filter_coefficient * self.control_dt).exp());
        let torques = error * g.proportional + self.integral * g.integral + derivative;
        self.integral += error * self.control_dt;
        torques
    }
}

impl Controller for Pid {
    fn control_dt(&self) -> f64 {
        self.control_dt
    }

    fn reset(&mut self) {
        self.integral = Vector2::zeros();
        self.filtered = None;
    }

    fn wheel_torques(&mut self, state: &State, setpoint: &Setpoint) -> [f64; 3] {
        let before = self.integral;
        let error = setpoint.tilt - state.to_heading(state.tilt_components());
        let virtual_torques = self.virtual_torques(error).push(0.0);
        let wanted: Vector3<f64> = self.wheels.wheel_torques(&virtual_torques, self.map);
        let given = saturate(wanted, self.max_torque);
        if given != wanted {
            // A saturated motor cannot act on the integral: hold it.
            self.integral = before;
        }
        given.into()
    }
}
