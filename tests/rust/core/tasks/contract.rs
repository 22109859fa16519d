//! Properties of every task.

use crate::run::{Run, actions};
use ballbot_core::batch::{Autoreset, Batch, TaskKind, task_kinds};
use ballbot_core::task::DIVERGED;
use ballbot_core::terrain::Terrain;
use ballbot_core::{Error, ModelKind};
use std::sync::Arc;

const N: usize = 11;

/// Short episodes of any task: falls, changing commands and time limits all occur.
fn batch(kind: &dyn TaskKind, model: ModelKind, mode: Autoreset, threads: usize, seed: u64, n: usize) -> Batch {
    let description = kind.description();
    let mut config = kind.config();
    config.set_model(model);
    config.set("max_episode_steps", &[70.0]).unwrap();
    config.set("max_wheel_torque", &[1.0]).unwrap();
    for (name, values) in [
        ("command_seconds", [0.1, 0.2]),
        ("goal_seconds", [0.1, 0.2]),
        ("cruise_seconds", [0.1, 0.2]),
        ("stop_seconds", [0.1, 0.2]),
        ("push_seconds", [0.1, 0.3]),
        ("settling", [0.1, 0.1]),
        ("hold_seconds", [0.05, 0.05]),
        ("push_duration", [0.05, 0.05]),
        ("path_acceleration", [10.0, 10.0]),
        ("path_jerk", [1e3, 1e3]),
        ("reset_tilt", [0.2, 0.2]),
    ] {
        if let Some(option) = description.options.iter().find(|option| option.name == name) {
            config.set(name, &values[..option.default.len()]).unwrap();
        }
    }
    if description.has_terrain && model != ModelKind::Contact {
        config.set_terrain(Some(Arc::new(Terrain::plane(0.05, 1.0).unwrap())));
    }
    config.batch(n, mode, Some(threads), seed).unwrap()
}

#[test]
fn lanes_threads_and_snapshots_change_nothing() {
    for kind in task_kinds() {
        let name = kind.description().name;
        for (model, mode) in [
            (ModelKind::Contact, Autoreset::SameStep),
            (ModelKind::Contact, Autoreset::NextStep),
            (ModelKind::Spatial, Autoreset::SameStep),
        ] {
            let mut runs = [1, 3].map(|threads| Run::new(batch(kind, model, mode, threads, 5, N)));
            let mut singles: Vec<_> = (0..N).map(|i| Run::new(batch(kind, model, mode, 1, 5 + i as u64, 1))).collect();
            let mut ended = 0;
            for k in 0..150 {
                if k == 75 {
                    // Continues from snapshots of the other batch.
                    let saved = runs[0].snapshots();
                    for (i, bytes) in saved.iter().enumerate() {
                        runs[1].batch.load(i, bytes).unwrap();
                    }
                }
                let taken = actions(0, N, k, 0.2);
                runs.iter_mut().for_each(|run| run.step(&taken).unwrap());
                ended += runs[0].outcomes.iter().filter(|outcome| outcome.done()).count();
                for (i, single) in singles.iter_mut().enumerate() {
                    single.step(&taken[3 * i..3 * i + 3]).unwrap();
                    let label = format!("{name}, {model}, {mode:?}: environment {i}, step {k}");
                    assert!(runs[0].bits(i) == runs[1].bits(i), "{label}: threads");
                    assert_eq!(runs[0].outcomes[i], single.outcomes[0], "{label}");
                    assert_eq!(runs[0].observation(i), single.observation(0), "{label}");
                    assert_eq!(super::command(&runs[0], i), super::command(single, 0), "{label}");
                }
            }
            assert!(ended > N, "{name}, {model}: {ended} ends prove little");
        }
    }
}

#[test]
fn rewards_are_the_sum_of_their_terms_and_rows_stay_within_their_bounds() {
    for kind in task_kinds() {
        let description = kind.description();
        let mut run = Run::new(batch(kind, ModelKind::Contact, Autoreset::SameStep, 1, 9, N));
        let mut reasons = std::collections::BTreeSet::new();
        for k in 0..200 {
            run.step(&actions(0, N, k, 1.0)).unwrap();
            for i in 0..N {
                let outcome = run.outcomes[i];
                reasons.extend(outcome.terminated);
                assert!(run.observation(i).iter().all(|value| value.abs() <= 10.0), "{}", description.name);
                if outcome.done() {
                    continue;
                }
                let mut terms = vec![0.0; description.terms.len()];
                run.batch.reward_terms(i, &mut terms).unwrap();
                let sum: f64 = terms.iter().sum();
                assert!((outcome.reward - sum).abs() < 1e-12 * (1.0 + sum.abs()), "{}: {terms:?}", description.name);
                for (term, value) in description.terms.iter().zip(&terms) {
                    // A robot may go back.
                    let is_signed = term.name != "progress";
                    let is_right = *value <= 0.0 || !term.cost;
                    assert!(
                        is_right && (*value >= 0.0 || term.cost || !is_signed),
                        "{}: {}",
                        description.name,
                        term.name
                    );
                }
            }
        }
        assert!(reasons.contains("tilt") && !reasons.contains(DIVERGED), "{}: {reasons:?}", description.name);
    }
}

#[test]
fn a_command_set_by_hand_holds_to_the_end_of_the_episode() {
    for kind in task_kinds().into_iter().filter(|kind| !kind.description().command.is_empty()) {
        let description = kind.description();
        let name = description.name;
        let mut run = Run::new(batch(kind, ModelKind::Contact, Autoreset::SameStep, 1, 3, N));
        let before = super::command(&run, 4);
        let mut desired: Vec<_> = (0..description.command.len()).map(|k| 0.01 + 0.02 * k as f64).collect();
        // Slow enough for the sharp turns of this curve.
        desired[0] = 0.005;
        run.batch.set_command(2, &desired).unwrap();
        assert_eq!(super::command(&run, 2), desired, "{name}");
        assert_eq!(super::command(&run, 4), before, "{name}: another environment");
        let mut changed = false;
        for _ in 0..70 {
            run.step(&[0.0; 3 * N]).unwrap();
            if run.outcomes[2].done() {
                changed = super::command(&run, 2) != desired;
                break;
            }
            assert_eq!(super::command(&run, 2), desired, "{name}");
        }
        assert!(changed, "{name}: the next episode has a separate command");
    }
}

#[test]
fn wrong_commands_are_rejected_with_value_and_limit() {
    for kind in task_kinds() {
        let description = kind.description();
        let mut run = Run::new(batch(kind, ModelKind::Contact, Autoreset::SameStep, 1, 3, N));
        let parts = description.command.len();
        if parts == 0 {
            assert!(run.batch.set_command(0, &[]).unwrap_err().to_string().contains("has no command"));
            continue;
        }
        let before = super::command(&run, 0);
        assert!(matches!(run.batch.set_command(0, &vec![0.0; parts + 1]), Err(Error::Length { .. })));
        assert!(matches!(run.batch.set_command(N, &vec![0.0; parts]), Err(Error::OutOfRange { .. })));
        for bad in [1e9, f64::NAN, f64::INFINITY] {
            let mut command = before.clone();
            command[parts - 1] = bad;
            let message = run.batch.set_command(0, &command).unwrap_err().to_string();
            assert!(message.contains(description.command[parts - 1].name), "{message}");
        }
        assert_eq!(super::command(&run, 0), before);
    }
}
