//! The robots that events produce.

use super::{SEED, config, draw, draws, optional, scaled, several, started};
use crate::run::{Run, actions};
use ballbot_core::actuator::MotorOptions;
use ballbot_core::batch::{
    Autoreset, BalanceConfig, Batch, Environment, Event, Operation, ResetRequest, When, event_sets, load_events,
};
use ballbot_core::models::Scale;
use ballbot_core::sensor::SensorOptions;
use ballbot_core::{ModelKind, Params, State};

/// Events on parameters only at resets, so that a robot without events can get the same parameters.
fn at_resets() -> Vec<Event> {
    let once = |event: &Event| matches!(event.when, When::Reset | When::Startup);
    several().into_iter().filter(|event| once(event) && !event.term.starts_with("actuators.")).collect()
}

#[test]
fn randomized_robots_equal_robots_made_with_the_sampled_parameters() {
    for model in ModelKind::ALL {
        assert_equal_to_robots_made(&config(model, 1000, &at_resets()));
    }
}

/// Robots without symmetry whose motors are not ideal: their tilt is from an equilibrium that is sampled, too.
#[test]
fn randomized_general_robots_equal_robots_made_with_the_sampled_parameters() {
    let events = [
        Event { range: vec![[-0.01, 0.01], [0.0, 0.02]], ..Event::new("body_com_offset", [0.0; 2]) },
        Event::new("body_products_of_inertia", [-1e-3, 1e-3]),
        Event::new("floor_tilt", [-0.1, 0.1]),
        Event::new("wheel_zenith_offsets", [-0.05, 0.05]),
        Event { operation: Operation::Add, ..Event::new("wheel_azimuths", [-0.05, 0.05]) },
        Event { when: When::Startup, ..scaled("wheel_inertia", [0.9, 1.1]) },
    ];
    let actuators = MotorOptions { delay: 0.004, lag: 0.01, strength: [0.9, 1.0, 1.1], ..MotorOptions::default() };
    for model in [ModelKind::Spatial, ModelKind::Contact, ModelKind::Rigid] {
        let config = BalanceConfig { actuators: actuators.clone(), ..config(model, 1000, &events) };
        assert_equal_to_robots_made(&config);
    }
}

/// Compares the robots of a batch with events at resets with robots of other batches without events.
fn assert_equal_to_robots_made(config: &BalanceConfig) {
    const N: usize = 11;
    let model = config.model;
    let mut randomized = started(config, N, Autoreset::Disabled, SEED);
    let nominal = BalanceConfig { events: Vec::new(), ..config.clone() };
    let mut alone: Vec<Run> = (0..N).map(|i| started(&nominal, 1, Autoreset::Disabled, SEED + i as u64)).collect();
    for episode in 0..3 {
        if episode > 0 {
            randomized.reset(&[true; N]);
        }
        for (i, alone) in alone.iter_mut().enumerate() {
            let params = randomized.batch.params(i).unwrap();
            assert_ne!(params, randomized.batch.nominal_params(i).unwrap());
            if episode == 0 {
                // Its first start is also sampled for the sampled robot.
                let config = BalanceConfig { params: params.clone(), ..nominal.clone() };
                *alone = started(&config, 1, Autoreset::Disabled, SEED + i as u64);
            } else {
                alone.batch.set_params(0, params).unwrap();
                alone.reset(&[true]);
            }
        }
        for k in 0..25 {
            randomized.step(&actions(0, N, k, 0.4)).unwrap();
            for (i, alone) in alone.iter_mut().enumerate() {
                alone.step(&actions(i, 1, k, 0.4)).unwrap();
                assert!(randomized.bits(i) == alone.bits(0), "{model}: robot {i}, episode {episode}, step {k}");
            }
        }
    }
}

#[test]
fn ranges_at_the_nominal_value_change_no_bit() {
    let nominal = Params::paper();
    let mut events: Vec<Event> = nominal
        .fields()
        .map(|(name, values)| Event { range: values.iter().map(|&v| [v, v]).collect(), ..Event::new(name, [0.0; 2]) })
        .collect();
    for (place, (name, _)) in nominal.fields().enumerate() {
        let id = Some(1 + place as u64);
        events.push(Event { id, operation: Operation::Add, ..Event::new(name, [0.0; 2]) });
        events.push(Event { id: Some(1000 + place as u64), ..scaled(name, [1.0; 2]) });
    }
    let events: Vec<_> = events.into_iter().map(optional).collect();
    // Checks of 64 events at once take long.
    for (model, events) in ModelKind::ALL.into_iter().zip(events.chunks(events.len().div_ceil(4))) {
        for mode in [Autoreset::SameStep, Autoreset::NextStep] {
            let mut with = started(&config(model, 12, events), 9, mode, SEED);
            let mut without = started(&config(model, 12, &[]), 9, mode, SEED);
            for k in 0..40 {
                with.step(&actions(0, 9, k, 0.5)).unwrap();
                without.step(&actions(0, 9, k, 0.5)).unwrap();
                assert!(with.all_bits() == without.all_bits(), "{model}, {mode:?}, step {k}");
            }
        }
    }
}

#[test]
fn a_single_environment_equals_an_environment_of_a_batch() {
    for model in [ModelKind::Contact, ModelKind::Spatial] {
        let config = config(model, 20, &several());
        let mut batch = started(&config, 3, Autoreset::Disabled, SEED);
        let mut single = Environment::new(&config, SEED + 2).unwrap();
        let mut observation = vec![0.0; single.observation_len()];
        for _ in 0..2 {
            single.reset(&mut observation);
            assert_eq!(batch.observation(2), observation, "{model}");
            assert_eq!(batch.batch.params(2).unwrap(), single.robot().params());
            assert_eq!(batch.batch.nominal_params(2).unwrap(), single.nominal_params());
            for k in 0..20 {
                batch.step(&actions(0, 3, k, 0.4)).unwrap();
                single.step(&actions(2, 1, k, 0.4), &mut observation);
                assert_eq!(batch.observation(2), observation, "{model}, step {k}");
                let bits = |draws: &[f64]| draws.iter().map(|d| d.to_bits()).collect::<Vec<_>>();
                assert_eq!(bits(batch.batch.draws(2).unwrap()), bits(single.draws()));
            }
            batch.reset(&[true; 3]);
        }
    }
}

#[test]
fn a_thousand_resets_do_not_drift() {
    let nominal = Params::paper();
    let events =
        [scaled("body_mass", [0.8, 1.2]), Event { operation: Operation::Add, ..Event::new("gravity", [-1.0, 1.0]) }];
    let mut run = started(&config(ModelKind::Contact, 1000, &events), 1, Autoreset::Disabled, SEED);
    let mut sums = [[0.0; 2]; 2];
    for k in 0..1000 {
        let params = run.batch.params(0).unwrap();
        let (factor, term) = (draw(&run.batch, 0, "body_mass"), draw(&run.batch, 0, "gravity"));
        assert_eq!(params.body_mass, nominal.body_mass * factor);
        assert_eq!(params.gravity, nominal.gravity + term);
        assert!((0.8..=1.2).contains(&factor) && (-1.0..=1.0).contains(&term));
        sums[k / 500][0] += (factor - 1.0) / 0.2;
        sums[k / 500][1] += term;
        run.reset(&[true]);
    }
    // Means of 500 uniform numbers in [-1, 1], whose standard deviation is 0.026.
    assert!(sums.iter().flatten().all(|sum| (sum / 500.0).abs() < 0.09), "{sums:?}");
}

#[test]
fn inertia_follows_the_mass_and_static_friction_the_dynamic_one() {
    let nominal = Params::paper();
    let events = [
        scaled("body_mass", [0.7, 1.3]),
        Event { operation: Operation::Add, id: Some(1), ..Event::new("body_mass", [0.0, 0.5]) },
        scaled("ball_mass", [0.9, 1.1]),
        Event::new("wheel_dynamic_friction", [0.3, 1.2]),
    ];
    let run = started(&config(ModelKind::Contact, 10, &events), 50, Autoreset::Disabled, SEED);
    for i in 0..50 {
        let p = run.batch.params(i).unwrap();
        let mass = nominal.body_mass * draw(&run.batch, i, "body_mass") + draw(&run.batch, i, "body_mass:1");
        assert!((p.body_mass - mass).abs() < 1e-12);
        let close = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-14, "{a} and {b}");
        for (moment, was) in p.body_inertia.iter().zip(nominal.body_inertia) {
            close(moment / p.body_mass, was / nominal.body_mass);
        }
        close(p.ball_inertia / p.ball_mass, nominal.ball_inertia / nominal.ball_mass);
        close(p.wheel_static_friction / p.wheel_dynamic_friction, 1.1);
        assert_eq!(p.floor_static_friction, nominal.floor_static_friction);
    }
}

#[test]
fn a_given_inertia_has_precedence() {
    let moments = [0.05, 0.06, 0.02];
    let given = Event { range: moments.map(|m| [m, m]).to_vec(), ..Event::new("body_inertia", [0.0; 2]) };
    let events = [scaled("body_mass", [0.7, 1.3]), given];
    let run = started(&config(ModelKind::Contact, 10, &events), 3, Autoreset::Disabled, SEED);
    assert!((0..3).all(|i| run.batch.params(i).unwrap().body_inertia == moments));
}

#[test]
fn events_sample_around_the_last_set_params() {
    let events = [scaled("body_mass", [0.8, 1.2])];
    let mut run = started(&config(ModelKind::Contact, 10, &events), 2, Autoreset::Disabled, SEED);
    let heavy = Params { body_mass: 4.0, ..Params::paper() };
    run.batch.set_params(1, &heavy).unwrap();
    for _ in 0..3 {
        assert_eq!(run.batch.nominal_params(1).unwrap(), &heavy);
        assert_eq!(run.batch.params(1).unwrap().body_mass, 4.0 * draw(&run.batch, 1, "body_mass"));
        assert_eq!(run.batch.params(0).unwrap().body_mass, 2.228 * draw(&run.batch, 0, "body_mass"));
        run.reset(&[true; 2]);
    }
    // A nominal robot that the events make invalid.
    let before = run.all_bits();
    let light = Params { body_mass: 0.44, wheel_mass: 0.1192, ..Params::paper() };
    let error = run.batch.set_params(1, &light).unwrap_err().to_string();
    assert!(error.contains("events[0] (body_mass)") && error.contains("wheel_mass"), "{error}");
    assert_eq!(run.batch.nominal_params(1).unwrap(), &heavy);
    assert!(run.all_bits() == before);
}

#[test]
fn a_given_start_is_checked_against_the_robot_of_its_episode() {
    // The ball of the next episode is larger: a ball at the nominal height would be in the floor.
    let events = [scaled("ball_radius", [1.01, 1.02])];
    for model in ModelKind::ALL {
        let mut run = started(&config(model, 10, &events), 1, Autoreset::Disabled, SEED);
        let before = run.all_bits();
        let start = [Some(State::upright(&Params::paper()))];
        let request = ResetRequest { starts: Some(&start), seeds: Some(&[Some(5)]), mask: None };
        let mut observations = run.observations.clone();
        let error = run.batch.reset_with(&request, &mut observations).unwrap_err().to_string();
        assert!(error.contains("ball_position[2]"), "{model}: {error}");
        assert!(run.all_bits() == before, "{model}");
        let ball = Params { ball_radius: 0.115, ..Params::paper() };
        if model == ModelKind::Contact {
            // In the air above any ball.
            let start = [Some(State::upright(&ball))];
            run.batch.reset_with(&ResetRequest { starts: Some(&start), ..request }, &mut observations).unwrap();
            assert_eq!(run.batch.params(0).unwrap().ball_radius, 0.112 * draw(&run.batch, 0, "ball_radius"));
        }
    }
}

#[test]
fn sets_fit_every_preset_and_model() {
    for set in event_sets() {
        let events = load_events(set).unwrap();
        for preset in Params::preset_names() {
            for model in ModelKind::ALL {
                let params = Params::preset(preset).unwrap();
                let config = BalanceConfig { params, model, events: events.clone(), ..BalanceConfig::default() };
                let batch = Batch::new(&config, 2, Autoreset::SameStep, Some(1), SEED);
                if set == "wide" && model == ModelKind::Planar {
                    // It takes only symmetric robots.
                    assert!(batch.err().unwrap().to_string().contains("body_com_offset"));
                    continue;
                }
                let mut run = Run::new(batch.unwrap_or_else(|e| panic!("{set}, {preset}, {model}: {e}")));
                for _ in 0..20 {
                    run.reset(&[true; 2]);
                    run.batch.params(0).unwrap().validate().unwrap();
                    run.step(&actions(0, 2, 0, 0.3)).unwrap();
                }
                assert!(draws(&run.batch, 0, "body_mass")[0].is_finite());
            }
        }
    }
}

#[test]
fn scaled_amounts_follow_the_size_of_the_robot() {
    let of = |term: &str, range: [f64; 2]| Event { operation: Operation::AddScaled, ..Event::new(term, range) };
    let events = [of("body_com_offset", [0.002, 0.004]), of("wheel_coulomb_friction", [0.005, 0.01])];
    let drawn = |robot: &str| {
        let params = Params::preset(robot).unwrap();
        let run = started(
            &BalanceConfig { params, ..config(ModelKind::Contact, 10, &events) },
            32,
            Autoreset::SameStep,
            SEED,
        );
        (0..32)
            .map(|i| {
                let (params, nominal) = (run.batch.params(i).unwrap(), run.batch.nominal_params(i).unwrap());
                let friction = params.wheel_coulomb_friction - nominal.wheel_coulomb_friction;
                [params.body_com_offset[0] - nominal.body_com_offset[0], friction]
            })
            .collect::<Vec<_>>()
    };
    let paper = drawn("paper");
    assert!(paper.iter().all(|[x, c]| (0.002..=0.004).contains(x) && (0.005..=0.01).contains(c)), "{paper:?}");
    for robot in ["kugle", "rezero"] {
        let params = Params::preset(robot).unwrap();
        let length = params.body_com_height / Params::paper().body_com_height;
        for ([x, c], [of_x, of_c]) in paper.iter().zip(drawn(robot)) {
            assert!(
                (of_x / (x * length) - 1.0).abs() < 1e-9 && (of_c / (c * Scale::of(&params).torque) - 1.0).abs() < 1e-9
            );
        }
    }
}

#[test]
fn optional_events_of_sensors_are_left_out_without_sensors() {
    let event = optional(Event::new("sensors.gyro_bias", [0.0, 0.01]));
    let mut config = config(ModelKind::Contact, 10, &[event]);
    assert_eq!(started(&config, 1, Autoreset::SameStep, SEED).batch.draw_columns().count(), 0);
    config.sensors = Some(SensorOptions::default());
    assert!(draw(&started(&config, 1, Autoreset::SameStep, SEED).batch, 0, "sensors.gyro_bias") > 0.0);
}
