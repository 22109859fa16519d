//! Readings of sensors: closed forms and statistics.

use crate::run::{Run, actions};
use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, Observation};
use ballbot_core::fields::Fields;
use ballbot_core::lanes::{Memory, Scalar};
use ballbot_core::sensor::{EpisodeStart, Onboard, Readings, Sensor, SensorOptions};
use ballbot_core::task::Balance;
use ballbot_core::{LaneState, ModelKind, Params, State, Wheels, attitude};
use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use std::f64::consts::{PI, TAU};

/// Duration of a control step, s.
pub(super) const DT: f64 = 0.01;
/// Robots and steps of the statistics: their runs with and without errors are the same motion.
pub(super) const ROBOTS: usize = 400;
pub(super) const STEPS: usize = 25;

/// Readings of a single robot.
struct Robot {
    sensors: Onboard,
    memory: Vec<f64>,
}

impl Robot {
    fn new(options: &SensorOptions, start: &State) -> Self {
        let sensors = Onboard::new(options, DT, None).unwrap();
        let mut memory = vec![0.0; sensors.memory_len()];
        let state = LaneState::from(start);
        let gravity = Params::paper().gravity_vector().into();
        sensors.begin(
            &EpisodeStart { gravity, floor_rate: [0.0; 3], state: &state, key: [1, 2], options: None },
            &mut memory,
        );
        Self { sensors, memory }
    }

    fn read(&mut self, state: &State) -> [f64; 12] {
        let mut memory = Memory::<f64>::new(Scalar, &mut self.memory);
        let observed: State = self.sensors.read(&LaneState::from(state), &mut memory).into();
        assert_eq!(&observed, state, "without an estimator the true state is observed");
        numbers(&self.sensors.readings(|number| self.memory[number]).unwrap())
    }
}

/// Gyroscope, accelerometer, wheel angles, wheel rates.
fn numbers(readings: &Readings<f64>) -> [f64; 12] {
    let (Wheels([a, b, c]), Wheels([d, e, f])) = (readings.wheel_angles, readings.wheel_rates);
    let (w, s) = (readings.gyro, readings.specific_force);
    [w.x, w.y, w.z, s.x, s.y, s.z, a, b, c, d, e, f]
}

pub(super) fn assert_near(found: &[f64], expected: &[f64], limit: f64) {
    for (k, (found, expected)) in found.iter().zip(expected).enumerate() {
        assert!((found - expected).abs() <= limit, "number {k}: {found}, expected {expected}");
    }
}

#[test]
fn robot_at_rest_reads_gravity_upwards() {
    for (tilt, yaw) in [([0.0, 0.0], 0.0), ([0.2, -0.1], 0.7), ([0.0, 1.0], -3.0)] {
        let state = State::tilted(&Params::paper(), tilt.into(), yaw);
        let imu_position = [0.1, -0.05, 0.3];
        let mut robot = Robot::new(&SensorOptions { imu_position, ..SensorOptions::default() }, &state);
        let up = state.body_quaternion.inverse_transform_vector(&Vector3::z()) * Params::paper().gravity;
        for _ in 0..3 {
            let expected = [0.0, 0.0, 0.0, up.x, up.y, up.z, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
            assert_near(&robot.read(&state), &expected, 1e-14);
        }
    }
}

/// A body that turns at the rate ω about the vertical reads, at a position p off the axis, the mean centripetal acceleration
/// −ω · 2 sin(ω dt / 2)/dt · p across the axis.
#[test]
fn accelerometer_off_the_axis_reads_the_centripetal_acceleration() {
    let (place, rate) = ([0.03, 0.2, 0.4], 5.0_f64);
    let at = |k: usize| {
        let mut state = State::upright(&Params::paper());
        state.body_quaternion = attitude([0.0; 2].into(), rate * DT * k as f64);
        state.body_angular_velocity = Vector3::z() * rate;
        state
    };
    let mut robot = Robot::new(&SensorOptions { imu_position: place, ..SensorOptions::default() }, &at(0));
    robot.read(&at(0));
    let inwards = -rate * 2.0 * (0.5 * rate * DT).sin() / DT;
    for k in 1..200 {
        let expected = [0.0, 0.0, rate, inwards * place[0], inwards * place[1], Params::paper().gravity];
        assert_near(&robot.read(&at(k)), &expected, 1e-11);
    }
}

#[test]
fn robot_in_free_fall_reads_no_force() {
    let fall = |k: usize| {
        let mut state = State::tilted(&Params::paper(), [0.3, 0.2].into(), 1.0);
        let speed = -Params::paper().gravity * DT * k as f64;
        state.body_velocity = Vector3::new(0.4, 0.0, speed);
        state
    };
    let mut robot = Robot::new(&SensorOptions::default(), &fall(0));
    robot.read(&fall(0));
    for k in 1..50 {
        assert_near(&robot.read(&fall(k))[3..6], &[0.0; 3], 1e-12);
    }
}

/// A wheel that turns at a constant rate: its angles in whole ticks, correct on average, and its rates in whole ticks
/// per step.
#[test]
fn encoders_count_ticks() {
    let ticks = 500.0;
    let tick = TAU / ticks;
    let rate = 0.731 * tick / DT;
    let at = |k: usize| {
        let mut state = State::upright(&Params::paper());
        state.wheel_angles = Wheels([7.0, -3.0, 0.2]).map(|first| first + rate * DT * k as f64);
        state.wheel_speeds = Wheels([rate; 3]);
        state
    };
    let options = SensorOptions { encoder_ticks: ticks, ..SensorOptions::default() };
    let mut robot = Robot::new(&options, &at(0));
    let mut sum = [0.0; 3];
    let mut last = [0.0; 3];
    for k in 0..2000 {
        let read = robot.read(&at(k));
        for wheel in 0..3 {
            let (angle, speed) = (read[6 + wheel], read[9 + wheel]);
            let turned = rate * DT * k as f64;
            assert!((angle / tick - (angle / tick).round()).abs() < 1e-9, "{angle} is between two ticks");
            assert!((angle - turned).abs() < tick, "{angle} is more than a tick from {turned}");
            if k > 0 {
                assert!((speed - (angle - last[wheel]) / DT).abs() < 1e-9);
            }
            let of_a_step = speed * DT / tick;
            assert!(of_a_step.abs() < 1e-9 || (of_a_step - 1.0).abs() < 1e-9, "{of_a_step} ticks in a step");
            last[wheel] = angle;
            sum[wheel] += angle - turned;
        }
    }
    // The mean of an angle is the mean of the true angle minus a constant within half a tick either way.
    for sum in sum {
        assert!((sum / 2000.0).abs() <= 0.5 * tick, "{}", sum / 2000.0 / tick);
    }
    let mut exact = Robot::new(&SensorOptions::default(), &at(0));
    for k in 0..100 {
        let turned = rate * DT * k as f64;
        let expected = [turned, turned, turned, rate, rate, rate];
        assert_near(&exact.read(&at(k))[6..], &expected, 1e-11);
    }
}

/// A mounting error turns both vectors of the IMU by the same rotation, the same over a whole episode.
#[test]
fn misaligned_axes_are_turned_together() {
    let states: Vec<_> = (0..4)
        .map(|k| {
            let mut state = State::tilted(&Params::paper(), [0.1 * k as f64, 0.2].into(), 0.3);
            state.body_angular_velocity = Vector3::new(1.0, k as f64, -2.0);
            state.body_velocity = Vector3::new(0.01 * (k * k) as f64, 0.1, 0.0);
            state
        })
        .collect();
    let options = SensorOptions { imu_misalignment: 0.05, ..SensorOptions::default() };
    let mut robot = Robot::new(&options, &states[0]);
    let mut exact = Robot::new(&SensorOptions::default(), &states[0]);
    let (mut turned, mut straight) = (Vec::new(), Vec::new());
    for state in &states {
        for (robot, vectors) in [(&mut robot, &mut turned), (&mut exact, &mut straight)] {
            let read = robot.read(state);
            vectors.extend([Vector3::from_column_slice(&read[..3]), Vector3::from_column_slice(&read[3..6])]);
        }
    }
    let rotation = Rotation3::from_matrix_unchecked({
        let columns = |v: &[Vector3<f64>]| nalgebra::Matrix3::from_columns(&[v[0], v[1], v[4]]);
        columns(&turned) * columns(&straight).try_inverse().unwrap()
    });
    let angle = UnitQuaternion::from_rotation_matrix(&rotation).angle();
    assert!(angle > 1e-3 && angle < 5.0 * 0.05 * 3.0_f64.sqrt(), "{angle} rad");
    for (turned, straight) in turned.iter().zip(&straight) {
        assert!((rotation * straight - turned).norm() < 1e-12);
    }
}

/// Readings of all robots in all steps, including the first.
pub(super) fn run(sensors: &SensorOptions) -> Vec<[f64; 12]> {
    let config = BalanceConfig {
        model: ModelKind::Contact,
        sensors: Some(sensors.clone()),
        max_wheel_torque: Some(0.5),
        task: Balance { fall_tilt: PI, ..Balance::default() },
        ..BalanceConfig::default()
    };
    let mut run = Run::new(Batch::new(&config, ROBOTS, Autoreset::SameStep, Some(1), 7).unwrap());
    let read = |run: &Run| (0..ROBOTS).map(|i| numbers(&run.batch.readings(i).unwrap())).collect::<Vec<_>>();
    let mut readings = read(&run);
    for k in 0..STEPS {
        run.step(&actions(0, ROBOTS, k, 0.05)).unwrap();
        readings.extend(read(&run));
    }
    readings
}

/// Errors of the readings of one sensor: `errors[step][robot]` by axis, and none elsewhere.
fn errors(options: &SensorOptions, exact: &[[f64; 12]], sensor: usize) -> Vec<Vec<[f64; 3]>> {
    let differences = run(options).into_iter().zip(exact).map(|(found, exact)| {
        for k in (0..12).filter(|k| k / 3 != sensor) {
            assert_eq!(found[k].to_bits(), exact[k].to_bits(), "number {k} under {options:?}");
        }
        [0, 1, 2].map(|axis| found[3 * sensor + axis] - exact[3 * sensor + axis])
    });
    differences.collect::<Vec<_>>().chunks(ROBOTS).map(<[_]>::to_vec).collect()
}

/// Checks mean and standard deviation of normal numbers within five standard errors.
pub(super) fn assert_normal(numbers: &[f64], deviation: f64, what: &str) {
    let count = numbers.len() as f64;
    let mean = numbers.iter().sum::<f64>() / count;
    let variance = numbers.iter().map(|x| x * x).sum::<f64>() / count;
    assert!(mean.abs() < 5.0 * deviation / count.sqrt(), "{what}: mean {mean}, deviation {deviation}");
    let error = variance / (deviation * deviation) - 1.0;
    assert!(error.abs() < 5.0 * (2.0 / count).sqrt(), "{what}: variance off by {error}");
}

#[test]
fn errors_have_the_requested_statistics() {
    let exact = run(&SensorOptions::default());
    let none = SensorOptions::default();
    for (sensor, name) in [(0, "gyro"), (1, "accelerometer")] {
        let option = |suffix: &str, value: f64| {
            let mut options = none.clone();
            options.set(&format!("{name}_{suffix}"), &[value]).unwrap();
            errors(&options, &exact, sensor)
        };
        // White noise: independent in time, between axes and robots.
        let noise = option("noise", 0.002);
        let deviation = 0.002 / DT.sqrt();
        let flat: Vec<f64> = noise.iter().flatten().flatten().copied().collect();
        assert_normal(&flat, deviation, "noise");
        let products = |a: &dyn Fn(usize, usize) -> f64, b: &dyn Fn(usize, usize) -> f64| {
            let pairs = (0..STEPS).flat_map(|k| (0..ROBOTS - 1).map(move |i| (k, i)));
            let products: Vec<f64> = pairs.map(|(k, i)| a(k, i) * b(k, i) / (deviation * deviation)).collect();
            let mean = products.iter().sum::<f64>() / products.len() as f64;
            assert!(mean.abs() < 5.0 / (products.len() as f64).sqrt(), "{name}: correlation {mean}");
        };
        products(&|k, i| noise[k][i][0], &|k, i| noise[k + 1][i][0]);
        products(&|k, i| noise[k][i][0], &|k, i| noise[k][i][1]);
        products(&|k, i| noise[k][i][1], &|k, i| noise[k][i][2]);
        products(&|k, i| noise[k][i][2], &|k, i| noise[k][i + 1][2]);
        // A bias: the same over a whole episode.
        let bias = option("bias", 0.03);
        for step in &bias[1..] {
            for (now, first) in step.iter().zip(&bias[0]) {
                assert_near(now, first, 1e-12);
            }
        }
        assert_normal(&bias[0].iter().flatten().copied().collect::<Vec<_>>(), 0.03, "bias");
        // A walk of the bias: its deviation grows with the root of time, by independent steps.
        let walk = option("bias_walk", 0.4);
        for k in [0, 3, 8, STEPS] {
            let numbers: Vec<f64> = walk[k].iter().flatten().copied().collect();
            assert_normal(&numbers, 0.4 * ((k + 1) as f64 * DT).sqrt(), "walk");
        }
        let steps = walk.windows(2).flat_map(|pair| pair[0].iter().zip(&pair[1]).map(|(a, b)| b[0] - a[0]));
        assert_normal(&steps.collect::<Vec<_>>(), 0.4 * DT.sqrt(), "step of the walk");
        // A range: both bounds are reached, neither is exceeded.
        let mut options = none.clone();
        options.set(&format!("{name}_noise"), &[0.3]).unwrap();
        options.set(&format!("{name}_range"), &[2.0]).unwrap();
        let read: Vec<f64> = run(&options).iter().flat_map(|read| read[3 * sensor..][..3].to_vec()).collect();
        let extremes = read.iter().fold([f64::MAX, f64::MIN], |[low, high], v| [low.min(*v), high.max(*v)]);
        assert_eq!(extremes, [-2.0, 2.0], "{name}");
    }
}

/// Before the first reset the readings are for robots at rest, and do not affect the readings of episodes.
#[test]
fn robots_that_were_never_reset_read_and_are_estimated_at_rest() {
    for model in [ModelKind::Contact, ModelKind::Spatial] {
        let config = BalanceConfig {
            model,
            sensors: Some(SensorOptions { latency: 0.02, ..SensorOptions::default() }),
            observation: Observation::Sensors,
            ..BalanceConfig::default()
        };
        let made = || Batch::new(&config, 9, Autoreset::SameStep, Some(1), 7).unwrap();
        let (seen, unseen) = (made(), made());
        for i in 0..9 {
            let mut expected = [0.0; 12];
            expected[5] = config.params.gravity;
            assert_near(&numbers(&seen.readings(i).unwrap()), &expected, 1e-12);
            assert_near(&seen.estimate(i).unwrap().to_array(), &seen.state(i).unwrap().to_array(), 1e-12);
        }
        let (mut seen, mut unseen) = (Run::new(seen), Run::new(unseen));
        for k in 0..3 {
            assert!(seen.all_bits() == unseen.all_bits(), "{model}: step {k}");
            [&mut seen, &mut unseen].into_iter().for_each(|run| run.step(&actions(0, 9, k, 0.05)).unwrap());
        }
    }
}

/// Readings are the readings of a latency ago, to the last bit; before that, the first readings.
#[test]
fn latency_delays_all_readings() {
    let options = SensorOptions { gyro_noise: 0.01, accelerometer_bias: 0.1, ..SensorOptions::default() };
    let present = run(&options);
    let slow = SensorOptions { imu_rate: 25.0, encoder_rate: 50.0, ..options };
    for (options, present) in [(options, present), (slow.clone(), run(&slow))] {
        let delayed = run(&SensorOptions { latency: 3.0 * DT, ..options });
        for k in 0..=STEPS {
            let then = k.saturating_sub(3) * ROBOTS;
            assert_eq!(delayed[k * ROBOTS..][..ROBOTS], present[then..][..ROBOTS], "step {k}");
        }
    }
}

/// Observation through sensors against the true rows: worst error of each row over `steps` steps of nine robots under small
/// torques, with and without latency.
fn observed_errors(sensors: &SensorOptions, steps: usize) -> [f32; 16] {
    let config = |observation| BalanceConfig {
        model: ModelKind::Contact,
        scale_observations: false,
        max_wheel_torque: Some(0.5),
        sensors: Some(sensors.clone()),
        observation,
        task: Balance { fall_tilt: PI, ..Balance::default() },
        ..BalanceConfig::default()
    };
    let new = |observation| Run::new(Batch::new(&config(observation), 9, Autoreset::SameStep, Some(1), 7).unwrap());
    let (mut truth, mut measured) = (new(Observation::GroundTruth), new(Observation::Sensors));
    let latency = sensors.latency_steps(DT).unwrap();
    let mut past = vec![truth.observations.clone(); latency + 1];
    let mut worst = [0.0_f32; 16];
    let mut privileged = vec![0.0; 16];
    for k in 0..steps {
        for run in [&mut truth, &mut measured] {
            run.step(&actions(0, 9, k, 0.05)).unwrap();
        }
        assert_eq!(truth.rewards, measured.rewards);
        assert_eq!(truth.terminated, measured.terminated);
        past.remove(0);
        past.push(truth.observations.clone());
        for i in 0..9 {
            measured.batch.privileged_observation(i, &mut privileged).unwrap();
            assert_eq!(privileged, truth.observation(i));
            // The last action is not a reading.
            for row in 0..13 {
                let error = (past[0][16 * i + row] - measured.observation(i)[row]).abs();
                worst[row] = worst[row].max(error);
            }
            assert_eq!(privileged[13..], measured.observation(i)[13..]);
        }
    }
    worst
}

/// Rows of the observation while nine robots begin to fall; wheel speeds are means over the step. The rates about x and y
/// are off by the bias that the estimator always expects, at most half of its standard deviation.
#[test]
fn exact_readings_follow_the_motion() {
    for latency in [0.0, 0.03] {
        let worst = observed_errors(&SensorOptions { latency, ..SensorOptions::default() }, 25);
        println!("latency {latency}: {worst:?}");
        let limits = [2e-3, 2e-3, 2e-3, 1e-3, 1e-3, 1e-6, 0.3, 0.3, 0.3, 3e-4, 3e-4, 3e-3, 3e-3];
        for (row, (error, limit)) in worst.iter().zip(limits).enumerate() {
            assert!(*error < limit, "latency {latency}, row {row}: off by {error}, limit {limit}");
        }
    }
}

/// A gyroscope with a bias: the estimator finds the tilt that the integral of the gyroscope loses.
#[test]
fn estimator_finds_a_bias() {
    let bias = SensorOptions { gyro_bias: 0.05, gyro_noise: 1e-4, encoder_ticks: 4096.0, ..SensorOptions::default() };
    let worst = observed_errors(&bias, 50);
    println!("with a bias: {worst:?}");
    // A bias of 0.05 rad/s by itself would be 0.025 rad after half a second, up to three times that among nine robots.
    assert!(worst[0].max(worst[1]) < 0.025, "{worst:?}");
}
