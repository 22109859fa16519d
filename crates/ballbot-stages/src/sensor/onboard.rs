//! Gyroscope, accelerometer and encoders, and the state estimated from them.

use super::axes::AxesErrors;
use super::constants::{Constants, constants_of};
use super::encoders;
use super::estimator::Estimator;
use super::options::SensorOptions;
use super::readings::Readings;
use super::{EpisodeStart, Sensor};
use ballbot_base::control_steps::steps_of;
use ballbot_base::error::Result;
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Draws, Lane, Memory, Quat, Scalar, Vec3, run_one};
use ballbot_base::params::Params;
use ballbot_base::state::State;
use ballbot_base::wheels::Wheels;

/// Sensors on the body and at the wheels, read once per control step.
#[derive(Clone, Debug)]
pub struct Onboard {
    options: SensorOptions,
    /// Constants of `options`.
    constants: Constants<f64>,
    /// Whether the memory of each robot has separate constants.
    individual: bool,
    gyro: AxesErrors,
    accelerometer: AxesErrors,
    /// Whether any robot has control steps without a sample of gyroscope and accelerometer, or of the encoders.
    slow_imu: bool,
    slow_encoders: bool,
    misaligned: bool,
    /// Whether the floor of any robot turns.
    on_turning_floor: bool,
    /// Maximum number of control steps between a measurement and its reading.
    latency: usize,
    dt: f64,
    /// Source of the observed state; without an estimator it is the true state.
    estimator: Option<Estimator>,
}

/// Blocks of random numbers of a reading; the blocks of reading 0 are sampled once per episode.
const GYRO: [u32; 2] = [0, 1];
const ACCELEROMETER: [u32; 2] = [2, 3];
const MOUNTING: u32 = 4;
const PHASES: u32 = 5;

/// Episodes since the environment was seeded.
const EPISODES: usize = 0;
/// The current episode, and the key of its random numbers.
const EPISODE: usize = 1;
const KEY: usize = 2;
/// Readings in this episode.
const COUNT: usize = 4;
const GRAVITY: usize = 5;
const GYRO_BIAS: usize = 8;
const ACCELEROMETER_BIAS: usize = 11;
/// Rotation from the axes of gyroscope and accelerometer to the body axes.
const ALIGNMENT: usize = 14;
/// Velocity of the IMU and attitude of the body at the last measurement.
const VELOCITY: usize = 18;
const ATTITUDE: usize = 21;
const ENCODERS: usize = 25;
/// Sum of the specific forces since the last sample, if not every control step has one.
const FORCES: usize = ENCODERS + encoders::MEMORY;
/// The readings that have been output.
const READ: usize = FORCES + 3;
/// The delayed readings, newest first, beginning with the reading of the last step; then the robot's own constants, if
/// it has any, and the memory of the estimator.
const UNDER_WAY: usize = READ + NUMBERS;

/// Numbers of the readings.
const NUMBERS: usize = Readings::<f64>::LEN;

impl Onboard {
    /// Sensors that are read every `control_dt` (s). If the robot `observed` is given, tasks observe the readings
    /// through its estimator; else they observe the true state.
    ///
    /// # Errors
    /// The errors of [`SensorOptions::check`] and [`Estimator::new`].
    pub fn new(options: &SensorOptions, control_dt: f64, observed: Option<&Params>) -> Result<Self> {
        Self::of(options, options, false, control_dt, observed)
    }

    /// Sensors of robots with individual options ([`EpisodeStart::options`]), each up to the option of `largest`. The
    /// errors that the estimator expects follow from `options`.
    ///
    /// # Errors
    /// As [`Onboard::new`], for `options`.
    pub fn individual(
        options: &SensorOptions,
        largest: &SensorOptions,
        control_dt: f64,
        observed: Option<&Params>,
    ) -> Result<Self> {
        Self::of(options, largest, true, control_dt, observed)
    }

    fn of(
        options: &SensorOptions,
        largest: &SensorOptions,
        individual: bool,
        control_dt: f64,
        observed: Option<&Params>,
    ) -> Result<Self> {
        options.check(control_dt, observed.is_some())?;
        let l = largest;
        let gyro = [l.gyro_noise, l.gyro_bias_walk, l.gyro_range];
        let accelerometer = [l.accelerometer_noise, l.accelerometer_bias_walk, l.accelerometer_range];
        let slow = |rate: f64| if individual { rate > 0.0 } else { steps_of(rate, control_dt) > 1.0 };
        Ok(Self {
            constants: constants_of(options, control_dt)?,
            individual,
            gyro: AxesErrors::new(gyro, GYRO),
            accelerometer: AxesErrors::new(accelerometer, ACCELEROMETER),
            slow_imu: slow(l.imu_rate),
            slow_encoders: slow(l.encoder_rate),
            misaligned: l.imu_misalignment > 0.0,
            on_turning_floor: false,
            latency: l.latency_steps(control_dt)?,
            dt: control_dt,
            estimator: observed.map(|params| Estimator::of(params, options, control_dt)).transpose()?,
            options: options.clone(),
        })
    }

    /// The same for robots on floors that may turn: the gyroscope measures their angular velocity, too.
    #[must_use]
    pub fn on_turning_floor(self, on_turning_floor: bool) -> Self {
        Self { on_turning_floor, ..self }
    }

    /// The estimator, if tasks observe the readings.
    pub fn estimator(&self) -> Option<&Estimator> {
        self.estimator.as_ref()
    }

    /// The first number of a robot's own constants.
    #[inline(always)]
    fn own(&self) -> usize {
        UNDER_WAY + NUMBERS * self.latency
    }

    /// The first number of the estimator.
    #[inline(always)]
    fn estimated(&self) -> usize {
        self.own() + if self.individual { Constants::<f64>::LEN } else { 0 }
    }

    /// The first number of the angular velocity of a floor that turns.
    #[inline(always)]
    fn floor_rate(&self) -> usize {
        self.estimated() + if self.estimator.is_some() { Estimator::MEMORY } else { 0 }
    }

    #[inline(always)]
    fn constants<L: Lane>(&self, memory: &Memory<'_, L>) -> Constants<L> {
        if self.individual {
            return memory.group(self.own());
        }
        self.constants.map(
            #[inline(always)]
            |number| memory.splat(*number),
        )
    }

    /// Velocity of the IMU, inertial frame.
    #[inline(always)]
    fn velocity<L: Lane>(state: &LaneState<L>, place: [L; 3]) -> Vec3<L> {
        let lever = state.body_angular_velocity.cross(place.into());
        state.body_velocity + state.body_quaternion.rotation().apply(lever)
    }

    /// The readings at the end of a control step, after `before` earlier readings.
    #[inline(always)]
    fn measure<L: Lane>(
        &self,
        state: &LaneState<L>,
        draws: &Draws<L>,
        before: L,
        constants: &Constants<L>,
        memory: &mut Memory<'_, L>,
    ) -> Readings<L> {
        let c = constants;
        let imu_due = if self.slow_imu { Some(c.imu_period.due(before)) } else { None };
        let (velocity, attitude) = (Self::velocity(state, c.place), state.body_quaternion);
        let halfway = memory.quaternion(ATTITUDE).halfway(attitude).rotation();
        let per_second = velocity.x.splat(1.0 / self.dt);
        let acceleration = (velocity - memory.vector(VELOCITY)) * per_second - memory.vector(GRAVITY);
        memory.set_vector(VELOCITY, velocity);
        memory.set_quaternion(ATTITUDE, attitude);

        let (mut rate, mut force) = (state.body_angular_velocity, halfway.apply_transposed(acceleration));
        if self.on_turning_floor {
            rate += attitude.rotation().apply_transposed(memory.vector(self.floor_rate()));
        }
        if let Some(due) = imu_due {
            force = Self::mean_force(force, c.imu_period.inverse, before, due, memory);
        }
        if self.misaligned {
            let alignment = memory.quaternion(ALIGNMENT).rotation();
            (rate, force) = (alignment.apply_transposed(rate), alignment.apply_transposed(force));
        }
        let mut gyro = self.gyro.read(rate, &c.gyro, draws, memory, GYRO_BIAS);
        let mut specific_force = self.accelerometer.read(force, &c.accelerometer, draws, memory, ACCELEROMETER_BIAS);
        if let Some(due) = imu_due {
            gyro = Vec3::select(due, gyro, memory.vector(self.held()));
            specific_force = Vec3::select(due, specific_force, memory.vector(self.held() + 3));
        }
        let due = if self.slow_encoders { Some(c.encoder_period.due(before)) } else { None };
        let (wheel_angles, mut wheel_rates) = c.encoders.read(state.wheel_angles, due, memory, ENCODERS);
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
    /// `force`, the force of the current step, which has the weight `share`.
    #[inline(always)]
    fn mean_force<L: Lane>(force: Vec3<L>, share: L, before: L, due: L::Mask, memory: &mut Memory<'_, L>) -> Vec3<L> {
        let zero = before.zero();
        let sum = memory.vector(FORCES) + force;
        memory.set_vector(FORCES, Vec3::select(due, Vec3::zero(zero), sum));
        // The first sample covers one step.
        Vec3::select(before.le(zero), force, sum * share)
    }

    /// The readings of a latency ago; before that, the readings at the start of the episode.
    #[inline(always)]
    fn delayed<L: Lane>(
        &self,
        present: &Readings<L>,
        latency: L,
        first: L::Mask,
        memory: &mut Memory<'_, L>,
    ) -> Readings<L> {
        let mut newer = *present;
        let mut read = newer;
        for age in 0..self.latency {
            let late_enough = latency.le(latency.splat(age as f64));
            let index = UNDER_WAY + NUMBERS * age;
            let older = Readings::select(first, &newer, &memory.group(index));
            memory.set_group(index, &newer);
            newer = older;
            read = Readings::select(late_enough, &read, &older);
        }
        read
    }
}

impl Sensor for Onboard {
    /// Length without latency and estimator; see [`Onboard::memory_len`].
    const MEMORY: usize = UNDER_WAY;

    fn is_individual(&self) -> bool {
        self.individual
    }

    fn memory_len(&self) -> usize {
        self.floor_rate() + if self.on_turning_floor { 3 } else { 0 }
    }

    fn begin(&self, start: &EpisodeStart<'_>, memory: &mut [f64]) {
        let episode = memory[EPISODES] + 1.0;
        memory.fill(0.0);
        memory[EPISODES] = episode;
        memory[EPISODE] = episode;
        let key = start.key.map(f64::from);
        memory[KEY..KEY + 2].copy_from_slice(&key);
        self.set_gravity(start.gravity, start.floor_rate, memory);
        let state = start.state;
        let (options, constants) = match start.options.filter(|_| self.individual) {
            Some(own) => (own, constants_of(own, self.dt).expect("the options were checked")),
            None => (&self.options, self.constants),
        };
        let period = steps_of(options.encoder_rate, self.dt) * self.dt;
        run_one(
            #[inline(always)]
            || {
                let draws = Draws::<f64>::new(Scalar, key, episode, 0.0);
                let [a, b, c, _] = draws.normals(MOUNTING);
                let half = Vec3::new(a, b, c) * (0.5 * options.imu_misalignment);
                let upright = Quat { w: 1.0, v: Vec3::new(0.0, 0.0, 0.0) };
                let [p, q, r, _] = draws.units(PHASES);
                let mut memory = Memory::<f64>::new(Scalar, memory);
                if self.individual {
                    memory.set_group(self.own(), &constants);
                }
                let turned = state.wheel_speeds.map(|speed| speed * period);
                constants.encoders.begin(state.wheel_angles, turned, Wheels([p, q, r]), &mut memory, ENCODERS);
                memory.set3(GYRO_BIAS, self.gyro.first_bias(options.gyro_bias, &draws));
                let bias = self.accelerometer.first_bias(options.accelerometer_bias, &draws);
                memory.set3(ACCELEROMETER_BIAS, bias);
                memory.set_quaternion(ALIGNMENT, upright.turned(half));
                memory.set_vector(VELOCITY, Self::velocity(state, constants.place));
                memory.set_quaternion(ATTITUDE, state.body_quaternion);
                if let Some(estimator) = &self.estimator {
                    estimator.begin(state, &mut memory.after(self.estimated()));
                }
            },
        );
    }

    fn set_gravity(&self, gravity: [f64; 3], floor_rate: [f64; 3], memory: &mut [f64]) {
        memory[GRAVITY..GYRO_BIAS].copy_from_slice(&gravity);
        if self.on_turning_floor {
            memory[self.floor_rate()..][..3].copy_from_slice(&floor_rate);
        }
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
        let constants = self.constants(memory);
        let present = self.measure(state, &draws, before, &constants, memory);
        let read = self.delayed(&present, constants.latency, before.le(before.zero()), memory);
        memory.set_group(READ, &read);
        let Some(estimator) = &self.estimator else { return *state };
        let mut memory = memory.after(self.estimated());
        let estimate = estimator.update(&read, &mut memory);
        if self.latency > 0 {
            // The first readings are repeated until others arrive.
            estimator.wait(before.lt(constants.latency), &mut memory);
        }
        estimate
    }

    #[inline(always)]
    fn last<L: Lane>(&self, state: &LaneState<L>, memory: &mut Memory<'_, L>) -> LaneState<L> {
        let Some(estimator) = &self.estimator else { return *state };
        let read = memory.group(READ);
        estimator.last(&read, &memory.after(self.estimated()))
    }

    fn readings(&self, number: impl Fn(usize) -> f64) -> Option<Readings<f64>> {
        let mut indices = READ..;
        Some(Readings::from_fn(|| number(indices.next().unwrap_or_default())))
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
