//! A floor that moves, and on which friction differs from place to place.

use super::Params;
use super::floor::STEEPEST;
use crate::error::{Error, Result, check};
use crate::lanes::{Scalar, run_one};
use crate::perturbed_floor::{FloorMotion, FrictionMap, Tile};
use nalgebra::Vector3;
use std::f64::consts::TAU;

/// Largest neglected acceleration of a rolling floor at the height of the CoM, as a fraction of gravity.
const MOST_NEGLECTED: f64 = 0.1;

impl Params {
    /// Whether the floor moves.
    pub fn has_moving_floor(&self) -> bool {
        self.floor_tilt_amplitude != [0.0; 2] || self.floor_acceleration != [0.0; 2]
    }

    /// Whether floor friction differs from place to place.
    pub fn has_uneven_friction(&self) -> bool {
        self.floor_friction_gradient != [0.0; 2] || self.floor_patch_size > 0.0 && self.floor_patch_friction != [1.0; 2]
    }

    /// Whether the floor moves, or its friction differs from place to place.
    pub fn has_perturbed_floor(&self) -> bool {
        self.has_moving_floor() || self.has_uneven_friction()
    }

    /// The same robot on a floor at rest with the same friction everywhere.
    #[must_use]
    pub fn on_still_floor(&self) -> Self {
        Self {
            floor_tilt_amplitude: [0.0; 2],
            floor_acceleration: [0.0; 2],
            floor_friction_gradient: [0.0; 2],
            floor_patch_size: 0.0,
            ..self.clone()
        }
    }

    /// Acceleration of gravity in the frame of the floor `time` s after the start of an episode, less the acceleration of the
    /// floor, m/s²: [`Params::gravity_vector`] on a floor at rest.
    pub fn gravity_at(&self, time: f64) -> Vector3<f64> {
        if !self.has_moving_floor() {
            return self.gravity_vector();
        }
        let up = run_one(
            #[inline(always)]
            || FloorMotion::new(self).load::<f64>(Scalar).up(time),
        );
        Vector3::zeros() - Vector3::new(up.x, up.y, up.z)
    }

    /// The mean of [`Params::gravity_at`] in the middle of each of `steps` time steps of `sim_dt` seconds, the first at `start`
    /// s after the start of an episode.
    pub fn mean_gravity(&self, start: f64, sim_dt: f64, steps: usize) -> Vector3<f64> {
        let sum = run_one(
            #[inline(always)]
            || {
                let motion = FloorMotion::new(self).load::<f64>(Scalar);
                let ups = (0..steps).map(|step| motion.up(start + (step as f64 + 0.5) * sim_dt));
                ups.fold(Vector3::zeros(), |sum, up| sum + Vector3::new(up.x, up.y, up.z))
            },
        );
        sum / -(steps as f64)
    }

    /// Angular velocity of the floor in its own frame `time` s after the start of an episode, rad/s.
    pub fn floor_rate_at(&self, time: f64) -> Vector3<f64> {
        if self.floor_tilt_amplitude == [0.0; 2] {
            return Vector3::zeros();
        }
        let (mut tilt, mut rate) = (Vector3::zeros(), Vector3::zeros());
        let per_second = TAU / self.floor_tilt_period;
        for i in 0..2 {
            let (sin, cos) = (per_second * time + self.floor_tilt_phases[i]).sin_cos();
            tilt[i] = self.floor_tilt[i] + self.floor_tilt_amplitude[i] * sin;
            rate[i] = self.floor_tilt_amplitude[i] * per_second * cos;
        }
        let squared = tilt.norm_squared();
        let angle = squared.sqrt();
        // The right Jacobian of rotations; series where the quotients lose digits.
        let (first, second) = if angle < 1e-3 {
            (0.5 - squared / 24.0, 1.0 / 6.0 - squared / 120.0)
        } else {
            ((1.0 - angle.cos()) / squared, (angle - angle.sin()) / (squared * angle))
        };
        let across = tilt.cross(&rate);
        rate - across * first + tilt.cross(&across) * second
    }

    /// Factor of floor friction at x and y, m: 1 on an even floor.
    pub fn floor_friction_factor(&self, x: f64, y: f64) -> f64 {
        if !self.has_uneven_friction() {
            return 1.0;
        }
        run_one(
            #[inline(always)]
            || FrictionMap::new(self).factor::<f64>(Scalar, [x, y], &mut Tile::default()),
        )
    }

    /// Checks that the floor is at rest, as `what` requires.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] naming the motion.
    pub fn require_still_floor(&self, what: &str) -> Result<()> {
        for (name, value) in
            [("floor_tilt_amplitude", self.floor_tilt_amplitude), ("floor_acceleration", self.floor_acceleration)]
        {
            if value != [0.0; 2] {
                return Err(Error::Inconsistent(format!("{what}: {name} = {value:?}, but it requires zeros")));
            }
        }
        Ok(())
    }

    /// Checks that floor friction is the same everywhere, as `what` requires.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] naming what differs.
    pub fn require_even_friction(&self, what: &str) -> Result<()> {
        let gradient = self.floor_friction_gradient;
        if gradient != [0.0; 2] {
            let name = "floor_friction_gradient";
            return Err(Error::Inconsistent(format!("{what}: {name} = {gradient:?}, but it requires zeros")));
        }
        if self.has_uneven_friction() {
            let (size, factors) = (self.floor_patch_size, self.floor_patch_friction);
            return Err(Error::Inconsistent(format!(
                "{what}: floor_patch_size = {size} m with floor_patch_friction = {factors:?}, but it requires 0"
            )));
        }
        Ok(())
    }

    pub(super) fn validate_perturbed_floor(&self) -> Result<()> {
        let [least, most] = self.floor_patch_friction;
        check("floor_patch_friction[0]", least, format_args!("at most floor_patch_friction[1] = {most}"), |f| {
            f <= most
        })?;
        let size = self.floor_patch_size;
        check("floor_patch_size", size, "0, or at least 1e-3 m", |size| size == 0.0 || size >= 1e-3)?;
        if self.floor_tilt_amplitude == [0.0; 2] {
            return Ok(());
        }
        let [x, y] = [0, 1].map(|i| self.floor_tilt[i].abs() + self.floor_tilt_amplitude[i].abs());
        let words = format_args!("at most {STEEPEST} rad");
        check("the length of |floor_tilt| + |floor_tilt_amplitude|", x.hypot(y), words, |angle| angle <= STEEPEST)?;
        let [x, y] = self.floor_tilt_amplitude;
        let rate = TAU / self.floor_tilt_period;
        let neglected = x.hypot(y) * rate * rate * (self.ball_radius + self.body_com_height);
        let most = MOST_NEGLECTED * self.gravity;
        check(
            "floor_tilt_amplitude (2 pi / floor_tilt_period)^2 (ball_radius + body_com_height)",
            neglected,
            format_args!("at most {most} m/s^2, {MOST_NEGLECTED} of gravity: the models neglect this acceleration"),
            |acceleration| acceleration <= most,
        )?;
        Ok(())
    }
}
