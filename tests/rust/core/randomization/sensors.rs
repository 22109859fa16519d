//! Events on the options of the sensors.

use super::{SEED, alone, config, draw, every, reset_to, scaled, started, starts};
use crate::run::actions;
use ballbot_core::ModelKind;
use ballbot_core::actuator::Ideal;
use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, Event, Observation, Operation};
use ballbot_core::fields::Fields;
use ballbot_core::sensor::{Exact, SensorOptions};

const N: usize = 11;

fn added(term: &str, range: [f64; 2]) -> Event {
    Event { operation: Operation::Add, ..Event::new(term, range) }
}

/// Every effect at once, in control steps of 10 ms.
fn everything() -> SensorOptions {
    SensorOptions {
        gyro_noise: 2e-3,
        gyro_bias: 0.02,
        gyro_bias_walk: 0.01,
        gyro_range: 1.5,
        accelerometer_noise: 0.02,
        accelerometer_bias: 0.05,
        accelerometer_bias_walk: 0.03,
        accelerometer_range: 10.5,
        imu_position: [0.05, -0.02, 0.2],
        imu_misalignment: 0.02,
        imu_rate: 50.0,
        encoder_ticks: 512.0,
        encoder_rate: 34.0,
        latency: 0.02,
    }
}

/// An event on each option.
fn each_option() -> Vec<Event> {
    let mut events: Vec<_> = SensorOptions::FIELDS
        .iter()
        .filter(|field| field.name != "latency" && field.name != "imu_position")
        .map(|field| scaled(&format!("sensors.{}", field.name), [0.5, 1.5]))
        .collect();
    events.push(added("sensors.imu_position", [-0.1, 0.1]));
    events.push(added("sensors.latency", [0.0, 0.04]));
    events
}

fn sensing(sensors: &SensorOptions, model: ModelKind, steps: usize, events: &[Event]) -> BalanceConfig {
    BalanceConfig { sensors: Some(sensors.clone()), ..config(model, steps, events) }
}

fn readings(batch: &Batch, i: usize) -> Vec<f64> {
    let read = batch.readings(i).unwrap();
    let vectors = [read.gyro, read.specific_force].into_iter().flat_map(|v| [v.x, v.y, v.z]);
    vectors.chain(read.wheel_angles).chain(read.wheel_rates).collect()
}

/// Compares the readings of a batch with readings of other batches that have the sampled options.
fn assert_equal_to_sensors_made(config: &BalanceConfig) {
    let model = config.model;
    let mut sampled = started(config, N, Autoreset::Disabled, SEED);
    let starts = starts(config, N);
    for episode in 0..3 {
        reset_to(&mut sampled, &starts);
        let mut made: Vec<_> = (0..N)
            .map(|i| {
                let sensors = sampled.batch.sensors(i).unwrap().clone();
                assert_ne!(Some(&sensors), config.sensors.as_ref(), "robot {i}");
                let made = BalanceConfig { sensors: Some(sensors), events: Vec::new(), ..config.clone() };
                alone(&made, i, episode, &starts[i])
            })
            .collect();
        for k in 0..25 {
            for (i, alone) in made.iter().enumerate() {
                let (found, expected) = (readings(&sampled.batch, i), readings(&alone.batch, 0));
                assert_eq!(found, expected, "{model}: robot {i}, episode {episode}, step {k}");
            }
            sampled.step(&actions(0, N, k, 0.4)).unwrap();
            made.iter_mut().enumerate().for_each(|(i, alone)| alone.step(&actions(i, 1, k, 0.4)).unwrap());
        }
    }
}

#[test]
fn sampled_sensors_equal_sensors_made_with_the_sampled_options() {
    for model in [ModelKind::Contact, ModelKind::Spatial] {
        assert_equal_to_sensors_made(&sensing(&everything(), model, 1000, &each_option()));
    }
}

/// Effects that some robots of eight have and others do not.
#[test]
fn sampled_sensors_without_an_effect_equal_sensors_made_without_it() {
    for field in SensorOptions::FIELDS {
        let term = format!("sensors.{}", field.name);
        let without = Event::new(&term, [0.0; 2]);
        assert_equal_to_sensors_made(&sensing(&everything(), ModelKind::Contact, 1000, &[without]));
        // The other way round.
        let index = SensorOptions::FIELDS.iter().position(|other| other.name == field.name).unwrap();
        let range = everything().values(index).iter().map(|&value| [value; 2]).collect();
        let with = Event { range, ..Event::new(&term, [0.0; 2]) };
        assert_equal_to_sensors_made(&sensing(&SensorOptions::default(), ModelKind::Contact, 1000, &[with]));
    }
}

#[test]
fn options_at_their_nominal_value_change_no_bit() {
    for nominal in [SensorOptions::default(), everything()] {
        let mut events = Vec::new();
        for (index, field) in SensorOptions::FIELDS.iter().enumerate() {
            let term = format!("sensors.{}", field.name);
            let range = nominal.values(index).iter().map(|&value| [value; 2]).collect();
            events.push(Event { range, ..Event::new(&term, [0.0; 2]) });
            events.push(Event { id: Some(1 + index as u64), ..added(&term, [0.0; 2]) });
        }
        // Whether a task observes through sensors, which are then sampled in each step.
        for estimated in [false, true] {
            let mut sensors = nominal.clone();
            let mut events = events.clone();
            if estimated {
                (sensors.imu_rate, sensors.encoder_rate) = (0.0, 0.0);
                events.retain(|event| !event.term.ends_with("_rate"));
            }
            let observation = if estimated { Observation::Sensors } else { Observation::GroundTruth };
            let config =
                |events: &[Event]| BalanceConfig { observation, ..sensing(&sensors, ModelKind::Contact, 12, events) };
            let mut with = started(&config(&events), 9, Autoreset::SameStep, SEED);
            let mut without = started(&config(&[]), 9, Autoreset::SameStep, SEED);
            for k in 0..30 {
                with.step(&actions(0, 9, k, 0.5)).unwrap();
                without.step(&actions(0, 9, k, 0.5)).unwrap();
                assert!(with.all_bits() == without.all_bits(), "step {k}, estimated: {estimated}");
                for i in 0..9 {
                    assert_eq!(readings(&with.batch, i), readings(&without.batch, i), "step {k}");
                }
            }
        }
    }
}

/// Errors of sensors do not affect the physics.
#[test]
fn samples_of_sensors_do_not_move_the_robot() {
    let mut with =
        started(&sensing(&everything(), ModelKind::Contact, 20, &each_option()), N, Autoreset::SameStep, SEED);
    let mut without = started(&config(ModelKind::Contact, 20, &[]), N, Autoreset::SameStep, SEED);
    for k in 0..50 {
        with.step(&actions(0, N, k, 0.4)).unwrap();
        without.step(&actions(0, N, k, 0.4)).unwrap();
        assert!(with.all_bits() == without.all_bits(), "step {k}");
    }
}

#[test]
fn an_estimator_uses_the_options_without_events() {
    // A robot whose gyroscope is worse than its estimator expects.
    let sensors = SensorOptions { gyro_noise: 1e-4, ..SensorOptions::default() };
    let worse = Event::new("sensors.gyro_noise", [0.02, 0.02]);
    let with = |events: &[Event], sensors: &SensorOptions| {
        let config =
            BalanceConfig { observation: Observation::Sensors, ..sensing(sensors, ModelKind::Contact, 1000, events) };
        let mut run = started(&config, 1, Autoreset::Disabled, SEED);
        (0..20).for_each(|k| run.step(&actions(0, 1, k, 0.1)).unwrap());
        (readings(&run.batch, 0), run.batch.estimate(0).unwrap())
    };
    let (read, estimate) = with(&[worse], &sensors);
    let (same, expecting) = with(&[], &SensorOptions { gyro_noise: 0.02, ..sensors });
    assert_eq!(read, same);
    assert_ne!(estimate, expecting);
}

#[test]
fn latencies_are_whole_control_steps_with_equal_probability() {
    let events = [Event::new("sensors.latency", [0.005, 0.042])];
    let sensors = SensorOptions::default();
    let mut run = started(&sensing(&sensors, ModelKind::Contact, 100, &events), 64, Autoreset::Disabled, SEED);
    let mut counts = [0_usize; 4];
    for _ in 0..20 {
        for i in 0..64 {
            let latency = draw(&run.batch, i, "sensors.latency");
            assert_eq!(latency, run.batch.sensors(i).unwrap().latency);
            counts[(latency / 0.01).round() as usize - 1] += 1;
        }
        run.reset(&[true; 64]);
    }
    // 320 expected in each, with a standard deviation of 15.
    assert!(counts.iter().all(|count| (260..=380).contains(count)), "{counts:?}");
}

#[test]
fn snapshots_continue() {
    let config = BalanceConfig {
        observation: Observation::Sensors,
        ..sensing(
            &SensorOptions { imu_rate: 0.0, encoder_rate: 0.0, ..everything() },
            ModelKind::Contact,
            15,
            &each_option().into_iter().filter(|event| !event.term.ends_with("_rate")).collect::<Vec<_>>(),
        )
    };
    let mut run = started(&config, N, Autoreset::SameStep, SEED);
    (0..10).for_each(|k| run.step(&actions(0, N, k, 0.4)).unwrap());
    let snapshots = run.snapshots();
    let mut other = started(&config, N, Autoreset::SameStep, SEED + 100);
    snapshots.iter().enumerate().for_each(|(i, bytes)| other.batch.load(i, bytes).unwrap());
    for k in 10..40 {
        run.step(&actions(0, N, k, 0.4)).unwrap();
        other.step(&actions(0, N, k, 0.4)).unwrap();
        assert!(run.all_bits() == other.all_bits(), "step {k}");
        for i in 0..N {
            assert_eq!(run.batch.sensors(i).unwrap(), other.batch.sensors(i).unwrap());
            assert_eq!(readings(&run.batch, i), readings(&other.batch, i));
        }
    }
}

#[test]
fn events_that_sensors_do_not_allow_are_rejected() {
    let rejection = |config: &BalanceConfig| {
        Batch::new(config, 2, Autoreset::SameStep, Some(1), SEED).map(|_| ()).expect_err("a rejection").to_string()
    };
    let one = |event: &Event| sensing(&everything(), ModelKind::Contact, 10, std::slice::from_ref(event));
    for (event, words) in [
        (Event::new("sensors.color", [0.0, 1.0]), &["unknown term", "sensors.gyro_noise", "push"][..]),
        (every([0.1, 0.2], Event::new("sensors.gyro_noise", [0.0, 0.1])), &["within an episode", "'reset'"]),
        (scaled("sensors.latency", [0.5, 1.5]), &["op = 'scale'", "'abs' or 'add'", "0.01 s"]),
        (Event::new("sensors.gyro_noise", [-0.1, 0.1]), &["sensors.gyro_noise = -0.1"]),
        (Event::new("sensors.imu_misalignment", [0.0, 0.2]), &["sensors.imu_misalignment = 0.2"]),
        // Both ends are possible, values in between are not.
        (Event::new("sensors.encoder_ticks", [0.0, 1.5]), &["sensors.encoder_ticks = 0.", "at least 1"]),
        (Event { range: vec![[0.0, 0.1]; 2], ..Event::new("sensors.imu_position", [0.0; 2]) }, &["2 pairs"]),
    ] {
        let (error, label) = (rejection(&one(&event)), format!("events[0] ({})", event.term));
        assert!(error.contains(&label) && words.iter().all(|word| error.contains(word)), "{words:?}: {error}");
    }
    let late = rejection(&one(&Event::new("sensors.latency", [0.0, 1.2])));
    assert!(late.contains("sensors.latency / control_dt = 120"), "{late}");
    let noisy = Event::new("sensors.gyro_noise", [0.0, 0.1]);
    let error = rejection(&config(ModelKind::Contact, 10, std::slice::from_ref(&noisy)));
    assert!(error.contains("the robots have none"), "{error}");
    let slow = Event::new("sensors.imu_rate", [20.0, 200.0]);
    let estimated = BalanceConfig {
        observation: Observation::Sensors,
        sensors: Some(SensorOptions::default()),
        ..config(ModelKind::Contact, 10, &[slow])
    };
    let error = rejection(&estimated);
    assert!(error.contains("events[0] (sensors.imu_rate)") && error.contains("sensors.imu_rate = 20"), "{error}");
    // Custom sensors are the same on all robots.
    let (config, ideal) = (one(&noisy), Ideal { max_torque: 0.3 });
    let batch = Batch::with_stages(&config, &ideal, &Exact, 2, Autoreset::SameStep, Some(1), SEED);
    assert!(batch.map(|_| ()).unwrap_err().to_string().contains("of the caller's own"));
}
