//! Invalid robots from samples that are each valid.

use super::{SEED, config, every, scaled, started};
use crate::run::actions;
use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, Environment, Event, Operation, ResetRequest};
use ballbot_core::{ModelKind, Params, State};

const N: usize = 128;

/// Ranges whose five ends together leave wheel 0 without load, but no four of them.
fn five() -> [Event; 5] {
    let azimuths = vec![[0.0; 2], [-0.27, 0.0], [0.0; 2]];
    [
        Event { range: vec![[-0.03, 0.0], [0.0; 2]], ..Event::new("body_com_offset", [0.0; 2]) },
        scaled("body_com_height", [0.8, 1.0]),
        Event { operation: Operation::Add, ..Event::new("wheel_zenith", [-0.12, 0.0]) },
        Event { shared: true, ..Event::new("wheel_zenith_offsets", [-0.12, 0.0]) },
        Event { range: azimuths, operation: Operation::Add, ..Event::new("wheel_azimuths", [0.0; 2]) },
    ]
}

fn with(events: &[Event]) -> BalanceConfig {
    config(ModelKind::Contact, 2, events)
}

/// [`five`] in an order in which no sample tried at the creation of an environment hits the corner.
fn unnoticed() -> [Event; 5] {
    let mut events = five();
    for _ in 0..events.len() {
        if with(&events).validate().is_ok() {
            return events;
        }
        events.rotate_left(1);
    }
    panic!("each order was rejected");
}

#[test]
fn only_all_five_ends_together_are_invalid() {
    let ends = |left_out: Option<usize>| {
        let mut robot = Params::paper();
        for (place, event) in five().iter().enumerate().filter(|(place, _)| Some(*place) != left_out) {
            let low = event.range[0][0];
            match place {
                0 => robot.body_com_offset[0] = low,
                1 => robot.body_com_height *= low,
                2 => robot.wheel_zenith += low,
                3 => robot.wheel_zenith_offsets = [low; 3],
                _ => robot.wheel_azimuths[1] += event.range[1][0],
            }
        }
        robot.validate()
    };
    (0..5).for_each(|place| ends(Some(place)).unwrap());
    assert!(ends(None).unwrap_err().to_string().contains("the load of wheel 0"));
}

#[test]
fn an_invalid_robot_is_sampled_again() {
    let events = unnoticed();
    let mut run = started(&with(&events), N, Autoreset::Disabled, SEED);
    let (mut repeated, mut episodes) = (vec![0; N], 0);
    let mut found = None;
    while episodes < 1000 {
        run.reset(&[true; N]);
        episodes += 1;
        for (i, before) in repeated.iter_mut().enumerate() {
            run.batch.params(i).unwrap().validate().unwrap();
            assert!(run.batch.draws(i).unwrap().iter().all(|draw| draw.is_finite()), "robot {i}, episode {episodes}");
            let now = run.batch.repeated_draws(i).unwrap();
            if now > *before {
                found = found.or(Some((i, episodes + 1)));
                *before = now;
            }
        }
    }
    let sum: u32 = repeated.iter().sum();
    // Eight in a hundred thousand.
    assert!((2..40).contains(&sum), "{sum} of {}", 1000 * N);
    // It is the same in a batch of one, in a single environment, and in what a given start is checked against.
    let (i, episode) = found.unwrap();
    let seed = SEED + i as u64;
    let mut again = started(&with(&events), N, Autoreset::Disabled, SEED);
    let mut alone = started(&with(&events), 1, Autoreset::Disabled, seed);
    let mut single = Environment::new(&with(&events), seed).unwrap();
    let mut observation = vec![0.0; single.observation_len()];
    single.reset(&mut observation);
    for _ in 2..episode {
        again.reset(&[true; N]);
        alone.reset(&[true]);
        single.reset(&mut observation);
    }
    again.reset(&[true; N]);
    single.reset(&mut observation);
    let robot = again.batch.params(i).unwrap().clone();
    let starts = [Some(State::at_equilibrium(&robot, 0.0))];
    let request = ResetRequest { starts: Some(&starts), ..ResetRequest::default() };
    alone.batch.reset_with(&request, &mut alone.observations).unwrap();
    assert_eq!(again.batch.repeated_draws(i).unwrap(), 1);
    assert_eq!(alone.batch.repeated_draws(0).unwrap(), 1);
    assert_eq!(single.repeated_draws(), 1);
    assert_eq!(alone.batch.params(0).unwrap(), &robot);
    assert_eq!(single.robot().params(), &robot);
    // A new seed restarts the count, from its first episode on.
    again.batch.seed(&[Some(5); N]).unwrap();
    assert_eq!(again.batch.repeated_draws(i).unwrap(), 1);
    again.reset(&[true; N]);
    assert_eq!(again.batch.repeated_draws(i).unwrap(), 0);
}

/// The same within an episode, where earlier samples persist.
#[test]
fn only_the_invalid_sample_within_an_episode_is_repeated() {
    const ROBOTS: usize = 2048;
    // A third of the body is 6.23 times a wheel: more than any three of the factors.
    let mass = |id: u64| Event { id: Some(id), ..scaled("wheel_mass", [1.0, 1.63]) };
    let steps = 20;
    let events = [mass(1), mass(2), mass(3), every([0.01, 0.01], mass(4))];
    let config = BalanceConfig { max_episode_steps: 10 * steps, ..with(&events) };
    let batch = Batch::new(&config, ROBOTS, Autoreset::Disabled, Some(1), SEED);
    let mut run = crate::run::Run::new(batch.unwrap());
    let first: Vec<_> = (0..ROBOTS).map(|i| run.batch.draws(i).unwrap()[..3].to_vec()).collect();
    let (mut sum, mut changes) = (0, 0);
    for k in 0..steps {
        let before: Vec<_> = (0..ROBOTS).map(|i| run.batch.draws(i).unwrap()[3]).collect();
        run.step(&actions(0, ROBOTS, k, 0.0)).unwrap();
        for i in 0..ROBOTS {
            let draws = run.batch.draws(i).unwrap();
            assert_eq!(draws[..3], first[i], "robot {i}, step {k}");
            assert!(k == 0 || draws[3].is_finite());
            changes += usize::from(draws[3] != before[i]);
            run.batch.params(i).unwrap().validate().unwrap();
        }
        sum = (0..ROBOTS).map(|i| run.batch.repeated_draws(i).unwrap()).sum();
    }
    assert!(sum > 3 && changes > (steps - 2) * ROBOTS, "{sum} repeated, {changes} changes");
}
