//! Contacts between the robots of a scene.

use super::world::{BALL, PLANE, WHEEL};
use rapier3d_f64::prelude::*;

/// Friction and restitution between robots.
///
/// Colliders of a robot in a scene of several have its number, from 1, as user data; colliders of obstacles have 0.
#[derive(Clone, Copy, Debug, Default)]
pub struct Between {
    /// Coulomb's coefficient.
    pub friction: f64,
    /// Coefficient of restitution.
    pub restitution: f64,
}

impl PhysicsHooks for Between {
    fn filter_contact_pair(&self, context: &PairFilterContext) -> Option<SolverFlags> {
        let pair = [context.collider1, context.collider2].map(|handle| &context.colliders[handle]);
        let groups = pair.map(|collider| collider.collision_groups().memberships);
        let is = |i: usize, group: Group| groups[i].intersects(group);
        let excluded = if are_of_two_robots(pair) {
            // Each robot has its own planes.
            is(0, PLANE) || is(1, PLANE)
        } else {
            is(0, BALL) && is(1, WHEEL) || is(0, WHEEL) && is(1, BALL)
        };
        (!excluded).then(SolverFlags::default)
    }

    fn modify_solver_contacts(&self, context: &mut ContactModificationContext) {
        let pair = [context.collider1, context.collider2].map(|handle| &context.colliders[handle]);
        if let (true, Some(contact)) = (are_of_two_robots(pair), context.rigid_mut()) {
            *contact.friction = self.friction;
            *contact.restitution = self.restitution;
        }
    }
}

fn are_of_two_robots(pair: [&Collider; 2]) -> bool {
    let [a, b] = pair.map(|collider| collider.user_data);
    a != b && a != 0 && b != 0
}
