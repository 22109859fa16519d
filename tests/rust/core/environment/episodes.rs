//! Ends of episodes, success, and snapshots in mid-episode.

use super::{Episode, config, rows};
use ballbot_core::batch::{BalanceConfig, Outcome};
use ballbot_core::task::Balance;
use ballbot_core::{Error, ModelKind, State};
use nalgebra::{Vector2, Vector3};
use std::f64::consts::PI;

#[test]
fn falls_terminate_the_episode() {
    for model in ModelKind::ALL {
        let config = config(model);
        let mut episode = Episode::from(&config, &State::tilted(&config.params, Vector2::new(0.05, 0.0), 0.0));
        let mut last = 0.0;
        let (steps, outcome) = episode.finish(|episode| {
            last = episode.env.robot().state().tilt();
            episode.step([0.0; 3])
        });
        let tilt = episode.env.robot().state().tilt();
        assert_eq!(outcome.terminated, Some("tilt"), "{model}");
        assert!(!outcome.truncated && !outcome.success);
        assert!(last <= config.task.fall_tilt && tilt > config.task.fall_tilt, "{model}: from {last} to {tilt} rad");
        assert_eq!(episode.env.reward_terms()[0], ("alive", 0.0));
        // A fall on the very last step is a fall.
        let brief = BalanceConfig { max_episode_steps: steps, ..config };
        let mut episode = Episode::from(&brief, &State::tilted(&brief.params, Vector2::new(0.05, 0.0), 0.0));
        assert_eq!(episode.finish(|episode| episode.step([0.0; 3])), (steps, outcome));
    }
}

#[test]
fn floor_contact_terminates_the_episode() {
    let mut config = config(ModelKind::Rigid);
    config.task.fall_tilt = PI;
    let mut episode = Episode::from(&config, &State::tilted(&config.params, Vector2::new(0.05, 0.0), 0.0));
    let (_, outcome) = episode.finish(|episode| episode.step([0.0; 3]));
    assert_eq!(outcome.terminated, Some("bot_on_floor"));
    assert!(episode.env.robot().bot_on_floor() && !outcome.truncated && !outcome.success);
    assert!(episode.env.robot().state().tilt() > 0.7, "{:?}", episode.env.robot().state());
}

#[test]
fn divergence_terminates_the_episode_and_a_reset_clears_it() {
    for model in ModelKind::ALL {
        for impulse in [1e3, 1e4] {
            let mut episode = Episode::new(&config(model), 7);
            episode.env.robot_mut().push(&Vector3::new(0.0, impulse, 0.0), None).unwrap();
            let outcome = episode.step([0.1; 3]);
            let expected = Outcome { terminated: Some("diverged"), ..Outcome::default() };
            assert_eq!(outcome, expected, "{model}, {impulse} N·s");
            assert!(episode.env.over() && episode.env.reward_terms().iter().all(|(_, value)| *value == 0.0));
            let bounded = episode.seen.iter().zip(rows()).all(|(value, row)| value.abs() <= row.bound);
            assert!(bounded, "{model}: {:?}", episode.seen);
            let run = |episode: &mut Episode| {
                episode.env.seed(8);
                episode.reset();
                (episode.finish(|episode| episode.step([0.1, -0.2, 0.05])), episode.seen)
            };
            assert_eq!(run(&mut episode), run(&mut Episode::new(&config(model), 1)), "{model}, {impulse} N·s");
        }
    }
}

/// Default task, driven by the regulator; `act` may interfere before each step.
fn outcome_of(config: &BalanceConfig, seed: u64, mut act: impl FnMut(&mut Episode, usize)) -> (usize, Outcome) {
    let mut episode = Episode::new(config, seed);
    let mut k = 0;
    episode.finish(|episode| {
        act(episode, k);
        k += 1;
        episode.regulated(episode.env.config().task.setpoint.into())
    })
}

#[test]
fn balancing_robots_are_truncated_in_success() {
    for model in ModelKind::ALL {
        for (seed, steps) in [(1, 1000), (2, 400)] {
            let mut config = BalanceConfig { max_episode_steps: steps, ..config(model) };
            config.task.setpoint = [0.05, -0.1];
            let expected = Outcome { truncated: true, success: true, ..Outcome::default() };
            let (found, outcome) = outcome_of(&config, seed, |_, _| ());
            assert_eq!((found, Outcome { reward: 0.0, ..outcome }), (steps, expected), "{model}, seed {seed}");
        }
    }
}

#[test]
fn success_depends_on_the_end_of_the_episode() {
    let config = BalanceConfig { max_episode_steps: 600, ..config(ModelKind::Spatial) };
    let success = |config: &BalanceConfig, act: &dyn Fn(&mut Episode, usize)| {
        let (steps, outcome) = outcome_of(config, 4, act);
        assert!(steps == config.max_episode_steps && outcome.truncated, "{outcome:?}");
        outcome.success
    };
    let push_at = |step: usize| {
        move |episode: &mut Episode, k: usize| {
            if k == step {
                episode.env.robot_mut().push(&Vector3::new(0.2, 0.0, 0.0), None).unwrap();
            }
        }
    };
    // Tilted by the push for most of a second: before the last two seconds, then within them.
    assert!(success(&config, &push_at(250)));
    assert!(!success(&config, &push_at(450)));
    assert!(!success(&config, &push_at(570)));
    // Upright, but at a different position.
    let mut far = config.clone();
    far.task.success_radius = 1e-6;
    assert!(!success(&far, &push_at(250)));
    // An episode shorter than the window cannot fill it, however calm.
    let mut calm = config.clone();
    calm.task = Balance { reset_tilt: 0.0, reset_ball_speed: 0.0, reset_tilt_rate: 0.0, ..calm.task };
    assert!(!success(&BalanceConfig { max_episode_steps: 199, ..calm.clone() }, &|_, _| ()));
    assert!(success(&BalanceConfig { max_episode_steps: 200, ..calm }, &|_, _| ()));
    // A window of zero length is the last step.
    let mut instant = config;
    instant.task.success_window = 0.0;
    assert!(success(&instant, &push_at(300)));
    assert!(!success(&instant, &push_at(570)));
}

#[test]
fn loaded_environments_continue_bit_for_bit() {
    for model in ModelKind::ALL {
        let config = BalanceConfig { max_episode_steps: 40, ..config(model) };
        let run = |episode: &mut Episode| {
            let mut seen = Vec::new();
            for k in 0..120_i8 {
                if episode.env.over() {
                    episode.reset();
                }
                let action = [0.3, -0.2, 0.1].map(|a| a * f32::from(k % 5 - 2));
                let outcome = episode.step(action);
                seen.push((episode.seen, outcome, episode.env.reward_terms()));
            }
            seen
        };
        let mut episode = Episode::new(&config, 11);
        episode.env.robot_mut().push(&Vector3::new(0.0, 0.02, 0.0), None).unwrap();
        for _ in 0..17 {
            episode.regulated(Vector2::zeros());
        }
        let saved = episode.env.save();
        let expected = run(&mut episode);
        assert!(expected.iter().any(|(_, outcome, _)| outcome.done()), "no episode ended");
        let mut other = Episode::new(&config, 12);
        other.env.load(&saved).unwrap();
        assert!(run(&mut other) == expected, "{model}: the loaded environment went another way");
        let before = other.env.save();
        let error = other.env.load(&saved[..saved.len() / 2]).unwrap_err();
        assert!(matches!(&error, Error::Decode { .. }), "{error:?}");
        assert!(other.env.save() == before, "{model}: rejected, but something changed");
    }
}
