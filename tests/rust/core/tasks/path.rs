//! The path task.

use super::{command, config, metrics, regulate, reset_to, run_of, standing};

/// Rows of the current point and of the last preview point.
const NOW: usize = 11;
const AHEAD: usize = 21;

#[test]
fn the_point_moves_on_a_circle_at_the_commanded_speed() {
    let mut run = run_of(&*config("path", &[("path_acceleration", &[1.0])]), 1);
    reset_to(&mut run, &[Some(standing(0.5, 1.0, 0.0))]);
    let (radius, speed) = (0.5, 0.4);
    let mut desired = [0.0; 13];
    (desired[0], desired[1], desired[8]) = (speed, radius, radius);
    run.batch.set_command(0, &desired).unwrap();
    assert_eq!(command(&run, 0), desired);
    let mut way = 0.0;
    regulate(&mut run, 600, |k, run| {
        let t = 0.01 * (k + 1) as f64;
        // From rest with half of the acceleration, 0.5 m/s², then at constant speed, to the left of the start: each step at the
        // speed of its end.
        way += 0.01 * speed.min(0.5 * t);
        let state = run.batch.state(0).unwrap();
        let (sin, cos) = state.yaw().sin_cos();
        for (first, way) in [(NOW, way), (AHEAD, way + speed)] {
            if first == AHEAD && 0.5 * t < speed {
                continue;
            }
            let angle = way / radius;
            let expected = [radius * angle.cos(), 1.0 + radius * angle.sin()];
            let (dx, dy) = (expected[0] - state.ball_position.x, expected[1] - state.ball_position.y);
            let heading = [cos * dx + sin * dy, cos * dy - sin * dx];
            for (row, expected) in run.observation(0)[first..first + 2].iter().zip(heading) {
                assert!((f64::from(*row) - expected).abs() < 1e-5, "step {k}, row {first}: {row}, {expected}");
            }
        }
    });
    assert!(way > 2.0);
}

#[test]
fn metrics_are_the_lateral_and_total_errors() {
    let mut run = run_of(&*config("path", &[("settling", &[1.0]), ("max_episode_steps", &[400.0])]), 8);
    let mut sums = [0.0; 8];
    regulate(&mut run, 399, |k, run| {
        for (i, sum) in sums.iter_mut().enumerate() {
            let rows = run.observation(i);
            let error = f64::from(rows[NOW]).hypot(f64::from(rows[NOW + 1]));
            *sum += if k >= 100 { error * error } else { 0.0 };
        }
    });
    regulate(&mut run, 1, |_, _| ());
    for (i, sum) in sums.into_iter().enumerate() {
        let [across, error] = metrics(&run, i)[..] else { unreachable!() };
        let expected = (sum / 299.0).sqrt();
        assert!((error / expected - 1.0).abs() < 0.01, "environment {i}: {error}, {expected}");
        assert!(across > 0.0 && across <= error, "environment {i}: {across}, {error}");
    }
}

#[test]
fn a_command_faster_than_the_acceleration_allows_is_slowed_down() {
    let mut run = run_of(&*config("path", &[("path_acceleration", &[0.2])]), 1);
    let mut desired = [0.0; 13];
    (desired[0], desired[1], desired[8]) = (2.0, 0.5, 0.5);
    run.batch.set_command(0, &desired).unwrap();
    let speed = command(&run, 0)[0];
    assert!((speed - (0.2_f64 * 0.5).sqrt()).abs() < 1e-9, "{speed} m/s");
}

/// Velocity, acceleration, jerk and snap of the setpoint are derivatives of its position, on all kinds of curves.
#[test]
fn the_setpoint_has_the_derivatives_of_the_point() {
    let mut run = run_of(&*config("path", &[("control_dt", &[0.002]), ("path_acceleration", &[2.0])]), 16);
    // The last steps, after the start at half of the acceleration.
    let mut points = vec![Vec::new(); 16];
    regulate(&mut run, 2000, |k, run| {
        if k >= 1990 {
            points.iter_mut().enumerate().for_each(|(i, points)| points.push(run.batch.setpoint(i).unwrap()));
        }
    });
    for (i, points) in points.iter().enumerate() {
        let parts = |at: usize| {
            let point = &points[at];
            [point.position, point.velocity, point.acceleration, point.jerk, point.snap]
        };
        let (before, now, after) = (parts(2), parts(3), parts(4));
        for order in 0..4 {
            let slope = (after[order] - before[order]) / 0.004;
            let error = (slope - now[order + 1]).norm();
            let size = now[order + 1].norm();
            assert!(error < 2e-3 * size + 1e-4, "environment {i}, derivative {}: {error}, {size}", order + 1);
        }
    }
}

#[test]
fn the_speed_of_a_point_obeys_the_limits_of_its_derivatives() {
    for (acceleration, jerk) in [(0.6, 2.0), (2.0, 1.0), (10.0, 0.3)] {
        let options: [(&str, &[f64]); 3] =
            [("path_acceleration", &[acceleration]), ("path_jerk", &[jerk]), ("path_speed", &[10.0, 10.0])];
        let mut run = run_of(&*config("path", &options), 24);
        // The point first gains speed.
        regulate(&mut run, 600, |k, run| {
            for i in (0..24).filter(|_| k > 500) {
                let setpoint = run.batch.setpoint(i).unwrap();
                let within = |found: f64, most: f64| assert!(found <= 1.02 * most, "{i}: {found}, {most}");
                within(setpoint.acceleration.norm(), acceleration);
                within(setpoint.jerk.norm(), jerk);
                within(setpoint.snap.norm(), jerk * jerk / acceleration);
            }
        });
    }
}
