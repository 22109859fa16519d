//! The rim of a wheel, which consists of its rollers.

use super::Params;
use super::geometry::reject;
use crate::error::{Result, check};
use std::f64::consts::PI;

impl Params {
    /// Whether the rims of the wheels have a ripple.
    pub fn has_ripple(&self) -> bool {
        self.roller_ripple != 0.0
    }

    /// Checks that the wheels are round, as `what` requires.
    ///
    /// # Errors
    /// [`crate::Error::Inconsistent`] naming the ripple.
    pub fn require_round_wheels(&self, what: &str) -> Result<()> {
        let ripple = self.roller_ripple;
        reject(what, self.has_ripple().then(|| format!("roller_ripple = {ripple} m, but it requires 0")))
    }

    /// Whether the axes of the rollers are inclined, as on mecanum wheels.
    pub fn has_inclined_rollers(&self) -> bool {
        self.roller_angle != 0.0
    }

    /// Checks that the rollers are not inclined, as `what` requires.
    ///
    /// # Errors
    /// [`crate::Error::Inconsistent`] naming the angle.
    pub fn require_omniwheels(&self, what: &str) -> Result<()> {
        reject(what, self.inclined_rollers())
    }

    pub(super) fn inclined_rollers(&self) -> Option<String> {
        let angle = self.roller_angle;
        self.has_inclined_rollers().then(|| format!("roller_angle = {angle} rad, but it requires 0"))
    }

    pub(super) fn validate_rollers(&self) -> Result<()> {
        let count = self.roller_count;
        check("roller_count", count, "a whole number", |n| n.fract() == 0.0)?;
        let straight = self.wheel_radius * (1.0 - (PI / count).cos());
        let words = format_args!(
            "at most {straight} m, wheel_radius (1 - cos(pi / roller_count)), the ripple of straight rollers"
        );
        check("roller_ripple", self.roller_ripple, words, |ripple| ripple <= straight)?;
        Ok(())
    }
}
