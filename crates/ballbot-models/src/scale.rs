//! The size of a robot relative to the robot of the paper.

use super::LinearModel;
use super::capture::Hold;
use ballbot_base::fields::Fields;
use ballbot_base::params::Params;
use std::sync::OnceLock;

/// Least scale of a lean: a robot without traction could not command any.
const LEAST_LEAN: f64 = 0.05;

/// Factors from a quantity of the paper's robot to the same quantity of a dynamically similar robot (Froude scaling).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// Of times: the time constant 1/λ of toppling.
    pub time: f64,
    /// Of accelerations: gravity.
    pub acceleration: f64,
    /// Of masses: the mass of body and ball.
    pub mass: f64,
    /// Of wheel torques: the largest torque of a wheel that holds a small lean, over the lean.
    pub torque: f64,
    /// Of leans: the lean that traction and motors can hold, at least 0.05.
    pub lean: f64,
    /// Of wheel speeds: the scale of velocities over that of wheel radii.
    pub wheel_speed: f64,
    /// Of the acceleration of the ball per lean, in units of gravity; no factor of a unit has it.
    pub lean_acceleration: f64,
}

impl Scale {
    /// The scale of a robot; 1 for the robot of the paper.
    pub fn of(params: &Params) -> Self {
        static PAPER: OnceLock<Scale> = OnceLock::new();
        let paper = PAPER.get_or_init(|| Self::absolute(&Params::paper()));
        let own = Self::absolute(params);
        Self {
            time: own.time / paper.time,
            acceleration: own.acceleration / paper.acceleration,
            mass: own.mass / paper.mass,
            torque: own.torque / paper.torque,
            lean: (own.lean / paper.lean).max(LEAST_LEAN),
            wheel_speed: own.wheel_speed / paper.wheel_speed,
            lean_acceleration: own.lean_acceleration / paper.lean_acceleration,
        }
    }

    /// 1/λ (s), gravity (m/s²), the mass (kg), the torque that holds a lean (N·m/rad), the lean that the robot can hold (rad), the
    /// speed of a wheel (rad/s) at the velocity that gravity gives in that time, and the acceleration per lean (1/rad).
    fn absolute(params: &Params) -> Self {
        let level = params.on_level_floor();
        let linear = LinearModel::new(&level);
        let hold = Hold::of(&level, &linear);
        let time = linear.toppling_squared().sqrt().recip();
        Self {
            time,
            acceleration: level.gravity,
            mass: level.body_mass + level.ball_mass,
            torque: hold.torque,
            lean: hold.lean,
            wheel_speed: level.gravity * time / level.wheel_radius,
            lean_acceleration: linear.acceleration_per_lean() / level.gravity,
        }
    }

    /// Options with the defaults of the robot where they are unset.
    pub fn fit<F: Fields>(&self, options: &F) -> F {
        options.fitted(|unit| self.factor(unit).expect("scaled options have a unit that scales"))
    }

    /// The factor of a quantity with a unit; `None` for units that no option of a task or controller has.
    pub fn factor(&self, unit: &str) -> Option<f64> {
        Some(match unit {
            "" => 1.0,
            "rad" => self.lean,
            "s" => self.time,
            "1/s" | "rad/s" => self.time.recip(),
            "m/s²" => self.acceleration,
            "m/s³" => self.acceleration / self.time,
            "m/s" => self.acceleration * self.time,
            "m" => self.acceleration * self.time * self.time,
            "kg" => self.mass,
            "N" => self.mass * self.acceleration,
            "N·s/m" => self.mass / self.time,
            "N·m" => self.torque,
            "N·m/(rad/s)" => self.torque / self.wheel_speed,
            _ => return None,
        })
    }
}
