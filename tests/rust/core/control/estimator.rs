//! The estimator against the true motion: exact where the kinematics are exact, within its own covariance under noise,
//! and bounded where wheels slip.

mod closed_loop;
mod coarse;
mod noise;
mod record;

use ballbot_core::lanes::{EIGHT, Eight, Kernel, Registers};
use ballbot_core::lanes::{Lane, Memory, Quat, Rotation, Scalar, Vec3, Wide, run_eight, run_one};
use ballbot_core::sensor::estimator::{Estimator, EstimatorOptions, Odometry, Tracker};
use ballbot_core::sensor::{Readings, SensorOptions};
use ballbot_core::{Error, LaneState, ModelKind, Params, State};
use nalgebra::{UnitQuaternion, Vector3};
use proptest::prelude::*;
use record::{Filter, Noise, Plan, Record, attitude_error, crooked};

use crate::support::general::any_general_robot;
use crate::support::{any_start, natural_rate};

pub const IMU: [f64; 3] = [0.03, -0.02, 0.2];

fn options() -> EstimatorOptions {
    EstimatorOptions { imu_position: IMU, ..EstimatorOptions::default() }
}

fn rotation(q: &UnitQuaternion<f64>) -> Rotation<f64> {
    Quat { w: q.w, v: Vec3::new(q.i, q.j, q.k) }.rotation()
}

fn lanes(v: &Vector3<f64>) -> Vec3<f64> {
    Vec3::new(v.x, v.y, v.z)
}

/// Largest relative difference of ball velocity and spin between odometry from exact rates and the state.
fn odometry_error(odometry: &Odometry, state: &State) -> f64 {
    let rotation = rotation(&state.body_quaternion);
    let rate = odometry.ball_rate(&rotation, lanes(&state.body_angular_velocity), state.wheel_speeds);
    let [x, y] = odometry.velocity(rate);
    let (v, w) = (&state.ball_velocity, &state.ball_angular_velocity);
    let scale = 1.0_f64.max(v.norm()).max(w.norm()).max(state.body_angular_velocity.norm());
    (x - v.x).abs().max((y - v.y).abs()).max((rate.z - w.z).abs()) / scale
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn odometry_of_any_robot_is_exact_without_slip(params in any_general_robot(), start in any_start(1.5, 3.0)) {
        let state = start.of(&params);
        let error = odometry_error(&Odometry::new(&params).unwrap(), &state);
        prop_assert!(error < 1e-12, "{error:e} at the natural rate {}", natural_rate(&params));
    }
}

#[test]
fn odometry_is_exact_along_a_motion() {
    for params in [Params::paper(), crooked()] {
        let record = Record::driven(&params, ModelKind::Spatial, &Plan::default());
        let odometry = Odometry::new(&params).unwrap();
        let error = record.states.iter().map(|s| odometry_error(&odometry, s)).fold(0.0, f64::max);
        let fastest = record.states.iter().map(|s| s.ball_velocity.norm()).fold(0.0, f64::max);
        assert!(fastest > 0.3, "the robot hardly moves: {fastest} m/s");
        assert!(error < 1e-12, "{error:e}");
    }
}

#[test]
fn tracker_has_the_states_of_its_estimator_and_its_own_memory() {
    let sensors = SensorOptions { imu_position: IMU, gyro_noise: 1e-3, ..SensorOptions::default() };
    let params = crooked();
    let record = Record::driven(&params, ModelKind::Spatial, &Plan::default());
    let options = EstimatorOptions::of(&sensors, &params, record.dt);
    let mut filter = Filter::new(&params, &options, record.dt, &record.states[0], &record.readings[0]);
    let mut tracker = Tracker::new(&params, &sensors, record.dt).unwrap();
    tracker.reset(Some(&record.states[0]));
    tracker.update(&record.readings[0]).unwrap();
    for readings in &record.readings[1..] {
        let rates = tracker.wheel_rates(readings.wheel_angles);
        assert!((rates.column() - readings.wheel_rates.column()).norm() < 1e-9, "the rates are of the angles");
        assert_eq!(*tracker.clone().update(readings).unwrap(), filter.update(readings));
        tracker.update(readings).unwrap();
    }
    assert_eq!(tracker.estimate().slipping.0, filter.slipping());
}

/// Largest errors of tilt and yaw (rad), velocity (m/s) and position (m) along a record without noise.
fn largest_errors(record: &Record, options: &EstimatorOptions) -> [f64; 4] {
    let mut filter = Filter::new(&record.params, options, record.dt, &record.states[0], &record.readings[0]);
    let mut largest = [0.0_f64; 4];
    for (state, readings) in record.states.iter().zip(&record.readings).skip(1) {
        let found = filter.update(readings);
        let attitude = attitude_error(state, &found);
        let errors = [
            attitude.xy().norm(),
            attitude.z.abs(),
            (state.ball_velocity - found.ball_velocity).norm(),
            (state.ball_position - found.ball_position).norm(),
        ];
        largest.iter_mut().zip(errors).for_each(|(most, error)| *most = most.max(error));
        assert_eq!(filter.slipping(), [0.0; 3], "a gripping wheel is used");
    }
    largest
}

#[test]
fn estimates_follow_a_motion_without_noise() {
    // A filter that estimates a bias, and a filter that assumes none.
    let sure = EstimatorOptions { gyro_bias: [0.0; 3], gyro_bias_walk: [0.0; 3], ..options() };
    for (options, limits) in [(options(), [2e-3, 2e-3, 1e-3, 1e-3]), (sure, [2e-4, 2e-4, 1e-3, 1e-3])] {
        for params in [Params::paper(), crooked()] {
            let errors = |dt| {
                let plan = Plan { dt, ..Plan::default() };
                largest_errors(&Record::driven(&params, ModelKind::Spatial, &plan), &options)
            };
            let (coarse, fine) = (errors(0.01), errors(0.005));
            println!("largest errors (rad, rad, m/s, m) at 10 ms {coarse:?}, at 5 ms {fine:?}");
            for (error, limit) in coarse.into_iter().zip(limits) {
                assert!(error < limit, "{coarse:?}");
            }
        }
    }
}

/// Readings of a robot that leans steadily: it accelerates according to its equations.
fn steady_lean(params: &Params, lean: f64, dt: f64, steps: usize) -> (Record, f64) {
    let record = Record::leaning(params, lean, dt, steps);
    let accelerated = record.states[steps].ball_velocity.x / (dt * steps as f64);
    (record, accelerated)
}

/// Tilt of a filter that treats the accelerometer as gravity: gyroscope, and a pull of 1/s towards the accelerometer.
fn plain_filter(record: &Record) -> f64 {
    let mut gravity = record.states[0].body_quaternion.inverse_transform_vector(&Vector3::z());
    for readings in &record.readings[1..] {
        let (rate, force) = (readings.gyro, readings.specific_force);
        let rate = Vector3::new(rate.x, rate.y, rate.z);
        let force = Vector3::new(force.x, force.y, force.z).normalize();
        gravity += (gravity.cross(&rate) + (force - gravity)) * record.dt;
        gravity.normalize_mut();
    }
    gravity.xy().norm().atan2(gravity.z)
}

#[test]
fn steady_lean_is_not_taken_for_upright() {
    let lean = 5.0_f64.to_radians();
    for (name, off) in [("paper", 1.9), ("kugle", 3.7), ("rezero", 3.25), ("asroballet", 3.85)] {
        let params = Params::preset(name).unwrap();
        let (record, acceleration) = steady_lean(&params, lean, 0.01, 1000);
        // The accelerometer sees the lean minus the angle whose tangent is the acceleration over gravity.
        let seen = lean - (acceleration / params.gravity).atan();
        let plain = plain_filter(&record);
        assert!((plain - seen).abs() < 1e-3, "{name}: plain {plain}, {seen} by the closed form");
        let plain_off = (lean - plain).to_degrees();
        // From upright, with an initial uncertainty of 0.1 rad.
        let believed = State { body_quaternion: UnitQuaternion::identity(), ..record.states[0].clone() };
        let options = EstimatorOptions { start_attitude: 0.1, ..options() };
        let mut filter = Filter::new(&params, &options, record.dt, &believed, &record.readings[0]);
        let mut found = believed;
        for readings in &record.readings[1..] {
            found = filter.update(readings);
        }
        let error = (found.tilt() - lean).to_degrees();
        println!("{name}: plain filter {plain_off:.2} deg off, estimator {error:.4} deg");
        assert!((plain_off - off).abs() < 0.05, "{name}: the plain filter is {plain_off} deg off, expected {off}");
        assert!(error.abs() < 0.1, "{name}: {error} deg off");
    }
}

struct InEights<'a> {
    estimator: &'a Estimator,
    starts: &'a [(State, [f64; 12])],
    steps: &'a [Vec<[f64; 12]>],
    found: &'a mut Vec<Vec<u64>>,
}

/// The numbers of readings, of one robot or of eight.
#[inline(always)]
fn readings_of<L: Lane>(numbers: [L; 12]) -> Readings<L> {
    let mut numbers = numbers.into_iter();
    Readings::from_fn(|| numbers.next().unwrap())
}

fn numbers_of(readings: &Readings<f64>) -> [f64; 12] {
    let mut numbers = Vec::new();
    readings.map(|number| numbers.push(*number));
    numbers.try_into().unwrap()
}

impl Kernel for InEights<'_> {
    #[inline(always)]
    fn run<S: Registers>(self, simd: S) {
        let eights = |rows: &[[f64; 12]]| -> [Wide<S>; 12] {
            std::array::from_fn(|k| Wide::<S>::load(simd, &Eight(std::array::from_fn(|i| rows[i][k]))))
        };
        let mut cells = vec![Eight::default(); Estimator::MEMORY];
        let mut states = ballbot_core::LaneState::<Eight>::default();
        for (i, (state, _)) in self.starts.iter().enumerate() {
            states.set_lane(i, &state.into());
        }
        let first: Vec<_> = self.starts.iter().map(|(_, r)| *r).collect();
        let mut memory = Memory::<Wide<S>>::new(simd, &mut cells);
        self.estimator.begin(&states.load::<Wide<S>>(simd), &mut memory);
        for step in std::iter::once(&first).chain(self.steps) {
            let state = self.estimator.update(&readings_of(eights(step)), &mut memory);
            states.store(&self.estimator.balanced(&state, &memory));
        }
        for i in 0..EIGHT {
            let state = State::from(states.lane(i)).to_array();
            let kept = cells.iter().map(|cell| cell.0[i]);
            self.found.push(state.into_iter().chain(kept).map(f64::to_bits).collect());
        }
    }

    fn run_one_by_one(self) {
        let estimator = self.estimator;
        for (i, (start, first)) in self.starts.iter().enumerate() {
            let mut cells = vec![0.0; Estimator::MEMORY];
            let state = run_one(
                #[inline(always)]
                || {
                    let mut memory = Memory::<f64>::new(Scalar, &mut cells);
                    estimator.begin(&LaneState::from(start), &mut memory);
                    let mut last = LaneState::from(start);
                    for readings in std::iter::once(first).chain(self.steps.iter().map(|step| &step[i])) {
                        let state = estimator.update(&readings_of(*readings), &mut memory);
                        last = estimator.balanced(&state, &memory);
                    }
                    State::from(last).to_array()
                },
            );
            self.found.push(state.into_iter().chain(cells).map(f64::to_bits).collect());
        }
    }
}

/// Eight robots; the wheels of one robot slip.
#[test]
fn eight_in_lanes_equal_single_robots() {
    let estimator = Estimator::new(&crooked(), &options(), 0.01).unwrap();
    let plan = Plan { steps: 100, ..Plan::default() };
    let record = Record::driven(&crooked(), ModelKind::Spatial, &plan);
    let noisy: Vec<_> = (0..EIGHT as u64).map(|seed| record.with_noise(&Noise::default(), seed)).collect();
    let starts: Vec<_> = noisy.iter().map(|r| (r.states[0].clone(), numbers_of(&r.readings[0]))).collect();
    let mut steps: Vec<Vec<_>> =
        (1..=plan.steps).map(|k| noisy.iter().map(|r| numbers_of(&r.readings[k])).collect()).collect();
    steps[50][3][9] += 20.0;
    let mut together = Vec::new();
    let mut apart = Vec::new();
    let run = |found| InEights { estimator: &estimator, starts: &starts, steps: &steps, found };
    run_eight(run(&mut together));
    run(&mut apart).run_one_by_one();
    assert_eq!(together.len(), EIGHT);
    for (i, (together, apart)) in together.iter().zip(&apart).enumerate() {
        assert!(together == apart, "robot {i} in lanes differs from the single robot");
        assert!(apart.iter().all(|bits| f64::from_bits(*bits).is_finite()));
    }
}

#[test]
fn options_and_time_steps_out_of_range_are_rejected_by_name() {
    let params = Params::paper();
    let d = EstimatorOptions::default();
    for (options, dt, name) in [
        (EstimatorOptions { gyro_noise: 0.0, ..d }, 0.01, "gyro_noise"),
        (EstimatorOptions { encoder_noise: f64::NAN, ..d }, 0.01, "encoder_noise"),
        (EstimatorOptions { accelerometer_noise: -1.0, ..d }, 0.01, "accelerometer_noise"),
        (EstimatorOptions { imu_position: [0.0, 0.0, f64::INFINITY], ..d }, 0.01, "imu_position[2]"),
        (EstimatorOptions { rolling_error: 0.6, ..d }, 0.01, "rolling_error"),
        (EstimatorOptions { slip_gate: 0.5, ..d }, 0.01, "slip_gate"),
        (EstimatorOptions { lean_time: 0.0, ..d }, 0.01, "lean_time"),
        (d, 0.0, "dt"),
        (d, 1.5, "dt"),
        (d, f64::NAN, "dt"),
    ] {
        let error = Estimator::new(&params, &options, dt).unwrap_err();
        assert!(matches!(&error, Error::OutOfRange { name: found, .. } if found == name), "{name}: {error}");
    }
}
