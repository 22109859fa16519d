//! The estimator of attitude, velocity, position and lean bias from an IMU and three encoders.
//!
//! An error-state extended Kalman filter: gyroscope and accelerometer propagate the estimate of attitude and velocity,
//! wheel rates correct it, slipping wheels are excluded. It assumes a level floor: its tilt is measured from the
//! vertical. See `docs/estimator.md`.

mod belief;
mod correction;
mod covariance;
mod gate;
mod lean;
mod numbers;
mod odometry;
mod options;
mod prediction;
mod tracker;

pub use odometry::Odometry;
pub use options::EstimatorOptions;
pub use tracker::Tracker;

use super::{Readings, SensorOptions};
use ballbot_base::error::{Result, check};
use ballbot_base::fields::Fields;
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Heading, Lane, Mat3, Memory, Rotation, Vec3};
use ballbot_base::params::Params;
use ballbot_base::wheels::Wheels;
use belief::Belief;
use covariance::{Covariance, SPIN, STATES};
use gate::JumpLimit;
use lean::LeanObserver;

/// Longest time between two readings, s.
pub(super) const MAX_DT: f64 = 1.0;

/// Largest correction of the attitude by the lean bias, rad.
const MAX_LEAN_BIAS: f64 = 0.1;

/// The estimator of one kind of robot, written over lanes. Its memory of a robot is in [`Memory`].
#[derive(Clone, Debug)]
pub struct Estimator {
    options: EstimatorOptions,
    odometry: Odometry,
    jump: JumpLimit,
    lean: LeanObserver,
    dt: f64,
}

/// Estimates in addition to the state.
#[derive(Clone, Copy)]
pub struct Estimate<L> {
    /// Bias of the gyroscope, body frame, rad/s.
    pub gyro_bias: Vec3<L>,
    /// Equilibrium lean of the robot minus the equilibrium lean of its parameters, heading frame, rad: positive towards
    /// +x and +y.
    pub lean_bias: [L; 2],
    /// Covariance of the attitude error, a rotation vector in the inertial frame, rad².
    pub attitude_covariance: Mat3<L>,
    /// Covariance of the error of the IMU's horizontal velocity without the part due to the heading error, inertial
    /// frame, (m/s)²: xx, xy, yy.
    pub velocity_covariance: [L; 3],
    /// 1 for a wheel that slipped in the last step, else 0.
    pub slipping: Wheels<L>,
}

impl Estimator {
    /// Count of numbers that it keeps for a robot.
    pub const MEMORY: usize = belief::LEN;

    /// The estimator of the robot of `params` with a reading every `dt` seconds.
    ///
    /// # Errors
    /// [`ballbot_base::Error::OutOfRange`] for an option beyond its limit and for `dt` that is not above 0 and at most 1 s;
    /// errors of [`Params::validate`].
    pub fn new(params: &Params, options: &EstimatorOptions, dt: f64) -> Result<Self> {
        params.validate()?;
        options.check_limits()?;
        check("dt", dt, format_args!("> 0 and <= {MAX_DT} s"), |dt| dt > 0.0 && dt <= MAX_DT)?;
        Ok(Self {
            options: *options,
            odometry: Odometry::new(params)?,
            jump: JumpLimit::new(params, options, dt),
            lean: LeanObserver::new(params, options.lean_time, dt),
            dt,
        })
    }

    /// The estimator of the robot of `params` with sensors that are read every `dt` seconds: the errors that it expects
    /// are [`EstimatorOptions::of`] them.
    ///
    /// # Errors
    /// As [`Estimator::new`].
    pub fn of(params: &Params, sensors: &SensorOptions, dt: f64) -> Result<Self> {
        params.validate()?;
        Self::new(params, &EstimatorOptions::of(sensors, params, dt), dt)
    }

    /// The map between wheel rates and ball rate.
    pub fn odometry(&self) -> &Odometry {
        &self.odometry
    }

    /// Begins an episode: the initial estimate is `state`, with the deviations of the options.
    #[inline(always)]
    pub fn begin<L: Lane>(&self, state: &LaneState<L>, memory: &mut Memory<'_, L>) {
        let rotation = state.body_quaternion.rotation();
        let rate = state.body_angular_velocity;
        let (v, zero) = (state.ball_velocity, rate.x.zero());
        let arm = self.arm_velocity(&rotation, rate);
        let o = &self.options;
        let mut variances = [zero; STATES];
        for (i, variance) in variances.iter_mut().enumerate() {
            let deviation = match i {
                0..3 => o.start_attitude,
                3..6 => o.gyro_bias[i - 3],
                SPIN => o.start_velocity / self.odometry.ball_radius,
                _ => o.start_velocity,
            };
            *variance = zero.splat(deviation * deviation);
        }
        let heading = Heading::new(state.body_quaternion);
        let mut belief = Belief {
            attitude: state.body_quaternion,
            gyro_bias: Vec3::zero(zero),
            velocity: [v.x + arm.x, v.y + arm.y],
            spin: state.ball_angular_velocity.z,
            position: [state.ball_position.x, state.ball_position.y],
            ball_attitude: state.ball_quaternion,
            lean: self.lean.start(&rotation, &heading, [v.x, v.y], rate),
            lean_bias: [zero; 2],
            gyro: rate,
            mean_gyro: rate,
            wheel_rates: state.wheel_speeds,
            expected: Wheels::zero(zero),
            slipping: Wheels::zero(zero),
            begun: zero,
            covariance: Covariance::diagonal(variances),
            cross: [zero; STATES],
        };
        belief.expected = self.expected(&belief, &rotation, rate).wheel_rates;
        belief.store(memory);
    }

    /// The state after `readings`: at the first call of an episode these are readings at the start, at each later call
    /// readings one step later.
    #[inline(always)]
    pub fn update<L: Lane>(&self, readings: &Readings<L>, memory: &mut Memory<'_, L>) -> LaneState<L> {
        let mut belief = Belief::load(memory);
        let first = belief.begun.le(belief.begun.zero());
        let (force, middle) = self.predict(&mut belief, readings);
        self.correct(&mut belief, readings);

        let rotation = belief.attitude.rotation();
        let rate = readings.gyro - belief.gyro_bias;
        let expected = self.expected(&belief, &rotation, rate);
        let velocity = expected.velocity;
        belief.position = self.moved(&belief, readings, &force, &middle, velocity);
        belief.ball_attitude = belief.ball_attitude.turned(expected.ball_rate * rate.x.splat(0.5 * self.dt));
        let heading = Heading::new(belief.attitude);
        belief.lean_bias = self.lean.advance(&mut belief.lean, &rotation, &heading, velocity, rate);
        belief.mean_gyro = mean(belief.gyro, readings.gyro);
        belief.gyro = readings.gyro;
        belief.wheel_rates = readings.wheel_rates;
        belief.expected = expected.wheel_rates;
        belief.begun = rate.x.splat(1.0);
        belief.store_outside(first, memory);
        if L::any(first) {
            return self.last(readings, memory);
        }
        self.state(&belief, readings, &expected)
    }

    /// Makes the next [`Estimator::update`] of the robots in `mask` the first of their episode: the last update was
    /// repeated.
    #[inline(always)]
    pub fn wait<L: Lane>(&self, mask: L::Mask, memory: &mut Memory<'_, L>) {
        Belief::wait(mask, memory);
    }

    /// The state that the last [`Estimator::update`] returned, which was called with `readings`.
    #[inline(always)]
    pub fn last<L: Lane>(&self, readings: &Readings<L>, memory: &Memory<'_, L>) -> LaneState<L> {
        let belief = Belief::load(memory);
        let expected = self.expected(&belief, &belief.attitude.rotation(), belief.gyro - belief.gyro_bias);
        self.state(&belief, readings, &expected)
    }

    /// A state whose attitude is rotated back by the lean bias, within ±0.1 rad: a controller that holds the
    /// equilibrium of the parameters then holds the equilibrium of the robot, without an integrator.
    #[inline(always)]
    pub fn balanced<L: Lane>(&self, state: &LaneState<L>, memory: &Memory<'_, L>) -> LaneState<L> {
        let belief = Belief::load(memory);
        let heading = Heading::new(state.body_quaternion);
        let limit = belief.spin.splat(MAX_LEAN_BIAS);
        let [x, y] = belief.lean_bias;
        let (x, y) = (x.min(limit).max(-limit), y.min(limit).max(-limit));
        let inertial_x = heading.cos.mul_add(x, -(heading.sin * y));
        let inertial_y = heading.sin.mul_add(x, heading.cos * y);
        // Leaning towards +x is a rotation about +y.
        let back = Vec3::new(inertial_y * 0.5, inertial_x * -0.5, x.zero());
        LaneState { body_quaternion: state.body_quaternion.turned(back), ..*state }
    }

    /// Estimates in addition to the state.
    #[inline(always)]
    pub fn estimate<L: Lane>(&self, memory: &Memory<'_, L>) -> Estimate<L> {
        let belief = Belief::load(memory);
        let p = &belief.covariance.rows;
        let row = [[p[0][0], p[0][1], p[0][2]], [p[1][0], p[1][1], p[1][2]], [p[2][0], p[2][1], p[2][2]]];
        Estimate {
            gyro_bias: belief.gyro_bias,
            lean_bias: belief.lean_bias,
            attitude_covariance: row.into(),
            velocity_covariance: [
                p[covariance::VELOCITY][covariance::VELOCITY],
                p[covariance::VELOCITY][covariance::VELOCITY + 1],
                p[covariance::VELOCITY + 1][covariance::VELOCITY + 1],
            ],
            slipping: belief.slipping,
        }
    }

    /// Velocity of the IMU relative to the ball's center, inertial frame, m/s.
    #[inline(always)]
    fn arm_velocity<L: Lane>(&self, rotation: &Rotation<L>, rate: Vec3<L>) -> Vec3<L> {
        rotation.apply(rate.cross(self.arm(rate.x)))
    }

    /// Position of the IMU, body frame, m.
    #[inline(always)]
    fn arm<L: Lane>(&self, like: L) -> Vec3<L> {
        let [x, y, z] = self.options.imu_position;
        Vec3::new(like.splat(x), like.splat(y), like.splat(z))
    }

    /// Motion of ball and wheels predicted from the estimates.
    #[inline(always)]
    fn expected<L: Lane>(&self, belief: &Belief<L>, rotation: &Rotation<L>, rate: Vec3<L>) -> Expected<L> {
        let arm = self.arm_velocity(rotation, rate);
        let velocity = [belief.velocity[0] - arm.x, belief.velocity[1] - arm.y];
        let ball_rate = self.odometry.rolling_rate(velocity, belief.spin);
        Expected { arm, velocity, ball_rate, wheel_rates: self.odometry.wheel_rates(rotation, rate, ball_rate) }
    }

    /// Position of the ball after a step: from the wheel rates, or from the velocity where a wheel slips.
    #[inline(always)]
    fn moved<L: Lane>(
        &self,
        belief: &Belief<L>,
        readings: &Readings<L>,
        force: &Vec3<L>,
        middle: &Rotation<L>,
        velocity: [L; 2],
    ) -> [L; 2] {
        let rate = mean(belief.gyro, readings.gyro) - belief.gyro_bias;
        let rolled = self.odometry.velocity(self.odometry.ball_rate(middle, rate, readings.wheel_rates));
        let slips = belief.any_slips();
        let by_force = [force.x, force.y];
        let mut position = belief.position;
        for i in 0..2 {
            let carried = by_force[i].mul_add_all(-0.5 * self.dt, velocity[i]);
            position[i] = L::select(slips, carried, rolled[i]).mul_add_all(self.dt, position[i]);
        }
        position
    }

    #[inline(always)]
    fn state<L: Lane>(&self, belief: &Belief<L>, readings: &Readings<L>, expected: &Expected<L>) -> LaneState<L> {
        let zero = belief.spin.zero();
        let ball_position = Vec3::new(belief.position[0], belief.position[1], zero.splat(self.odometry.ball_radius));
        let ball_velocity = Vec3::new(expected.velocity[0], expected.velocity[1], zero);
        LaneState {
            ball_position,
            ball_quaternion: belief.ball_attitude,
            ball_velocity,
            ball_angular_velocity: expected.ball_rate,
            body_position: ball_position,
            body_quaternion: belief.attitude,
            body_velocity: ball_velocity,
            body_angular_velocity: readings.gyro - belief.gyro_bias,
            wheel_angles: readings.wheel_angles,
            wheel_speeds: readings.wheel_rates,
        }
    }
}

/// Motion of ball and wheels.
struct Expected<L> {
    /// Velocity of the IMU relative to the ball's center, inertial frame, m/s.
    arm: Vec3<L>,
    /// Velocity of the ball, inertial frame, m/s.
    velocity: [L; 2],
    /// Angular velocity of the ball, inertial frame, rad/s.
    ball_rate: Vec3<L>,
    /// Wheel rates, rad/s.
    wheel_rates: Wheels<L>,
}

#[inline(always)]
fn mean<L: Lane>(a: Vec3<L>, b: Vec3<L>) -> Vec3<L> {
    (a + b) * a.x.splat(0.5)
}
