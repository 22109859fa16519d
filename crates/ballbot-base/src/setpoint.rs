//! The goal of a controller.

use crate::error::{Result, check};
use crate::lanes::lane_struct;
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
}

/// What follows from the names of the parts.
macro_rules! parts {
    ($count:literal: $($part:ident)*) => {
        /// Names of the parts of a [`Setpoint`].
        pub const SETPOINT_PARTS: [&str; $count] = [$(stringify!($part)),*];

        impl Setpoint {
            /// A part by its name, of [`SETPOINT_PARTS`]; empty for any other name.
            pub fn part(&self, name: &str) -> &[f64] {
                match name {
                    $(stringify!($part) => self.$part.numbers(),)*
                    _ => &[],
                }
            }

            /// Mutable [`Setpoint::part`].
            pub fn part_mut(&mut self, name: &str) -> &mut [f64] {
                match name {
                    $(stringify!($part) => self.$part.numbers_mut(),)*
                    _ => &mut [],
                }
            }
        }

        impl From<&Setpoint> for LaneSetpoint<f64> {
            fn from(setpoint: &Setpoint) -> Self {
                Self { $($part: setpoint.$part.into()),* }
            }
        }

        impl From<&LaneSetpoint<f64>> for Setpoint {
            fn from(setpoint: &LaneSetpoint<f64>) -> Self {
                Self { $($part: setpoint.$part.into()),* }
            }
        }
    };
}

parts!(8: position velocity acceleration jerk snap yaw yaw_rate tilt);

/// Numbers of a part.
trait Part {
    fn numbers(&self) -> &[f64];
    fn numbers_mut(&mut self) -> &mut [f64];
}

impl Part for f64 {
    fn numbers(&self) -> &[f64] {
        slice::from_ref(self)
    }
    fn numbers_mut(&mut self) -> &mut [f64] {
        slice::from_mut(self)
    }
}

impl Part for Vector2<f64> {
    fn numbers(&self) -> &[f64] {
        self.as_slice()
    }
    fn numbers_mut(&mut self) -> &mut [f64] {
        self.as_mut_slice()
    }
}

/// The setpoint parts followed by a controller that holds a position.
pub const MOTION_PARTS: &[&str] = &["position", "velocity", "acceleration", "jerk", "snap", "yaw", "yaw_rate"];

lane_struct! {
    /// [`Setpoint`] of one robot or of eight, in registers or in memory.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct LaneSetpoint<T> {
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
