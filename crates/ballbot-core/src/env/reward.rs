//! The reward: named terms, each times its scale.

use super::ACTION_LEN;
use crate::state::State;
use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

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
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
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

    /// The reward.
    pub fn sum(&self) -> f64 {
        self.values().iter().sum()
    }
}

/// What the reward of a step depends on.
pub(super) struct Transition<'a> {
    pub state: &'a State,
    pub setpoint: &'a Vector2<f64>,
    pub action: &'a [f32; ACTION_LEN],
    pub last_action: &'a [f32; ACTION_LEN],
    pub fallen: bool,
}

pub(super) fn terms(
    scales: &RewardScales,
    fall_tilt: f64,
    success_radius: f64,
    transition: &Transition<'_>,
) -> RewardTerms {
    let state = transition.state;
    let distance = (state.ball_position.xy() - transition.setpoint).norm_squared();
    let mean_square =
        |values: [f32; ACTION_LEN]| values.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>() / ACTION_LEN as f64;
    let change = [0, 1, 2].map(|i| transition.action[i] - transition.last_action[i]);
    RewardTerms {
        alive: if transition.fallen { 0.0 } else { scales.alive },
        tilt: -scales.tilt * (state.tilt() / fall_tilt).powi(2).min(1.0),
        position: -scales.position * distance / (distance + success_radius * success_radius),
        velocity: -scales.velocity * state.ball_velocity.xy().norm_squared().min(1.0),
        rate: -scales.rate * state.body_angular_velocity.norm_squared().min(100.0),
        action: -scales.action * mean_square(*transition.action),
        action_change: -scales.action_change * mean_square(change),
    }
}
