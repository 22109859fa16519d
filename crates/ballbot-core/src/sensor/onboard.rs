//! Gyroscope, accelerometer and encoders, and the state that follows from them.

use super::axes::Axes;
use super::dead_reckoning;
use super::encoders::Encoders;
use super::normal::Draws;
use super::options::SensorOptions;
use super::readings::Readings;
use super::{EpisodeStart, Sensor};
use crate::error::Result;
use crate::lane_state::LaneState;
use crate::lanes::{Lane, Memory, Quat, Scalar, Vec3, run_one};

/// Sensors on the body and at the wheels, read once a control step.
#[derive(Clone, Debug, PartialEq)]
pub struct Onboard {
    gyro: Axes,
    accelerometer: Axes,
    encoders: Encoders,
    /// Of gyroscope and accelerometer, body frame, m.
    place: [f64; 3],
    /// Standard deviation of each angle of the mounting, rad.
    misalignment: f64,
    /// Control steps between a measurement and its reading.
    latency: usize,
    dt: f64,
    /// Whether tasks observe what follows from the readings, not the true state.
    observed: bool,
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
const GYRO_BIAS: usize = 6;
const ACCELEROMETER_BIAS: usize = 9;
/// Rotation from the axes of gyroscope and accelerometer to those of the body.
const ALIGNMENT: usize = 12;
/// Velocity of the IMU and attitude of the body at the last measurement.
const VELOCITY: usize = 16;
const ATTITUDE: usize = 19;
const ENCODERS: usize = 23;
/// The readings that are out.
const READ: usize = ENCODERS + Encoders::MEMORY;
const STATE: usize = READ + NUMBERS;
/// The readings that are under way, newest first.
const UNDER_WAY: usize = STATE + dead_reckoning::MEMORY;

/// Numbers of the readings.
const NUMBERS: usize = 12;

impl Onboard {
    /// Sensors that are read every `control_dt` (s). Tasks observe what follows from the readings if `observed`, else the
    /// true state.
    ///
    /// # Errors
    /// Those of [`SensorOptions::validate`] and [`SensorOptions::latency_steps`].
    pub fn new(options: &SensorOptions, control_dt: f64, observed: bool) -> Result<Self> {
        options.validate()?;
        let o = options;
        let gyro = [o.gyro_noise, o.gyro_bias, o.gyro_bias_walk, o.gyro_range];
        let accelerometer =
            [o.accelerometer_noise, o.accelerometer_bias, o.accelerometer_bias_walk, o.accelerometer_range];
        Ok(Self {
            gyro: Axes::new(gyro, control_dt, GYRO),
            accelerometer: Axes::new(accelerometer, control_dt, ACCELEROMETER),
            encoders: Encoders::new(o.encoder_ticks, control_dt),
            place: o.imu_position,
            misalignment: o.imu_misalignment,
            latency: o.latency_steps(control_dt)?,
            dt: control_dt,
            observed,
        })
    }

    /// Velocity of the IMU, inertial frame.
    #[inline(always)]
    fn velocity<L: Lane>(&self, state: &LaneState<L>) -> Vec3<L> {
        let like = state.body_velocity.x;
        let place = Vec3::from(self.place.map(|p| like.splat(p)));
        state.body_velocity + state.body_quaternion.rotation().apply(state.body_angular_velocity.cross(place))
    }

    /// What the sensors read at the end of a control step.
    #[inline(always)]
    fn measure<L: Lane>(&self, state: &LaneState<L>, draws: &Draws<L>, memory: &mut Memory<'_, L>) -> Readings<L> {
        let (velocity, attitude) = (self.velocity(state), state.body_quaternion);
        let halfway = memory.quaternion(ATTITUDE).halfway(attitude).rotation();
        let per_second = velocity.x.splat(1.0 / self.dt);
        let mut acceleration = (velocity - memory.vector(VELOCITY)) * per_second;
        acceleration.z += memory.get(GRAVITY);
        memory.set_vector(VELOCITY, velocity);
        memory.set_quaternion(ATTITUDE, attitude);

        let (mut rate, mut force) = (state.body_angular_velocity, halfway.apply_transposed(acceleration));
        if self.misalignment > 0.0 {
            let alignment = memory.quaternion(ALIGNMENT).rotation();
            (rate, force) = (alignment.apply_transposed(rate), alignment.apply_transposed(force));
        }
        let gyro = self.gyro.read(rate, draws, memory, GYRO_BIAS);
        let specific_force = self.accelerometer.read(force, draws, memory, ACCELEROMETER_BIAS);
        let (wheel_angles, wheel_rates) = self.encoders.read(state.wheel_angles, memory, ENCODERS);
        Readings { gyro, specific_force, wheel_angles, wheel_rates }
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
    /// Without latency; see [`Onboard::memory_len`].
    const MEMORY: usize = UNDER_WAY;

    fn memory_len(&self) -> usize {
        UNDER_WAY + NUMBERS * self.latency
    }

    fn begin(&self, start: &EpisodeStart<'_>, memory: &mut [f64]) {
        let episode = memory[EPISODES] + 1.0;
        memory.fill(0.0);
        memory[EPISODES] = episode;
        memory[EPISODE] = episode;
        let key = start.key.map(f64::from);
        memory[KEY..KEY + 2].copy_from_slice(&key);
        memory[GRAVITY] = start.gravity;
        let state = start.state;
        run_one(
            #[inline(always)]
            || {
                let draws = Draws::<f64>::new(Scalar, key, episode, 0.0);
                let [a, b, c, _] = draws.normals(MOUNTING);
                let half = Vec3::new(a, b, c) * (0.5 * self.misalignment);
                let upright = Quat { w: 1.0, v: Vec3::new(0.0, 0.0, 0.0) };
                let [p, q, r, _] = draws.units(PHASES);
                self.encoders.begin(state.wheel_angles, state.wheel_speeds, [p, q, r], &mut memory[ENCODERS..READ]);
                dead_reckoning::begin(start.params, state, &mut memory[STATE..UNDER_WAY]);
                let mut memory = Memory::<f64>::new(Scalar, memory);
                memory.set3(GYRO_BIAS, self.gyro.first_bias(&draws));
                memory.set3(ACCELEROMETER_BIAS, self.accelerometer.first_bias(&draws));
                memory.set_quaternion(ALIGNMENT, upright.turned(half));
                memory.set_vector(VELOCITY, self.velocity(state));
                memory.set_quaternion(ATTITUDE, state.body_quaternion);
            },
        );
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
        let present = self.measure(state, &draws, memory);
        let read = self.delayed(&present, before.le(before.zero()), memory);
        for (k, number) in numbers(&read).into_iter().enumerate() {
            memory.set(READ + k, number);
        }
        if self.observed { dead_reckoning::update(&read, self.dt, memory, STATE) } else { *state }
    }

    fn readings(&self, number: impl Fn(usize) -> f64) -> Option<Readings<f64>> {
        let mut values = [0.0; NUMBERS];
        values.iter_mut().enumerate().for_each(|(k, value)| *value = number(READ + k));
        Some(readings(values))
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
