//! What is wrong with a robot, in the coordinates of the linear model.

use super::LaneSetpoint;
use super::balance_frame::BalanceFrame;
use crate::lane_state::LaneState;
use crate::lanes::{Heading, Lane, wrapped_angle};
use crate::models::linear::STATES;

/// Deviation from the setpoint in the linear model's coordinates.
#[inline(always)]
pub(super) fn deviation<L: Lane>(
    frame: &BalanceFrame,
    state: &LaneState<L>,
    setpoint: &LaneSetpoint<L>,
) -> [L; STATES] {
    let attitude = frame.attitude(state.body_quaternion);
    let heading = Heading::new(attitude);
    let (p, v) = (state.ball_position, state.ball_velocity);
    let [x, y] = heading.of(p.x - setpoint.position[0], p.y - setpoint.position[1]);
    let [vx, vy] = heading.of(v.x - setpoint.velocity[0], v.y - setpoint.velocity[1]);
    let [inertial_x, inertial_y] = attitude.tilt_components();
    let [tilt_x, tilt_y] = heading.of(inertial_x, inertial_y);
    let yaw = wrapped_angle(attitude.yaw() - setpoint.yaw);
    let rate = frame.of_body(state.body_angular_velocity);
    [x, y, tilt_x, tilt_y, yaw, vx, vy, rate.x, rate.y, rate.z]
}

/// −row · x.
#[inline(always)]
pub(super) fn product<L: Lane, const N: usize>(row: &[f64; N], x: &[L; N]) -> L {
    let mut sum = x[0] * -row[0];
    for j in 1..N {
        sum = x[j].mul_add_all(-row[j], sum);
    }
    sum
}
