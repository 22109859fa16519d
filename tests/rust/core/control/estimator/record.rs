//! True motions, and their sensor readings.

use crate::support::general;
use ballbot_core::control::{Controller, Lqr, Setpoint};
use ballbot_core::lanes::{Memory, Scalar, Vec3, run_one};
use ballbot_core::models::SpatialModel;
use ballbot_core::sensor::Readings;
use ballbot_core::sensor::estimator::{Estimate, Estimator, EstimatorOptions};
use ballbot_core::{Ballbot, LaneState, ModelKind, Params, State, Wheels};
use nalgebra::{Matrix3, Vector2, Vector3, Vector6};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use std::f64::consts::TAU;

pub use super::IMU;

/// A robot without symmetry.
pub fn crooked() -> Params {
    general::crooked()
}

/// A motion: the target moves along a lemniscate while the heading turns back and forth.
pub struct Plan {
    /// Time between two readings, s.
    pub dt: f64,
    pub steps: usize,
}

impl Default for Plan {
    fn default() -> Self {
        Self { dt: 0.01, steps: 500 }
    }
}

impl Plan {
    pub fn setpoint(&self, k: usize) -> Setpoint {
        let phase = TAU * self.dt * k as f64 / 5.0;
        Setpoint {
            position: Vector2::new(phase.sin(), (2.0 * phase).sin() * 0.5) * 0.4,
            yaw: 0.8 * phase.sin(),
            ..Setpoint::default()
        }
    }
}

/// States at the ends of the steps, the first at the start, with the readings there.
pub struct Record {
    pub params: Params,
    pub dt: f64,
    pub states: Vec<State>,
    pub readings: Vec<Readings<f64>>,
}

/// Velocity of the IMU, inertial frame, m/s.
pub fn imu_velocity(state: &State) -> Vector3<f64> {
    state.body_velocity + state.body_quaternion * state.body_angular_velocity.cross(&Vector3::from(IMU))
}

fn lanes(v: &Vector3<f64>) -> Vec3<f64> {
    Vec3::new(v.x, v.y, v.z)
}

/// Exact readings at the end of a step from `before` to `now`.
pub fn read(params: &Params, before: &State, now: &State, dt: f64) -> Readings<f64> {
    let middle = before.body_quaternion.slerp(&now.body_quaternion, 0.5);
    let acceleration = (imu_velocity(now) - imu_velocity(before)) / dt;
    let force = middle.inverse_transform_vector(&(acceleration + Vector3::z() * params.gravity));
    Readings {
        gyro: lanes(&now.body_angular_velocity),
        specific_force: lanes(&force),
        wheel_angles: now.wheel_angles,
        wheel_rates: Wheels::from_fn(|i| (now.wheel_angles[i] - before.wheel_angles[i]) / dt),
    }
}

impl Record {
    fn of(params: &Params, dt: f64, states: Vec<State>) -> Self {
        let first = read(params, &states[0], &states[0], dt);
        let later = states.windows(2).map(|pair| read(params, &pair[0], &pair[1], dt));
        Self { readings: std::iter::once(first).chain(later).collect(), params: params.clone(), dt, states }
    }

    /// A motion under LQR on the true state.
    pub fn driven(params: &Params, model: ModelKind, plan: &Plan) -> Self {
        let substeps = (plan.dt / 0.001).round() as usize;
        let mut robot = Ballbot::new(params, model, 0.001).unwrap();
        robot.reset(&State::tilted_from_equilibrium(params, Vector2::new(0.03, -0.02), 0.4)).unwrap();
        let mut lqr = Lqr::new(params, plan.dt).unwrap();
        let mut states = vec![robot.state()];
        for k in 0..plan.steps {
            let torques = lqr.wheel_torques(&robot.state(), &plan.setpoint(k));
            robot.step(torques, substeps).unwrap();
            states.push(robot.state());
        }
        Self::of(params, plan.dt, states)
    }

    /// A robot that leans by `lean` (rad) towards +x at all times, and accelerates as it then must.
    pub fn leaning(params: &Params, lean: f64, dt: f64, steps: usize) -> Self {
        let model = SpatialModel::new(params, true, true);
        let attitude = ballbot_core::attitude(Vector2::new(0.0, lean), 0.0);
        let at =
            |torques: &Vector3<f64>| model.accelerations(&attitude, &Vector6::zeros(), Wheels::of_column(*torques));
        let free = at(&Vector3::zeros());
        let columns = [0, 1, 2].map(|i| (at(&Vector3::ith(i, 1.0)) - free).fixed_rows::<3>(2).into_owned());
        let torques = Matrix3::from_columns(&columns).lu().solve(&-free.fixed_rows::<3>(2).into_owned()).unwrap();
        let steady = at(&torques);
        assert!(steady.fixed_rows::<3>(2).norm() < 1e-9 && steady[0] > 0.1, "{steady}");
        let state = |k: usize| {
            let time = dt * k as f64;
            let (velocity, spin) = (steady.fixed_rows::<2>(0) * time, steady[5] * time);
            let mut state = State::rolling(params, velocity, spin, attitude, Vector3::zeros());
            state.ball_position += (velocity * (0.5 * time)).push(0.0);
            state.body_position = state.ball_position;
            state.wheel_angles = state.wheel_speeds.map(|rate| rate * 0.5 * time);
            state
        };
        Self::of(params, dt, (0..=steps).map(state).collect())
    }

    /// The same motion with noise on the readings, sampled with `seed`.
    pub fn with_noise(&self, noise: &Noise, seed: u64) -> Self {
        let mut sensors = Sensors::new(noise, seed);
        let readings = self.readings.iter().map(|exact| sensors.read(exact, self.dt)).collect();
        Self { readings, params: self.params.clone(), dt: self.dt, states: self.states.clone() }
    }
}

/// Standard deviations of the sensors, for one reading.
#[derive(Clone, Copy)]
pub struct Noise {
    /// rad/s.
    pub gyro: f64,
    /// rad/s.
    pub gyro_bias: f64,
    /// m/s².
    pub accelerometer: f64,
    /// Angle of a tick, rad.
    pub tick: f64,
}

impl Default for Noise {
    /// The better of the two IMUs and the encoders that were measured on Kugle.
    fn default() -> Self {
        Self { gyro: 0.013, gyro_bias: 0.02, accelerometer: 0.02, tick: TAU / 70_997.0 }
    }
}

/// Sensors of one robot.
pub struct Sensors {
    noise: Noise,
    rng: ChaCha8Rng,
    pub bias: Vector3<f64>,
    last_angles: Option<[f64; 3]>,
}

impl Sensors {
    pub fn new(noise: &Noise, seed: u64) -> Self {
        let mut sensors =
            Self { noise: *noise, rng: ChaCha8Rng::seed_from_u64(seed), bias: Vector3::zeros(), last_angles: None };
        sensors.bias = sensors.normal() * noise.gyro_bias;
        sensors
    }

    /// Three normal numbers with variance 1, by the Box-Muller method.
    pub fn normal(&mut self) -> Vector3<f64> {
        let mut uniform = || 1.0 - self.rng.random::<f64>();
        Vector3::from_fn(|_, _| (-2.0 * uniform().ln()).sqrt() * (TAU * uniform()).cos())
    }

    pub fn read(&mut self, exact: &Readings<f64>, dt: f64) -> Readings<f64> {
        let gyro = self.bias + self.normal() * self.noise.gyro;
        let force = self.normal() * self.noise.accelerometer;
        let tick = self.noise.tick;
        let angles = exact.wheel_angles.map(|angle| (angle / tick).round() * tick);
        let last = self.last_angles.replace(angles.0).unwrap_or(angles.0);
        Readings {
            gyro: exact.gyro + lanes(&gyro),
            specific_force: exact.specific_force + lanes(&force),
            wheel_angles: angles,
            wheel_rates: Wheels::from_fn(|i| (angles[i] - last[i]) / dt),
        }
    }
}

/// The error of an estimated attitude as a rotation vector, inertial frame, rad.
pub fn attitude_error(truth: &State, found: &State) -> Vector3<f64> {
    (truth.body_quaternion * found.body_quaternion.inverse()).scaled_axis()
}

/// An estimator with the memory of one robot.
pub struct Filter {
    estimator: Estimator,
    cells: Vec<f64>,
}

impl Filter {
    pub fn new(params: &Params, options: &EstimatorOptions, dt: f64, start: &State, first: &Readings<f64>) -> Self {
        let estimator = Estimator::new(params, options, dt).unwrap();
        let mut cells = vec![0.0; Estimator::MEMORY];
        estimator.begin(&LaneState::from(start), &mut Memory::<f64>::new(Scalar, &mut cells));
        let mut filter = Self { estimator, cells };
        assert_eq!(filter.update(first).body_quaternion, start.body_quaternion, "no time has passed");
        filter
    }

    pub fn update(&mut self, readings: &Readings<f64>) -> State {
        let Self { estimator, cells } = self;
        run_one(
            #[inline(always)]
            || estimator.update(readings, &mut Memory::<f64>::new(Scalar, cells)),
        )
        .into()
    }

    /// The state with the lean bias removed.
    pub fn balanced(&mut self, state: &State) -> State {
        let Self { estimator, cells } = self;
        estimator.balanced(&LaneState::from(state), &Memory::<f64>::new(Scalar, cells)).into()
    }

    pub fn estimate(&mut self) -> Estimate<f64> {
        let Self { estimator, cells } = self;
        estimator.estimate(&Memory::<f64>::new(Scalar, cells))
    }

    pub fn slipping(&mut self) -> [f64; 3] {
        self.estimate().slipping.0
    }
}
