//! The goal of a controller.

use crate::error::{Result, check};
use crate::lanes::{Lane, cells};
use nalgebra::Vector2;
use std::slice;

/// Desired position and motion of ball and body.
///
/// An accelerating robot leans. If the derivatives of the flat output of a motion are given
/// (`Reference`), lean and torques of the motion are fed forward; if they are zero, only the
/// deviations from position, velocity and heading drive the robot.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Setpoint {
    /// Ball position on the floor, inertial frame, m.
    pub position: Vector2<f64>,
    /// Ball velocity, inertial frame, m/s.
    pub velocity: Vector2<f64>,
    /// Acceleration of the flat output, inertial frame, m/s²: the robot leans in proportion to it. In slow motion it is
    /// the acceleration of the ball.
    pub acceleration: Vector2<f64>,
    /// Derivative of `acceleration`, m/s³.
    pub jerk: Vector2<f64>,
    /// Derivative of `jerk`, m/s⁴.
    pub snap: Vector2<f64>,
    /// Heading, rad.
    pub yaw: f64,
    /// Rate of the heading, rad/s.
    pub yaw_rate: f64,
    /// Tilt components about the heading frame's x and y axes, rad; only for tilt controllers.
    pub tilt: Vector2<f64>,
}

/// Largest magnitude of a number of a setpoint.
const MAX_SETPOINT: f64 = 1e4;

impl Setpoint {
    /// Checks that every number is within ±1e4.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] naming the first number outside.
    pub fn validate(&self) -> Result<()> {
        for name in SETPOINT_PARTS {
            for &value in self.part(name) {
                let limit = format_args!("within ±{MAX_SETPOINT}");
                check(format_args!("setpoint {name}"), value, limit, |v| v.abs() <= MAX_SETPOINT)?;
            }
        }
        Ok(())
    }

    /// A part by its name, of [`SETPOINT_PARTS`]; empty for any other name.
    pub fn part(&self, name: &str) -> &[f64] {
        match name {
            "position" => self.position.as_slice(),
            "velocity" => self.velocity.as_slice(),
            "acceleration" => self.acceleration.as_slice(),
            "jerk" => self.jerk.as_slice(),
            "snap" => self.snap.as_slice(),
            "yaw" => slice::from_ref(&self.yaw),
            "yaw_rate" => slice::from_ref(&self.yaw_rate),
            "tilt" => self.tilt.as_slice(),
            _ => &[],
        }
    }

    /// Mutable [`Setpoint::part`].
    pub fn part_mut(&mut self, name: &str) -> &mut [f64] {
        match name {
            "position" => self.position.as_mut_slice(),
            "velocity" => self.velocity.as_mut_slice(),
            "acceleration" => self.acceleration.as_mut_slice(),
            "jerk" => self.jerk.as_mut_slice(),
            "snap" => self.snap.as_mut_slice(),
            "yaw" => slice::from_mut(&mut self.yaw),
            "yaw_rate" => slice::from_mut(&mut self.yaw_rate),
            "tilt" => self.tilt.as_mut_slice(),
            _ => &mut [],
        }
    }
}

/// Names of the parts of a [`Setpoint`].
pub const SETPOINT_PARTS: [&str; 8] =
    ["position", "velocity", "acceleration", "jerk", "snap", "yaw", "yaw_rate", "tilt"];

/// The setpoint parts followed by a controller that holds a position.
pub const MOTION_PARTS: &[&str] = &["position", "velocity", "acceleration", "jerk", "snap", "yaw", "yaw_rate"];

cells! {
    /// [`Setpoint`] in memory.
    #[derive(Clone, Debug, Default, PartialEq)]
    pub struct SetpointCells {
        /// As in [`Setpoint`].
        pub position: [T; 2],
        /// As in [`Setpoint`].
        pub velocity: [T; 2],
        /// As in [`Setpoint`].
        pub acceleration: [T; 2],
        /// As in [`Setpoint`].
        pub jerk: [T; 2],
        /// As in [`Setpoint`].
        pub snap: [T; 2],
        /// As in [`Setpoint`].
        pub yaw: T,
        /// As in [`Setpoint`].
        pub yaw_rate: T,
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
    pub acceleration: [L; 2],
    /// As in [`Setpoint`].
    pub jerk: [L; 2],
    /// As in [`Setpoint`].
    pub snap: [L; 2],
    /// As in [`Setpoint`].
    pub yaw: L,
    /// As in [`Setpoint`].
    pub yaw_rate: L,
    /// As in [`Setpoint`].
    pub tilt: [L; 2],
}

impl<T> SetpointCells<T> {
    /// Reads the setpoint.
    #[inline(always)]
    pub fn load<L: Lane<Cell = T>>(&self, token: L::Token) -> LaneSetpoint<L> {
        LaneSetpoint {
            position: load2(token, &self.position),
            velocity: load2(token, &self.velocity),
            acceleration: load2(token, &self.acceleration),
            jerk: load2(token, &self.jerk),
            snap: load2(token, &self.snap),
            yaw: L::load(token, &self.yaw),
            yaw_rate: L::load(token, &self.yaw_rate),
            tilt: load2(token, &self.tilt),
        }
    }
}

#[inline(always)]
fn load2<L: Lane>(token: L::Token, [x, y]: &[L::Cell; 2]) -> [L; 2] {
    [L::load(token, x), L::load(token, y)]
}

impl From<&Setpoint> for SetpointCells<f64> {
    fn from(setpoint: &Setpoint) -> Self {
        Self {
            position: setpoint.position.into(),
            velocity: setpoint.velocity.into(),
            acceleration: setpoint.acceleration.into(),
            jerk: setpoint.jerk.into(),
            snap: setpoint.snap.into(),
            yaw: setpoint.yaw,
            yaw_rate: setpoint.yaw_rate,
            tilt: setpoint.tilt.into(),
        }
    }
}

impl From<&SetpointCells<f64>> for Setpoint {
    fn from(cells: &SetpointCells<f64>) -> Self {
        Self {
            position: cells.position.into(),
            velocity: cells.velocity.into(),
            acceleration: cells.acceleration.into(),
            jerk: cells.jerk.into(),
            snap: cells.snap.into(),
            yaw: cells.yaw,
            yaw_rate: cells.yaw_rate,
            tilt: cells.tilt.into(),
        }
    }
}
