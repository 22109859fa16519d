//! The velocity task.

use super::{command, config, metrics, regulate, run_of};
use crate::run::actions;
use ballbot_core::Params;
use ballbot_core::batch::{Autoreset, History, Observation, TaskConfig};
use ballbot_core::sensor::SensorOptions;

#[test]
fn metrics_are_the_settled_errors_of_the_episode() {
    let options: &[(_, &[f64])] =
        &[("settling", &[1.0]), ("command_seconds", &[2.0, 2.0]), ("max_episode_steps", &[500.0])];
    let mut run = run_of(&*config("velocity", options), 3);
    let mut sums = [[0.0; 2]; 3];
    let mut commands: Vec<_> = (0..3).map(|i| super::command(&run, i)).collect();
    regulate(&mut run, 500, |k, run| {
        // A command applies to the steps after the observation that shows it; settled after the first second of each
        // two.
        for (i, sum) in sums.iter_mut().enumerate() {
            if k % 200 >= 100 && k < 499 {
                let state = run.batch.state(i).unwrap();
                let (sin, cos) = state.yaw().sin_cos();
                let v = state.ball_velocity;
                let heading = [cos * v.x + sin * v.y, cos * v.y - sin * v.x];
                let turning = (state.body_quaternion * state.body_angular_velocity).z;
                let [x, y, rate] = commands[i][..] else { unreachable!() };
                sum[0] += (heading[0] - x).powi(2) + (heading[1] - y).powi(2);
                sum[1] += (turning - rate).powi(2);
            }
            commands[i] = super::command(run, i);
        }
    });
    for (i, sum) in sums.iter().enumerate() {
        // 100 settled steps of the first two commands, and none of the third, up to the last step.
        let expected = sum.map(|sum| (sum / 199.0).sqrt());
        let found = metrics(&run, i);
        for (found, expected) in found.iter().zip(expected) {
            assert!((found / expected - 1.0).abs() < 0.02, "environment {i}: {found}, {expected}");
        }
    }
}

#[test]
fn the_setpoint_of_the_task_brings_a_regulator_to_the_command() {
    let options: &[(_, &[f64])] = &[("command_seconds", &[5.0, 5.0]), ("settling", &[3.0]), ("standing", &[0.0])];
    let mut run = run_of(&*config("velocity", options), 24);
    regulate(&mut run, 2000, |_, _| ());
    for i in 0..24 {
        let [velocity, yaw_rate] = metrics(&run, i)[..] else { unreachable!() };
        assert!(velocity < 0.02 && yaw_rate < 0.02, "environment {i}: {velocity} m/s, {yaw_rate} rad/s");
        assert!(run.outcomes[i].success, "environment {i}");
    }
}

/// Robots that observe through sensors with noise and bias.
fn sensed() -> Box<dyn TaskConfig> {
    let sensors = SensorOptions { gyro_noise: 0.01, gyro_bias: 0.05, ..SensorOptions::default() };
    let mut config = config("velocity", &[]);
    config.set_history(History::Last(2));
    config.set_sensors(Some(sensors));
    config.set_observation(Observation::Sensors);
    config
}

#[test]
fn a_command_repeats_the_last_reading_and_changes_no_other_number() {
    let config = sensed();
    let mut runs = [run_of(&*config, 3), run_of(&*config, 3)];
    let params = Params { gravity: 5.0, ..Params::paper() };
    for k in 0..40 {
        // At once after the reset, in an episode, and under another gravity.
        if [0, 7, 20].contains(&k) {
            let same = command(&runs[1], 1);
            runs[1].batch.set_command(1, &same).unwrap();
        }
        if k == 12 {
            runs.iter_mut().for_each(|run| run.batch.set_params(1, &params).unwrap());
        }
        for run in &mut runs {
            run.step(&actions(0, 3, k, 0.02)).unwrap();
        }
        let [plain, commanded] = &runs;
        for i in 0..3 {
            let readings = [plain, commanded].map(|run| format!("{:?}", run.batch.readings(i).unwrap()));
            assert_eq!(readings[0], readings[1], "robot {i}, step {k}");
            assert_eq!(plain.observation(i), commanded.observation(i), "robot {i}, step {k}");
        }
    }
}

#[test]
fn a_command_is_shown_at_once_and_by_all_observations_of_an_episode_that_begins() {
    let config = sensed();
    let mut run = run_of(&*config, 2);
    let desired = [0.1, 0.2, 0.3];
    run.batch.set_command(1, &desired).unwrap();
    let width = run.batch.observation_len() / 2;
    let mut rows = vec![0.0; 2 * width];
    run.batch.observation(1, &mut rows).unwrap();
    for observation in rows.chunks(width) {
        assert_eq!(observation[11..14], desired.map(|value| value as f32));
    }
    run.step(&[0.0; 6]).unwrap();
    run.batch.set_command(1, &[0.4, 0.0, 0.0]).unwrap();
    run.batch.observation(1, &mut rows).unwrap();
    assert_eq!((rows[11], rows[width + 11]), (0.1, 0.4));
}

#[test]
fn a_command_before_the_first_episode_is_rejected() {
    let mut batch = config("velocity", &[]).batch(2, Autoreset::SameStep, Some(1), 0).unwrap();
    let message = batch.set_command(0, &[0.0; 3]).unwrap_err().to_string();
    assert!(message.contains("before the first reset"), "{message}");
}
