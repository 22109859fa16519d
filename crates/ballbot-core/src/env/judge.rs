//! What a control step is worth and whether it ends the episode, for one robot or for eight.

use super::observation::{OBSERVATION_LEN, observe};
use super::reward::{self, RewardScales, RewardTerms, Transition};
use super::{ACTION_LEN, BalanceConfig, Termination};
use crate::lane_state::LaneState;
use crate::lanes::{Lane, atan2_positive, cells};
use serde::{Deserialize, Serialize};

/// What an episode is judged by.
#[derive(Clone, Debug)]
pub struct Judge {
    setpoint: [f64; 2],
    fall_tilt: f64,
    success_tilt: f64,
    success_radius: f64,
    success_steps: f64,
    scales: RewardScales,
}

cells! {
    /// What an episode remembers.
    #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
    pub struct Episode {
        pub steps: T,
        /// The step at which this episode is truncated.
        pub limit: T,
        pub last_action: [T; ACTION_LEN],
        /// Consecutive steps, up to now, within the bounds of success.
        pub good_steps: T,
    }
}

cells! {
    /// What came of a step.
    #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
    pub struct Verdict {
        pub observation: [T; OBSERVATION_LEN],
        /// In the order of [`RewardTerms::NAMES`].
        pub terms: [T; RewardTerms::NAMES.len()],
        pub reward: T,
        /// 0 for none, else the number of the [`Termination`].
        pub termination: T,
        /// 1 if so, else 0; likewise `success`.
        pub truncated: T,
        pub success: T,
    }
}

/// The robot after a step.
pub struct Robot<L: Lane> {
    pub state: LaneState<L>,
    /// False where a step met numbers that are not finite.
    pub healthy: L::Mask,
    pub on_floor: L::Mask,
}

impl Judge {
    /// Of a valid task.
    pub fn new(config: &BalanceConfig) -> Self {
        Self {
            setpoint: config.setpoint,
            fall_tilt: config.fall_tilt,
            success_tilt: config.success_tilt,
            success_radius: config.success_radius,
            success_steps: config.success_steps() as f64,
            scales: config.reward,
        }
    }

    /// What the robot senses.
    #[inline(always)]
    pub fn observe<L: Lane>(&self, state: &LaneState<L>, last_action: &[L; ACTION_LEN]) -> [L; OBSERVATION_LEN] {
        observe(state, &self.setpoint, last_action)
    }

    /// Counts the step, pays for it and decides whether the episode ends.
    #[inline(always)]
    pub fn judge<L: Lane>(
        &self,
        token: L::Token,
        robot: &Robot<L>,
        action: [L; ACTION_LEN],
        episode: &mut Episode<L::Cell>,
        verdict: &mut Verdict<L::Cell>,
    ) {
        let state = &robot.state;
        let zero = state.ball_position.x.zero();
        let one = zero.splat(1.0);

        let up = state.body_quaternion.rotation().rows[2];
        let tilt = atan2_positive(up.x.mul_add(up.x, up.y.squared()).sqrt(), up.z);
        let (x, y) = (state.ball_position.x - self.setpoint[0], state.ball_position.y - self.setpoint[1]);
        let distance_squared = x.mul_add(x, y.squared());

        let sound = robot.healthy & state.within_bounds();
        let tilted = zero.splat(self.fall_tilt).lt(tilt);
        let termination = L::select(
            sound,
            L::select(
                tilted,
                zero.splat(f64::from(Termination::Tilt as u8)),
                L::select(robot.on_floor, zero.splat(f64::from(Termination::BotOnFloor as u8)), zero),
            ),
            zero.splat(f64::from(Termination::Diverged as u8)),
        );
        let goes_on = termination.le(zero);

        let near = distance_squared.le(zero.splat(self.success_radius * self.success_radius));
        let good = goes_on & near & tilt.le(zero.splat(self.success_tilt));
        let good_steps = L::select(good, L::load(token, &episode.good_steps) + 1.0, zero);
        let steps = L::load(token, &episode.steps) + 1.0;
        let truncated = goes_on & L::load(token, &episode.limit).le(steps);
        let success = goes_on & zero.splat(self.success_steps).le(good_steps);

        let [a, b, c] = &episode.last_action;
        let transition = Transition {
            tilt,
            distance_squared,
            ball_velocity: [state.ball_velocity.x, state.ball_velocity.y],
            body_rate: state.body_angular_velocity,
            action,
            last_action: [L::load(token, a), L::load(token, b), L::load(token, c)],
            fallen: !goes_on,
        };
        let terms = reward::terms(&self.scales, self.fall_tilt, self.success_radius, &transition);
        let mut reward = zero;
        for (term, cell) in terms.into_iter().zip(&mut verdict.terms) {
            let term = L::select(sound, term, zero);
            reward += term;
            term.store(cell);
        }
        for (value, cell) in self.observe(state, &action).into_iter().zip(&mut verdict.observation) {
            value.store(cell);
        }
        reward.store(&mut verdict.reward);
        termination.store(&mut verdict.termination);
        L::select(truncated, one, zero).store(&mut verdict.truncated);
        L::select(success, one, zero).store(&mut verdict.success);
        steps.store(&mut episode.steps);
        good_steps.store(&mut episode.good_steps);
        for (value, cell) in action.into_iter().zip(&mut episode.last_action) {
            value.store(cell);
        }
    }
}
