//! The goal task.

use super::{at_rest, command, config, metrics, regulate, reset_to, run_of, standing};
use ballbot_core::Params;
use ballbot_core::batch::Autoreset;
use ballbot_core::models::fastest_move;

/// Control steps of an episode.
const STEPS: usize = 2000;

#[test]
fn fastest_move_agrees_with_the_table_of_flat_moves() {
    // Moves of 0.5, 1 and 2 m at the torque at which a wheel of the upright robot slips, from a planar simulation.
    let params = Params::paper();
    for (distance, expected) in [(0.5, 2.19), (1.0, 2.91), (2.0, 3.96)] {
        let found = fastest_move(&params, distance);
        assert!((found / expected - 1.0).abs() < 0.03, "{distance} m: {found} s, {expected} s");
    }
    assert!(fastest_move(&params, 0.0) == 0.0);
    for preset in Params::preset_names() {
        let params = Params::preset(preset).unwrap();
        let times = [0.01, 0.1, 1.0, 10.0].map(|distance| fastest_move(&params, distance));
        assert!(times.is_sorted() && times[0] > 0.0 && times[3] < 100.0, "{preset}: {times:?}");
    }
}

#[test]
fn goals_are_held_and_timed() {
    let options: &[(_, &[f64])] = &[("goal_seconds", &[8.0, 8.0]), ("goal_distance", &[1.0, 1.0])];
    let mut run = run_of(&*config("goal", options), 8);
    reset_to(&mut run, &vec![Some(standing(3.0, -2.0, 0.4)); 8]);
    for i in 0..8 {
        let goal = command(&run, i);
        assert!(((goal[0] - 3.0).hypot(goal[1] + 2.0) - 1.0).abs() < 1e-12, "{goal:?}");
        assert_eq!(run.batch.setpoint(i).unwrap(), at_rest(goal[0], goal[1]));
    }
    let mut arrivals = vec![Vec::new(); 8];
    let mut since = [None; 8];
    regulate(&mut run, STEPS, |k, run| {
        if k + 1 == STEPS {
            return;
        }
        for i in 0..8 {
            // The step may have ended with a new goal; this is about the goal before it.
            if (k + 1) % 800 == 0 {
                arrivals[i].push(since[i].take());
                continue;
            }
            let ball = run.batch.state(i).unwrap().ball_position;
            let goal = command(run, i);
            let near = (ball.x - goal[0]).hypot(ball.y - goal[1]) <= 0.02;
            since[i] = near.then(|| since[i].unwrap_or(k % 800 + 1));
        }
    });
    let fastest = fastest_move(&Params::paper(), 1.0);
    for (i, steps) in arrivals.iter().enumerate() {
        let [held, ratio] = metrics(&run, i)[..] else { unreachable!() };
        assert_eq!(held, 1.0, "environment {i}");
        let mean = steps.iter().map(|step| step.unwrap() as f64 * 0.01).sum::<f64>() / 2.0;
        // The second goal is a meter from where the ball was, not from the first.
        assert!((ratio - mean / fastest).abs() < 0.02, "environment {i}: {ratio}, {mean} s by {fastest} s");
        assert!(ratio > 0.9 && ratio < 2.0 && run.outcomes[i].success, "environment {i}: {ratio}");
    }
}

#[test]
fn goals_replaced_by_hand_count_if_there_was_time_for_them() {
    let mut run = run_of(&*config("goal", &[]), 1);
    reset_to(&mut run, &[Some(standing(0.0, 0.0, 0.0))]);
    run.batch.set_command(0, &[50.0, 0.0]).unwrap();
    regulate(&mut run, 700, |_, _| ());
    let ball = run.batch.state(0).unwrap().ball_position;
    run.batch.set_command(0, &[ball.x + 0.3, ball.y]).unwrap();
    regulate(&mut run, 1300, |_, _| ());
    assert_eq!(metrics(&run, 0)[0], 0.5);
    assert!(!run.outcomes[0].success);
}

#[test]
fn impossible_options_are_rejected() {
    let wrong: [(_, &[f64], _); 2] =
        [("hold_seconds", &[20.0], "hold_seconds = 20"), ("goal_seconds", &[3.0, 2.0], "goal_seconds[0] = 3")];
    for (option, values, name) in wrong {
        let made = config("goal", &[(option, values)]).batch(1, Autoreset::SameStep, Some(1), 0);
        let message = made.err().unwrap().to_string();
        assert!(message.contains(name), "{message}");
    }
}
