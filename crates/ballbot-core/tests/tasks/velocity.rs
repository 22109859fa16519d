//! The velocity task.

use crate::{config, metrics, regulate, run_of};
use ballbot_core::task::Velocity;

#[test]
fn metrics_are_the_settled_errors_of_the_episode() {
    let task = Velocity { settling: 1.0, command_seconds: [2.0, 2.0], ..Velocity::default() };
    let mut config = config(task);
    config.max_episode_steps = 500;
    let mut run = run_of(&config, 3);
    let mut sums = [[0.0; 2]; 3];
    let mut commands: Vec<_> = (0..3).map(|i| crate::command(&run, i)).collect();
    regulate(&config, &mut run, 500, |k, run| {
        // A command is for the steps after the observation that shows it; settled after the first second of each two.
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
            commands[i] = crate::command(run, i);
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
    let task = Velocity { command_seconds: [5.0, 5.0], settling: 3.0, standing: 0.0, ..Velocity::default() };
    let config = config(task);
    let mut run = run_of(&config, 24);
    regulate(&config, &mut run, config.max_episode_steps, |_, _| ());
    for i in 0..24 {
        let [velocity, yaw_rate] = metrics(&run, i)[..] else { unreachable!() };
        assert!(velocity < 0.02 && yaw_rate < 0.02, "environment {i}: {velocity} m/s, {yaw_rate} rad/s");
        assert!(run.outcomes[i].success, "environment {i}");
    }
}
