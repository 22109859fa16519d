//! The reward: named terms, each times its scale.

use super::ACTION_LEN;
use crate::lanes::{Lane, Vec3};

/// Weight of each term; costs are subtracted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RewardScales {
    /// For every step that does not end in a fall.
    pub alive: f64,
    /// Of the squared tilt over the tilt at which the episode ends.
    pub tilt: f64,
    /// Of the distance from the setpoint, saturating: d² / (d² + r²) with r the success radius.
    pub position: f64,
    /// Of the squared ball speed in m/s.
    pub velocity: f64,
    /// Of the squared body rate in rad/s.
    pub rate: f64,
    /// Of the mean squared action.
    pub action: f64,
    /// Of the mean squared change of the action.
    pub action_change: f64,
}

impl Default for RewardScales {
    fn default() -> Self {
        Self { alive: 1.0, tilt: 1.0, position: 0.5, velocity: 0.2, rate: 0.01, action: 0.02, action_change: 0.02 }
    }
}

/// The terms of one step, scaled and signed: the reward is their sum.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RewardTerms {
    /// See [`RewardScales`], likewise for all fields.
    pub alive: f64,
    /// Cost of tilt.
    pub tilt: f64,
    /// Cost of distance.
    pub position: f64,
    /// Cost of ball speed.
    pub velocity: f64,
    /// Cost of body rate.
    pub rate: f64,
    /// Cost of effort.
    pub action: f64,
    /// Cost of jerky effort.
    pub action_change: f64,
}

impl RewardTerms {
    /// Names of the terms, in the order of [`RewardTerms::values`].
    pub const NAMES: [&'static str; 7] = ["alive", "tilt", "position", "velocity", "rate", "action", "action_change"];

    /// The terms in the order of [`RewardTerms::NAMES`].
    pub fn values(&self) -> [f64; 7] {
        [self.alive, self.tilt, self.position, self.velocity, self.rate, self.action, self.action_change]
    }

    /// From the terms in the order of [`RewardTerms::NAMES`].
    pub(super) fn from_values([alive, tilt, position, velocity, rate, action, action_change]: [f64; 7]) -> Self {
        Self { alive, tilt, position, velocity, rate, action, action_change }
    }

    /// The reward.
    pub fn sum(&self) -> f64 {
        self.values().iter().sum()
    }
}

/// What the reward of a step depends on.
pub(super) struct Transition<L: Lane> {
    pub tilt: L,
    /// From the setpoint.
    pub distance_squared: L,
    /// x, y.
    pub ball_velocity: [L; 2],
    pub body_rate: Vec3<L>,
    pub action: [L; ACTION_LEN],
    pub last_action: [L; ACTION_LEN],
    pub fallen: L::Mask,
}

/// The terms in the order of [`RewardTerms::NAMES`].
#[inline(always)]
pub(super) fn terms<L: Lane>(
    scales: &RewardScales,
    fall_tilt: f64,
    success_radius: f64,
    transition: &Transition<L>,
) -> [L; RewardTerms::NAMES.len()] {
    let zero = transition.tilt.zero();
    let [vx, vy] = transition.ball_velocity;
    let [a, b, c] = transition.action;
    let [last_a, last_b, last_c] = transition.last_action;
    let tilt = (transition.tilt / fall_tilt).squared().min(zero.splat(1.0));
    let distance = transition.distance_squared;
    let speed = vx.mul_add(vx, vy.squared()).min(zero.splat(1.0));
    let rate = transition.body_rate.norm_squared().min(zero.splat(100.0));
    [
        L::select(transition.fallen, zero, zero.splat(scales.alive)),
        tilt * -scales.tilt,
        distance / (distance + success_radius * success_radius) * -scales.position,
        speed * -scales.velocity,
        rate * -scales.rate,
        mean_square([a, b, c]) * -scales.action,
        mean_square([a - last_a, b - last_b, c - last_c]) * -scales.action_change,
    ]
}

#[inline(always)]
fn mean_square<L: Lane>([a, b, c]: [L; ACTION_LEN]) -> L {
    (a.squared() + b.squared() + c.squared()) / ACTION_LEN as f64
}
