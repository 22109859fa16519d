//! When events fire.

use super::{SEED, at, config, draw, draws, every, optional, started};
use crate::run::actions;
use ballbot_core::ModelKind;
use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, Event};
use ballbot_core::task::Balance;

const CONTROL_DT: f64 = 0.01;

fn friction() -> Event {
    optional(Event::new("floor_dynamic_friction", [0.5, 1.0]))
}

#[test]
fn an_event_at_a_time_fires_once_an_episode_before_the_action_of_that_step() {
    for model in [ModelKind::Contact, ModelKind::Spatial] {
        for (time, step) in [(0.0, 0), (0.03, 3), (0.034, 4)] {
            let mut run = started(&config(model, 8, &[at(time, friction())]), 9, Autoreset::SameStep, SEED);
            let mut seen = Vec::new();
            for k in 0..24 {
                let before = draw(&run.batch, 4, "floor_dynamic_friction");
                assert_eq!(before.is_nan(), k % 8 <= step, "at {time}, before step {k}");
                run.step(&actions(0, 9, k, 0.2)).unwrap();
                let after = draw(&run.batch, 4, "floor_dynamic_friction");
                if k % 8 == 7 {
                    // Reset within the step.
                    assert!(after.is_nan());
                    assert_eq!(run.batch.params(4).unwrap(), run.batch.nominal_params(4).unwrap());
                } else if k % 8 == step {
                    assert_eq!(run.batch.params(4).unwrap().floor_dynamic_friction, after);
                    seen.push(after);
                } else if k % 8 > step {
                    assert_eq!(after, before);
                }
            }
            assert!(seen.len() == 3 && seen[0] != seen[1] && seen[1] != seen[2]);
        }
    }
}

#[test]
fn a_slope_changes_within_the_episode() {
    for model in [ModelKind::Spatial, ModelKind::Contact, ModelKind::Rigid] {
        let events = [every([0.05, 0.1], Event::new("floor_tilt", [-0.1, 0.1]))];
        let mut run = started(&config(model, 1000, &events), 9, Autoreset::Disabled, SEED);
        let mut slopes = vec![[0.0; 2]];
        for k in 0..30 {
            let before = run.batch.state(4).unwrap();
            run.step(&actions(0, 9, k, 0.1)).unwrap();
            let moved = (run.batch.state(4).unwrap().ball_position - before.ball_position).norm();
            assert!(moved < 0.05, "{model}: jumps by {moved} m");
            let params = run.batch.params(4).unwrap();
            if *slopes.last().unwrap() != params.floor_tilt {
                slopes.push(params.floor_tilt);
                assert_eq!(draws(&run.batch, 4, "floor_tilt"), params.floor_tilt);
            }
        }
        assert!(slopes.len() >= 4, "{model}: {slopes:?}");
    }
}

#[test]
fn planar_rejects_events_on_the_slope() {
    let events = [Event::new("floor_tilt", [-0.1, 0.1])];
    let made = Batch::new(&config(ModelKind::Planar, 10, &events), 2, Autoreset::SameStep, Some(1), SEED);
    let error = made.map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("(floor_tilt)") && error.contains("it requires zeros"), "{error}");
}

/// Steps before which the event of environment `i` fired, in an episode of `steps`.
fn firings(gap: [f64; 2], n: usize, steps: usize) -> Vec<Vec<usize>> {
    // Without torque and tilt nothing falls.
    let upright = Balance { reset_tilt: 0.0, reset_ball_speed: 0.0, reset_tilt_rate: 0.0, ..Balance::default() };
    let config = BalanceConfig { task: upright, ..config(ModelKind::Contact, steps + 1, &[every(gap, friction())]) };
    let mut run = started(&config, n, Autoreset::Disabled, SEED);
    let mut found = vec![Vec::new(); n];
    for k in 0..steps {
        let before: Vec<_> = (0..n).map(|i| draw(&run.batch, i, "floor_dynamic_friction").to_bits()).collect();
        run.step(&vec![0.0; 3 * n]).unwrap();
        for i in 0..n {
            if draw(&run.batch, i, "floor_dynamic_friction").to_bits() != before[i] {
                found[i].push(k);
            }
        }
    }
    found
}

#[test]
fn gaps_are_uniform_and_do_not_drift() {
    let exact = firings([0.05, 0.05], 1, 60);
    assert_eq!(exact[0], (1..12).map(|k| 5 * k).collect::<Vec<_>>());
    // Not a multiple of the control step: the mean gap is preserved.
    let odd = firings([0.025, 0.025], 1, 60);
    assert_eq!(odd[0][..6], [3, 5, 8, 10, 13, 15]);

    let found = firings([0.04, 0.16], 256, 60);
    let firsts: Vec<_> = found.iter().map(|steps| steps[0] as f64 * CONTROL_DT).collect();
    let seconds: Vec<_> = found.iter().map(|steps| (steps[1] - steps[0]) as f64 * CONTROL_DT).collect();
    for (gaps, early) in [(&firsts, 0.0), (&seconds, CONTROL_DT)] {
        let mean = gaps.iter().sum::<f64>() / 256.0;
        let variance = gaps.iter().map(|gap| (gap - mean).powi(2)).sum::<f64>() / 256.0;
        assert!(gaps.iter().all(|gap| (0.04 - early - 1e-9..=0.16 + CONTROL_DT + 1e-9).contains(gap)));
        // Of uniform gaps: mean 0.1 (half a step of delay at first), variance 0.0012; four standard errors.
        assert!((mean - 0.1).abs() < 0.005 + 0.009, "{mean}");
        assert!((variance - 0.0012).abs() < 0.0003, "{variance}");
    }
}

#[test]
fn timers_restart_with_the_episode() {
    let gap = [0.05, 0.09];
    let mut run = started(&config(ModelKind::Contact, 40, &[every(gap, friction())]), 1, Autoreset::Disabled, SEED);
    let mut firsts = Vec::new();
    for _ in 0..20 {
        let mut first = 0;
        while draw(&run.batch, 0, "floor_dynamic_friction").is_nan() {
            run.step(&[0.0; 3]).unwrap();
            first += 1;
        }
        firsts.push(first);
        run.reset(&[true]);
    }
    // The step that fires is counted.
    assert!(firsts.iter().all(|first| (6..=10).contains(first)), "{firsts:?}");
    assert!(firsts.iter().any(|first| *first != firsts[0]));
}
