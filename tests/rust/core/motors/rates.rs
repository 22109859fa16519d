//! Sensors that are sampled less often than once per control step.

use super::readings::{DT, ROBOTS, STEPS, assert_near, assert_normal, run};
use ballbot_core::fields::Fields;
use ballbot_core::sensor::SensorOptions;

/// Rates in Hz and the control steps in their periods, of 10 ms each.
const PERIODS: [(f64, usize); 9] =
    [(0.0, 1), (1e6, 1), (100.0, 1), (70.0, 1), (65.0, 2), (50.0, 2), (30.0, 3), (12.5, 8), (0.001, 100_000)];

/// Errors that differ from sample to sample.
fn noisy() -> SensorOptions {
    SensorOptions {
        gyro_noise: 0.01,
        gyro_bias: 0.02,
        accelerometer_noise: 0.02,
        imu_misalignment: 0.01,
        encoder_ticks: 1e6,
        ..SensorOptions::default()
    }
}

/// Numbers `first` to `first` + 5 of the readings of all robots in step `k`.
fn half(readings: &[[f64; 12]], k: usize, first: usize) -> Vec<[f64; 6]> {
    let robots = &readings[k * ROBOTS..][..ROBOTS];
    robots.iter().map(|read| read[first..first + 6].try_into().unwrap()).collect()
}

/// Each sensor changes only at its samples, and does not affect the other sensor.
#[test]
fn readings_are_held_between_samples() {
    let every_step = run(&noisy());
    for (rate, period) in PERIODS {
        let imu = run(&SensorOptions { imu_rate: rate, ..noisy() });
        let encoders = run(&SensorOptions { encoder_rate: rate, ..noisy() });
        for (slow, first, other) in [(&imu, 0, 6), (&encoders, 6, 0)] {
            if period == 1 {
                assert!(*slow == every_step, "{rate} Hz");
            }
            for k in 0..=STEPS {
                assert_eq!(half(slow, k, other), half(&every_step, k, other), "{rate} Hz, step {k}");
                let (now, before) = (half(slow, k, first), half(slow, k.saturating_sub(1), first));
                if k % period > 0 {
                    assert_eq!(now, before, "{rate} Hz, step {k}");
                } else if k > 0 {
                    let all_changed = now.iter().zip(&before).all(|(now, before)| now[..3] != before[..3]);
                    assert!(all_changed, "{rate} Hz, step {k}");
                }
            }
        }
    }
}

/// Without errors a sample has the rate of the body at its step, the mean of the specific forces since the last sample, and
/// the angles of its step; rates of wheels are differences of these angles over the time between.
#[test]
fn samples_follow_from_the_readings_of_every_step() {
    let every_step = run(&SensorOptions::default());
    for (rate, period) in PERIODS {
        let slow = run(&SensorOptions { imu_rate: rate, encoder_rate: rate, ..SensorOptions::default() });
        for k in (0..=STEPS).step_by(period) {
            for i in 0..ROBOTS {
                let of = |k: usize| &every_step[k * ROBOTS + i];
                let sample = &slow[k * ROBOTS + i];
                assert_eq!(sample[..3], of(k)[..3], "{rate} Hz, step {k}");
                assert_eq!(sample[6..9], of(k)[6..9], "{rate} Hz, step {k}");
                let steps = period.min(k + 1);
                for axis in 0..3 {
                    let force = (k + 1 - steps..=k).map(|k| of(k)[3 + axis]).sum::<f64>() / steps as f64;
                    let turned = if k > 0 { of(k)[6 + axis] - of(k - period)[6 + axis] } else { 0.0 };
                    let speed = if k > 0 { turned / (period as f64 * DT) } else { of(0)[9 + axis] };
                    assert_near(&[sample[3 + axis], sample[9 + axis]], &[force, speed], 1e-9);
                }
            }
        }
    }
}

/// Noise of a density is averaged over the period; the walk of a bias continues between samples.
#[test]
fn samples_have_the_requested_statistics() {
    for (rate, period) in PERIODS.into_iter().filter(|(_, period)| (2..STEPS).contains(period)) {
        let exact = run(&SensorOptions { imu_rate: rate, ..SensorOptions::default() });
        for (first, name) in [(0, "gyro"), (3, "accelerometer")] {
            let errors = |suffix: &str, value: f64| {
                let mut options = SensorOptions { imu_rate: rate, ..SensorOptions::default() };
                options.set(&format!("{name}_{suffix}"), &[value]).unwrap();
                let found = run(&options);
                let error = |k: usize| (0..3 * ROBOTS).map(move |j| (k * ROBOTS + j / 3, first + j % 3));
                let samples = (0..=STEPS).step_by(period);
                samples.map(|k| error(k).map(|(n, j)| found[n][j] - exact[n][j]).collect()).collect::<Vec<Vec<_>>>()
            };
            let noise = errors("noise", 0.002);
            let deviation = 0.002 / (period as f64 * DT).sqrt();
            assert_normal(&noise.concat(), deviation, "noise");
            let products: Vec<_> =
                noise.windows(2).flat_map(|pair| pair[0].iter().zip(&pair[1]).map(|(a, b)| a * b)).collect();
            let mean = products.iter().sum::<f64>() / products.len() as f64 / (deviation * deviation);
            assert!(mean.abs() < 5.0 / (products.len() as f64).sqrt(), "{name}, {rate} Hz: correlation {mean}");
            for (sample, errors) in errors("bias_walk", 0.4).iter().enumerate() {
                assert_normal(errors, 0.4 * ((sample * period + 1) as f64 * DT).sqrt(), "walk");
            }
        }
    }
}
