//! Consistency of the covariance, and accuracy under noise.

use super::options;
use super::record::{Filter, Noise, Plan, Record, Sensors, attitude_error, imu_velocity};
use ballbot_core::sensor::estimator::EstimatorOptions;
use ballbot_core::{ModelKind, Params, State};
use nalgebra::{Matrix2, Matrix3, Rotation2, UnitQuaternion, Vector3};

const SEEDS: u64 = 100;

/// Assumptions of a filter with the exact errors of its sensors.
fn assumptions(noise: &Noise) -> EstimatorOptions {
    EstimatorOptions {
        gyro_noise: noise.gyro,
        gyro_bias: [noise.gyro_bias; 3],
        gyro_bias_walk: [0.0; 3],
        accelerometer_noise: noise.accelerometer,
        encoder_noise: noise.tick / 12.0_f64.sqrt(),
        rolling_error: 0.0,
        ..options()
    }
}

/// The 95 % band of the mean of `SEEDS` squares of three normal numbers: χ² with 300 degrees of freedom over 100.
const BAND: [f64; 2] = [2.539, 3.499];

#[test]
fn errors_match_the_covariance() {
    let record = Record::driven(&Params::paper(), ModelKind::Spatial, &Plan { steps: 1000, ..Plan::default() });
    let noise = Noise::default();
    let options = assumptions(&noise);
    let mut squares = vec![0.0; record.states.len()];
    let (mut tilt, mut velocity, mut position, mut count) = (0.0, 0.0, 0.0, 0.0);
    for seed in 0..SEEDS {
        let noisy = record.with_noise(&noise, seed);
        let mut draws = Sensors::new(&noise, seed + 1000);
        let doubt = UnitQuaternion::from_scaled_axis(draws.normal() * options.start_attitude);
        let first = &record.states[0];
        let off = (draws.normal() * options.start_velocity).xy().push(0.0);
        let believed = State {
            body_quaternion: doubt * first.body_quaternion,
            ball_velocity: first.ball_velocity + off,
            ..first.clone()
        };
        let mut filter = Filter::new(&record.params, &options, record.dt, &believed, &noisy.readings[0]);
        for (k, square) in squares.iter_mut().enumerate().skip(1) {
            let (truth, found) = (&record.states[k], filter.update(&noisy.readings[k]));
            let error = attitude_error(truth, &found);
            let rows = filter.estimate().attitude_covariance.rows.map(|r| Vector3::new(r.x, r.y, r.z).transpose());
            let covariance = Matrix3::from_rows(&rows);
            *square += error.dot(&(covariance.try_inverse().unwrap() * error)) / SEEDS as f64;
            if k > 200 {
                tilt += error.xy().norm_squared();
                velocity += (truth.ball_velocity - found.ball_velocity).norm_squared();
                position += (truth.ball_position - found.ball_position).norm_squared();
                count += 1.0;
            }
        }
    }
    let rms = [tilt, velocity, position].map(|sum: f64| (sum / count).sqrt());
    println!("RMS: tilt {:.3} mrad, velocity {:.3} mm/s, position {:.3} mm", rms[0] * 1e3, rms[1] * 1e3, rms[2] * 1e3);
    for k in [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000] {
        println!("NEES after {k} steps: {:.3}", squares[k]);
    }
    let inside = squares[1..].iter().filter(|s| (BAND[0]..BAND[1]).contains(*s)).count();
    let mean = squares[1..].iter().sum::<f64>() / 1000.0;
    println!("{inside} of 1000 steps inside the 95 % band, mean {mean:.3}");
    assert!((BAND[0]..BAND[1]).contains(&mean), "mean NEES {mean}");
    assert!(inside > 850, "{inside} of 1000 steps inside the band");
    let [tilt, velocity, position] = rms;
    assert!(tilt < 2e-3 && velocity < 0.015 && position < 0.02, "RMS {rms:?}");
}

/// Mean over steps and robots of the squared velocity error relative to its covariance, 2 if they agree, for robots
/// whose wheels are larger or smaller by `error` than the filter assumes.
fn velocity_squares(options: &EstimatorOptions, error: f64) -> f64 {
    let nominal = Params::paper();
    let (mut sum, mut count) = (0.0, 0.0);
    for seed in 0..16 {
        let side = if seed % 2 == 0 { error } else { -error };
        let params = Params { wheel_radius: nominal.wheel_radius * (1.0 + side), ..nominal.clone() };
        let record = Record::driven(&params, ModelKind::Spatial, &Plan::default());
        let noisy = record.with_noise(&Noise::default(), seed);
        let mut filter = Filter::new(&nominal, options, record.dt, &record.states[0], &noisy.readings[0]);
        for (k, truth) in record.states.iter().enumerate().skip(1) {
            let found = filter.update(&noisy.readings[k]);
            if k <= 100 {
                continue;
            }
            // Without the part due to the heading error.
            let heading = Rotation2::new(attitude_error(truth, &found).z);
            let error = imu_velocity(truth).xy() - heading * imu_velocity(&found).xy();
            let [xx, xy, yy] = filter.estimate().velocity_covariance;
            sum += error.dot(&(Matrix2::new(xx, xy, xy, yy).try_inverse().unwrap() * error));
            count += 1.0;
        }
    }
    sum / count
}

/// They are constant, so averaging readings does not remove them.
#[test]
fn the_covariance_has_the_error_of_the_wheels() {
    let sure = assumptions(&Noise::default());
    let aware = EstimatorOptions { rolling_error: EstimatorOptions::default().rolling_error, ..sure };
    let one = aware.rolling_error;
    let of = |options: &EstimatorOptions, error: f64| {
        let found = velocity_squares(options, error);
        println!("velocity, rolling_error = {}, wheels off by {error}: {found:.2}", options.rolling_error);
        found
    };
    assert!((1.2..2.4).contains(&of(&sure, 0.0)));
    assert!(of(&sure, one) > 3.0);
    assert!((1.2..2.4).contains(&of(&aware, one)));
    assert!((0.3..1.5).contains(&of(&aware, 0.0)));
}
