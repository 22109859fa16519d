//! Gyroscope, accelerometer and encoders, and the state that follows from them.

use super::axes::Axes;
use super::encoders::Encoders;
use super::estimator::{Estimator, EstimatorOptions, MAX_DT};
use super::normal::Draws;
use super::options::SensorOptions;
use super::period::Period;
use super::readings::Readings;
use super::{EpisodeStart, Sensor};
use crate::error::{Result, check};
use crate::lane_state::LaneState;
use crate::lanes::{Lane, Memory, Quat, Scalar, Vec3, run_one};
use crate::params::Params;
use crate::state::State;
use std::f64::consts::TAU;

/// Sensors on the body and at the wheels, read once a control step.
#[derive(Clone, Debug)]
pub struct Onboard {
    gyro: Axes,
    accelerometer: Axes,
    encoders: Encoders,
    /// Of gyroscope and accelerometer.
    imu_period: Period,
    encoder_period: Period,
    /// Of gyroscope and accelerometer, body frame, m.
    place: [f64; 3],
    /// Standard deviation of each angle of the mounting, rad.
    misalignment: f64,
    /// Control steps between a measurement and its reading.
    latency: usize,
    dt: f64,
    /// What tasks observe the robot by; the true state without one.
    estimator: Option<Estimator>,
}

/// Blocks of random numbers of a reading; those of reading 0 are drawn once an episode.
const GYRO: [u32; 2] = [0, 1];
const ACCELEROMETER: [u32; 2] = [2, 3];
const MOUNTING: u32 = 4;
const PHASES: u32 = 5;

/// Episodes since the environment was seeded.
const EPISODES: usize = 0;
/// The present one, and the key of its random numbers.
const EPISODE: usize = 1;
const KEY: usize = 2;
/// Readings in this episode.
const COUNT: usize = 4;
const GRAVITY: usize = 5;
const GYRO_BIAS: usize = 8;
const ACCELEROMETER_BIAS: usize = 11;
/// Rotation from the axes of gyroscope and accelerometer to those of the body.
const ALIGNMENT: usize = 14;
/// Velocity of the IMU and attitude of the body at the last measurement.
const VELOCITY: usize = 18;
const ATTITUDE: usize = 21;
const ENCODERS: usize = 25;
/// Sum of the specific forces since the last sample, if not every control step has one.
const FORCES: usize = ENCODERS + Encoders::MEMORY;
/// The readings that are out.
const READ: usize = FORCES + 3;
/// The readings that are under way, newest first, from that of the last step on; then what the estimator keeps.
const UNDER_WAY: usize = READ + NUMBERS;

/// Least errors that an estimator expects, rad/s, m/s², rad, and rad or m/s.
const LEAST_RATE_ERROR: f64 = 1e-4;
const LEAST_FORCE_ERROR: f64 = 1e-2;
const LEAST_ANGLE_ERROR: f64 = 1e-6;
const LEAST_START_ERROR: f64 = 1e-3;

/// Numbers of the readings.
const NUMBERS: usize = 12;

impl Onboard {
    /// Sensors that are read every `control_dt` (s). Tasks observe what an estimator makes of the readings, that of the robot
    /// `observed` if it is given; else the true state.
    ///
    /// # Errors
    /// Those of [`SensorOptions::validate`], [`SensorOptions::latency_steps`] and [`Estimator::new`];
    /// [`crate::Error::OutOfRange`] for `control_dt` above 1 s and for sensors without a sample in every control step with an estimator.
    pub fn new(options: &SensorOptions, control_dt: f64, observed: Option<&Params>) -> Result<Self> {
        options.validate()?;
        if observed.is_some() {
            let limit = format_args!("> 0 and <= {MAX_DT} s with observation = sensors");
            check("control_dt", control_dt, limit, |dt| dt > 0.0 && dt <= MAX_DT)?;
            options.check_sampled_each_step(control_dt)?;
        }
        let o = options;
        let [imu_period, encoder_period] = o.periods(control_dt);
        let gyro = [o.gyro_noise, o.gyro_bias, o.gyro_bias_walk, o.gyro_range];
        let accelerometer =
            [o.accelerometer_noise, o.accelerometer_bias, o.accelerometer_bias_walk, o.accelerometer_range];
        Ok(Self {
            gyro: Axes::new(gyro, control_dt, imu_period, GYRO),
            accelerometer: Axes::new(accelerometer, control_dt, imu_period, ACCELEROMETER),
            encoders: Encoders::new(o.encoder_ticks, encoder_period),
            imu_period,
            encoder_period,
            place: o.imu_position,
            misalignment: o.imu_misalignment,
            latency: o.latency_steps(control_dt)?,
            dt: control_dt,
            estimator: observed
                .map(|params| Estimator::new(params, &expected_errors(options, control_dt), control_dt))
                .transpose()?,
        })
    }

    /// The first number of the estimator.
    #[inline(always)]
    fn estimated(&self) -> usize {
        UNDER_WAY + NUMBERS * self.latency
    }

    /// Velocity of the IMU, inertial frame.
    #[inline(always)]
    fn velocity<L: Lane>(&self, state: &LaneState<L>) -> Vec3<L> {
        let like = state.body_velocity.x;
        let [x, y, z] = self.place;
        let place = Vec3::new(like.splat(x), like.splat(y), like.splat(z));
        state.body_velocity + state.body_quaternion.rotation().apply(state.body_angular_velocity.cross(place))
    }

    /// What the sensors read at the end of a control step, after `before` others.
    #[inline(always)]
    fn measure<L: Lane>(
        &self,
        state: &LaneState<L>,
        draws: &Draws<L>,
        before: L,
        memory: &mut Memory<'_, L>,
    ) -> Readings<L> {
        let imu_due = self.imu_period.due(before);
        let (velocity, attitude) = (self.velocity(state), state.body_quaternion);
        let halfway = memory.quaternion(ATTITUDE).halfway(attitude).rotation();
        let per_second = velocity.x.splat(1.0 / self.dt);
        let acceleration = (velocity - memory.vector(VELOCITY)) * per_second - memory.vector(GRAVITY);
        memory.set_vector(VELOCITY, velocity);
        memory.set_quaternion(ATTITUDE, attitude);

        let (mut rate, mut force) = (state.body_angular_velocity, halfway.apply_transposed(acceleration));
        if let Some(due) = imu_due {
            force = self.mean_force(force, before, due, memory);
        }
        if self.misalignment > 0.0 {
            let alignment = memory.quaternion(ALIGNMENT).rotation();
            (rate, force) = (alignment.apply_transposed(rate), alignment.apply_transposed(force));
        }
        let mut gyro = self.gyro.read(rate, draws, memory, GYRO_BIAS);
        let mut specific_force = self.accelerometer.read(force, draws, memory, ACCELEROMETER_BIAS);
        if let Some(due) = imu_due {
            gyro = Vec3::select(due, gyro, memory.vector(self.held()));
            specific_force = Vec3::select(due, specific_force, memory.vector(self.held() + 3));
        }
        let due = self.encoder_period.due(before);
        let (wheel_angles, mut wheel_rates) = self.encoders.read(state.wheel_angles, due, memory, ENCODERS);
        if let Some(due) = due {
            for (wheel, rate) in wheel_rates.iter_mut().enumerate() {
                *rate = L::select(due, *rate, memory.get(self.held() + 9 + wheel));
            }
        }
        Readings { gyro, specific_force, wheel_angles, wheel_rates }
    }

    /// The first number of the readings of the last step without latency.
    #[inline(always)]
    fn held(&self) -> usize {
        if self.latency > 0 { UNDER_WAY } else { READ }
    }

    /// Mean of the specific forces of the control steps since the last sample, each in the body frame of its step; with
    /// `force`, that of the present one.
    #[inline(always)]
    fn mean_force<L: Lane>(&self, force: Vec3<L>, before: L, due: L::Mask, memory: &mut Memory<'_, L>) -> Vec3<L> {
        let zero = before.zero();
        let sum = memory.vector(FORCES) + force;
        memory.set_vector(FORCES, Vec3::select(due, Vec3::zero(zero), sum));
        // The first sample is that of one step.
        Vec3::select(before.le(zero), force, sum * zero.splat(1.0 / self.imu_period.steps()))
    }

    /// The readings of a latency ago; those of the start of the episode before that.
    #[inline(always)]
    fn delayed<L: Lane>(&self, present: &Readings<L>, first: L::Mask, memory: &mut Memory<'_, L>) -> Readings<L> {
        let mut newer = numbers(present);
        for age in 0..self.latency {
            for (k, number) in newer.iter_mut().enumerate() {
                let index = UNDER_WAY + NUMBERS * age + k;
                let older = L::select(first, *number, memory.get(index));
                memory.set(index, *number);
                *number = older;
            }
        }
        readings(newer)
    }
}

impl Sensor for Onboard {
    /// Without latency and estimator; see [`Onboard::memory_len`].
    const MEMORY: usize = UNDER_WAY;

    fn memory_len(&self) -> usize {
        self.estimated() + if self.estimator.is_some() { Estimator::MEMORY } else { 0 }
    }

    fn begin(&self, start: &EpisodeStart<'_>, memory: &mut [f64]) {
        let episode = memory[EPISODES] + 1.0;
        memory.fill(0.0);
        memory[EPISODES] = episode;
        memory[EPISODE] = episode;
        let key = start.key.map(f64::from);
        memory[KEY..KEY + 2].copy_from_slice(&key);
        memory[GRAVITY..GYRO_BIAS].copy_from_slice(&start.gravity);
        let state = start.state;
        run_one(
            #[inline(always)]
            || {
                let draws = Draws::<f64>::new(Scalar, key, episode, 0.0);
                let [a, b, c, _] = draws.normals(MOUNTING);
                let half = Vec3::new(a, b, c) * (0.5 * self.misalignment);
                let upright = Quat { w: 1.0, v: Vec3::new(0.0, 0.0, 0.0) };
                let [p, q, r, _] = draws.units(PHASES);
                self.encoders.begin(state.wheel_angles, state.wheel_speeds, [p, q, r], &mut memory[ENCODERS..FORCES]);
                let mut memory = Memory::<f64>::new(Scalar, memory);
                memory.set3(GYRO_BIAS, self.gyro.first_bias(&draws));
                memory.set3(ACCELEROMETER_BIAS, self.accelerometer.first_bias(&draws));
                memory.set_quaternion(ALIGNMENT, upright.turned(half));
                memory.set_vector(VELOCITY, self.velocity(state));
                memory.set_quaternion(ATTITUDE, state.body_quaternion);
                if let Some(estimator) = &self.estimator {
                    estimator.begin(state, &mut memory.after(self.estimated()));
                }
            },
        );
    }

    fn set_gravity(&self, gravity: [f64; 3], memory: &mut [f64]) {
        memory[GRAVITY..GYRO_BIAS].copy_from_slice(&gravity);
    }

    fn seeded(&self, memory: &mut [f64]) {
        memory[EPISODES] = 0.0;
    }

    #[inline(always)]
    fn read<L: Lane>(&self, state: &LaneState<L>, memory: &mut Memory<'_, L>) -> LaneState<L> {
        let before = memory.get(COUNT);
        let count = before + 1.0;
        memory.set(COUNT, count);
        let key = [memory.get(KEY), memory.get(KEY + 1)];
        let draws = Draws::new(memory.token(), key, memory.get(EPISODE), count);
        let present = self.measure(state, &draws, before, memory);
        let read = self.delayed(&present, before.le(before.zero()), memory);
        for (k, number) in numbers(&read).into_iter().enumerate() {
            memory.set(READ + k, number);
        }
        let Some(estimator) = &self.estimator else { return *state };
        let mut memory = memory.after(self.estimated());
        let estimate = estimator.update(&read, &mut memory);
        if self.latency > 0 {
            // The first readings are repeated until others arrive.
            estimator.wait(before.lt(before.splat(self.latency as f64)), &mut memory);
        }
        estimate
    }

    fn readings(&self, number: impl Fn(usize) -> f64) -> Option<Readings<f64>> {
        let mut values = [0.0; NUMBERS];
        values.iter_mut().enumerate().for_each(|(k, value)| *value = number(READ + k));
        Some(readings(values))
    }

    fn estimate(&self, number: impl Fn(usize) -> f64) -> Option<State> {
        let (estimator, read) = (self.estimator.as_ref()?, self.readings(&number)?);
        let mut kept = [0.0; Estimator::MEMORY];
        kept.iter_mut().enumerate().for_each(|(k, value)| *value = number(self.estimated() + k));
        Some(last_estimate(estimator, &read, &mut kept))
    }
}

/// Not generic, so that it is compiled once.
fn last_estimate(estimator: &Estimator, read: &Readings<f64>, memory: &mut [f64]) -> State {
    let state = run_one(
        #[inline(always)]
        || estimator.last(read, &Memory::<f64>::new(Scalar, memory)),
    );
    state.into()
}

/// What an estimator expects of sensors with these options. Readings without errors leave those of its model.
fn expected_errors(options: &SensorOptions, dt: f64) -> EstimatorOptions {
    let reading = |density: f64| density / dt.sqrt();
    let tick = if options.encoder_ticks > 0.0 { TAU / options.encoder_ticks } else { 0.0 };
    EstimatorOptions {
        imu_position: options.imu_position,
        gyro_noise: reading(options.gyro_noise).clamp(LEAST_RATE_ERROR, 10.0),
        gyro_bias: options.gyro_bias.min(10.0),
        gyro_bias_walk: options.gyro_bias_walk.min(10.0),
        // A bias of the accelerometer is not estimated.
        accelerometer_noise: reading(options.accelerometer_noise)
            .hypot(options.accelerometer_bias)
            .clamp(LEAST_FORCE_ERROR, 100.0),
        encoder_noise: (tick / 12.0_f64.sqrt()).clamp(LEAST_ANGLE_ERROR, 1.0),
        start_attitude: options.imu_misalignment.max(LEAST_START_ERROR),
        start_velocity: LEAST_START_ERROR,
        ..EstimatorOptions::default()
    }
}

#[inline(always)]
fn numbers<L: Lane>(read: &Readings<L>) -> [L; NUMBERS] {
    let ([a, b, c], [d, e, f]) = (read.wheel_angles, read.wheel_rates);
    let (w, s) = (read.gyro, read.specific_force);
    [w.x, w.y, w.z, s.x, s.y, s.z, a, b, c, d, e, f]
}

#[inline(always)]
fn readings<L: Lane>([wx, wy, wz, sx, sy, sz, a, b, c, d, e, f]: [L; NUMBERS]) -> Readings<L> {
    Readings {
        gyro: Vec3::new(wx, wy, wz),
        specific_force: Vec3::new(sx, sy, sz),
        wheel_angles: [a, b, c],
        wheel_rates: [d, e, f],
    }
}
