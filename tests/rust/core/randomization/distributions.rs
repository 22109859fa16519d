//! Draws against their distribution functions (Kolmogorov-Smirnov).

use super::{SEED, config, draw, started};
use ballbot_core::ModelKind;
use ballbot_core::batch::{Autoreset, Distribution, Event};

const ENVS: usize = 64;
const RESETS: usize = 64;

/// Draws of `gravity`.
fn sample(distribution: Distribution, range: [f64; 2]) -> Vec<f64> {
    let event = Event { distribution, ..Event::new("gravity", range) };
    let mut run = started(&config(ModelKind::Contact, 10, &[event]), ENVS, Autoreset::Disabled, SEED);
    let mut found = Vec::new();
    for _ in 0..RESETS {
        found.extend((0..ENVS).map(|i| draw(&run.batch, i, "gravity")));
        run.reset(&[true; ENVS]);
    }
    found.sort_by(f64::total_cmp);
    found
}

/// Largest difference of the empirical distribution function from `cdf`, in units of its critical value at 0.1 %.
fn statistic(sorted: &[f64], cdf: impl Fn(f64) -> f64) -> f64 {
    let n = sorted.len() as f64;
    let distance = |(i, &x): (usize, &f64)| (cdf(x) - i as f64 / n).abs().max((cdf(x) - (i + 1) as f64 / n).abs());
    sorted.iter().enumerate().map(distance).fold(0.0, f64::max) * n.sqrt() / 1.95
}

/// Integral of the standard normal distribution from -3 to `z`, by Simpson's rule.
fn normal_integral(z: f64) -> f64 {
    let steps = 200;
    let h = (z + 3.0) / f64::from(steps);
    let density = |x: f64| (-0.5 * x * x).exp();
    let weight = |k: i32| if k == 0 || k == steps { 1.0 } else { 2.0 + 2.0 * f64::from(k % 2) };
    (0..=steps).map(|k| weight(k) * density(-3.0 + h * f64::from(k))).sum::<f64>() * h / 3.0
}

#[test]
fn samples_have_their_distributions() {
    let uniform = |x: f64| (x - 2.0) / 18.0;
    let log_uniform = |x: f64| (x / 2.0).ln() / 10.0_f64.ln();
    let normal = |x: f64| normal_integral((x - 10.0) / 1.5) / normal_integral(3.0);

    let sampled = sample(Distribution::Uniform, [2.0, 20.0]);
    assert!(statistic(&sampled, uniform) < 1.0);
    // The test detects other distributions.
    assert!(statistic(&sampled, log_uniform) > 2.0 && statistic(&sampled, normal) > 2.0);

    let sampled = sample(Distribution::LogUniform, [2.0, 20.0]);
    assert!(statistic(&sampled, log_uniform) < 1.0);

    let sampled = sample(Distribution::Normal, [10.0, 1.5]);
    assert!(statistic(&sampled, normal) < 1.0);
    assert!(sampled[0] >= 5.5 && sampled[sampled.len() - 1] <= 14.5);
    // It is truncated, not clipped.
    assert!(sampled[1] > sampled[0] && sampled[0] > 5.5);
    let narrower = |x: f64| (normal_integral((x - 10.0) / 1.2) / normal_integral(3.0)).clamp(0.0, 1.0);
    assert!(statistic(&sampled, narrower) > 1.0);
}

#[test]
fn numbers_of_a_vector_are_sampled_separately_unless_shared() {
    let sampled = |shared: bool| {
        let event = Event { shared, ..super::scaled("body_inertia", [0.95, 1.05]) };
        let run = started(&config(ModelKind::Contact, 10, &[event]), 1, Autoreset::Disabled, SEED);
        super::draws(&run.batch, 0, "body_inertia")
    };
    let [own, shared] = [sampled(false), sampled(true)];
    assert!(own[0] != own[1] && own[1] != own[2]);
    assert!(shared[0] == shared[1] && shared[1] == shared[2]);
}
