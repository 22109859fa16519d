//! The accelerometer reads the actual gravity.

use super::models;
use crate::run::Run;
use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, Event, ResetRequest, When};
use ballbot_core::sensor::SensorOptions;
use ballbot_core::{ModelKind, Params, State};
use nalgebra::{UnitQuaternion, Vector3};

/// Nine upright robots at rest.
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
        // A snapshot includes the current gravity.
        let bytes = run.batch.save(0).unwrap();
        run.batch.reset(None, &mut run.observations).unwrap();
        run.batch.load(1, &bytes).unwrap();
        run.step(&idle).unwrap();
        assert_reads(&run, 1, 3.7, &format!("{model}, snapshot"));
    }
}

/// Acceleration of the body over a control step of 10 ms minus `gravity`, in the attitude halfway.
fn specific_force(before: &State, after: &State, gravity: &Vector3<f64>) -> Vector3<f64> {
    let acceleration = (after.body_velocity - before.body_velocity) / 0.01;
    let halfway = before.body_quaternion.slerp(&after.body_quaternion, 0.5);
    halfway.inverse_transform_vector(&(acceleration - gravity))
}

/// Largest difference of a component of the specific force of environment `i`, m/s².
fn off_by(run: &Run, i: usize, expected: &Vector3<f64>) -> f64 {
    let force = run.batch.readings(i).unwrap().specific_force;
    (Vector3::new(force.x, force.y, force.z) - expected).amax()
}

#[test]
fn accelerometer_follows_the_slope_within_an_episode() {
    let tilt = [0.12, -0.2];
    for (model, n) in models().into_iter().filter(|(model, _)| *model != ModelKind::Planar) {
        let config = BalanceConfig { model, sensors: Some(SensorOptions::default()), ..BalanceConfig::default() };
        let sloped = Params { floor_tilt: tilt, ..config.params.clone() };
        let ranges = tilt.map(|number| [number, number]).to_vec();
        let tips = Event { when: When::At(0.02), range: ranges, ..Event::new("floor_tilt", [0.0; 2]) };
        let mut run = standing(&BalanceConfig { events: vec![tips], ..config.clone() }, n);
        for k in 0..5 {
            let before: Vec<_> = run.batch.states().collect();
            run.step(&vec![0.0; 3 * n]).unwrap();
            let gravity = if k < 2 { config.params.gravity_vector() } else { sloped.gravity_vector() };
            for (i, before) in before.iter().enumerate() {
                let expected = specific_force(before, &run.batch.state(i).unwrap(), &gravity);
                let off = off_by(&run, i, &expected);
                assert!(off <= 1e-9, "{model}: environment {i}, step {k}: off by {off:e} m/s²");
            }
        }
    }
}

/// Held still on the slope it reads the force that holds it against gravity: the reading on a level floor, rotated with
/// the slope.
#[test]
fn accelerometer_at_rest_on_a_slope_reads_its_support() {
    let params = Params { floor_tilt: [0.1, 0.05], ..Params::paper() };
    let lean = params.slope_lean().unwrap();
    let start = State::tilted_from_equilibrium(&params, lean, 0.4);
    let torques = params.holding_torques(0.4).unwrap();
    for (model, n) in models().into_iter().filter(|(model, _)| *model != ModelKind::Planar) {
        let config = BalanceConfig {
            model,
            params: params.clone(),
            max_wheel_torque: Some(1.0),
            sensors: Some(SensorOptions::default()),
            ..BalanceConfig::default()
        };
        let mut run = standing(&config, n);
        let request = ResetRequest { starts: Some(&vec![Some(start.clone()); n]), ..ResetRequest::default() };
        run.batch.reset_with(&request, &mut run.observations).unwrap();
        let held: Vec<f32> = (0..3 * n).map(|k| torques[k % 3] as f32).collect();
        let floor = UnitQuaternion::from_scaled_axis(Vector3::new(0.1, 0.05, 0.0));
        let expected =
            (floor * start.body_quaternion).inverse_transform_vector(&Vector3::new(0.0, 0.0, params.gravity));
        for _ in 0..3 {
            run.step(&held).unwrap();
            for i in 0..n {
                let off = off_by(&run, i, &expected);
                assert!(off <= 1e-4, "{model}: environment {i} is off by {off:e} m/s²");
            }
        }
    }
}
