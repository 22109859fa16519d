//! Memory of an estimator from one reading to the next.

use super::covariance::{Covariance, NUMBERS, STATES};
use ballbot_base::lanes::{Lane, Memory, Quat, Vec3};
use ballbot_base::wheels::Wheels;

/// Numbers before the covariance.
const BEFORE: usize = 36;

/// Index of [`Belief::begun`].
const BEGUN: usize = BEFORE - 1;

/// Index of [`Belief::cross`].
const CROSS: usize = BEFORE + NUMBERS;

/// Numbers of a [`Belief`].
pub const LEN: usize = CROSS + STATES;

/// The estimated quantities, and what the next step needs from this step.
#[derive(Clone, Copy)]
pub struct Belief<L> {
    /// Attitude of the body.
    pub attitude: Quat<L>,
    /// Bias of the gyroscope, body frame, rad/s.
    pub gyro_bias: Vec3<L>,
    /// Horizontal velocity of the IMU, inertial frame, m/s.
    pub velocity: [L; 2],
    /// Spin of the ball about the vertical, rad/s.
    pub spin: L,
    /// Position of the ball, inertial frame, m.
    pub position: [L; 2],
    /// Attitude of the ball.
    pub ball_attitude: Quat<L>,
    /// State of the observer of the lean bias.
    pub lean: [L; 2],
    /// Lean bias, heading frame, rad.
    pub lean_bias: [L; 2],
    /// Last reading of the gyroscope, rad/s.
    pub gyro: Vec3<L>,
    /// Mean of the gyroscope over the last step, rad/s.
    pub mean_gyro: Vec3<L>,
    /// Wheel rates of the last reading, rad/s.
    pub wheel_rates: Wheels<L>,
    /// Wheel rates predicted from the estimates, rad/s.
    pub expected: Wheels<L>,
    /// 1 for a wheel that slipped in the last step, else 0.
    pub slipping: Wheels<L>,
    /// 0 before the first reading of an episode, then 1.
    pub begun: L,
    /// Covariance of the estimation error.
    pub covariance: Covariance<L>,
    /// Its covariance with the relative error of the rolling, which is not estimated.
    pub cross: [L; STATES],
}

impl<L: Lane> Belief<L> {
    #[inline(always)]
    pub fn load(memory: &Memory<'_, L>) -> Self {
        let mut cross = [memory.get(CROSS); STATES];
        for (i, number) in cross.iter_mut().enumerate() {
            *number = memory.get(CROSS + i);
        }
        Self {
            attitude: memory.quaternion(0),
            gyro_bias: memory.vector(4),
            velocity: memory.group(7),
            spin: memory.get(9),
            position: memory.group(10),
            ball_attitude: memory.quaternion(12),
            lean: memory.group(16),
            lean_bias: memory.group(18),
            gyro: memory.vector(20),
            mean_gyro: memory.vector(23),
            wheel_rates: memory.wheels(26),
            expected: memory.wheels(29),
            slipping: memory.wheels(32),
            begun: memory.get(BEGUN),
            covariance: Covariance::load(memory, BEFORE),
            cross,
        }
    }

    /// Whether a wheel slipped in the last step.
    #[inline(always)]
    pub fn any_slips(&self) -> L::Mask {
        let Wheels([a, b, c]) = self.slipping;
        a.zero().lt(a + b + c)
    }

    #[inline(always)]
    pub fn store(&self, memory: &mut Memory<'_, L>) {
        memory.set_quaternion(0, self.attitude);
        memory.set_vector(4, self.gyro_bias);
        memory.set_group(7, &self.velocity);
        memory.set(9, self.spin);
        memory.set_group(10, &self.position);
        memory.set_quaternion(12, self.ball_attitude);
        memory.set_group(16, &self.lean);
        memory.set_group(18, &self.lean_bias);
        memory.set_vector(20, self.gyro);
        memory.set_vector(23, self.mean_gyro);
        memory.set_wheels(26, self.wheel_rates);
        memory.set_wheels(29, self.expected);
        memory.set_wheels(32, self.slipping);
        memory.set(BEGUN, self.begun);
        self.covariance.store(memory, BEFORE);
        for (i, number) in self.cross.into_iter().enumerate() {
            memory.set(CROSS + i, number);
        }
    }

    /// Makes the next reading of the robots in `mask` the first of their episode.
    #[inline(always)]
    pub fn wait(mask: L::Mask, memory: &mut Memory<'_, L>) {
        let begun = memory.get(BEGUN);
        memory.set(BEGUN, L::select(mask, begun.zero(), begun));
    }

    /// [`Belief::store`] for the robots outside `mask`; for the robots inside, only what is read.
    #[inline(always)]
    pub fn store_outside(&self, mask: L::Mask, memory: &mut Memory<'_, L>) {
        if !L::any(mask) {
            self.store(memory);
            return;
        }
        let kept = Self::load(memory);
        self.store(memory);
        let read =
            Self { gyro: self.gyro, mean_gyro: self.gyro, wheel_rates: self.wheel_rates, begun: self.begun, ..kept };
        let mut new = [self.spin.zero(); LEN];
        for (i, number) in new.iter_mut().enumerate() {
            *number = memory.get(i);
        }
        read.store(memory);
        for (i, number) in new.into_iter().enumerate() {
            memory.set(i, L::select(mask, memory.get(i), number));
        }
    }
}
