//! Integral action in the observation of the position error.

use super::{config, run_of};
use crate::run::Run;
use ballbot_core::batch::{Autoreset, Under};
use ballbot_core::control::Lqr;
use ballbot_core::task::ACTION_LEN;
use ballbot_core::{Error, Params};

const N: usize = 9;

/// Robots under the regulator, which does not see the integral, and their observations after each step.
fn observed(run: &mut Run, steps: usize) -> Vec<Vec<f32>> {
    let lqr = Lqr::new(&Params::paper(), run.batch.control_dt()).unwrap();
    let mut actions = vec![0.0; N * ACTION_LEN];
    let step = |_| {
        run.step_under(&Under::new(&lqr), &mut actions).unwrap();
        run.observations.clone()
    };
    (0..steps).map(step).collect()
}

/// A vector of at most some length.
fn within([x, y]: [f64; 2], most: f64) -> [f64; 2] {
    let share = (most / x.hypot(y)).min(1.0);
    [x * share, y * share]
}

fn leaning(rate: f64) -> Run {
    // The robots rest off the setpoint, on a floor that is not level.
    let options: &[(&str, &[f64])] = &[
        ("scale_observations", &[1.0]),
        ("integral_rate", &[rate]),
        ("reset_tilt", &[0.1]),
        ("max_episode_steps", &[400.0]),
    ];
    let mut config = config("balance", options);
    config.set_params(Params { floor_tilt: [0.04, -0.06], ..Params::paper() });
    run_of(&*config, N)
}

#[test]
fn the_observed_position_error_grows_by_its_integral_at_rest() {
    const RATE: f64 = 4.0;
    let [mut plain, mut with] = [0.0, RATE].map(leaning);
    assert_eq!(plain.observations, with.observations);
    let names: Vec<_> = plain.batch.task().rows.iter().map(|row| row.name).collect();
    let place = |name: &str| names.iter().position(|other| *other == name).unwrap();
    let position = ["x", "y"].map(|axis| place(&format!("ball position from the setpoint, heading {axis}")));
    let velocity = ["x", "y"].map(|axis| place(&format!("ball velocity, heading {axis}")));
    let (mut integral, mut largest) = ([[0.0_f64; 2]; N], [0.0_f64; 2]);
    for (k, (alone, shown)) in observed(&mut plain, 900).iter().zip(observed(&mut with, 900)).enumerate() {
        for (i, integral) in integral.iter_mut().enumerate() {
            let row = |rows: &[f32], place: usize| f64::from(rows[i * names.len() + place]);
            let begins = k % 400 == 399;
            let speed = velocity.map(|place| row(alone, place));
            let slow = 1.0 / (1.0 + (speed[0].powi(2) + speed[1].powi(2)) / 0.15_f64.powi(2));
            let error = position.map(|place| row(alone, place));
            let share = slow * RATE * 0.01;
            let [x, y] = within(error, 2.0);
            *integral = if begins { [0.0; 2] } else { within([integral[0] + x * share, integral[1] + y * share], 3.0) };
            let sum = [error[0] + integral[0], error[1] + integral[1]];
            let expected = within(sum, 4.0);
            largest = [largest[0].max(integral[0].hypot(integral[1])), largest[1].max(sum[0].hypot(sum[1]))];
            for (place, expected) in position.into_iter().zip(expected) {
                let found = row(&shown, place);
                assert!((found - expected).abs() < 1e-4, "step {k}, robot {i}: {found}, {expected}");
            }
            let others = (0..names.len()).filter(|place| !position.contains(place));
            others.for_each(|place| assert!(row(alone, place) == row(&shown, place), "step {k}: {}", names[place]));
        }
    }
    // Both limits are reached.
    assert!(largest[0] > 2.99 && largest[1] > 4.1, "{largest:?}");
}

#[test]
fn a_loaded_environment_continues_with_its_integral() {
    let [mut run, mut other] = [leaning(4.0), leaning(4.0)];
    observed(&mut run, 150);
    for i in 0..N {
        other.batch.load((i + 2) % N, &run.batch.save(i).unwrap()).unwrap();
    }
    let rows = run.observations.len() / N;
    for (ours, theirs) in observed(&mut run, 100).iter().zip(observed(&mut other, 100)) {
        for i in 0..N {
            assert_eq!(ours[i * rows..][..rows], theirs[(i + 2) % N * rows..][..rows]);
        }
    }
    let error = leaning(0.0).batch.load(0, &run.batch.save(0).unwrap()).unwrap_err().to_string();
    assert!(error.contains("options of its task differ"), "{error}");
}

#[test]
fn an_integral_needs_a_scaled_position_error() {
    let error = |task: &str, scaled: f64, rate: f64| {
        let options: &[(&str, &[f64])] = &[("scale_observations", &[scaled]), ("integral_rate", &[rate])];
        config(task, options).batch(1, Autoreset::Disabled, Some(1), 0).err().unwrap()
    };
    assert_eq!(
        error("velocity", 1.0, 2.0).to_string(),
        "integral_rate = 2: the task velocity does not observe the ball position from the setpoint, heading x"
    );
    assert_eq!(error("balance", 0.0, 2.0).to_string(), "integral_rate = 2 needs scale_observations");
    for rate in [-0.1, 10.1, f64::NAN] {
        assert!(matches!(error("balance", 1.0, rate), Error::OutOfRange { .. }));
    }
}
