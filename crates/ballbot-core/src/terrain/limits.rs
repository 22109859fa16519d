//! Slopes that a robot can stand on.

use crate::error::{Result, check};
use crate::kinematics::Omniwheels;
use crate::params::Params;
use std::f64::consts::FRAC_PI_2;

/// Slopes at which a robot that stands still meets a limit, rad; π/2 where none is met.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlopeLimits {
    /// The lean that holds it is the tilt at which it counts as fallen.
    pub fall: f64,
    /// A wheel slips on the ball, or the ball on the ground.
    pub traction: f64,
    /// A motor gives its largest torque.
    pub motor: f64,
}

impl SlopeLimits {
    /// The smallest of them, rad.
    pub fn smallest(&self) -> f64 {
        self.fall.min(self.traction).min(self.motor)
    }
}

impl Params {
    /// Slopes that the robot can stand on, whatever their direction and its heading; it counts as fallen at the tilt
    /// `fall_tilt`, rad.
    ///
    /// On a slope γ a robot leans by asin(M r_k sin γ / (M_b l)) and its motors hold τ = r_w M g sin γ U⁻ᵀ h for a horizontal
    /// unit vector h, with M the mass of ball and body, and l the distance of the body's center of mass from the ball's. The
    /// loads of the wheels are those upright: exact limits of traction are lower by the lean.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] unless `fall_tilt` is above 0 and at most π/2.
    pub fn slope_limits(&self, fall_tilt: f64) -> Result<SlopeLimits> {
        check("fall_tilt", fall_tilt, "above 0 and at most pi/2", |tilt| tilt > 0.0 && tilt <= FRAC_PI_2)?;
        let angle = |sine: f64| if sine < 1.0 { sine.asin() } else { FRAC_PI_2 };
        let mass = self.ball_mass + self.body_mass;
        let weight = mass * self.gravity;
        let holds = self.body_mass * self.body_com().norm() / (mass * self.ball_radius);
        let inverse =
            Omniwheels::new(self).u.transpose().try_inverse().expect("the axles of a validated robot span space");
        let attitude = self.equilibrium_attitude(0.0);
        let loads = self.equilibrium_wheel_loads();
        let (mut traction, mut motor) = (self.floor_dynamic_friction.atan().sin(), f64::INFINITY);
        for (i, load) in loads.into_iter().enumerate() {
            let share = (attitude * inverse.row(i).transpose()).xy().norm();
            traction = traction.min(self.wheel_dynamic_friction * load / (weight * share));
            motor = motor.min(self.max_wheel_torque / (self.wheel_radius * weight * share));
        }
        Ok(SlopeLimits { fall: angle(fall_tilt.sin() * holds), traction: angle(traction), motor: angle(motor) })
    }
}
