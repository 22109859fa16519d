//! Losses at the ball: rolling and spinning friction of the floor, and friction of the rollers.

use super::Params;
use crate::error::{Error, Result};

impl Params {
    /// Names of the parameters of losses at the ball: rolling and spinning friction of the floor, friction of the rollers.
    pub const LOSSES: [&'static str; 4] =
        ["floor_rolling_friction", "floor_spinning_friction", "roller_friction", "roller_friction_slope"];

    fn losses(&self) -> [f64; 4] {
        [self.floor_rolling_friction, self.floor_spinning_friction, self.roller_friction, self.roller_friction_slope]
    }

    /// Whether the ball has rolling or spinning friction, or the rollers have friction.
    pub fn has_losses(&self) -> bool {
        self.losses() != [0.0; 4]
    }

    /// Largest fraction of the speed of each loss that it removes in a step: none adds energy if their number times the
    /// fraction is at most 1. The losses of the ball's three rates do not couple and count as one.
    pub fn loss_share(&self) -> f64 {
        let [rolling, spinning, rollers, slope] = self.losses().map(|value| value > 0.0);
        let count = if rolling || spinning { 1.0 } else { 0.0 } + if rollers || slope { 3.0 } else { 0.0 };
        if count > 0.0 { 1.0 / count } else { 0.0 }
    }

    /// The robot without the losses of [`Params::has_losses`].
    #[must_use]
    pub fn without_losses(&self) -> Self {
        Self {
            floor_rolling_friction: 0.0,
            floor_spinning_friction: 0.0,
            roller_friction: 0.0,
            roller_friction_slope: 0.0,
            ..self.clone()
        }
    }

    /// Checks that the robot has none of the losses, as `what` requires.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] naming the first parameter that is not zero.
    pub fn require_lossless(&self, what: &str) -> Result<()> {
        match Self::LOSSES.iter().zip(self.losses()).find(|(_, value)| *value != 0.0) {
            Some((name, value)) => Err(Error::Inconsistent(format!("{what}: {name} = {value}, but it requires 0"))),
            None => Ok(()),
        }
    }
}
