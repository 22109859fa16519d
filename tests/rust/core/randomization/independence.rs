//! Draws depend only on seed, episode, id and count.

use super::{SEED, config, draws, scaled, several, started};
use crate::run::actions;
use ballbot_core::ModelKind;
use ballbot_core::batch::{Autoreset, Batch, Event, ResetRequest, When};
use std::collections::BTreeMap;

const N: usize = 11;
const STEPS: usize = 12;

/// Draws of environment `i` after each step, as bits by label.
type History = Vec<BTreeMap<String, Vec<u64>>>;

fn present(batch: &Batch, i: usize) -> BTreeMap<String, Vec<u64>> {
    let bits = |label: &str| draws(batch, i, label).iter().map(|d| d.to_bits()).collect();
    batch.draw_columns().map(|(label, _)| (label.clone(), bits(&label))).collect()
}

/// Three episodes of environment `i` of `n`.
fn history(events: &[Event], n: usize, threads: usize, i: usize, seed: u64) -> History {
    let config = config(ModelKind::Contact, STEPS, events);
    let mut run = crate::run::Run::new(Batch::new(&config, n, Autoreset::SameStep, Some(threads), seed).unwrap());
    let mut history = vec![present(&run.batch, i)];
    for k in 0..3 * STEPS {
        run.step(&actions(0, n, k, 0.3)).unwrap();
        history.push(present(&run.batch, i));
    }
    history
}

#[test]
fn samples_do_not_depend_on_the_number_of_environments_or_threads() {
    let all = history(&several(), N, 1, 10, SEED);
    assert_eq!(all, history(&several(), N, 2, 10, SEED));
    assert_eq!(all, history(&several(), 1, 1, 0, SEED + 10));
    assert_ne!(all, history(&several(), N, 1, 9, SEED));
    assert_ne!(all[0]["body_mass"], all[STEPS]["body_mass"]);
}

#[test]
fn adding_or_moving_an_event_changes_no_other_sample() {
    let events = several();
    let all = history(&events, 2, 1, 0, SEED);
    let reversed: Vec<_> = events.iter().rev().cloned().collect();
    assert_eq!(all, history(&reversed, 2, 1, 0, SEED));
    for left_out in 0..events.len() {
        let mut fewer = events.clone();
        let gone = fewer.remove(left_out).label();
        let mut expected = all.clone();
        expected.iter_mut().for_each(|draws| drop(draws.remove(&gone)));
        assert_eq!(expected, history(&fewer, 2, 1, 0, SEED), "without {gone}");
    }
}

#[test]
fn events_do_not_change_the_starts() {
    // Terms that no start depends on.
    let events = [scaled("gravity", [0.9, 1.1]), Event::new("wheel_dynamic_friction", [0.3, 1.0])];
    let mut with = started(&config(ModelKind::Contact, 3, &events), N, Autoreset::SameStep, SEED);
    let mut without = started(&config(ModelKind::Contact, 3, &[]), N, Autoreset::SameStep, SEED);
    for k in 0..9 {
        assert_eq!(with.observations == without.observations, k % 3 == 0, "step {k}");
        with.step(&actions(0, N, k, 0.3)).unwrap();
        without.step(&actions(0, N, k, 0.3)).unwrap();
    }
}

#[test]
fn autoreset_modes_sample_the_same_episodes() {
    // Draws of each episode, right before its last step.
    let episodes = |mode: Autoreset| {
        let mut run = started(&config(ModelKind::Contact, STEPS, &several()), N, mode, SEED);
        let mut found = Vec::new();
        for _ in 0..3 {
            for k in 0..STEPS - 1 {
                run.step(&actions(0, N, k, 0.3)).unwrap();
            }
            found.push((0..N).map(|i| present(&run.batch, i)).collect::<Vec<_>>());
            run.step(&actions(0, N, 0, 0.3)).unwrap();
            match mode {
                Autoreset::SameStep => (),
                Autoreset::NextStep => run.step(&actions(0, N, 0, 0.3)).unwrap(),
                Autoreset::Disabled => run.reset(&[true; N]),
            }
        }
        found
    };
    let expected = episodes(Autoreset::Disabled);
    assert_eq!(expected, episodes(Autoreset::SameStep));
    assert_eq!(expected, episodes(Autoreset::NextStep));
}

#[test]
fn a_seed_gives_the_episodes_of_a_new_environment() {
    let config = config(ModelKind::Contact, STEPS, &several());
    let fresh = started(&config, N, Autoreset::Disabled, SEED);
    let mut used = started(&config, N, Autoreset::Disabled, 5);
    used.reset(&[true; N]);
    let seeds: Vec<_> = (0..N as u64).map(|i| Some(SEED + i)).collect();
    let mut observations = vec![0.0; used.observations.len()];
    let request = ResetRequest { seeds: Some(&seeds), ..ResetRequest::default() };
    used.batch.reset_with(&request, &mut observations).unwrap();
    assert_eq!(observations, fresh.observations);
    for i in 0..N {
        assert_eq!(present(&used.batch, i), present(&fresh.batch, i));
        assert_eq!(used.batch.params(i).unwrap(), fresh.batch.params(i).unwrap());
    }
}

#[test]
fn values_sampled_at_startup_persist() {
    let events = [Event { when: When::Startup, ..scaled("body_mass", [0.8, 1.2]) }, scaled("gravity", [0.9, 1.1])];
    let config = config(ModelKind::Contact, STEPS, &events);
    let batch = Batch::new(&config, N, Autoreset::Disabled, Some(1), SEED).unwrap();
    let made: Vec<_> = (0..N).map(|i| batch.params(i).unwrap().body_mass).collect();
    assert!(made.iter().all(|mass| made.iter().filter(|other| *other == mass).count() == 1));
    assert!((0..N).all(|i| draws(&batch, i, "gravity")[0].is_nan()));
    let mut run = crate::run::Run::new(batch);
    for _ in 0..3 {
        assert!((0..N).all(|i| run.batch.params(i).unwrap().body_mass == made[i]));
        run.reset(&[true; N]);
    }
    run.batch.seed(&[Some(9); N]).unwrap();
    run.reset(&[true; N]);
    let masses: Vec<_> = (0..N).map(|i| run.batch.params(i).unwrap().body_mass).collect();
    assert!(masses.iter().all(|mass| *mass == masses[0]) && masses[0] != made[0]);
}

#[test]
fn ids_choose_the_random_numbers() {
    let sampled = |id: Option<u64>, term: &str| {
        let event = Event { id, ..scaled(term, [0.8, 1.2]) };
        let label = event.label();
        let run = started(&config(ModelKind::Contact, STEPS, &[event]), 1, Autoreset::Disabled, SEED);
        draws(&run.batch, 0, &label)[0]
    };
    assert_eq!(sampled(Some(3), "body_mass"), sampled(Some(3), "gravity"));
    assert_ne!(sampled(Some(3), "body_mass"), sampled(Some(4), "body_mass"));
    assert_ne!(sampled(None, "body_mass"), sampled(None, "gravity"));
    // CRC-32 of the text "gravity", as in zlib.
    assert_eq!(sampled(None, "gravity"), sampled(Some(0x5A1D_25A7), "gravity"));
}
