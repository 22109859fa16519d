//! The rim of an omniwheel, which consists of its rollers.

use super::Params;
use crate::error::{Error, Result, check};
use std::f64::consts::PI;

impl Params {
    /// Whether the rims of the wheels have a ripple.
    pub fn has_ripple(&self) -> bool {
        self.roller_ripple != 0.0
    }

    /// Checks that the wheels are round, as `what` requires.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] naming the ripple.
    pub fn require_round_wheels(&self, what: &str) -> Result<()> {
        if self.has_ripple() {
            let ripple = self.roller_ripple;
            return Err(Error::Inconsistent(format!("{what}: roller_ripple = {ripple} m, but it requires 0")));
        }
        Ok(())
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
