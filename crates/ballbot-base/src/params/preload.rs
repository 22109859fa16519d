//! The preload of the wheels: springs, magnets or a keeper that press them on the ball.
//!
//! Body and ball pull each other with the constant force P = `wheel_preload` along the mast: −P e_z on the body and P e_z
//! on the ball, with e_z the z axis of the body, both at the ball's center. The pair has no moment, and no power while
//! the wheels touch the ball. It acts while the ball's center is within the ball's radius of the origin of the body
//! frame. Friction of a keeper's own rollers on the ball, and a preload that changes with wear or deflection, are not
//! modeled.

use super::Params;
use crate::error::{Result, check};
use crate::wheels::Wheels;
use nalgebra::{Matrix3, Vector3};

/// Largest preload, in weights of the body. Beyond it the weight would be lost in the rounding of the loads.
const MAX_WEIGHTS: f64 = 1e3;

impl Params {
    /// Whether the wheels have a preload.
    pub fn has_preload(&self) -> bool {
        self.wheel_preload != 0.0
    }

    /// Load of each wheel by the preload alone, N: Σ N_i p_i = P e_z, P / (3 cos α) on a symmetric robot.
    pub fn preload_wheel_loads(&self) -> Wheels<f64> {
        if !self.has_preload() {
            return Wheels::default();
        }
        let directions = Matrix3::from_columns(&self.contact_directions().0);
        let pull = Vector3::z() * self.wheel_preload;
        // Coplanar directions do not carry load; validation rejects them.
        Wheels::of_column(directions.lu().solve(&pull).unwrap_or_else(Vector3::zeros))
    }

    pub(super) fn validate_preload(&self) -> Result<()> {
        let most = MAX_WEIGHTS * self.body_mass * self.gravity;
        let words = format_args!("at most {most} N, {MAX_WEIGHTS} times the body's weight");
        check("wheel_preload", self.wheel_preload, words, |force| force <= most)?;
        Ok(())
    }
}
