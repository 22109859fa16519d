//! A sloped floor: the direction of gravity in its frame, and the static equilibrium of a robot on it.

use super::Params;
use crate::error::{Error, Result, check};
use crate::wheels::Wheels;
use nalgebra::{Matrix3, UnitQuaternion, Vector2, Vector3};

/// Largest angle between the floor's normal and the vertical, rad.
pub(super) const STEEPEST: f64 = 0.5;

impl Params {
    /// Angle θ between the floor's normal and the vertical, rad.
    pub fn slope(&self) -> f64 {
        let [x, y] = self.floor_tilt;
        x.hypot(y)
    }

    /// Unit vector opposite to gravity in the frame of the floor, whose z axis is the floor's normal: with the rotation
    /// R by the vector ω = `floor_tilt` of angle θ, it is Rᵀ e3 = (−ω_y sin θ / θ, ω_x sin θ / θ, cos θ).
    pub fn up(&self) -> Vector3<f64> {
        let angle = self.slope();
        if angle == 0.0 {
            return Vector3::z();
        }
        let share = angle.sin() / angle;
        let [x, y] = self.floor_tilt;
        Vector3::new(-y * share, x * share, angle.cos())
    }

    /// Acceleration of gravity in the frame of the floor, −g [`Params::up`], m/s²: (0, 0, −g) on a level floor.
    pub fn gravity_vector(&self) -> Vector3<f64> {
        // A difference, so that no zero is negative: adding a negative zero would change bits.
        Vector3::zeros() - self.up() * self.gravity
    }

    /// The same robot on a level floor at rest.
    #[must_use]
    pub fn on_level_floor(&self) -> Self {
        Self { floor_tilt: [0.0; 2], floor_tilt_amplitude: [0.0; 2], floor_acceleration: [0.0; 2], ..self.clone() }
    }

    /// Checks that the floor is level, as `what` requires.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] naming the tilt.
    pub fn require_level(&self, what: &str) -> Result<()> {
        if self.floor_tilt == [0.0; 2] {
            return Ok(());
        }
        Err(Error::Inconsistent(format!("{what}: floor_tilt = {:?}, but it requires zeros", self.floor_tilt)))
    }

    pub(super) fn validate_slope(&self) -> Result<()> {
        let words = format_args!("at most {STEEPEST} rad");
        check("the angle of floor_tilt, its length,", self.slope(), words, |angle| angle <= STEEPEST)?;
        Ok(())
    }

    /// Tilt from the floor's normal at which a robot is at rest on the slope, rad: the rotation vector (x, y) for
    /// [`State::tilted_from_equilibrium`](crate::State::tilted_from_equilibrium), at any heading.
    ///
    /// The common center of mass of ball and body is then above the floor contact. With the mass M = M_k + M_b and the
    /// distance l of the body's center of mass from the ball's center this is θ + asin(M r_k sin θ / (M_b l)), uphill. The
    /// motors hold it by [`Params::holding_torques`].
    ///
    /// # Errors
    /// [`Error::Inconsistent`] for a slope that is too steep: M r_k sin θ > M_b l.
    pub fn slope_lean(&self) -> Result<Vector2<f64>> {
        let angle = self.slope();
        if angle == 0.0 {
            return Ok(Vector2::zeros());
        }
        let needed = (self.ball_mass + self.body_mass) * self.ball_radius * angle.sin();
        let largest = self.body_mass * self.body_com().norm();
        if needed > largest {
            return Err(Error::Inconsistent(format!(
                "no lean holds the robot on the slope of floor_tilt = {:?}: it takes {needed} kg·m, (ball_mass + body_mass) \
                 ball_radius sin of the slope, of the {largest} kg·m that the body has about the ball's center",
                self.floor_tilt
            )));
        }
        let lean = angle + (needed / largest).asin();
        Ok(Vector2::zeros() - Vector2::from(self.floor_tilt) * (lean / angle))
    }

    /// Motor torques that hold a robot at the heading `yaw` (rad) still in [`Params::slope_lean`], N·m. With the vector
    /// u = [`Params::up`] in the frame of the floor, the body attitude R and U = [`Params::drive_matrix`], τ = r_w M g U⁻ᵀ
    /// Rᵀ (e3 × u), zero on a level floor.
    ///
    /// # Errors
    /// As [`Params::slope_lean`].
    pub fn holding_torques(&self, yaw: f64) -> Result<Wheels<f64>> {
        let lean = UnitQuaternion::from_scaled_axis(self.slope_lean()?.push(0.0));
        let attitude = lean * self.equilibrium_attitude(yaw);
        let weight = (self.ball_mass + self.body_mass) * self.gravity;
        let moment = attitude.inverse_transform_vector(&Vector3::z().cross(&self.up())) * weight;
        let axles: Matrix3<f64> = self.drive_matrix().transpose();
        let torques = axles.lu().solve(&moment).expect("the axles of a validated robot span space");
        Ok(Wheels::of_column(torques * self.wheel_radius))
    }
}
