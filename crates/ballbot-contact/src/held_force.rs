//! An external force on the body, as an impulse of each step.

use super::constants::Constants;
use super::footing::Footing;
use super::state::ContactState;
use ballbot_base::lanes::{Lane, Quat, Value, Vec3};

/// Adds the impulse of the force in this step, and its moment about the body's CoM, to the push of the step; in the floor
/// frame.
#[inline(always)]
pub fn hold<L: Lane, V: Value<L>>(
    c: &Constants<V>,
    token: L::Token,
    state: &mut ContactState<L::Cell>,
    footing: Option<&Footing<L::Cell>>,
) {
    let left = L::load(token, &state.force.left);
    if !L::any(left.zero().lt(left)) {
        return;
    }
    let point = Vec3::<L>::load(token, &state.force.point);
    let (mut impulse, acts) = state.force.advance::<L>(token);
    if let Some(footing) = footing {
        impulse = footing.in_frame(token, impulse);
    }
    let rotation = Quat::<L>::load(token, &state.body_quaternion).rotation();
    let in_principal = c.principal_axes(left).rotation().apply_transposed(point);
    let moment = rotation.apply(in_principal - c.com(left)).cross(impulse);
    let sums = [impulse.x, impulse.y, impulse.z, moment.x, moment.y, moment.z];
    for (cell, more) in state.push.iter_mut().zip(sums) {
        let before = L::load(token, cell);
        L::select(acts, before + more, before).store(cell);
    }
}
