//! The balance task with a robot that leans in equilibrium.

use super::lean;
use crate::run::Run;
use crate::support::general::crooked;
use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, Environment, ResetRequest};
use ballbot_core::control::{Controller, Lqr, Setpoint};
use ballbot_core::{ModelKind, Params, State};
use nalgebra::Vector2;

/// The task, its robot leaning by 10 deg at rest: twice as far as an episode may start, half as far as it may tilt.
fn leaning_task() -> BalanceConfig {
    let height = Params::paper().body_com_height;
    let params = Params { body_com_offset: [-height * 10.0_f64.to_radians().tan(), 0.0], ..crooked() };
    BalanceConfig { params, model: ModelKind::Spatial, max_episode_steps: 600, ..BalanceConfig::default() }
}

#[test]
fn the_balance_task_starts_and_ends_by_the_tilt_from_equilibrium() {
    let config = leaning_task();
    let params = &config.params;
    let mut environment = Environment::new(&config, 5).unwrap();
    let mut observation = vec![0.0; environment.observation_len()];
    let mut largest = 0.0_f64;
    for _ in 0..300 {
        environment.reset(&mut observation);
        largest = largest.max(lean(params, &environment.robot().state()));
    }
    assert!(largest <= config.task.reset_tilt + 1e-12 && largest > 0.95 * config.task.reset_tilt, "{largest}");
    for (tilt, ends) in [(0.99, false), (1.01, true)] {
        for direction in [Vector2::x(), Vector2::y(), -Vector2::x(), -Vector2::y()] {
            let start = State::tilted_from_equilibrium(params, direction * (tilt * config.task.fall_tilt), 0.4);
            environment.reset_to(&start, &mut observation).unwrap();
            // Within a control step the robot falls by a thousandth of its tilt.
            let outcome = environment.step(&[0.0; 3], &mut observation);
            assert_eq!(outcome.terminated, ends.then_some("tilt"), "{tilt} of fall_tilt towards {direction}");
            let cost = environment.reward_terms().into_iter().find(|(name, _)| *name == "tilt").unwrap().1;
            let expected = (lean(params, &environment.robot().state()) / config.task.fall_tilt).powi(2).min(1.0);
            assert!((cost + expected).abs() < 1e-12, "cost {cost}, expected {expected}");
        }
    }
}

#[test]
fn lqr_succeeds_in_the_balance_task_with_a_robot_that_leans() {
    let config = leaning_task();
    for seed in 0..10 {
        let mut environment = Environment::new(&config, seed).unwrap();
        let mut observation = vec![0.0; environment.observation_len()];
        environment.reset(&mut observation);
        let mut lqr = Lqr::new(&config.params, config.control_dt).unwrap();
        let setpoint = Setpoint { yaw: environment.robot().state().yaw(), ..Setpoint::default() };
        loop {
            let torques = lqr.wheel_torques(&environment.robot().state(), &setpoint);
            let action = torques.map(|torque| (torque / config.action_torque()) as f32);
            let outcome = environment.step(action.as_slice(), &mut observation);
            assert_eq!(outcome.terminated, None, "seed {seed}");
            if outcome.truncated {
                assert!(outcome.success, "seed {seed}");
                break;
            }
        }
    }
}

/// Replacing a robot in a batch changes the definition of its tilt.
#[test]
fn the_tilt_of_a_task_follows_the_parameters_of_its_robot() {
    let leaning = leaning_task().params;
    let config = BalanceConfig { params: Params::paper(), ..leaning_task() };
    let mut run = Run::new(Batch::new(&config, 2, Autoreset::Disabled, Some(1), 0).unwrap());
    run.batch.set_params(1, &leaning).unwrap();
    let starts = [&config.params, &leaning].map(|params| Some(State::at_equilibrium(params, 0.0)));
    let request = ResetRequest { starts: Some(&starts), ..ResetRequest::default() };
    run.batch.reset_with(&request, &mut run.observations).unwrap();
    assert!(run.batch.state(1).unwrap().tilt() > 0.17, "the second robot leans");
    let tilt_costs = |run: &mut Run| {
        run.step(&[0.0; 6]).unwrap();
        [0, 1].map(|i| {
            let mut terms = vec![0.0; run.batch.task().terms.len()];
            run.batch.reward_terms(i, &mut terms).unwrap();
            let tilt = run.batch.task().terms.iter().position(|term| term.name == "tilt").unwrap();
            terms[tilt]
        })
    };
    for cost in tilt_costs(&mut run) {
        assert!(cost.abs() < 1e-20, "the tilt of a robot in equilibrium costs {cost}");
    }
    // A snapshot includes its robot.
    let saved = [run.batch.save(0).unwrap(), run.batch.save(1).unwrap()];
    run.batch.load(0, &saved[1]).unwrap();
    run.batch.load(1, &saved[0]).unwrap();
    assert_eq!(run.batch.params(0).unwrap(), &leaning);
    for cost in tilt_costs(&mut run) {
        assert!(cost.abs() < 1e-20, "after a swap of the robots it costs {cost}");
    }
}
