//! Normal numbers have their moments, from functions that are exact to rounding.

use ballbot_base::lanes::normal::{cosine_and_sine, logarithm};
use ballbot_core::lanes::{Draws, Scalar};
use std::f64::consts::FRAC_PI_2;

#[test]
fn functions_are_exact_to_rounding() {
    for i in 0..=1000 {
        let share = f64::from(i) / 1001.0;
        for exponent in [-32.0_f64, -7.0, -1.0] {
            let expected = ((1.0 + share) * exponent.exp2()).ln();
            let error = (logarithm(1.0 + share, exponent) - expected).abs();
            assert!(error <= 2e-15 * expected.abs().max(0.1), "ln: {error:e} at {share}, {exponent}");
        }
        let angle = share * FRAC_PI_2;
        let [cosine, sine] = cosine_and_sine(angle);
        let error = (cosine - angle.cos()).abs().max((sine - angle.sin()).abs());
        assert!(error <= 4e-16, "at {angle}: {error:e}");
    }
}

/// Moments of 200 000 numbers, each within five standard errors, and the fraction beyond three deviations.
#[test]
fn numbers_are_standard_normal() {
    let n = 50_000;
    let draw = |i: u32| Draws::<f64>::new(Scalar, [3.0, 4.0], f64::from(i % 7), f64::from(i / 7)).normals(i % 3);
    let numbers: Vec<f64> = (0..n).flat_map(draw).collect();
    let count = numbers.len() as f64;
    let moment = |power: i32| numbers.iter().map(|x| x.powi(power)).sum::<f64>() / count;
    for (power, expected, variance) in
        [(1, 0.0, 1.0), (2, 1.0, 2.0), (3, 0.0, 15.0), (4, 3.0, 96.0), (6, 15.0, 10_170.0)]
    {
        let limit = 5.0 * f64::sqrt(variance / count);
        let error = (moment(power) - expected).abs();
        assert!(error <= limit, "moment {power}: off by {error}, limit {limit}");
    }
    let beyond = numbers.iter().filter(|x| x.abs() > 3.0).count() as f64;
    let (expected, deviation) = (0.002_699_8 * count, (0.002_699_8 * count).sqrt());
    assert!((beyond - expected).abs() < 5.0 * deviation, "{beyond} beyond three deviations, expected {expected}");
    // No number repeats within a block or from one reading to the next.
    for lag in [1, 2, 3, 4, 28] {
        let products = numbers.iter().zip(&numbers[lag..]).map(|(a, b)| a * b).sum::<f64>() / count;
        assert!(products.abs() < 5.0 / count.sqrt(), "lag {lag}: {products}");
    }
}
