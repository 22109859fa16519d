//! Mechanical energy of a state of any model.

use crate::kinematics::Omniwheels;
use crate::lane_state::LaneState;
use crate::lanes::{Vec3, run_one};
use crate::params::Params;
use crate::payload::{Payload, PayloadMotion};
use crate::state::State;
use nalgebra::Vector3;

/// Kinetic energy of ball, body and wheels (absolute wheel spin) plus potential energy, J. The potential energy is zero
/// with the ball resting on the floor (on a sloped floor, at the origin) and the body's CoM at the height of the ball
/// center.
pub fn mechanical_energy(params: &Params, wheels: &Omniwheels, state: &State) -> f64 {
    let arm = params.body_com();
    let rate = state.body_angular_velocity;
    let com_velocity = state.body_velocity + state.body_quaternion * rate.cross(&arm);
    let up = params.up();
    let height = |place: &Vector3<f64>| up.dot(place) - params.ball_radius * up.z;
    let com_height = height(&(state.body_position + state.body_quaternion * arm));
    // The axle of wheel i is −a_i, so its absolute spin is ψ̇_i − a_i·Ω.
    let spin = state.wheel_speeds.column() - wheels.axles * rate;
    let twice_kinetic = params.ball_mass * state.ball_velocity.norm_squared()
        + params.ball_inertia * state.ball_angular_velocity.norm_squared()
        + params.body_mass * com_velocity.norm_squared()
        + rate.dot(&(params.body_inertia_matrix() * rate))
        + params.wheel_inertia * spin.norm_squared();
    let ball_height = height(&state.ball_position);
    0.5 * twice_kinetic + params.gravity * (params.body_mass * com_height + params.ball_mass * ball_height)
}

/// [`mechanical_energy`] of a robot whose payload moves, `time` s after the reset: with its payload at its place, as of a
/// robot whose payload is fixed. The springs' energy is zero where their force holds the payload.
pub fn energy_with_payload(
    params: &Params,
    wheels: &Omniwheels,
    state: &State,
    payload: &PayloadMotion<f64>,
    time: f64,
) -> f64 {
    if !params.has_payload() {
        return mechanical_energy(params, wheels, state);
    }
    let up = params.up() * params.gravity;
    let of_payload = run_one(
        #[inline(always)]
        || Payload::new(params).energy(&LaneState::from(state), payload, Vec3::new(up.x, up.y, up.z), time),
    );
    let above = params.payload_mass * params.ball_radius * up.z;
    mechanical_energy(&params.without_payload(), wheels, state) + of_payload - above
}
