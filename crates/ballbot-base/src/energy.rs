//! Mechanical energy of a state of any model.

use crate::kinematics::Omniwheels;
use crate::lane_state::LaneState;
use crate::lanes::{Vec3, run_one};
use crate::params::Params;
use crate::payload::{PAYLOADS, Payload, PayloadMotion};
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

/// [`mechanical_energy`] of a robot whose payloads move, `time` s after the reset: with its payloads at their places, as of a
/// robot whose payloads are fixed. The springs' energy is zero where their force holds the payload.
pub fn energy_with_payloads(
    params: &Params,
    wheels: &Omniwheels,
    state: &State,
    motions: &[PayloadMotion<f64>; PAYLOADS],
    time: f64,
) -> f64 {
    if !params.has_payload() {
        return mechanical_energy(params, wheels, state);
    }
    let up = params.up() * params.gravity;
    let alone = mechanical_energy(&params.without_payloads(), wheels, state);
    alone + energy_of_payloads(&Payload::of(params), &LaneState::from(state), motions, &up, time)
        - params.mass_of_payloads() * params.ball_radius * up.z
}

/// [`Payload::energy`] of all payloads, J.
pub fn energy_of_payloads(
    payloads: &[Payload<f64>; PAYLOADS],
    body: &LaneState<f64>,
    motions: &[PayloadMotion<f64>; PAYLOADS],
    up: &Vector3<f64>,
    time: f64,
) -> f64 {
    let up = Vec3::new(up.x, up.y, up.z);
    let energy = |(payload, motion): (&Payload<f64>, &PayloadMotion<f64>)| {
        run_one(
            #[inline(always)]
            || payload.energy(body, motion, up, time),
        )
    };
    payloads.iter().zip(motions).filter(|(payload, _)| payload.mass > 0.0).map(energy).sum()
}
