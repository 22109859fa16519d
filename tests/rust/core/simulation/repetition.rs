//! The same run again: from a reset, from a new robot, from a snapshot.

use super::{Motion, Simulation, for_both, run};
use ballbot_core::control::{Controller, Lqr, Setpoint};
use ballbot_core::{Model, Params, State, Wheels};
use nalgebra::{Vector2, Vector3};

/// A run with everything: feedback, a push, a fall.
fn eventful(robot: &mut dyn Model) -> [f64; State::LEN] {
    let params = robot.params().clone();
    let mut lqr = Lqr::new(&params, 0.01).unwrap();
    robot.reset(&State::tilted(&params, Vector2::new(0.06, -0.02), 1.0)).unwrap();
    let mut fell = false;
    for k in 0..150 {
        if k == 40 {
            robot.push(&Vector3::new(0.1, 0.2, 0.0), &Vector3::new(0.0, 0.0, 0.3));
        }
        let torques =
            if k < 80 { lqr.wheel_torques(&robot.state(), &Setpoint::default()) } else { Wheels([0.3, -0.2, 0.1]) };
        run(robot, torques, 10);
        fell |= robot.bot_on_floor();
    }
    assert!(fell, "the run has no fall in it");
    robot.state().to_array()
}

fn repeated_runs_and_resets_are_bit_identical(simulation: Simulation) {
    let mut robot = simulation.paper();
    let first = eventful(robot.as_mut());
    assert!(first.iter().all(|v| v.is_finite()));
    assert_eq!(first, eventful(simulation.paper().as_mut()), "two robots differ");
    assert_eq!(first, eventful(robot.as_mut()), "a reset robot differs from a new one");
}

fn loaded_models_continue_bit_for_bit(simulation: Simulation) {
    let mut robot = simulation.paper();
    robot.reset(&State::tilted(&Params::paper(), Vector2::new(0.06, -0.02), 1.0)).unwrap();
    run(robot.as_mut(), [0.05, -0.1, 0.0], 100);
    robot.push(&Vector3::new(0.0, 0.1, 0.0), &Vector3::zeros());
    let saved = robot.save();
    let mut other = simulation.paper();
    other.load(&saved).unwrap();
    for _ in 0..300 {
        robot.step([0.1, 0.0, -0.05]);
        other.step([0.1, 0.0, -0.05]);
        assert_eq!(robot.state().to_array(), other.state().to_array(), "at {} s", robot.time());
    }
    assert!(other.load(&saved[..100]).is_err());
}

for_both!(repeated_runs_and_resets_are_bit_identical, loaded_models_continue_bit_for_bit);
