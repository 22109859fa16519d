//! What a controller is to bring about.

use crate::error::{Result, check};
use crate::lanes::{Lane, cells};
use nalgebra::Vector2;

/// Where ball and body should be.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Setpoint {
    /// Ball position on the floor, inertial frame, m.
    pub position: Vector2<f64>,
    /// Ball velocity, inertial frame, m/s.
    pub velocity: Vector2<f64>,
    /// Heading, rad.
    pub yaw: f64,
    /// Tilt components about the heading frame's x and y axes, rad; for controllers of tilt alone.
    pub tilt: Vector2<f64>,
}

/// Largest magnitude of a number of a setpoint.
const MAX_SETPOINT: f64 = 1e4;

impl Setpoint {
    /// Checks that every number is within ±1e4.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] naming the first that is not.
    pub fn validate(&self) -> Result<()> {
        let parts = [
            ("position", self.position.as_slice()),
            ("velocity", self.velocity.as_slice()),
            ("yaw", std::slice::from_ref(&self.yaw)),
            ("tilt", self.tilt.as_slice()),
        ];
        for (name, values) in parts {
            for &value in values {
                let limit = format_args!("within ±{MAX_SETPOINT}");
                check(format_args!("setpoint {name}"), value, limit, |v| v.abs() <= MAX_SETPOINT)?;
            }
        }
        Ok(())
    }
}

/// Names of the parts of a [`Setpoint`].
pub const SETPOINT_PARTS: [&str; 4] = ["position", "velocity", "yaw", "tilt"];

cells! {
    /// [`Setpoint`] as it lies in memory.
    #[derive(Clone, Debug, Default, PartialEq)]
    pub struct SetpointCells {
        /// As in [`Setpoint`].
        pub position: [T; 2],
        /// As in [`Setpoint`].
        pub velocity: [T; 2],
        /// As in [`Setpoint`].
        pub yaw: T,
        /// As in [`Setpoint`].
        pub tilt: [T; 2],
    }
}

/// [`Setpoint`] of one robot or of eight.
pub struct LaneSetpoint<L> {
    /// As in [`Setpoint`].
    pub position: [L; 2],
    /// As in [`Setpoint`].
    pub velocity: [L; 2],
    /// As in [`Setpoint`].
    pub yaw: L,
    /// As in [`Setpoint`].
    pub tilt: [L; 2],
}

impl<T> SetpointCells<T> {
    /// Reads the setpoint.
    #[inline(always)]
    pub fn load<L: Lane<Cell = T>>(&self, token: L::Token) -> LaneSetpoint<L> {
        LaneSetpoint {
            position: [L::load(token, &self.position[0]), L::load(token, &self.position[1])],
            velocity: [L::load(token, &self.velocity[0]), L::load(token, &self.velocity[1])],
            yaw: L::load(token, &self.yaw),
            tilt: [L::load(token, &self.tilt[0]), L::load(token, &self.tilt[1])],
        }
    }
}

impl From<&Setpoint> for SetpointCells<f64> {
    fn from(setpoint: &Setpoint) -> Self {
        Self {
            position: setpoint.position.into(),
            velocity: setpoint.velocity.into(),
            yaw: setpoint.yaw,
            tilt: setpoint.tilt.into(),
        }
    }
}
