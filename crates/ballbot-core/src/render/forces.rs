//! Arrows of the contact forces.

use super::color::srgb;
use super::renderer::Arrow;
use crate::kinematics::Omniwheels;
use crate::params::Params;
use crate::state::{Contacts, State};
use nalgebra::Vector3;

/// Length of an arrow per force, m/N.
const SCALE: f64 = 0.012;

/// Forces of wheels and floor on the ball: loads in blue, tractions in green, horizontal force of the floor in red.
pub fn force_arrows(params: &Params, state: &State, contacts: &Contacts) -> Vec<Arrow> {
    let wheels = Omniwheels::new(params);
    let mut arrows = Vec::with_capacity(7);
    for i in 0..3 {
        let (p, d) = (wheels.contact_directions[i], wheels.drive_directions[i]);
        let out = |v| state.body_quaternion * v;
        let contact = state.body_position + out(p * params.ball_radius);
        // Load arrows end at the outside of the wheel, which would hide them otherwise.
        let top = contact + out(p) * (2.0 * params.wheel_radius);
        let load = out(p) * (contacts.wheel_normal_forces[i] * SCALE);
        arrows.push(Arrow { from: top + load, to: top, color: srgb(0x1971c2) });
        let traction = out(d) * (contacts.wheel_tractions[i] * SCALE);
        arrows.push(Arrow { from: contact, to: contact + traction, color: srgb(0x2f9e44) });
    }
    let lowest = state.ball_position - Vector3::z() * params.ball_radius;
    // The vertical part would be inside the ball.
    let force = contacts.floor_force.xy().push(0.0) * SCALE;
    let above = Vector3::z() * (0.02 * params.ball_radius);
    arrows.push(Arrow { from: lowest + above, to: lowest + above + force, color: srgb(0xe03131) });
    arrows
}
