//! The fastest move from rest to rest along a flat polynomial.

use super::LinearModel;
use super::friction_limit::traction_torque;
use ballbot_base::params::Params;

/// Number of samples of a move.
const SAMPLES: usize = 64;

/// Duration, s, of the fastest move over `distance` (m) from rest to rest whose flat output follows the polynomial of
/// ninth degree with four derivatives zero at both ends, at the wheel torques at which a wheel of the upright robot
/// slips; zero for zero distance.
pub fn fastest_move(params: &Params, distance: f64) -> f64 {
    if distance <= 0.0 {
        return 0.0;
    }
    // Leaning by θ towards x: θ̈ = λ² θ + u, and ẍ = g θ − ℓ θ̈.
    let linear = LinearModel::new(params);
    let (toppling_squared, acceleration) = (linear.toppling_squared(), linear.acceleration_per_lean());
    // Each of three wheels at equal angles drives hardest in one direction, with the torque sqrt(2/3 Σ τ²).
    let per_acceleration = (2.0 / 3.0 * linear.turning_torques().column(1).norm_squared()).sqrt();
    let most = traction_torque(params) / per_acceleration;
    let needed = |seconds: f64| {
        let peak = |peak: f64, i: usize| {
            let [second, fourth] = shape(i as f64 / SAMPLES as f64);
            let (second, fourth) = (second / seconds.powi(2), fourth / seconds.powi(4));
            let u = (fourth - toppling_squared * second) * distance / acceleration;
            u.abs().max(peak)
        };
        (0..=SAMPLES).fold(0.0, peak)
    };
    // Slower moves need less torque.
    let (mut short, mut long) = (0.0, toppling_squared.sqrt().recip());
    while needed(long) > most && long < 1e6 {
        short = long;
        long *= 2.0;
    }
    for _ in 0..40 {
        let middle = 0.5 * (short + long);
        if needed(middle) > most { short = middle } else { long = middle }
    }
    long
}

/// Second and fourth derivative of 126 u⁵ − 420 u⁶ + 540 u⁷ − 315 u⁸ + 70 u⁹.
fn shape(u: f64) -> [f64; 2] {
    let powers: [f64; 8] = std::array::from_fn(|n| u.powi(n as i32));
    let coefficients = [126.0, -420.0, 540.0, -315.0, 70.0];
    let mut derivatives = [0.0; 2];
    for (i, c) in coefficients.into_iter().enumerate() {
        let n = (i + 5) as f64;
        derivatives[0] += c * n * (n - 1.0) * powers[i + 3];
        derivatives[1] += c * n * (n - 1.0) * (n - 2.0) * (n - 3.0) * powers[i + 1];
    }
    derivatives
}
