//! The Riccati equation of the regulator, for weights, rates and robots over the whole allowed range.

use ballbot_core::control::{LimitOptions, Lqr, LqrOptions, LqrWeights, Sampled};
use ballbot_core::fields::Fields;
use ballbot_core::models::LinearModel;
use ballbot_core::{Error, Params};
use nalgebra::DMatrix;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

fn regulator(params: &Params, control_dt: f64, weights: &LqrWeights) -> ballbot_core::Result<Sampled<Lqr>> {
    Lqr::with_weights(params, control_dt, weights, &LimitOptions::CAP)
}

/// ‖P − Riccati(P)‖ / ‖P‖ in units of equal cost, recomputed.
fn residual(lqr: &Lqr, params: &Params, control_dt: f64, weights: &LqrWeights) -> f64 {
    let (a, b) = LinearModel::new(params).discretize(control_dt);
    let a = DMatrix::from_column_slice(10, 10, a.as_slice());
    let b = DMatrix::from_column_slice(10, 3, b.as_slice());
    let (q, r) = weights.matrices();
    let (p, k) = (&lqr.regulator().cost, &lqr.regulator().gain);
    let closed_loop = &a - &b * k;
    let next = closed_loop.transpose() * p * &closed_loop + k.transpose() * r * k + &q - p;
    let unit = |i: usize, j: usize| (q[(i, i)] * q[(j, j)]).sqrt();
    let norm = |m: &DMatrix<f64>| DMatrix::from_fn(10, 10, |i, j| m[(i, j)] / unit(i, j)).norm();
    norm(&next) / norm(p)
}

/// Found by adversarial tests: the search for the closed loop's poles did not end.
#[test]
fn regulators_whose_poles_were_not_found_are_solved() {
    let paper = Params::paper();
    let weights = LqrWeights { velocity: 0.008625640592116447, tilt: 0.03365424802859868, ..LqrWeights::default() };
    let small_wheels = Params { wheel_radius: 0.009629761998194085, ..Params::paper() };
    for (params, control_dt, weights) in
        [(&paper, 0.001882252675411623, weights), (&small_wheels, 0.0008391083325679828, LqrWeights::default())]
    {
        let lqr = regulator(params, control_dt, &weights).unwrap();
        assert!(residual(&lqr, params, control_dt, &weights) < 1e-9);
    }
}

#[test]
fn every_regulator_is_solved_or_rejected() {
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let (mut solved, mut worst) = (0, 0.0_f64);
    let n = 3000;
    for _ in 0..n {
        let mut decades = |range: f64| 10.0_f64.powf(range * (2.0 * rng.random::<f64>() - 1.0));
        let mut weights = LqrWeights::default();
        for index in 0..LqrWeights::FIELDS.len() {
            weights.values_mut(index)[0] *= decades(3.0);
        }
        let paper = Params::paper();
        let params = Params { wheel_radius: paper.wheel_radius * decades(1.0), ..paper };
        let control_dt = 0.005 * decades(1.3);
        match regulator(&params, control_dt, &weights) {
            Ok(lqr) => {
                solved += 1;
                worst = worst.max(residual(&lqr, &params, control_dt, &weights));
            }
            Err(error) => assert!(matches!(error, Error::Riccati(_)), "{error}"),
        }
    }
    println!("{solved} of {n} solved, worst relative residual {worst:e}");
    assert!(worst < 1e-8, "{worst:e}");
    assert!(solved as f64 > 0.99 * f64::from(n), "{solved} of {n}");
}

#[test]
fn costs_without_a_regulator_are_rejected() {
    let paper = Params::paper();
    let identity = |n: usize| DMatrix::<f64>::identity(n, n);
    let rejected = |q: &DMatrix<f64>, r: &DMatrix<f64>, words: &str| {
        let made = Lqr::with_costs(&paper, 0.01, [q, r], &LqrOptions::default(), &LimitOptions::CAP);
        let error = made.unwrap_err().to_string();
        assert!(error.contains(words), "'{error}' does not contain '{words}'");
    };
    rejected(&(identity(10) * 1e16), &identity(3), "Q[0, 0] = 1e16 is out of range: it must be within ±1e15");
    rejected(&(identity(10) * f64::NAN), &identity(3), "Q[0, 0] = NaN");
    rejected(&identity(10), &(identity(3) * -1.0), "R is not positive semidefinite");
    rejected(&identity(10), &(identity(3) * 0.0), "R is not positive definite");
    rejected(&(identity(10) * 0.0), &identity(3), "Q is zero");
    let weights = LqrWeights { tilt: 1e-7, ..LqrWeights::default() };
    let error = regulator(&paper, 0.01, &weights).unwrap_err().to_string();
    assert_eq!(error, "tilt = 0.0000001 is out of range: it must be >= 1e-6 and <= 1e6 rad");
    for control_dt in [0.0, -1.0, f64::NAN, f64::INFINITY, 1001.0] {
        let error = regulator(&paper, control_dt, &LqrWeights::default()).unwrap_err().to_string();
        assert_eq!(error, format!("control_dt = {control_dt} is out of range: it must be > 0 and <= 1000 s"));
    }
}
