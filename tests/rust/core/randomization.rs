//! Events: their samples depend only on seed, episode and id, and the resulting robot equals a robot with those
//! parameters.

mod combinations;
mod distributions;
mod independence;
mod motors;
mod pushes;
mod rejections;
mod robots;
mod seeds;
mod sensors;
mod snapshots;
mod timing;

use crate::run::Run;
use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, Event, Operation, ResetRequest, When};
use ballbot_core::task::Balance;
use ballbot_core::{ModelKind, State};
use std::f64::consts::PI;

const SEED: u64 = 70;

/// Episodes that end only by their length, unless `steps` is beyond a fall.
fn config(model: ModelKind, steps: usize, events: &[Event]) -> BalanceConfig {
    BalanceConfig {
        model,
        max_episode_steps: steps,
        max_wheel_torque: Some(0.3),
        task: Balance { fall_tilt: PI, ..Balance::default() },
        events: events.to_vec(),
        ..BalanceConfig::default()
    }
}

fn started(config: &BalanceConfig, n: usize, mode: Autoreset, seed: u64) -> Run {
    Run::new(Batch::new(config, n, mode, Some(1), seed).unwrap())
}

/// A start of each of `n` robots.
fn starts(config: &BalanceConfig, n: usize) -> Vec<Option<State>> {
    let start = |i: usize| State::tilted(&config.params, [0.02 * (i as f64).sin(), 0.01].into(), 0.3);
    (0..n).map(|i| Some(start(i))).collect()
}

fn reset_to(run: &mut Run, starts: &[Option<State>]) {
    let request = ResetRequest { starts: Some(starts), ..ResetRequest::default() };
    run.batch.reset_with(&request, &mut run.observations).unwrap();
}

/// Robot `i` by itself in an episode, counted from 0, whose random numbers of the stages are the same as in a batch.
fn alone(config: &BalanceConfig, i: usize, episode: usize, start: &Option<State>) -> Run {
    let mut alone = started(config, 1, Autoreset::Disabled, SEED + i as u64);
    (0..episode).for_each(|_| alone.reset(&[true]));
    reset_to(&mut alone, std::slice::from_ref(start));
    alone
}

fn scaled(term: &str, range: [f64; 2]) -> Event {
    Event { operation: Operation::Scale, ..Event::new(term, range) }
}

fn every(gap: [f64; 2], event: Event) -> Event {
    Event { when: When::Every(gap), ..event }
}

fn at(time: f64, event: Event) -> Event {
    Event { when: When::At(time), ..event }
}

/// An event that models without its effect accept.
fn optional(event: Event) -> Event {
    Event { optional: true, ..event }
}

/// Events on masses, friction, geometry and motors, and within episodes.
fn several() -> Vec<Event> {
    vec![
        scaled("body_mass", [0.8, 1.2]),
        Event { shared: true, ..scaled("body_inertia", [0.9, 1.1]) },
        optional(Event::new("wheel_dynamic_friction", [0.3, 1.0])),
        scaled("ball_radius", [0.97, 1.02]),
        Event { when: When::Startup, ..scaled("body_com_height", [0.9, 1.1]) },
        Event::new("wheel_viscous_friction", [0.0, 1e-3]),
        every([0.03, 0.08], optional(Event::new("floor_dynamic_friction", [0.3, 1.0]))),
        at(0.05, Event { operation: Operation::Scale, ..Event::new("push", [0.1, 0.3]) }),
        Event::new("actuators.delay", [0.0, 0.02]),
        Event::new("actuators.delay_jitter", [0.0, 0.01]),
        every([0.02, 0.05], scaled("actuators.strength", [0.8, 1.2])),
    ]
}

/// Current samples of environment `i` by label.
fn draws(batch: &Batch, i: usize, label: &str) -> Vec<f64> {
    let mut first = 0;
    for (found, width) in batch.draw_columns() {
        if found == label {
            return batch.draws(i).unwrap()[first..first + width].to_vec();
        }
        first += width;
    }
    panic!("no samples of {label}");
}

/// As [`draws`], for a term with one number.
fn draw(batch: &Batch, i: usize, label: &str) -> f64 {
    draws(batch, i, label)[0]
}
