//! Scaled observations: each row is its saturated value minus its value at rest upright, over its typical magnitude,
//! within ±10.

use super::{Episode, OBSERVATION_LEN, config, lively};
use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, Outcome, StepBuffers};
use ballbot_core::task::{ACTION_LEN, Balance, SCALED_BOUND, TaskDescription};
use ballbot_core::{ModelKind, Params, State, attitude};
use nalgebra::{Vector2, Vector3};

fn scaled(config: &BalanceConfig) -> BalanceConfig {
    BalanceConfig { scale_observations: true, ..config.clone() }
}

/// The scaled row `i` from a raw row.
fn expected(i: usize, raw: f32) -> f64 {
    let description = TaskDescription::of::<Balance>();
    // Gravity points down the mast of the robot at rest; every other row is zero there.
    let rest = if i == 2 { -1.0 } else { 0.0 };
    let bound = f64::from(SCALED_BOUND);
    ((f64::from(raw) - rest) / description.rows[i].typical).clamp(-bound, bound)
}

#[track_caller]
fn assert_scaled(found: &[f32], raw: &[f32]) {
    for (i, (found, raw)) in found.iter().zip(raw).enumerate() {
        let expected = expected(i, *raw);
        // Raw rows are rounded to `f32` before they are scaled here.
        assert!((f64::from(*found) - expected).abs() <= 2e-6 * 10.0, "row {i}: {found}, expected {expected}");
    }
}

#[test]
fn typical_magnitudes_and_rest_are_described() {
    let description = TaskDescription::of::<Balance>();
    assert_eq!(description.rows.len(), OBSERVATION_LEN);
    let typical: Vec<f64> = description.rows.iter().map(|row| row.typical).collect();
    assert_eq!(typical, [0.1, 0.1, 0.1, 1.0, 1.0, 1.0, 5.0, 5.0, 5.0, 0.1, 0.1, 0.2, 0.2, 0.5, 0.5, 0.5]);
    let rest: Vec<f64> = (0..OBSERVATION_LEN).map(|i| if i == 2 { -1.0 } else { 0.0 }).collect();
    assert_eq!(description.scaling.rest, rest);
    assert_eq!(SCALED_BOUND, 10.0);
    assert!(BalanceConfig::default().scale_observations);
}

#[test]
fn observation_at_rest_upright_is_zero() {
    for model in ModelKind::ALL {
        let seen = Episode::from(&scaled(&config(model)), &State::upright(&Params::paper())).seen;
        assert_eq!(seen, [0.0; OBSERVATION_LEN], "{model}");
    }
}

#[test]
fn scaled_rows_are_deviations_over_typical_magnitudes() {
    let mut fast = State::rolling(
        &Params::paper(),
        Vector2::new(-40.0, 45.0),
        -1500.0,
        attitude(Vector2::new(1.2, 0.3), 0.0),
        Vector3::new(50.0, -60.0, 70.0),
    );
    fast.ball_position += Vector3::new(30.0, -40.0, 0.0);
    fast.body_position = fast.ball_position;
    for state in [lively(0.7), fast] {
        let config = config(ModelKind::Spatial);
        let (mut raw, mut scaled) = (Episode::from(&config, &state), Episode::from(&scaled(&config), &state));
        assert_scaled(&scaled.seen, &raw.seen);
        let action = [0.25, -0.75, 1.0];
        assert_eq!(raw.step(action), scaled.step(action));
        assert_scaled(&scaled.seen, &raw.seen);
    }
}

#[test]
fn rows_are_within_the_scaled_bound() {
    let mut state = State::rolling(
        &Params::paper(),
        Vector2::new(-40.0, 45.0),
        -1500.0,
        attitude(Vector2::zeros(), 0.0),
        Vector3::new(50.0, -60.0, 70.0),
    );
    state.ball_position += Vector3::new(30.0, -40.0, 0.0);
    state.body_position = state.ball_position;
    let seen = Episode::from(&scaled(&config(ModelKind::Spatial)), &state).seen;
    for (i, sign) in [(3, 1.0), (4, -1.0), (5, 1.0), (6, -1.0), (9, 1.0), (10, -1.0), (11, -1.0), (12, 1.0)] {
        assert_eq!(seen[i], sign * SCALED_BOUND, "row {i}");
    }
}

/// Observations of some steps of a batch, including final observations.
fn observations(config: &BalanceConfig, n: usize) -> Vec<f32> {
    let mut batch = Batch::new(config, n, Autoreset::SameStep, Some(1), 3).unwrap();
    let mut observations = vec![0.0; n * OBSERVATION_LEN];
    batch.reset(None, &mut observations).unwrap();
    let mut last = vec![0.0; n * OBSERVATION_LEN];
    let mut seen = observations.clone();
    for k in 0..40 {
        let actions: Vec<f32> = (0..n * ACTION_LEN).map(|i| 0.4 * ((i * 7 + k * 3) as f32).sin()).collect();
        let mut buffers = StepBuffers {
            observations: &mut observations,
            rewards: &mut vec![0.0; n],
            terminated: &mut vec![false; n],
            truncated: &mut vec![false; n],
            final_observations: &mut last,
            outcomes: &mut vec![Outcome::default(); n],
        };
        batch.step(&actions, &mut buffers).unwrap();
        seen.extend(&observations);
    }
    seen
}

#[test]
fn batches_scale_observations_as_single_environments_do() {
    for model in [ModelKind::Spatial, ModelKind::Contact, ModelKind::Rigid] {
        let mut config = BalanceConfig { max_episode_steps: 15, ..config(model) };
        config.task.reset_tilt = 0.3;
        let (raw, scaled) = (observations(&config, 11), observations(&scaled(&config), 11));
        assert_eq!(raw.len(), scaled.len());
        for (raw, scaled) in raw.chunks(OBSERVATION_LEN).zip(scaled.chunks(OBSERVATION_LEN)) {
            assert_scaled(scaled, raw);
        }
        let largest = scaled.iter().fold(0.0_f32, |most, value| most.max(value.abs()));
        assert!(largest > 2.0, "{model}: rows of at most {largest} prove little");
    }
}
