//! The term `push`.

use super::{SEED, at, config, draws, every, started};
use crate::run::actions;
use ballbot_core::batch::{Autoreset, Direction, Event, Operation};
use ballbot_core::{Ballbot, ModelKind, Params, State};
use nalgebra::Vector3;
use std::f64::consts::TAU;

const N: usize = 9;
/// Step before which the robots are pushed.
const STEP: usize = 5;

#[test]
fn a_push_equals_the_same_impulse_by_hand() {
    for model in ModelKind::ALL {
        for height in [None, Some([0.1, 0.3])] {
            let event = at(STEP as f64 * 0.01, Event { height, ..Event::new("push", [0.05, 0.2]) });
            let mut sampled = started(&config(model, 100, &[event]), N, Autoreset::Disabled, SEED);
            let mut by_hand = started(&config(model, 100, &[]), N, Autoreset::Disabled, SEED);
            for k in 0..20 {
                sampled.step(&actions(0, N, k, 0.2)).unwrap();
                for i in (0..N).filter(|_| k == STEP) {
                    let push = draws(&sampled.batch, i, "push");
                    let impulse = Vector3::new(push[1].cos(), push[1].sin(), 0.0) * push[0];
                    let point = height.map(|_| Vector3::z() * push[2]);
                    assert!((0.05..=0.2).contains(&push[0]) && (0.0..TAU).contains(&push[1]));
                    assert!(height.map_or(push[2].is_nan(), |[low, high]| (low..=high).contains(&push[2])));
                    by_hand.batch.push(i, &impulse, point.as_ref()).unwrap();
                }
                by_hand.step(&actions(0, N, k, 0.2)).unwrap();
                assert!(sampled.all_bits() == by_hand.all_bits(), "{model}, step {k}");
            }
        }
    }
}

#[test]
fn a_long_push_equals_equal_impulses_by_hand() {
    const STEPS: usize = 4;
    for model in ModelKind::ALL {
        let push = Event { duration: STEPS as f64 * 0.01, ..Event::new("push", [0.05, 0.2]) };
        let event = at(STEP as f64 * 0.01, push);
        let config_of = |events: &[Event]| config(model, 100, events);
        let mut sampled = started(&config_of(std::slice::from_ref(&event)), N, Autoreset::Disabled, SEED);
        let mut by_hand = started(&config_of(&[]), N, Autoreset::Disabled, SEED);
        for k in 0..20 {
            // A push continues after its robot is saved and restored.
            if k == STEP + 2 {
                let saved = sampled.snapshots();
                sampled = started(&config_of(std::slice::from_ref(&event)), N, Autoreset::Disabled, 5);
                saved.iter().enumerate().for_each(|(i, snapshot)| sampled.batch.load(i, snapshot).unwrap());
            }
            sampled.step(&actions(0, N, k, 0.2)).unwrap();
            for i in (0..N).filter(|_| (STEP..STEP + STEPS).contains(&k)) {
                let push = draws(&sampled.batch, i, "push");
                let impulse = Vector3::new(push[1].cos(), push[1].sin(), 0.0) * push[0];
                by_hand.batch.push(i, &(impulse / STEPS as f64), None).unwrap();
            }
            by_hand.step(&actions(0, N, k, 0.2)).unwrap();
            let states =
                |run: &crate::run::Run| (0..N).map(|i| run.batch.state(i).unwrap().to_array()).collect::<Vec<_>>();
            assert!(states(&sampled) == states(&by_hand), "{model}, step {k}");
        }
        assert_eq!(sampled.batch.push_count(0).unwrap(), 1);
    }
}

#[test]
fn a_push_ends_with_its_episode() {
    let push = Event { duration: 0.09, ..Event::new("push", [0.2, 0.2]) };
    let mut run = started(&config(ModelKind::Contact, 3, &[at(0.02, push)]), N, Autoreset::SameStep, SEED);
    let mut free = started(&config(ModelKind::Contact, 3, &[]), N, Autoreset::SameStep, SEED);
    for k in 0..5 {
        run.step(&actions(0, N, k, 0.2)).unwrap();
        free.step(&actions(0, N, k, 0.2)).unwrap();
        let same = (0..N).all(|i| run.batch.state(i).unwrap() == free.batch.state(i).unwrap());
        // The third step ends the episode: its state is the start of the next, before whose third step there is no push.
        assert!(same, "step {k}");
    }
}

#[test]
fn a_scaled_push_is_a_change_of_velocity() {
    let push = Event { direction: Direction::Azimuth(1.0), ..Event::new("push", [0.1, 0.1]) };
    let scaled = Event { operation: Operation::Scale, ..push.clone() };
    let impulse = Event { range: vec![[0.1 * 2.228; 2]], ..push };
    let [mut a, mut b] = [scaled, impulse]
        .map(|event| started(&config(ModelKind::Contact, 100, &[at(0.0, event)]), 1, Autoreset::Disabled, SEED));
    for k in 0..5 {
        a.step(&actions(0, 1, k, 0.2)).unwrap();
        b.step(&actions(0, 1, k, 0.2)).unwrap();
        assert_eq!(a.all_bits(), b.all_bits());
    }
    assert_eq!(draws(&a.batch, 0, "push")[..2], [0.1, 1.0]);
}

#[test]
fn pushes_come_from_everywhere() {
    let event = every([0.02, 0.02], Event::new("push", [0.0, 0.0]));
    let mut run = started(&config(ModelKind::Contact, 1000, &[event]), 64, Autoreset::Disabled, SEED);
    let mut octants = [0_usize; 8];
    for k in 0..21 {
        run.step(&vec![0.0; 3 * 64]).unwrap();
        for i in (0..64).filter(|_| k >= 2 && k % 2 == 0) {
            octants[(draws(&run.batch, i, "push")[1] / TAU * 8.0) as usize] += 1;
        }
    }
    // 640 directions, 80 expected in each with a standard deviation of 8.4.
    assert_eq!(octants.iter().sum::<usize>(), 640);
    assert!(octants.iter().all(|count| (46..=114).contains(count)), "{octants:?}");
}

/// A pending push keeps its point on a robot whose mass changes before the next step.
#[test]
fn a_push_and_a_change_of_mass_in_one_step_come_in_any_order() {
    let paper = Params::paper();
    let heavy = Params { body_mass: 1.5 * paper.body_mass, ball_mass: 1.2 * paper.ball_mass, ..paper };
    let (impulse, point) = (Vector3::new(0.2, -0.1, 0.0), Vector3::new(0.02, 0.01, 0.3));
    for model in ModelKind::ALL {
        let mut found = Vec::new();
        for push_first in [true, false] {
            let mut robot = Ballbot::new(&paper, model, 0.002).unwrap();
            robot.reset(&State::tilted(&paper, [0.05, 0.02].into(), 0.4)).unwrap();
            robot.step([0.02, 0.0, -0.01], 5).unwrap();
            if push_first && !matches!(model, ModelKind::Planar | ModelKind::Spatial) {
                robot.push(&impulse, Some(&point)).unwrap();
                assert!(robot.set_params(&heavy).unwrap());
            } else {
                // Models without contacts change their velocities at once.
                assert!(robot.set_params(&heavy).unwrap());
                robot.push(&impulse, Some(&point)).unwrap();
            }
            robot.step([0.0; 3], 10).unwrap();
            found.push(robot.state().to_array());
        }
        for (a, b) in found[0].iter().zip(&found[1]) {
            assert!((a - b).abs() < 1e-11, "{model}: {a} and {b}");
        }
    }
}
