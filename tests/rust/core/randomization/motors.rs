//! Events on the options of the actuators.

use super::{SEED, alone, at, config, draw, draws, every, reset_to, scaled, started, starts};
use crate::run::actions;
use ballbot_core::ModelKind;
use ballbot_core::actuator::{Ideal, MotorOptions};
use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, Event, Operation};
use ballbot_core::fields::Fields;
use ballbot_core::sensor::Exact;

const N: usize = 11;

fn added(term: &str, range: [f64; 2]) -> Event {
    Event { operation: Operation::Add, ..Event::new(term, range) }
}

/// Every effect at once, in model steps of 2 ms.
fn everything() -> MotorOptions {
    MotorOptions {
        delay: 0.012,
        strength: [0.9, 1.0, 1.1],
        lag: 0.007,
        stall_torque: 0.6,
        no_load_speed: 40.0,
        speed_limit: 20.0,
        peak_torque: 0.25,
        delay_jitter: 0.006,
    }
}

/// An event on each option.
fn each_option() -> Vec<Event> {
    vec![
        added("actuators.delay", [0.0, 0.024]),
        scaled("actuators.strength", [0.5, 1.5]),
        Event::new("actuators.lag", [0.0, 0.02]),
        scaled("actuators.stall_torque", [0.5, 1.5]),
        Event::new("actuators.no_load_speed", [20.0, 40.0]),
        Event::new("actuators.speed_limit", [1.0, 20.0]),
        Event::new("actuators.peak_torque", [0.05, 0.3]),
        Event::new("actuators.delay_jitter", [0.0, 0.008]),
    ]
}

/// Compares the robots of a batch with robots of other batches that have the sampled options.
fn assert_equal_to_robots_made(config: &BalanceConfig) {
    let model = config.model;
    let mut sampled = started(config, N, Autoreset::Disabled, SEED);
    let starts = starts(config, N);
    for episode in 0..3 {
        reset_to(&mut sampled, &starts);
        let mut made: Vec<_> = (0..N)
            .map(|i| {
                let actuators = sampled.batch.actuators(i).unwrap().clone();
                assert_ne!(actuators, config.actuators, "robot {i}");
                let made = BalanceConfig { actuators, events: Vec::new(), ..config.clone() };
                alone(&made, i, episode, &starts[i])
            })
            .collect();
        for k in 0..25 {
            sampled.step(&actions(0, N, k, 0.4)).unwrap();
            for (i, alone) in made.iter_mut().enumerate() {
                alone.step(&actions(i, 1, k, 0.4)).unwrap();
                assert!(sampled.bits(i) == alone.bits(0), "{model}: robot {i}, episode {episode}, step {k}");
            }
        }
    }
}

#[test]
fn sampled_motors_equal_motors_made_with_the_sampled_options() {
    for model in ModelKind::ALL {
        for actuators in [MotorOptions::default(), everything()] {
            let mut events = each_option();
            // Half a curve is not a curve: without a nominal curve no event gives one.
            let curve = |event: &Event| event.term.ends_with("stall_torque") || event.term.ends_with("no_load_speed");
            events.retain(|event| actuators.stall_torque > 0.0 || !curve(event));
            assert_equal_to_robots_made(&BalanceConfig { actuators, ..config(model, 1000, &events) });
        }
    }
}

/// Effects that some robots of eight have and others do not.
#[test]
fn sampled_motors_without_an_effect_equal_motors_made_without_it() {
    for option in ["delay", "delay_jitter", "lag", "speed_limit"] {
        let without = Event::new(&format!("actuators.{option}"), [0.0; 2]);
        let config = BalanceConfig { actuators: everything(), ..config(ModelKind::Contact, 1000, &[without]) };
        assert_equal_to_robots_made(&config);
    }
}

#[test]
fn options_at_their_nominal_value_change_no_bit() {
    for nominal in [MotorOptions::default(), everything()] {
        let mut events = Vec::new();
        for (index, field) in MotorOptions::FIELDS.iter().enumerate() {
            let term = format!("actuators.{}", field.name);
            let range = nominal.values(index).iter().map(|&value| [value; 2]).collect();
            events.push(Event { range, ..Event::new(&term, [0.0; 2]) });
            events.push(Event { id: Some(1 + index as u64), ..added(&term, [0.0; 2]) });
            if !field.name.starts_with("delay") {
                events.push(Event { id: Some(100 + index as u64), ..scaled(&term, [1.0; 2]) });
            }
        }
        for model in ModelKind::ALL {
            let config = |events: &[Event]| BalanceConfig { actuators: nominal.clone(), ..config(model, 12, events) };
            let mut with = started(&config(&events), 9, Autoreset::SameStep, SEED);
            let mut without = started(&config(&[]), 9, Autoreset::SameStep, SEED);
            for k in 0..30 {
                with.step(&actions(0, 9, k, 0.5)).unwrap();
                without.step(&actions(0, 9, k, 0.5)).unwrap();
                assert!(with.all_bits() == without.all_bits(), "{model}, step {k}");
            }
        }
    }
}

/// Motors weaker than commanded give what they can.
#[test]
fn sampled_torque_limits_match_the_motors() {
    let events = [Event::new("max_wheel_torque", [0.05, 0.4])];
    for model in ModelKind::ALL {
        let config = config(model, 1000, &events);
        let mut sampled = started(&config, N, Autoreset::Disabled, SEED);
        let mut weak = 0;
        for i in 0..N {
            let limit = sampled.batch.params(i).unwrap().max_wheel_torque;
            assert_eq!(limit, draw(&sampled.batch, i, "max_wheel_torque"));
            weak += usize::from(limit < 0.3);
        }
        assert!(weak > 2, "{weak} of {N}");
        let mut alone: Vec<_> = (0..N)
            .map(|i| {
                let peak_torque = sampled.batch.params(i).unwrap().max_wheel_torque;
                let actuators = MotorOptions { peak_torque, ..MotorOptions::default() };
                let config = BalanceConfig { actuators, events: Vec::new(), ..config.clone() };
                started(&config, 1, Autoreset::Disabled, SEED + i as u64)
            })
            .collect();
        for k in 0..20 {
            sampled.step(&actions(0, N, k, 1.0)).unwrap();
            for (i, alone) in alone.iter_mut().enumerate() {
                alone.step(&actions(i, 1, k, 1.0)).unwrap();
                assert!(sampled.bits(i) == alone.bits(0), "{model}: robot {i}, step {k}");
            }
        }
    }
}

/// From an event within the episode on, motors without strength act as under an action of zero.
#[test]
fn motors_change_within_an_episode() {
    const STEP: usize = 5;
    for model in ModelKind::ALL {
        let event = at(STEP as f64 * 0.01, Event::new("actuators.strength", [0.0; 2]));
        let mut sampled = started(&config(model, 100, &[event]), N, Autoreset::Disabled, SEED);
        let mut plain = started(&config(model, 100, &[]), N, Autoreset::Disabled, SEED);
        for k in 0..20 {
            sampled.step(&actions(0, N, k, 0.2)).unwrap();
            plain.step(&actions(0, N, k, if k < STEP { 0.2 } else { 0.0 })).unwrap();
            for i in 0..N {
                let strength = if k < STEP { 1.0 } else { 0.0 };
                assert_eq!(sampled.batch.actuators(i).unwrap().strength, [strength; 3]);
                assert_eq!(sampled.batch.state(i).unwrap(), plain.batch.state(i).unwrap(), "{model}, step {k}");
            }
        }
    }
}

#[test]
fn delays_are_whole_model_steps_with_equal_probability() {
    // From 2 to 6 model steps of 2 ms, the ends of the range between two.
    let events = [Event::new("actuators.delay", [0.003, 0.0125])];
    let mut run = started(&config(ModelKind::Contact, 100, &events), 64, Autoreset::Disabled, SEED);
    let mut counts = [0_usize; 5];
    for _ in 0..20 {
        for i in 0..64 {
            let delay = draw(&run.batch, i, "actuators.delay");
            assert_eq!(delay, run.batch.actuators(i).unwrap().delay);
            let steps = (delay / 0.002).round();
            assert_eq!(delay, steps * 0.002);
            counts[steps as usize - 2] += 1;
        }
        run.reset(&[true; 64]);
    }
    // 256 expected in each, with a standard deviation of 14.
    assert!(counts.iter().all(|count| (200..=312).contains(count)), "{counts:?}");
}

#[test]
fn motors_of_each_robot_are_shown() {
    let strength = Event { shared: true, ..scaled("actuators.strength", [0.8, 1.2]) };
    let events = [strength, every([0.02, 0.03], Event::new("actuators.lag", [0.01, 0.02]))];
    let mut run = started(&config(ModelKind::Contact, 100, &events), N, Autoreset::Disabled, SEED);
    for k in 0..9 {
        for i in 0..N {
            let options = run.batch.actuators(i).unwrap();
            let [a, b, c] = draws(&run.batch, i, "actuators.strength")[..] else { panic!("three numbers") };
            assert!(a == b && b == c && options.strength == [a; 3]);
            let lag = draw(&run.batch, i, "actuators.lag");
            assert_eq!(options.lag, if lag.is_nan() { 0.0 } else { lag });
            assert!(k < 4 || (0.01..=0.02).contains(&lag));
        }
        run.step(&actions(0, N, k, 0.1)).unwrap();
    }
}

#[test]
fn events_that_motors_do_not_allow_are_rejected() {
    let rejection = |event: &Event| {
        let config = config(ModelKind::Contact, 10, std::slice::from_ref(event));
        let error = Batch::new(&config, 2, Autoreset::SameStep, Some(1), SEED).map(|_| ()).expect_err(&event.term);
        error.to_string()
    };
    for (event, words) in [
        (Event::new("actuators.color", [0.0, 1.0]), &["unknown term", "actuators.delay", "body_mass", "push"][..]),
        (Event::new("delay", [0.0, 0.01]), &["unknown term 'delay'"]),
        (scaled("actuators.delay", [0.5, 1.5]), &["op = 'scale'", "'abs' or 'add'", "0.002 s"]),
        (Event::new("actuators.delay", [0.0021, 0.0039]), &["[0.0021, 0.0039]", "steps of 0.002 s"]),
        (Event::new("actuators.delay", [-0.01, 0.01]), &["actuators.delay = -0.01"]),
        (Event::new("actuators.delay", [0.0, 1.01]), &["actuators.delay = 1.01"]),
        (Event::new("actuators.strength", [0.0, 11.0]), &["actuators.strength[", "= 11"]),
        (Event::new("actuators.lag", [-0.1, 0.0]), &["actuators.lag = -0.1"]),
        (Event::new("actuators.stall_torque", [0.1, 0.2]), &["no_load_speed = 0", "needs both"]),
        (Event::new("actuators.speed_limit", [1e-9, 1.0]), &["at least 0.001"]),
        (Event::new("actuators.peak_torque", [0.1, 5.5]), &["peak_torque = 5.5", "max_wheel_torque = 5 "]),
        (Event { range: vec![[1.0, 1.0]; 2], ..scaled("actuators.strength", [1.0; 2]) }, &["2 pairs", "one, or 3"]),
    ] {
        let (error, label) = (rejection(&event), format!("events[0] ({})", event.term));
        assert!(error.contains(&label) && words.iter().all(|word| error.contains(word)), "{words:?}: {error}");
    }
    // Custom motors are the same on all robots.
    for term in ["actuators.strength", "max_wheel_torque"] {
        let config = config(ModelKind::Contact, 10, &[Event::new(term, [0.2, 1.1])]);
        let ideal = Ideal { max_torque: 0.3 };
        let batch = Batch::with_stages(&config, &ideal, &Exact, 2, Autoreset::SameStep, Some(1), SEED);
        assert!(batch.map(|_| ()).unwrap_err().to_string().contains("of the caller's own"));
    }
}
