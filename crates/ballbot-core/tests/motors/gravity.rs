//! The accelerometer reads the gravity that there is.

use super::models;
use super::run::Run;
use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, Event, ResetRequest, When};
use ballbot_core::sensor::SensorOptions;
use ballbot_core::{Params, State};

/// Nine robots that stand upright at rest.
fn standing(config: &BalanceConfig, n: usize) -> Run {
    let mut run = Run::new(Batch::new(config, n, Autoreset::SameStep, Some(1), 1).unwrap());
    let starts = vec![Some(State::upright(&config.params)); n];
    let request = ResetRequest { starts: Some(&starts), ..ResetRequest::default() };
    run.batch.reset_with(&request, &mut run.observations).unwrap();
    run
}

fn assert_reads(run: &Run, i: usize, gravity: f64, what: &str) {
    let force = run.batch.readings(i).unwrap().specific_force;
    let off = force.x.abs().max(force.y.abs()).max((force.z - gravity).abs());
    assert!(off < 1e-6, "{what}: environment {i} reads {force:?} m/s², expected {gravity} upwards");
}

#[test]
fn accelerometer_follows_the_gravity_within_an_episode() {
    for (model, n) in models() {
        let config = BalanceConfig {
            model,
            max_wheel_torque: Some(0.01),
            sensors: Some(SensorOptions::default()),
            ..BalanceConfig::default()
        };
        let usual = config.params.gravity;
        let idle = vec![0.0; 3 * n];

        let mut run = standing(&config, n);
        run.batch.set_params(1, &Params { gravity: 1.62, ..config.params.clone() }).unwrap();
        run.step(&idle).unwrap();
        for i in 0..n {
            assert_reads(&run, i, if i == 1 { 1.62 } else { usual }, &format!("{model}, set_params"));
        }

        let fall = Event { when: When::At(0.02), ..Event::new("gravity", [3.7, 3.7]) };
        let mut run = standing(&BalanceConfig { events: vec![fall], ..config.clone() }, n);
        for k in 0..4 {
            run.step(&idle).unwrap();
            let gravity = if k < 2 { usual } else { 3.7 };
            (0..n).for_each(|i| assert_reads(&run, i, gravity, &format!("{model}, event, step {k}")));
        }
        // A snapshot brings the present gravity along.
        let bytes = run.batch.save(0).unwrap();
        run.batch.reset(None, &mut run.observations).unwrap();
        run.batch.load(1, &bytes).unwrap();
        run.step(&idle).unwrap();
        assert_reads(&run, 1, 3.7, &format!("{model}, snapshot"));
    }
}
