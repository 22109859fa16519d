//! Arrows of the contact forces.

use super::color::srgb;
use super::renderer::Arrow;
use ballbot_base::kinematics::Omniwheels;
use ballbot_base::params::Params;
use ballbot_base::state::{Contacts, State};
use ballbot_base::terrain::Terrain;
use nalgebra::Vector3;

/// Length of an arrow per force, m/N.
const SCALE: f64 = 0.012;

/// Forces of wheels and ground on the ball: loads in blue, tractions in green, the force along the ground in red.
pub fn force_arrows(params: &Params, state: &State, contacts: &Contacts, terrain: Option<&Terrain>) -> Vec<Arrow> {
    let wheels = Omniwheels::new(params);
    let mut arrows = Vec::with_capacity(7);
    for i in 0..3 {
        let (p, d) = (wheels.contact_directions[i], wheels.drive_directions[i]);
        let out = |v| state.body_quaternion * v;
        let contact = state.body_position + out(p * params.ball_radius);
        // Load arrows end at the outside of the wheel, which would otherwise hide them.
        let top = contact + out(p) * (2.0 * params.wheel_radius);
        let load = out(p) * (contacts.wheel_normal_forces[i] * SCALE);
        arrows.push(Arrow { from: top + load, to: top, color: srgb(0x1971c2) });
        let traction = out(d) * (contacts.wheel_tractions[i] * SCALE);
        arrows.push(Arrow { from: contact, to: contact + traction, color: srgb(0x2f9e44) });
    }
    let normal = terrain.map_or(Vector3::z(), |terrain| terrain.normal(state.ball_position.x, state.ball_position.y));
    // Slightly above the ground; the part along the normal would be inside the ball.
    let from = state.ball_position - normal * (0.98 * params.ball_radius);
    let force = (contacts.floor_force - normal * contacts.floor_force.dot(&normal)) * SCALE;
    arrows.push(Arrow { from, to: from + force, color: srgb(0xe03131) });
    arrows
}
