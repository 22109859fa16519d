//! The state from the readings alone: the gyroscope integrated from the true start, and odometry by the encoders.

use super::readings::Readings;
use crate::lane_state::LaneState;
use crate::lanes::{Lane, Memory, Quat, Vec3};
use crate::params::Params;

/// Numbers of the memory, from the first one of the dead reckoning on.
const SPIN: usize = 0;
const RADIUS: usize = 9;
const ATTITUDE: usize = 10;
const BALL_ATTITUDE: usize = 14;
const POSITION: usize = 18;
const RATE: usize = 20;
const WHEEL_ANGLES: usize = 23;
const BEGUN: usize = 26;

/// How many numbers it keeps.
pub const MEMORY: usize = 27;

/// Begins an episode at a true state of a robot with the parameters `params`.
pub fn begin(params: &Params, start: &LaneState<f64>, memory: &mut [f64]) {
    let spin = params.drive_matrix().try_inverse().expect("wheels of valid parameters drive the ball about every axis")
        / params.gear_ratio();
    for (i, number) in memory[SPIN..SPIN + 9].iter_mut().enumerate() {
        *number = spin[(i / 3, i % 3)];
    }
    memory[RADIUS] = params.ball_radius;
    let quaternion = |q: Quat<f64>| [q.w, q.v.x, q.v.y, q.v.z];
    memory[ATTITUDE..ATTITUDE + 4].copy_from_slice(&quaternion(start.body_quaternion));
    memory[BALL_ATTITUDE..BALL_ATTITUDE + 4].copy_from_slice(&quaternion(start.ball_quaternion));
    memory[POSITION..POSITION + 2].copy_from_slice(&[start.ball_position.x, start.ball_position.y]);
    memory[WHEEL_ANGLES..WHEEL_ANGLES + 3].copy_from_slice(&start.wheel_angles);
    memory[BEGUN] = 0.0;
}

/// Angular velocity of a ball that rolls without slip, inertial frame, from the wheel rates: R(w + Ω) with w = U⁻¹ψ̇/k.
/// `rows` are those of U⁻¹/k, `attitude` is R and `rate` Ω of the body, body frame.
#[inline(always)]
pub fn ball_rate<L: Lane>(rows: [Vec3<L>; 3], attitude: Quat<L>, rate: Vec3<L>, wheel_rates: [L; 3]) -> Vec3<L> {
    let wheels = Vec3::from(wheel_rates);
    let relative = Vec3::new(rows[0].dot(wheels), rows[1].dot(wheels), rows[2].dot(wheels));
    attitude.rotation().apply(relative + rate)
}

/// The state after the readings of a control step of `dt` (s). Velocity and rate of the ball are means over the step; the
/// other rates are those read.
#[inline(always)]
pub fn update<L: Lane>(readings: &Readings<L>, dt: f64, memory: &mut Memory<'_, L>, first: usize) -> LaneState<L> {
    let begun = memory.get(first + BEGUN);
    let begun = begun.zero().lt(begun);
    let last_attitude = memory.quaternion(first + ATTITUDE);
    let last_rate = Vec3::select(begun, memory.vector(first + RATE), readings.gyro);
    let rate = (readings.gyro + last_rate) * dt_of(readings, 0.5);
    let turned = last_attitude.turned_in_own_frame(rate * dt_of(readings, 0.5 * dt));
    let attitude = Quat::select(begun, turned, last_attitude);

    let rows = [0, 3, 6].map(|row| memory.vector(first + SPIN + row));
    let ball_rate = ball_rate(rows, last_attitude.halfway(attitude), rate, readings.wheel_rates);
    let radius = memory.get(first + RADIUS);
    let zero = radius.zero();
    let velocity = Vec3::new(radius * ball_rate.y, -(radius * ball_rate.x), zero);
    let [x, y] = [memory.get(first + POSITION), memory.get(first + POSITION + 1)];
    let moved = L::select(begun, radius.splat(dt), zero);
    let position = Vec3::new(velocity.x.mul_add(moved, x), velocity.y.mul_add(moved, y), radius);
    let ball_attitude = memory.quaternion(first + BALL_ATTITUDE).turned(ball_rate * (moved * 0.5));

    memory.set_quaternion(first + ATTITUDE, attitude);
    memory.set_quaternion(first + BALL_ATTITUDE, ball_attitude);
    memory.set(first + POSITION, position.x);
    memory.set(first + POSITION + 1, position.y);
    memory.set_vector(first + RATE, readings.gyro);
    memory.set(first + BEGUN, radius.splat(1.0));
    let [a, b, c] = memory.get3(first + WHEEL_ANGLES);
    let [turned_a, turned_b, turned_c] = readings.wheel_angles;
    LaneState {
        ball_position: position,
        ball_quaternion: ball_attitude,
        ball_velocity: velocity,
        ball_angular_velocity: ball_rate,
        body_position: position,
        body_quaternion: attitude,
        body_velocity: velocity,
        body_angular_velocity: readings.gyro,
        wheel_angles: [a + turned_a, b + turned_b, c + turned_c],
        wheel_speeds: readings.wheel_rates,
    }
}

#[inline(always)]
fn dt_of<L: Lane>(readings: &Readings<L>, value: f64) -> L {
    readings.gyro.x.splat(value)
}
