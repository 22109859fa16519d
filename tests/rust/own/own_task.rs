//! A task ([`shuttle`]) and a controller ([`feedback`]) of another crate, each defined in one file, by type and by name.

mod feedback;
pub mod shuttle;

use crate::run::{Run, actions};
use ballbot_core::batch::{
    Autoreset, Batch, EnvConfig, Environment, Outcome, Under, register_task, task_kind, task_kinds,
};
use ballbot_core::control::{
    Controller, LimitOptions, NamedLaw, Setpoint, controller_kind, controller_kinds, register_controller,
};
use ballbot_core::task::{ACTION_LEN, TaskDescription};
use ballbot_core::{Error, ModelKind, State};
use feedback::{Feedback, Gains};
use nalgebra::Vector2;
use shuttle::Shuttle;
use std::sync::Once;

const SEED: u64 = 40;
/// Rows of the commanded velocity.
const COMMAND_ROWS: std::ops::Range<usize> = 7..9;

/// Short episodes of a few commands, some of which end in a fall or off the track.
fn config(model: ModelKind) -> EnvConfig<Shuttle> {
    EnvConfig {
        model,
        max_episode_steps: 45,
        max_wheel_torque: Some(0.5),
        task: Shuttle { interval: 10.0, track: 0.0105, fall_tilt: 0.2, ..Shuttle::default() },
        ..EnvConfig::default()
    }
}

fn batch(config: &EnvConfig<Shuttle>, n: usize, mode: Autoreset, threads: usize) -> Batch {
    Batch::new(config, n, mode, Some(threads), SEED).unwrap()
}

/// The task and the controller by name.
fn register() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        register_task::<Shuttle>().unwrap();
        register_controller(feedback::Feedback::KIND).unwrap();
    });
}

fn command(rows: &[f32]) -> [f32; 2] {
    rows[COMMAND_ROWS].try_into().unwrap()
}

#[test]
fn description_names_options_rows_terms_and_reasons() {
    let task = TaskDescription::of::<Shuttle>();
    assert_eq!((task.name, task.id, task.max_episode_steps), ("shuttle", "ballbot/Shuttle-v0", 600));
    assert_eq!(task.reward_threshold, None);
    let options: Vec<_> = task.options.iter().map(|o| (o.name, o.unit, o.default.clone(), o.limit.as_str())).collect();
    let expected = [
        ("speed", "m/s", vec![0.3], "> 0 and <= 2"),
        ("interval", "", vec![200.0], ">= 1"),
        ("track", "m", vec![3.0], "> 0"),
        ("reset_tilt", "rad", vec![0.05, 0.02], ">= 0"),
        ("fall_tilt", "rad", vec![0.3], "> 0 and <= 1"),
        ("tracked_error", "m/s", vec![0.1], "> 0"),
    ];
    assert_eq!(options, expected);
    assert_eq!(task.options[3].doc, "Largest first tilt about each axis; below `fall_tilt`.");
    assert_eq!(task.rows.len(), 9);
    assert_eq!((task.rows[7].name, task.rows[7].unit), ("commanded velocity, inertial x", "m/s"));
    assert_eq!((task.rows[3].bound, task.rows[3].typical), (20.0, 1.0));
    assert_eq!(task.scaling.rest, [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let terms: Vec<_> = task.terms.iter().map(|term| (term.name, term.scale, term.cost)).collect();
    assert_eq!(terms, [("tracking", 1.0, false), ("tilt", 0.5, true), ("action", 0.01, true)]);
    assert!(task.terms[0].formula.starts_with("1 / (1 + "));
    let reasons: Vec<_> = task.terminations.iter().map(|(name, _)| *name).collect();
    assert_eq!(reasons, ["tilt", "off_track", "diverged"]);
    assert!(task.success.contains("tracked_error"));
}

/// A single environment under the contract of `mode`.
struct Single {
    environment: Environment<Shuttle>,
    observation: Vec<f32>,
}

impl Single {
    fn new(config: &EnvConfig<Shuttle>, seed: u64) -> Self {
        let mut environment = Environment::new(config, seed).unwrap();
        let mut observation = vec![0.0; environment.observation_len()];
        environment.reset(&mut observation);
        Self { environment, observation }
    }

    fn step(&mut self, mode: Autoreset, action: &[f32]) -> Outcome {
        if self.environment.over() {
            self.environment.reset(&mut self.observation);
            return Outcome::default();
        }
        let outcome = self.environment.step(action, &mut self.observation);
        if outcome.done() && mode == Autoreset::SameStep {
            self.environment.reset(&mut self.observation);
        }
        outcome
    }
}

#[test]
fn batched_environments_equal_single_ones() {
    for (model, n) in [(ModelKind::Contact, 19), (ModelKind::Spatial, 9), (ModelKind::Rigid, 9)] {
        let config = config(model);
        for mode in [Autoreset::NextStep, Autoreset::SameStep] {
            let mut runs = [1, 2, 3].map(|threads| Run::new(batch(&config, n, mode, threads)));
            let mut singles: Vec<_> = (0..n).map(|i| Single::new(&config, SEED + i as u64)).collect();
            let mut reasons = [0, 0, 0, 0];
            for k in 0..130 {
                for run in &mut runs {
                    run.step(&actions(0, n, k, 0.3)).unwrap();
                }
                for (i, single) in singles.iter_mut().enumerate() {
                    let outcome = single.step(mode, &actions(i, 1, k, 0.3));
                    let label = format!("{model}, {mode:?}: environment {i}, step {k}");
                    assert_eq!(runs[0].outcomes[i], outcome, "{label}");
                    assert_eq!(runs[0].observation(i), single.observation, "{label}");
                    assert_eq!(runs[0].batch.state(i).unwrap(), single.environment.robot().state(), "{label}");
                    let mut terms = [0.0; 3];
                    runs[0].batch.reward_terms(i, &mut terms).unwrap();
                    let expected: Vec<_> = single.environment.reward_terms().iter().map(|(_, value)| *value).collect();
                    assert_eq!(terms.to_vec(), expected, "{label}");
                    for run in &runs[1..] {
                        assert!(run.bits(i) == runs[0].bits(i), "{label}, {} threads", run.batch.num_threads());
                    }
                    let kinds = [Some("tilt"), Some("off_track")].map(|reason| outcome.terminated == reason);
                    for (count, is) in reasons.iter_mut().zip([kinds[0], kinds[1], outcome.truncated, outcome.success])
                    {
                        *count += usize::from(is);
                    }
                }
            }
            assert!(reasons.iter().all(|count| *count > 3), "{model}, {mode:?}: {reasons:?} prove little");
        }
    }
}

#[test]
fn disabled_autoreset_leaves_ended_episodes_to_the_caller() {
    let config = EnvConfig { max_episode_steps: 3, ..config(ModelKind::Contact) };
    let mut run = Run::new(batch(&config, 11, Autoreset::Disabled, 1));
    for _ in 0..3 {
        run.step(&[0.0; 33]).unwrap();
    }
    assert!(run.step(&[0.0; 33]).unwrap_err().to_string().contains("environment 0 is over"));
    let commands: Vec<_> = (0..11).map(|i| command(run.observation(i))).collect();
    run.reset(&[true; 11]);
    let sampled: Vec<_> = (0..11).map(|i| command(run.observation(i))).collect();
    assert!((0..11).all(|i| sampled[i] != commands[i]), "the commands were not sampled again");
    run.step(&[0.0; 33]).unwrap();
}

#[test]
fn commands_are_sampled_at_their_interval() {
    for model in [ModelKind::Contact, ModelKind::Spatial] {
        let mut config = EnvConfig { scale_observations: false, ..config(model) };
        (config.task.track, config.task.fall_tilt) = (100.0, 1.0);
        let mut run = Run::new(batch(&config, 11, Autoreset::SameStep, 1));
        let mut held: Vec<_> = (0..11).map(|i| command(run.observation(i))).collect();
        for k in 1..=120 {
            run.step(&[0.0; 33]).unwrap();
            let in_episode = k % config.max_episode_steps;
            for (i, held) in held.iter_mut().enumerate() {
                let found = command(run.observation(i));
                if in_episode % 10 == 0 {
                    assert_ne!(found, *held, "{model}: environment {i}, step {k}");
                    *held = found;
                }
                assert_eq!(found, *held, "{model}: environment {i}, step {k}");
                assert!(Vector2::from(found).norm() <= 0.3);
            }
        }
    }
}

#[test]
fn reward_follows_the_command_of_its_step() {
    let mut config = EnvConfig { scale_observations: false, ..config(ModelKind::Contact) };
    config.task.interval = 1.0;
    let mut run = Run::new(batch(&config, 11, Autoreset::SameStep, 1));
    for _ in 0..5 {
        let commands: Vec<_> = (0..11).map(|i| command(run.observation(i)).map(f64::from)).collect();
        run.step(&[0.0; 33]).unwrap();
        for (i, [x, y]) in commands.into_iter().enumerate() {
            let velocity = run.batch.state(i).unwrap().ball_velocity.xy();
            let error = (velocity - Vector2::new(x, y)).norm_squared() / (0.3 * 0.3);
            let mut terms = [0.0; 3];
            run.batch.reward_terms(i, &mut terms).unwrap();
            assert!((terms[0] - 1.0 / (1.0 + error)).abs() < 1e-6, "environment {i}: {terms:?}");
        }
    }
}

#[test]
fn loaded_environments_continue_bit_for_bit() {
    for model in ModelKind::ALL {
        let config = config(model);
        let mut run = Run::new(batch(&config, 11, Autoreset::SameStep, 1));
        let mut other = Run::new(Batch::new(&config, 11, Autoreset::SameStep, Some(1), 900).unwrap());
        for k in 0..13 {
            run.step(&actions(0, 11, k, 0.1)).unwrap();
            other.step(&actions(0, 11, k + 1, 0.1)).unwrap();
        }
        for (i, bytes) in run.snapshots().iter().enumerate() {
            other.batch.load(i, bytes).unwrap();
        }
        let mut single = Single::new(&config, 0);
        single.environment.load(&run.batch.save(3).unwrap()).unwrap();
        run.last.fill(0.0);
        other.last.fill(0.0);
        for k in 13..100 {
            run.step(&actions(0, 11, k, 0.1)).unwrap();
            other.step(&actions(0, 11, k, 0.1)).unwrap();
            assert!(run.all_bits() == other.all_bits(), "{model}: step {k}");
            let outcome = single.step(Autoreset::SameStep, &actions(3, 1, k, 0.1));
            assert_eq!((run.outcomes[3], run.observation(3)), (outcome, &single.observation[..]), "{model}: step {k}");
        }
    }
    // Tasks are not confused with each other.
    let saved = batch(&config(ModelKind::Contact), 1, Autoreset::SameStep, 1).save(0).unwrap();
    let mut balance = Batch::new(
        &ballbot_core::batch::BalanceConfig { model: ModelKind::Contact, ..Default::default() },
        1,
        Autoreset::SameStep,
        Some(1),
        0,
    )
    .unwrap();
    let error = balance.load(0, &saved).unwrap_err().to_string();
    assert!(error.contains("it is of task 'shuttle'") && error.contains("this is task 'balance'"), "{error}");
}

#[test]
fn registered_tasks_are_configured_by_name() {
    register();
    assert!(task_kinds().iter().any(|kind| kind.description().name == "balance"));
    let kind = task_kind("shuttle").unwrap();
    assert_eq!(kind.description(), TaskDescription::of::<Shuttle>());
    let mut named = kind.config();
    named.set_model(ModelKind::Contact);
    for (name, values) in [
        ("max_episode_steps", &[45.0][..]),
        ("max_wheel_torque", &[0.5]),
        ("interval", &[10.0]),
        ("track", &[0.0105]),
        ("fall_tilt", &[0.2]),
        ("reset_tilt", &[0.04, 0.01]),
        ("scale_observations", &[0.0]),
    ] {
        named.set(name, values).unwrap();
        assert_eq!(named.get(name).unwrap(), values, "{name}");
    }
    named.set_reward("tilt", 2.0).unwrap();
    assert_eq!(named.reward(), [("tracking", 1.0), ("tilt", 2.0), ("action", 0.01)]);
    assert_eq!((named.get("speed"), named.get("speeed")), (Some(vec![0.3]), None));
    let mut typed = EnvConfig { scale_observations: false, ..config(ModelKind::Contact) };
    typed.task.reset_tilt = [0.04, 0.01];
    typed.reward.set("tilt", 2.0).unwrap();
    let mut runs = [
        Run::new(named.batch(11, Autoreset::SameStep, Some(1), SEED).unwrap()),
        Run::new(batch(&typed, 11, Autoreset::SameStep, 1)),
    ];
    for k in 0..60 {
        for run in &mut runs {
            run.step(&actions(0, 11, k, 0.3)).unwrap();
        }
        assert!(runs[0].all_bits() == runs[1].all_bits(), "step {k}");
    }
}

/// An option with its values.
type Setting<'a> = (&'a str, &'a [f64]);

#[test]
fn invalid_options_and_names_are_rejected() {
    register();
    let rejected = |set: &[Setting<'_>]| {
        let mut config = task_kind("shuttle").unwrap().config();
        config.set_model(ModelKind::Contact);
        let set = set.iter().try_for_each(|(name, values)| config.set(name, values));
        let batch = set.and_then(|()| config.batch(3, Autoreset::SameStep, Some(1), 0).map(|_| ()));
        batch.expect_err("accepted").to_string()
    };
    let cases: [(&[Setting<'_>], &str); 9] = [
        (&[("frameskip", &[1.0])], "unknown option 'frameskip': expected one of "),
        (&[("speed", &[0.1, 0.2])], "speed has 2 values, expected 1"),
        (&[("reset_tilt", &[0.1])], "reset_tilt has 1 values, expected 2"),
        (&[("speed", &[0.0])], "speed = 0 is out of range: it must be > 0 and <= 2 m/s"),
        (&[("interval", &[0.5])], "interval = 0.5 is out of range: it must be >= 1"),
        (&[("track", &[f64::INFINITY])], "track = inf is out of range: it must be > 0 m"),
        (&[("reset_tilt", &[0.1, -0.1])], "reset_tilt[1] = -0.1 is out of range: it must be >= 0 rad"),
        (&[("reset_tilt", &[0.1, 0.4])], "reset_tilt = 0.4 is out of range: it must be below fall_tilt = 0.3"),
        (&[("max_episode_steps", &[1.5])], "max_episode_steps = 1.5 is out of range"),
    ];
    for (set, words) in cases {
        let message = rejected(set);
        assert!(message.starts_with(words), "'{message}' does not start with '{words}'");
    }
    let mut config = task_kind("shuttle").unwrap().config();
    let error = config.set_reward("tracing", 1.0).unwrap_err().to_string();
    assert_eq!(
        error,
        "unknown reward term 'tracing': expected one of tracking, tilt, action; did you mean 'tracking'?"
    );
    let error = register_task::<Shuttle>().unwrap_err().to_string();
    assert_eq!(error, "there is a task 'shuttle' already");
    let error = task_kind("shuttles").err().unwrap();
    assert!(matches!(error, Error::UnknownName { .. }), "{error:?}");
    assert_eq!(
        error.to_string(),
        "unknown task 'shuttles': expected one of balance, velocity, goal, path, push, carry, navigate, ride, terrain, openballbot, shuttle; did you mean 'shuttle'?"
    );
}

#[test]
fn controllers_follow_the_command_of_the_task() {
    let config = config(ModelKind::Contact);
    let controller =
        Feedback::with_options(&config.params, config.control_dt, &Gains::default(), &LimitOptions::capped(1.0))
            .unwrap();
    let mut run = Run::new(
        Batch::new(&EnvConfig { scale_observations: false, ..config }, 11, Autoreset::SameStep, Some(1), 1).unwrap(),
    );
    let mut actions = [vec![0.0; 33], vec![0.0; 33]];
    run.batch.control(&Under::new(&controller), &mut actions[0]).unwrap();
    let setpoints: Vec<_> = (0..11)
        .map(|i| Setpoint {
            velocity: Vector2::from(command(run.observation(i)).map(f64::from)),
            ..Setpoint::default()
        })
        .collect();
    let again =
        Feedback::with_options(run.batch.params(0).unwrap(), 0.01, &Gains::default(), &LimitOptions::capped(1.0))
            .unwrap();
    run.batch.control(&Under { setpoints: Some(&setpoints), ..Under::new(&again) }, &mut actions[1]).unwrap();
    for (found, expected) in actions[0].iter().zip(&actions[1]) {
        assert!((found - expected).abs() < 1e-6, "{found}, expected {expected}");
    }
    assert!(actions[0].iter().any(|action| *action != 0.0));
}

#[test]
fn registered_controllers_are_made_by_name() {
    register();
    assert!(controller_kinds().iter().any(|kind| kind.name == "lqr"));
    let kind = controller_kind("feedback").unwrap();
    assert_eq!((kind.control_dt, kind.parts), (None, &["velocity"][..]));
    let options: Vec<_> = (kind.options)().iter().map(|o| (o.name, o.default[0])).collect();
    assert_eq!(options, [("tilt", 20.0), ("rate", 1.3), ("velocity", 0.03), ("filter", 0.05)]);
    let params = ballbot_core::Params::paper();
    let make = |limits, options: &[Setting<'_>]| (kind.make)(&params, 0.002, &limits, options);
    let mut named = make(LimitOptions::capped(0.3), &[("tilt", &[15.0])]).unwrap();
    let gains = Gains { tilt: 15.0, ..Gains::default() };
    let mut typed = Feedback::with_options(&params, 0.002, &gains, &LimitOptions::capped(0.3)).unwrap();
    let state = State::tilted(&params, Vector2::new(0.01, -0.02), 0.3);
    let setpoint = Setpoint { velocity: Vector2::new(0.2, -0.1), ..Setpoint::default() };
    for _ in 0..3 {
        assert_eq!(named.wheel_torques(&state, &setpoint), typed.wheel_torques(&state, &setpoint));
    }
    for (result, words) in [
        (
            make(LimitOptions::CAP, &[("tild", &[1.0])]),
            "unknown option 'tild': expected one of tilt, rate, velocity, filter",
        ),
        (make(LimitOptions::CAP, &[("filter", &[0.0])]), "filter = 0 is out of range: it must be > 0 s"),
        (make(LimitOptions::capped(9.0), &[]), "max_torque = 9 "),
    ] {
        let message = result.err().expect("accepted").to_string();
        assert!(message.starts_with(words), "{message}");
    }
    let error = register_controller(feedback::Feedback::KIND).unwrap_err().to_string();
    assert_eq!(error, "there is a controller 'feedback' already");
}

#[test]
fn registered_controllers_balance_a_batch_as_single_robots() {
    register();
    for (model, n) in [(ModelKind::Contact, 11), (ModelKind::Spatial, 3)] {
        let mut config = config(model);
        config.control_dt = 0.002;
        config.max_episode_steps = 1500;
        (config.task.track, config.task.interval) = (10.0, 5000.0);
        let make =
            || (controller_kind("feedback").unwrap().make)(&config.params, 0.002, &LimitOptions::CAP, &[]).unwrap();
        let controller = make();
        let mut run = Run::new(batch(&config, n, Autoreset::NextStep, 1));
        let mut single = (Single::new(&config, SEED + 1), make());
        let mut actions = vec![0.0; n * ACTION_LEN];
        let setpoints: Vec<_> = (0..n)
            .map(|i| Setpoint { velocity: Vector2::new(0.05 * (i as f64).sin(), 0.1), ..Setpoint::default() })
            .collect();
        for k in 0..1499 {
            let state = single.0.environment.robot().state();
            let torques = single.1.wheel_torques(&state, &setpoints[1]);
            run.step_under(&Under { setpoints: Some(&setpoints), ..Under::new(controller.as_ref()) }, &mut actions)
                .unwrap();
            assert_eq!(actions[3..6], torques.map(|t| (t / 0.5) as f32).0, "{model}: step {k}");
            let outcome = single.0.step(Autoreset::NextStep, &actions[3..6]);
            assert_eq!(run.outcomes[1], outcome, "{model}: step {k}");
            assert!(run.outcomes.iter().all(|outcome| !outcome.done()), "{model}: fell in step {k}");
        }
        for (i, setpoint) in setpoints.iter().enumerate() {
            let state = run.batch.state(i).unwrap();
            let error = (state.ball_velocity.xy() - setpoint.velocity).norm();
            assert!(state.tilt() < 0.03 && error < 0.1, "{model}, robot {i}: tilt {}, error {error}", state.tilt());
        }
    }
}
