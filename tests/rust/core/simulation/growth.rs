//! How fast a small tilt grows: the one number that every error of the dynamics enters.

use super::{Motion, Simulation, for_both};
use ballbot_core::{Params, State};
use nalgebra::Vector2;

/// Unstable pole of the upright robot with Table II, wheels counted with their absolute spin, 1/s.
const POLE: f64 = 6.091_744_51;

/// Growth rate λ of a small tilt from its values at three times h apart: cosh λh = (θ₋ + θ₊) / 2θ, for any fraction of
/// the decaying part, which half a step between rates and attitude would change.
fn growth_rate(simulation: Simulation, sim_dt: f64, azimuth: f64) -> f64 {
    let params = Params::paper();
    let mut robot = simulation.robot(&params, sim_dt);
    let tilt = 1e-6;
    robot.reset(&State::tilted(&params, Vector2::new(azimuth.cos(), azimuth.sin()) * tilt, 0.3)).unwrap();
    let [before, at, after] = [0.6, 0.8, 1.0].map(|until| {
        while robot.time() < until - 0.5 * sim_dt {
            robot.step([0.0; 3]);
        }
        robot.state().tilt()
    });
    ((before + after) / (2.0 * at)).acosh() / 0.2
}

fn small_tilt_grows_at_the_exact_rate(simulation: Simulation) {
    let limits: &[(f64, f64)] =
        simulation.pick(&[(1e-3, 2e-4), (2e-3, 1e-3)], &[(5e-4, 5e-7), (1e-3, 2e-6), (2e-3, 7e-6)]);
    for azimuth in [0.0, 0.5, 2.0] {
        for &(sim_dt, tolerance) in limits {
            let error = growth_rate(simulation, sim_dt, azimuth) / POLE - 1.0;
            println!("sim_dt {sim_dt} azimuth {azimuth}: growth-rate error {error:e}");
            assert!(error.abs() <= tolerance, "sim_dt {sim_dt}: relative error {error:e}, limit {tolerance:e}");
        }
    }
}

for_both!(small_tilt_grows_at_the_exact_rate);
