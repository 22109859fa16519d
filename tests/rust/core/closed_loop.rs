//! Batches under controllers: the closed loop equals control and step in sequence, and single robots, to the last
//! bit.

use crate::run::Run;
use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, Environment, Outcome, Under};
use ballbot_core::control::{
    Controller, LaneSetpoint, LimitOptions, Lqr, LqrWeights, Pid, PidGains, Sampled, Setpoint,
};
use ballbot_core::kinematics::TorqueMap;
use ballbot_core::lanes::{EIGHT, Eight};
use ballbot_core::task::{ACTION_LEN, Balance};
use ballbot_core::{LaneState, ModelKind, Params, State, attitude};
use nalgebra::{Vector2, Vector3};

const SEED: u64 = 40;

/// Short episodes, some of which end in a fall.
fn config(model: ModelKind, control_dt: f64) -> BalanceConfig {
    BalanceConfig {
        model,
        control_dt,
        max_episode_steps: 25,
        max_wheel_torque: Some(0.5),
        task: Balance { reset_tilt: 0.15, reset_tilt_rate: 2.0, fall_tilt: 0.2, ..Balance::default() },
        ..BalanceConfig::default()
    }
}

fn lqr(config: &BalanceConfig) -> Sampled<Lqr> {
    // The limit that the batch would set.
    let limits = LimitOptions { max_torque: Some(config.action_torque()), ..LimitOptions::TRACTION };
    Lqr::with_weights(&config.params, config.control_dt, &LqrWeights::default(), &limits).unwrap()
}

fn pid(config: &BalanceConfig) -> Sampled<Pid> {
    Pid::new(&config.params, config.control_dt, &PidGains::default(), TorqueMap::Consistent).unwrap()
}

/// A setpoint of each robot.
fn setpoints(n: usize) -> Vec<Setpoint> {
    let setpoint = |i: usize| {
        let wave = |k: usize| ((i * 5 + k) as f64).sin();
        Setpoint {
            position: Vector2::new(wave(0), wave(1)) * 0.2,
            velocity: Vector2::new(wave(2), wave(3)) * 0.1,
            acceleration: Vector2::new(wave(7), wave(8)) * 0.1,
            jerk: Vector2::new(wave(9), wave(10)) * 0.1,
            snap: Vector2::new(wave(11), wave(12)) * 0.1,
            yaw: 3.0 * wave(4),
            yaw_rate: 0.1 * wave(13),
            tilt: Vector2::new(wave(5), wave(6)) * 0.02,
        }
    };
    (0..n).map(setpoint).collect()
}

/// States, actions and results of single environments under clones of a controller, with the contract of `mode`.
fn assert_equals_singles<C: Controller + Clone>(config: &BalanceConfig, controller: &C, n: usize, mode: Autoreset) {
    let (model, torque) = (config.model, config.action_torque());
    let batch = || Run::new(Batch::new(config, n, mode, Some(1), SEED).unwrap());
    let setpoints = setpoints(n);
    let under = Under { setpoints: Some(&setpoints), ..Under::new(controller) };
    let (mut looped, mut stepped) = (batch(), batch());
    let mut singles: Vec<_> = (0..n)
        .map(|i| {
            let mut environment = Environment::new(config, SEED + i as u64).unwrap();
            let mut observation = vec![0.0; environment.observation_len()];
            environment.reset(&mut observation);
            (environment, controller.clone(), observation)
        })
        .collect();
    let mut actions = [vec![0.0; n * ACTION_LEN], vec![0.0; n * ACTION_LEN]];
    let (mut falls, mut ends) = (0, 0);
    for k in 0..90 {
        looped.step_under(&under, &mut actions[0]).unwrap();
        stepped
            .batch
            .control(&Under { setpoints: Some(&setpoints), ..Under::new(controller) }, &mut actions[1])
            .unwrap();
        stepped.step(&actions[1]).unwrap();
        assert!(looped.all_bits() == stepped.all_bits(), "{model}, {mode:?}: the loops differ in step {k}");
        let bits = |actions: &[f32]| actions.iter().map(|a| a.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&actions[0]), bits(&actions[1]), "{model}, {mode:?}: step {k}");
        for (i, (environment, controller, observation)) in singles.iter_mut().enumerate() {
            let label = format!("{model}, {mode:?}: environment {i}, step {k}");
            let mut outcome = Outcome::default();
            let mut reset = environment.over();
            if !reset {
                let torques = controller.wheel_torques(&environment.robot().state(), &setpoints[i]);
                let action = torques.map(|t| (t / torque) as f32);
                assert_eq!(bits(action.as_slice()), bits(&actions[0][i * ACTION_LEN..][..ACTION_LEN]), "{label}");
                outcome = environment.step(action.as_slice(), observation);
                reset = outcome.done() && mode == Autoreset::SameStep;
            }
            if reset {
                environment.reset(observation);
                controller.reset();
            }
            assert_eq!(looped.outcomes[i], outcome, "{label}");
            assert_eq!(looped.observation(i), observation, "{label}");
            assert_eq!(looped.batch.state(i).unwrap(), environment.robot().state(), "{label}");
            falls += usize::from(outcome.terminated.is_some());
            ends += usize::from(outcome.truncated);
        }
    }
    assert!(falls > 0 && ends > n, "{model}, {mode:?}: {falls} falls and {ends} full episodes prove little");
}

#[test]
fn closed_loop_of_lqr_equals_single_robots() {
    for (model, n) in [(ModelKind::Contact, 19), (ModelKind::Spatial, 5), (ModelKind::Rigid, 5), (ModelKind::Planar, 5)]
    {
        let config = config(model, 0.01);
        for mode in [Autoreset::NextStep, Autoreset::SameStep] {
            assert_equals_singles(&config, &lqr(&config), n, mode);
        }
    }
}

#[test]
fn closed_loop_of_pid_equals_single_robots() {
    for (model, n) in [(ModelKind::Contact, 19), (ModelKind::Spatial, 9), (ModelKind::Rigid, 9)] {
        let mut config = config(model, Pid::PAPER_CONTROL_DT);
        // Falls within the few milliseconds of an episode.
        config.task.fall_tilt = 0.155;
        for mode in [Autoreset::NextStep, Autoreset::SameStep] {
            assert_equals_singles(&config, &pid(&config), n, mode);
        }
    }
}

#[test]
fn closed_loop_does_not_depend_on_threads() {
    for (model, n, dt) in [
        (ModelKind::Contact, 1021, 0.01),
        (ModelKind::Contact, 5001, Pid::PAPER_CONTROL_DT),
        (ModelKind::Spatial, 64, 0.01),
        (ModelKind::Rigid, 32, 0.01),
    ] {
        let config = config(model, dt);
        let (lqr, pid) = (lqr(&config), pid(&config));
        let controller: &dyn Controller = if dt == Pid::PAPER_CONTROL_DT { &pid } else { &lqr };
        let setpoints = setpoints(n);
        let run = |threads: usize| {
            let mut run = Run::new(Batch::new(&config, n, Autoreset::SameStep, Some(threads), SEED).unwrap());
            assert_eq!(run.batch.num_threads(), threads);
            let mut actions = vec![0.0; n * ACTION_LEN];
            for _ in 0..30 {
                run.step_under(&Under { setpoints: Some(&setpoints), ..Under::new(controller) }, &mut actions).unwrap();
            }
            (run.all_bits(), actions)
        };
        let expected = run(1);
        for threads in [2, 3] {
            assert!(run(threads) == expected, "{model}: {threads} threads differ from one");
        }
    }
}

#[test]
fn default_setpoint_matches_the_task() {
    let mut config = config(ModelKind::Contact, 0.01);
    config.task.setpoint = [0.3, -0.2];
    let controller = lqr(&config);
    let given = vec![Setpoint { position: config.task.setpoint.into(), ..Setpoint::default() }; 11];
    let mut run = Run::new(Batch::new(&config, 11, Autoreset::SameStep, Some(1), SEED).unwrap());
    let mut actions = [vec![0.0; 33], vec![0.0; 33], vec![0.0; 33]];
    run.batch.control(&Under::new(&controller), &mut actions[0]).unwrap();
    run.batch.control(&Under { setpoints: Some(&given), ..Under::new(&controller) }, &mut actions[1]).unwrap();
    run.batch
        .control(&Under { setpoints: Some(&[Setpoint::default(); 11]), ..Under::new(&controller) }, &mut actions[2])
        .unwrap();
    assert_eq!(actions[0], actions[1]);
    assert_ne!(actions[0], actions[2]);
}

/// States from calm to wild.
fn scattered_states(params: &Params) -> Vec<State> {
    let state = |k: usize| {
        let wave = |i: usize| (k as f64 * 0.37 + i as f64 * 1.7).sin() * k as f64 / 400.0;
        let body = attitude(Vector2::new(wave(0), wave(1)) * 1.5, wave(2) * 3.0);
        let rate = Vector3::new(wave(3), wave(4), wave(5)) * 10.0;
        let mut state = State::rolling(params, Vector2::new(wave(6), wave(7)) * 3.0, 0.0, body, rate);
        state.ball_position += Vector3::new(wave(8), wave(9), 0.0) * 5.0;
        state
    };
    (0..400).map(state).collect()
}

#[test]
fn controllers_in_lanes_equal_the_scalar_law() {
    let config = config(ModelKind::Contact, Pid::PAPER_CONTROL_DT);
    let controllers: [Box<dyn Controller>; 2] = [Box::new(lqr(&config)), Box::new(pid(&config))];
    for (kind, controller) in controllers.iter().enumerate() {
        let states = scattered_states(&config.params);
        let setpoints = setpoints(EIGHT);
        let mut targets = LaneSetpoint::<Eight>::default();
        for (i, setpoint) in setpoints.iter().enumerate() {
            targets.set_lane(i, &setpoint.into());
        }
        let mut memory = vec![Eight::default(); controller.memory_len()];
        let mut single = vec![vec![0.0; controller.memory_len()]; EIGHT];
        let mut largest = 0.0_f64;
        for eight in states.chunks_exact(EIGHT) {
            let mut all = LaneState::<Eight>::default();
            eight.iter().enumerate().for_each(|(i, state)| all.set_lane(i, &LaneState::from(state)));
            let torques = controller.torques_eight(&all, &targets, f64::INFINITY, &mut memory);
            for (i, memory) in single.iter_mut().enumerate() {
                let expected =
                    controller.torques_one(&LaneState::from(&eight[i]), &(&setpoints[i]).into(), f64::INFINITY, memory);
                let found = torques.map(|cell| cell.0[i]);
                assert_eq!(found.map(f64::to_bits), expected.map(f64::to_bits), "controller {kind}, lane {i}");
                largest = largest.max(found.column().amax());
            }
        }
        for (number, cell) in memory.iter().enumerate() {
            let expected: Vec<_> = single.iter().map(|memory| memory[number].to_bits()).collect();
            assert_eq!(cell.0.map(f64::to_bits).to_vec(), expected, "controller {kind}, number {number}");
        }
        assert!(largest > 0.1, "no torques to compare");
    }
}

#[test]
fn memory_of_a_controller_restarts_with_another_controller() {
    let config = config(ModelKind::Contact, Pid::PAPER_CONTROL_DT);
    let (first, second) = (pid(&config), pid(&config));
    let mut run = Run::new(Batch::new(&config, 11, Autoreset::SameStep, Some(1), SEED).unwrap());
    let (mut fresh, mut used, mut again) = (vec![0.0; 33], vec![0.0; 33], vec![0.0; 33]);
    let tilted = vec![Setpoint { tilt: Vector2::new(0.004, 0.0), ..Setpoint::default() }; 11];
    let upright = vec![Setpoint::default(); 11];
    run.batch.control(&Under { setpoints: Some(&upright), ..Under::new(&first) }, &mut fresh).unwrap();
    run.batch.control(&Under { setpoints: Some(&tilted), ..Under::new(&first) }, &mut used).unwrap();
    run.batch.control(&Under { setpoints: Some(&upright), ..Under::new(&first) }, &mut used).unwrap();
    assert_ne!(used, fresh, "the PID keeps nothing");
    run.batch.control(&Under { setpoints: Some(&upright), ..Under::new(&second) }, &mut again).unwrap();
    assert_eq!(again, fresh);
    // The controller's memory of a loaded environment is reset as well.
    let saved = run.batch.save(3).unwrap();
    run.batch.control(&Under { setpoints: Some(&tilted), ..Under::new(&second) }, &mut used).unwrap();
    run.batch.load(3, &saved).unwrap();
    run.batch.control(&Under { setpoints: Some(&upright), ..Under::new(&second) }, &mut used).unwrap();
    assert_eq!(used[9..12], fresh[9..12]);
    assert_ne!(used, fresh);
}

#[test]
fn diverged_robots_do_not_affect_neighbors_in_the_closed_loop() {
    let config = config(ModelKind::Contact, 0.01);
    let controller = lqr(&config);
    let run = |impulse: f64| {
        let mut run = Run::new(Batch::new(&config, 11, Autoreset::NextStep, Some(1), SEED).unwrap());
        let mut actions = vec![0.0; 33];
        let mut steps = Vec::new();
        for k in 0..20 {
            if k == 5 {
                run.batch.push(2, &Vector3::new(impulse, 0.0, 0.0), None).unwrap();
            }
            run.step_under(&Under::new(&controller), &mut actions).unwrap();
            assert!(actions.iter().all(|a| a.is_finite()), "step {k}");
            steps.push((run.all_bits(), run.outcomes[2].terminated));
        }
        steps
    };
    let (calm, found) = (run(0.0), run(1e4));
    assert_eq!(found[5].1, Some("diverged"));
    for (k, (found, calm)) in found.iter().zip(&calm).enumerate() {
        for i in (0..11).filter(|i| *i != 2) {
            assert!(found.0[i] == calm.0[i], "robot {i}, step {k}");
        }
    }
}

/// Controller, setpoints, number of actions, and the error.
type Call<'a> = (&'a dyn Controller, Option<&'a [Setpoint]>, usize, &'a str);

#[test]
fn invalid_arguments_of_control_are_rejected() {
    let config = config(ModelKind::Contact, 0.01);
    let controller = lqr(&config);
    let wrong = Lqr::new(&config.params, 0.005).unwrap();
    let mut run = Run::new(Batch::new(&config, 11, Autoreset::SameStep, Some(1), SEED).unwrap());
    let before = run.snapshots();
    let mut actions = [0.0; 33];
    let ten = [Setpoint::default(); 10];
    let cases: [Call; 3] = [
        (
            &wrong,
            None,
            33,
            "control_dt of the controller = 0.005 is out of range: it must be the control_dt of the batch, 0.01 s",
        ),
        (&controller, Some(&ten), 33, "setpoints has 10 values, expected 11"),
        (&controller, None, 32, "actions has 32 values, expected 33"),
    ];
    for (controller, setpoints, len, words) in cases {
        let under = Under { setpoints, ..Under::new(controller) };
        let error = run.batch.control(&under, &mut actions[..len]).unwrap_err();
        assert_eq!(error.to_string(), words);
        let error = run.step_under(&under, &mut actions[..len]).unwrap_err();
        assert_eq!(error.to_string(), words);
    }
    assert!(run.snapshots() == before, "rejected, but something moved");
}
