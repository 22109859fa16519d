//! Robots that differ within a batch: each moves as in a batch of one with its parameters, to the last bit.

use crate::run::{Run, actions};
use ballbot_core::actuator::MotorOptions;
use ballbot_core::batch::{
    Autoreset, BalanceConfig, Batch, EnvConfig, Event, Observation, Operation, Outcome, ResetRequest,
};
use ballbot_core::task::{Balance, Velocity};
use ballbot_core::{Ballbot, ModelKind, Params, State, attitude};
use nalgebra::{Vector2, Vector3};

const SEED: u64 = 40;

/// Torque of an action of 1, N·m.
const ACTION_TORQUE: f64 = 0.5;

/// Short episodes, some of which end in a fall.
fn config(model: ModelKind, params: &Params) -> BalanceConfig {
    BalanceConfig {
        params: params.clone(),
        model,
        max_episode_steps: 25,
        max_wheel_torque: Some(ACTION_TORQUE),
        task: Balance { fall_tilt: 0.2, ..Balance::default() },
        ..BalanceConfig::default()
    }
}

fn batch(config: &BalanceConfig, n: usize, mode: Autoreset, seed: u64) -> Batch {
    Batch::new(config, n, mode, Some(1), seed).unwrap()
}

/// One block of eight and part of another, all different.
fn robots() -> Vec<Params> {
    let paper = Params::paper();
    let with = |change: &dyn Fn(&mut Params)| {
        let mut params = paper.clone();
        change(&mut params);
        params
    };
    vec![
        paper.clone(),
        with(&|p| p.body_mass *= 1.2),
        with(&|p| (p.ball_mass, p.ball_inertia) = (0.8 * p.ball_mass, 0.8 * p.ball_inertia)),
        with(&|p| p.wheel_viscous_friction = 1e-3),
        with(&|p| p.wheel_coulomb_friction = 5e-3),
        with(&|p| p.ball_radius *= 1.1),
        with(&|p| p.wheel_radius *= 0.9),
        with(&|p| p.wheel_static_friction = p.wheel_dynamic_friction),
        with(&|p| (p.floor_static_friction, p.floor_dynamic_friction) = (0.03, 0.02)),
        with(&|p| p.body_com_height *= 1.1),
        with(&|p| (p.gravity, p.ball_viscous_friction, p.wheel_zenith) = (8.0, 2.0, 0.7)),
    ]
}

/// The uniform batch with each robot replaced, then reset.
fn mixed(config: &BalanceConfig, robots: &[Params], mode: Autoreset, threads: usize) -> Run {
    let mut batch = Batch::new(config, robots.len(), mode, Some(threads), SEED).unwrap();
    for (i, params) in robots.iter().enumerate() {
        batch.set_params(i, params).unwrap();
        assert_eq!(batch.params(i).unwrap(), params);
    }
    Run::new(batch)
}

/// The same, with every other robot without symmetry, with losses at the ball and on a slope; some on inclined rollers, and
/// on wheels with a ripple, if the model has it.
fn general_robots(model: ModelKind) -> Vec<Params> {
    let rippled = model != ModelKind::Spatial;
    let mut robots = robots();
    for (i, params) in robots.iter_mut().enumerate().skip(1).step_by(2) {
        let share = 0.1 * i as f64;
        params.body_com_offset = [8e-3 * share, -5e-3];
        params.floor_tilt = [0.1 - 0.3 * share, 0.2 * share];
        match i % 4 {
            1 => params.floor_rolling_friction = 1e-3,
            _ => (params.floor_spinning_friction, params.roller_friction) = (1e-3, 0.02),
        }
        if rippled && i % 4 == 3 {
            (params.roller_ripple, params.roller_phases) = (3e-4 * share, [0.3, share, -1.0]);
        }
        if i % 4 == 1 {
            params.wheel_preload = 40.0 * share;
        }
        if i % 6 == 3 {
            params.roller_angle = 0.8 - share;
        }
        // A robot with only its CoM off the mast, and a robot whose only asymmetry is its principal axes.
        if i != 3 {
            params.body_products_of_inertia = [1e-3, -2e-3 * share, 1.5e-3];
        }
        if i != 5 {
            params.wheel_azimuths[i % 3] += 0.1 * share;
            params.wheel_zenith_offsets[(i + 1) % 3] -= 0.08 * share;
        } else {
            params.body_com_offset = [0.0; 2];
        }
        params.validate().unwrap();
    }
    robots
}

/// Models that simulate every robot.
const GENERAL: [ModelKind; 3] = [ModelKind::Spatial, ModelKind::Contact, ModelKind::Rigid];

#[test]
fn robots_of_a_mixed_batch_equal_batches_of_one() {
    let cases = ModelKind::ALL.map(|model| (model, robots())).into_iter();
    for (model, robots) in cases.chain(GENERAL.map(|model| (model, general_robots(model)))) {
        for mode in [Autoreset::NextStep, Autoreset::SameStep] {
            let mut alone: Vec<Run> = (0..robots.len())
                .map(|i| Run::new(batch(&config(model, &robots[i]), 1, mode, SEED + i as u64)))
                .collect();
            let mut mixed = [1, 2].map(|threads| self::mixed(&config(model, &robots[0]), &robots, mode, threads));
            let mut ends = 0;
            for k in 0..70 {
                for run in &mut mixed {
                    run.step(&actions(0, robots.len(), k, 0.4)).unwrap();
                }
                for (i, alone) in alone.iter_mut().enumerate() {
                    alone.step(&actions(i, 1, k, 0.4)).unwrap();
                    let expected = alone.bits(0);
                    for run in &mixed {
                        assert!(run.bits(i) == expected, "{model}, {mode:?}: robot {i} differs in step {k}");
                    }
                    ends += usize::from(alone.outcomes[0].done());
                }
            }
            assert!(ends > robots.len(), "{model}: only {ends} episodes ended");
        }
    }
}

#[test]
fn different_robots_move_differently() {
    let robots = robots();
    let uniform = vec![robots[0].clone(); robots.len()];
    for model in [ModelKind::Contact, ModelKind::Rigid] {
        let run = |robots: &[Params]| {
            let mut run = mixed(&config(model, &robots[0]), robots, Autoreset::SameStep, 1);
            for k in 0..20 {
                run.step(&actions(0, robots.len(), k, 1.0)).unwrap();
            }
            run.all_bits()
        };
        let (mixed, uniform) = (run(&robots), run(&uniform));
        assert_eq!(mixed[0], uniform[0], "{model}");
        for i in 1..robots.len() {
            // Static friction by itself has no effect on rigid robots that keep their grip.
            let silent = model == ModelKind::Rigid && i == 7;
            assert!(silent || mixed[i] != uniform[i], "{model}: the parameters of robot {i} have no effect");
        }
    }
}

#[test]
fn equal_parameters_change_no_bit() {
    // Joint friction has its own impulses in the solver's state.
    let params = Params { wheel_viscous_friction: 1e-4, wheel_coulomb_friction: 5e-3, ..Params::paper() };
    for model in ModelKind::ALL {
        let config = config(model, &params);
        let run = |set: bool| {
            let mut run = Run::new(batch(&config, 11, Autoreset::SameStep, SEED));
            let mut bits = Vec::new();
            for k in 0..60 {
                if set && k % 7 == 3 {
                    (0..11).for_each(|i| run.batch.set_params(i, &params).unwrap());
                }
                run.step(&actions(0, 11, k, 0.4)).unwrap();
                bits.push(run.all_bits());
            }
            bits
        };
        assert!(run(true) == run(false), "{model}");
    }
}

#[test]
fn restored_parameters_restore_the_motion() {
    let robots = robots();
    for model in [ModelKind::Planar, ModelKind::Spatial, ModelKind::Contact] {
        let config = config(model, &robots[0]);
        let run = |change: &dyn Fn(&mut Batch, usize)| {
            let mut run = Run::new(batch(&config, 11, Autoreset::SameStep, SEED));
            let mut bits = Vec::new();
            for k in 0..40 {
                change(&mut run.batch, k);
                run.step(&actions(0, 11, k, 0.4)).unwrap();
                bits.push(run.all_bits());
            }
            bits
        };
        // Between two steps, robots of the same geometry.
        let there_and_back = |batch: &mut Batch, k: usize| {
            for i in [1, 2, 4, 7, 8] {
                if k == 10 + i {
                    batch.set_params(i, &robots[i]).unwrap();
                    batch.set_params(i, &robots[0]).unwrap();
                }
            }
        };
        assert!(run(&there_and_back) == run(&|_, _| ()), "{model}");
    }
    // With steps and another geometry in between, from the next start on.
    for model in ModelKind::ALL {
        let config = config(model, &robots[0]);
        let mut fresh = Run::new(batch(&config, 11, Autoreset::SameStep, SEED));
        let mut used = mixed(&config, &robots, Autoreset::SameStep, 1);
        for k in 0..20 {
            used.step(&actions(0, 11, k, 0.4)).unwrap();
        }
        (0..11).for_each(|i| used.batch.set_params(i, &robots[0]).unwrap());
        let seeds: Vec<_> = (0..11).map(|i| Some(SEED + i)).collect();
        used.batch.seed(&seeds).unwrap();
        used.reset(&[true; 11]);
        assert_eq!(used.observations, fresh.observations, "{model}");
        used.last.fill(0.0);
        for k in 0..40 {
            for run in [&mut fresh, &mut used] {
                run.step(&actions(0, 11, k, 0.4)).unwrap();
            }
            assert!(fresh.all_bits() == used.all_bits(), "{model}: step {k}");
        }
    }
}

#[test]
fn parameters_change_in_mid_motion_and_neighbors_keep_their_bits() {
    let robots = robots();
    for model in ModelKind::ALL {
        let config = config(model, &robots[0]);
        for changed in [1, 2, 3, 4, 7, 8] {
            let mut plain = Run::new(batch(&config, 11, Autoreset::SameStep, SEED));
            let mut run = Run::new(batch(&config, 11, Autoreset::SameStep, SEED));
            let mut alone = Run::new(batch(&config, 1, Autoreset::SameStep, SEED + changed as u64));
            for k in 0..30 {
                if k == 5 {
                    let before = run.batch.state(changed).unwrap();
                    run.batch.set_params(changed, &robots[changed]).unwrap();
                    alone.batch.set_params(0, &robots[changed]).unwrap();
                    let moved = (run.batch.state(changed).unwrap().to_array().iter().zip(before.to_array()))
                        .map(|(after, before)| (after - before).abs())
                        .fold(0.0, f64::max);
                    // Rigid robots are rebuilt from their coordinates where bodies change.
                    assert!(moved <= if model == ModelKind::Rigid { 1e-9 } else { 0.0 }, "{model}: moved by {moved}");
                }
                for run in [&mut plain, &mut run] {
                    run.step(&actions(0, 11, k, 0.4)).unwrap();
                }
                alone.step(&actions(changed, 1, k, 0.4)).unwrap();
                assert!(run.bits(changed) == alone.bits(0), "{model}: robot {changed} differs in step {k}");
                for i in (0..11).filter(|i| *i != changed) {
                    assert!(run.bits(i) == plain.bits(i), "{model}: robot {i} feels robot {changed} in step {k}");
                }
            }
        }
    }
}

/// Products of inertia turn the principal axes, in which `contact` keeps the motion.
#[test]
fn inertia_changes_in_mid_motion() {
    let paper = Params::paper();
    let turned = |products| Params { body_products_of_inertia: products, ..Params::paper() };
    let (one, other) = (turned([4e-3, -6e-3, 3e-3]), turned([-2e-3, 1e-3, 5e-3]));
    for kind in GENERAL {
        let mut robot = Ballbot::new(&paper, kind, 0.002).unwrap();
        robot.reset(&moving(&paper)).unwrap();
        let mut batch = batch(&config(kind, &paper), 3, Autoreset::Disabled, SEED);
        let starts = vec![Some(moving(&paper)); 3];
        let request = ResetRequest { starts: Some(&starts), ..ResetRequest::default() };
        batch.reset_with(&request, &mut vec![0.0; 3 * batch.observation_len()]).unwrap();
        for params in [&one, &other, &paper] {
            trace(&mut robot);
            let before = [robot.state(), batch.state(1).unwrap()];
            assert!(robot.set_params(params).unwrap(), "{kind}: the motion did not continue");
            batch.set_params(1, params).unwrap();
            for (before, after) in before.iter().zip([robot.state(), batch.state(1).unwrap()]) {
                let moved = (before.to_array().iter().zip(after.to_array()))
                    .map(|(before, after)| (before - after).abs())
                    .fold(0.0, f64::max);
                assert!(moved <= if kind == ModelKind::Rigid { 1e-9 } else { 1e-14 }, "{kind}: moved by {moved}");
            }
        }
        // And it continues like the motion of a robot that always had these parameters.
        let mut built = Ballbot::new(&one, kind, 0.002).unwrap();
        built.reset(&robot.state()).unwrap();
        robot.set_params(&one).unwrap();
        for (k, (found, expected)) in trace(&mut robot).iter().zip(trace(&mut built)).enumerate() {
            let apart = found.iter().zip(expected).map(|(f, e)| (f - e).abs()).fold(0.0, f64::max);
            assert!(apart <= 1e-8, "{kind}: {apart} apart after step {k}");
        }
    }
}

#[test]
fn another_geometry_requires_a_reset() {
    let robots = robots();
    for model in ModelKind::ALL {
        let config = config(model, &robots[0]);
        let zeros = [0.0; 33];
        for mode in [Autoreset::SameStep, Autoreset::Disabled] {
            let mut run = Run::new(batch(&config, 11, mode, SEED));
            run.step(&zeros).unwrap();
            run.batch.set_params(6, &robots[6]).unwrap();
            let before = run.snapshots();
            let message = run.step(&zeros).unwrap_err().to_string();
            assert!(message.contains("environment 6"), "{model}, {mode:?}: {message}");
            assert!(run.snapshots() == before, "{model}, {mode:?}: something moved");
            let mut mask = [false; 11];
            mask[6] = true;
            run.reset(&mask);
            run.step(&zeros).unwrap();
            assert_eq!(run.batch.params(6).unwrap(), &robots[6]);
        }
        let mut plain = Run::new(batch(&config, 11, Autoreset::NextStep, SEED));
        let mut run = Run::new(batch(&config, 11, Autoreset::NextStep, SEED));
        plain.step(&zeros).unwrap();
        run.step(&zeros).unwrap();
        run.batch.set_params(6, &robots[6]).unwrap();
        for run in [&mut plain, &mut run] {
            run.step(&zeros).unwrap();
        }
        assert_eq!(run.outcomes[6], Outcome::default(), "{model}: not reset");
        // The second start of the seed, on the new robot.
        let mut alone = Run::new(batch(&self::config(model, &robots[6]), 1, Autoreset::NextStep, SEED + 6));
        alone.reset(&[true]);
        assert_eq!(run.batch.state(6).unwrap(), alone.batch.state(0).unwrap(), "{model}");
        for i in (0..11).filter(|i| *i != 6) {
            assert!(run.bits(i) == plain.bits(i), "{model}: robot {i}");
        }
    }
}

#[test]
fn rejected_parameters_change_nothing() {
    let robots = robots();
    for model in ModelKind::ALL {
        // Starts that are possible for the paper's robot.
        let mut config = config(model, &robots[0]);
        (config.task.reset_tilt, config.task.fall_tilt) = (1.1, 1.5);
        let mut rejected: Vec<(Params, &str)> = vec![
            (Params { body_mass: -1.0, ..Params::paper() }, "body_mass = -1 "),
            (Params { wheel_coulomb_friction: f64::NAN, ..Params::paper() }, "wheel_coulomb_friction = NaN "),
            (Params { max_wheel_torque: 0.4, ..Params::paper() }, "max_wheel_torque = 0.5 "),
            (
                Params { ball_radius: 1e-5, ball_inertia: 1e-12, ..Params::paper() },
                "the fastest first wheel or ball rate",
            ),
        ];
        if matches!(model, ModelKind::Contact | ModelKind::Rigid) {
            // Lower wheels, which reach the floor first.
            let low = Params { wheel_zenith: robots[0].wheel_zenith + 0.3, ..Params::paper() };
            rejected.push((low, "the robot cannot start where the task may place it"));
        }
        if model == ModelKind::Rigid {
            rejected.push((Params { wheel_mass: 0.7, ..Params::paper() }, "wheel_mass = 0.7 kg"));
        }
        let mut run = Run::new(batch(&config, 11, Autoreset::SameStep, SEED));
        let mut plain = Run::new(batch(&config, 11, Autoreset::SameStep, SEED));
        for k in 0..30 {
            if k % 3 == 1 {
                let before = run.snapshots();
                for (params, words) in &rejected {
                    let message = run.batch.set_params(9, params).unwrap_err().to_string();
                    assert!(message.contains(words), "{model}: '{message}' does not contain '{words}'");
                    assert!(run.snapshots() == before, "{model}: {message}, but something changed");
                }
            }
            for run in [&mut plain, &mut run] {
                run.step(&actions(0, 11, k, 0.1)).unwrap();
            }
            assert!(run.all_bits() == plain.all_bits(), "{model}: step {k}");
        }
        let error = run.batch.set_params(11, &robots[0]).unwrap_err().to_string();
        assert!(error.starts_with("environment index = 11 "), "{error}");
    }
}

#[test]
fn snapshots_carry_the_parameters() {
    let cases = ModelKind::ALL.map(|model| (model, robots())).into_iter();
    for (model, robots) in cases.chain(GENERAL.map(|model| (model, general_robots(model)))) {
        let config = config(model, &robots[0]);
        let mut run = mixed(&config, &robots, Autoreset::SameStep, 1);
        let mut other = Run::new(batch(&config, 11, Autoreset::SameStep, SEED + 100));
        for k in 0..12 {
            run.step(&actions(0, 11, k, 0.4)).unwrap();
            other.step(&actions(0, 11, k + 1, 0.4)).unwrap();
        }
        // Into other lanes.
        let place = |i: usize| (i + 3) % 11;
        for (i, params) in robots.iter().enumerate() {
            other.batch.load(place(i), &run.batch.save(i).unwrap()).unwrap();
            assert_eq!(other.batch.params(place(i)).unwrap(), params, "{model}");
        }
        run.last.fill(0.0);
        other.last.fill(0.0);
        for k in 12..50 {
            let actions = actions(0, 11, k, 0.4);
            let mut moved = actions.clone();
            (0..11).for_each(|i| moved[3 * place(i)..][..3].copy_from_slice(&actions[3 * i..][..3]));
            run.step(&actions).unwrap();
            other.step(&moved).unwrap();
            for i in 0..11 {
                assert!(run.bits(i) == other.bits(place(i)), "{model}: robot {i} differs in step {k}");
            }
        }
    }
}

#[test]
fn falls_and_divergence_in_mixed_blocks_do_not_affect_neighbors() {
    let robots = robots();
    for model in ModelKind::ALL {
        let mut config = config(model, &robots[0]);
        // The bodies of some robots come near the floor.
        (config.task.fall_tilt, config.max_episode_steps) = (1.4, 60);
        let run = |impulse: f64| {
            let mut run = mixed(&config, &robots, Autoreset::NextStep, 1);
            let mut steps = Vec::new();
            for k in 0..60 {
                if k == 5 {
                    run.batch.push(2, &Vector3::new(impulse, 0.0, 0.0), None).unwrap();
                }
                run.step(&actions(0, 11, k, 0.02)).unwrap();
                steps.push((run.all_bits(), run.outcomes[2].terminated));
            }
            steps
        };
        let calm = run(0.0);
        for (impulse, reason) in [(1e4, Some("diverged")), (3.0, None)] {
            let found = run(impulse);
            if reason.is_some() {
                assert_eq!(found[5].1, reason, "{model}");
            } else if matches!(model, ModelKind::Contact | ModelKind::Rigid) {
                assert!(found.iter().any(|(_, reason)| reason.is_some()), "{model}: no fall after {impulse} N·s");
            }
            for (k, ((found, _), (calm, _))) in found.iter().zip(&calm).enumerate() {
                for i in (0..11).filter(|i| *i != 2) {
                    assert!(found[i] == calm[i], "{model}, {impulse} N·s: robot {i} differs in step {k}");
                }
            }
        }
    }
}

/// Leaning, turning and rolling.
fn moving(params: &Params) -> State {
    let body = attitude(Vector2::new(0.05, -0.03), 0.6);
    State::rolling(params, Vector2::new(0.1, -0.05), 0.2, body, Vector3::new(0.2, -0.1, 0.3))
}

/// States of 30 steps.
fn trace(robot: &mut Ballbot) -> Vec<[f64; State::LEN]> {
    let step = |k: usize| {
        robot.step([0.02, -0.01, 0.005 * k as f64], 1).unwrap();
        robot.state().to_array()
    };
    (0..30).map(step).collect()
}

#[test]
fn parameters_of_a_single_robot_change_in_mid_motion() {
    let robots = robots();
    for kind in ModelKind::ALL {
        let start = |params: &Params| {
            let mut robot = Ballbot::new(params, kind, 0.002).unwrap();
            robot.reset(&moving(params)).unwrap();
            robot
        };
        let mut plain = start(&robots[0]);
        trace(&mut plain);
        let expected = trace(&mut plain);
        for changed in [1, 2, 3, 4] {
            let mut robot = start(&robots[0]);
            trace(&mut robot);
            let (before, time) = (robot.save(), robot.time());
            assert!(robot.set_params(&robots[0]).unwrap());
            assert!(robot.save() == before, "{kind}: equal parameters changed something");
            assert!(robot.set_params(&robots[changed]).unwrap(), "{kind}: the motion did not continue");
            assert_eq!((robot.params(), robot.time()), (&robots[changed], time));
            assert!(trace(&mut robot) != expected, "{kind}: parameters {changed} have no effect");
        }
    }
}

#[test]
fn single_robots_of_another_geometry_equal_new_ones() {
    let robots = robots();
    for kind in ModelKind::ALL {
        for changed in [5, 6, 9, 10] {
            let mut robot = Ballbot::new(&robots[0], kind, 0.002).unwrap();
            robot.reset(&moving(&robots[0])).unwrap();
            trace(&mut robot);
            robot.push(&Vector3::new(0.1, 0.0, 0.0), None).unwrap();
            assert!(!robot.set_params(&robots[changed]).unwrap(), "{kind}: the motion continued");
            let mut built = Ballbot::new(&robots[changed], kind, 0.002).unwrap();
            assert_eq!((robot.time(), robot.state()), (0.0, built.state()), "{kind}");
            assert!(trace(&mut robot) == trace(&mut built), "{kind}: parameters {changed}");
        }
    }
}

#[test]
fn single_robots_equal_robots_in_lanes_through_a_change() {
    let robots = robots();
    let config = config(ModelKind::Contact, &robots[0]);
    for changed in [1, 3, 4, 8] {
        let mut run = Run::new(batch(&config, 11, Autoreset::SameStep, SEED));
        let starts = vec![Some(moving(&robots[0])); 11];
        let request = ResetRequest { starts: Some(&starts), ..ResetRequest::default() };
        run.batch.reset_with(&request, &mut run.observations).unwrap();
        let mut robot = Ballbot::new(&robots[0], ModelKind::Contact, config.sim_dt).unwrap();
        robot.reset(&moving(&robots[0])).unwrap();
        for k in 0..12 {
            if k == 5 {
                run.batch.set_params(changed, &robots[changed]).unwrap();
                robot.set_params(&robots[changed]).unwrap();
            }
            let actions = actions(0, 11, k, 0.1);
            run.step(&actions).unwrap();
            assert!(!run.outcomes[changed].done());
            let torques = [0, 1, 2].map(|j| f64::from(actions[3 * changed + j]) * ACTION_TORQUE);
            robot.step(torques, config.substeps().unwrap()).unwrap();
            assert_eq!(run.batch.state(changed).unwrap(), robot.state(), "robot {changed}, step {k}");
        }
    }
}

/// Whatever follows from the robot: torques, scaling, options of the task, motors, events and the estimator.
#[test]
fn several_robots_are_as_each_alone() {
    let kugle = Params::preset("kugle").unwrap();
    let robots = [Params::paper(), kugle, Params::preset("rezero").unwrap()];
    for model in [ModelKind::Contact, ModelKind::Rigid] {
        let config = EnvConfig::<Velocity> {
            model,
            scale_by_robot: true,
            max_episode_steps: 12,
            observation: Observation::Sensors,
            actuators: MotorOptions { lag: 0.01, ..MotorOptions::default() },
            events: vec![Event { operation: Operation::Scale, ..Event::new("body_mass", [0.9, 1.1]) }],
            ..EnvConfig::default()
        };
        // The second robot again after the third, in part.
        let n = 4 * Batch::SAME_ROBOT - 3;
        let mut run = Run::new(Batch::of_robots(&config, &robots, n, Autoreset::SameStep, Some(2), SEED).unwrap());
        let together: Vec<_> = (0..30)
            .map(|k| {
                run.step(&actions(0, n, k, 0.6)).unwrap();
                run.all_bits()
            })
            .collect();
        for first in (0..n).step_by(Batch::SAME_ROBOT) {
            let params = &robots[first / Batch::SAME_ROBOT % robots.len()];
            let config = EnvConfig { params: params.clone(), ..config.clone() };
            let used = (n - first).min(Batch::SAME_ROBOT);
            let seed = SEED + first as u64;
            let mut alone = Run::new(Batch::new(&config, used, Autoreset::SameStep, Some(1), seed).unwrap());
            assert_eq!(run.batch.max_wheel_torque(first).unwrap().to_bits(), config.action_torque().to_bits());
            assert_eq!(run.batch.nominal_params(first).unwrap(), params);
            for (k, together) in together.iter().enumerate() {
                alone.step(&actions(first, used, k, 0.6)).unwrap();
                for i in 0..used {
                    assert!(together[first + i] == alone.bits(i), "{model}: robot {} differs in step {k}", first + i);
                }
            }
        }
    }
}

#[test]
fn an_invalid_robot_among_several_is_named() {
    let weak = Params { max_wheel_torque: 0.01, ..Params::paper() };
    let of = |robots: &[Params], n| {
        let config = config(ModelKind::Contact, &Params::paper());
        Batch::of_robots(&config, robots, n, Autoreset::SameStep, Some(1), 0).map_err(|error| error.to_string())
    };
    let robots = [Params::paper(), weak];
    let error = of(&robots, 9).err().unwrap();
    assert!(error.starts_with("robot 1 of 2: max_wheel_torque = 0.5") && error.contains("0.01 N·m"), "{error}");
    let error = of(&robots, 8).err().unwrap();
    assert!(error.contains("2 entries, but num_envs = 8 has room for 1") && error.contains("at least 9"), "{error}");
    assert!(of(&[], 8).err().unwrap().contains("at least one"));
}
