//! Slopes on which a robot can balance.

use crate::error::{Result, check};
use crate::kinematics::Omniwheels;
use crate::params::Params;
use nalgebra::Matrix3;
use std::f64::consts::FRAC_PI_2;

/// Slopes at which a robot at rest reaches a limit, rad; π/2 if it does not reach the limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlopeLimits {
    /// The lean that holds the robot equals the tilt at which it counts as fallen.
    pub fall: f64,
    /// A wheel slips on the ball, or the ball on the ground; a wheel slips before it loses its load.
    pub traction: f64,
    /// A motor gives its largest torque.
    pub motor: f64,
}

impl SlopeLimits {
    /// The smallest of the slopes, rad.
    pub fn smallest(&self) -> f64 {
        self.fall.min(self.traction).min(self.motor)
    }
}

impl Params {
    /// Slopes on which the robot can balance in its worst heading; it counts as fallen at the tilt `fall_tilt`, rad.
    ///
    /// It leans by [`Params::slope_lean`] and is held by [`Params::holding_torques`]. Loads are computed at this lean
    /// with the reaction of the drive. At rest the contacts grip, so friction is static. Derived in
    /// `docs/derivations.md`, "Slope".
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] unless `fall_tilt` is above 0 and at most π/2.
    pub fn slope_limits(&self, fall_tilt: f64) -> Result<SlopeLimits> {
        check("fall_tilt", fall_tilt, "above 0 and at most pi/2", |tilt| tilt > 0.0 && tilt <= FRAC_PI_2)?;
        let angle = |sine: f64| if sine < 1.0 { sine.asin() } else { FRAC_PI_2 };
        let mass = self.ball_mass + self.body_mass;
        let weight = mass * self.gravity;
        // Sine of the lean per sine of the slope.
        let lean = mass * self.ball_radius / (self.body_mass * self.body_com().norm());
        let wheels = Omniwheels::new(self);
        let spans = "axles and contacts of a validated robot span space";
        let body = self.to_balance_frame().inverse().to_rotation_matrix().into_inner();
        // Per sine of the slope, for the unit vector h of the moment that holds the robot, heading frame, N: tractions,
        // and changes of the loads by the body's weight at the lean, h × e3, and by the reaction to the tractions.
        let tractions = wheels.u.transpose().try_inverse().expect(spans) * body * (weight / self.roller_angle.cos());
        let across =
            Matrix3::new(0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0) * (lean * self.body_mass * self.gravity);
        let reaction = Matrix3::from_columns(&wheels.drive_directions.0) * tractions - body * across;
        let gains = Matrix3::from_columns(&wheels.contact_directions.0).try_inverse().expect(spans) * reaction;
        let friction = self.wheel_static_friction;
        let (mut traction, mut motor) = (self.floor_static_friction.atan().sin(), f64::INFINITY);
        let preloads = self.preload_wheel_loads();
        for (i, load) in self.equilibrium_wheel_loads().into_iter().enumerate() {
            let (pull, gain) = (tractions.fixed_view::<1, 2>(i, 0), gains.fixed_view::<1, 2>(i, 0) * friction);
            // sin γ (±pull - gain)·h = μ (N cos(lean) + N_P), for the worst direction of h, with the load N_P by the preload.
            let worst = (pull - gain).norm().max((pull + gain).norm());
            traction = traction.min(slipping_sine(worst, friction, [load - preloads[i], preloads[i]], lean));
            motor = motor.min(self.max_wheel_torque / (wheels.traction_radius * pull.norm()));
        }
        Ok(SlopeLimits { fall: angle(fall_tilt.sin() / lean), traction: angle(traction), motor: angle(motor) })
    }
}

/// Sine s of the slope at which a wheel slips, s `pull` = μ (N cos(lean) + N_P) with sin(lean) = s `lean`, for the loads
/// [N, N_P] by weight and preload; infinite if it never does.
fn slipping_sine(pull: f64, friction: f64, [weight, preload]: [f64; 2], lean: f64) -> f64 {
    if preload == 0.0 {
        return friction * weight / pull.hypot(lean * friction * weight);
    }
    let (grip, rest) = (friction * weight, friction * preload);
    if pull <= lean * rest {
        return f64::INFINITY;
    }
    let root = (pull * pull + lean * lean * (grip * grip - rest * rest)).sqrt();
    (pull * rest + grip * root) / pull.hypot(lean * grip).powi(2)
}
