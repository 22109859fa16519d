//! The payloads that move on the body: their motion in a step, and their reaction on the body.

use super::constants::{Constants, at3};
use super::state::ContactState;
use ballbot_base::lanes::{Lane, Value, Vec3};
use ballbot_base::payload::{Payload, PayloadMotion};

/// Largest square of the speed of a payload that has not diverged, m²/s².
const MAX_SPEED_SQUARED: f64 = 1e30;

/// Moves payload `index` over a step, and adds its reaction to the push of the step; in the inertial frame.
#[inline(always)]
pub fn carry<L: Lane, V: Value<L>>(c: &Constants<V>, token: L::Token, state: &mut ContactState<L::Cell>, index: usize) {
    let like = L::load(token, &state.steps);
    let payload = of_lanes(&c.payloads[index], like);
    let moves = payload.exists() & L::load(token, &state.diverged).le(like.zero());
    if !L::any(moves) {
        return;
    }
    let dt = c.sim_dt.at(like);
    let body = state.lane_state(token, c);
    let before = state.payloads[index].load::<L>(token);
    let force = payload.force(&payload.deflection(&body, &before), before.offset, like * dt);
    let impulse = body.body_quaternion.rotation().apply(force) * dt;
    let velocity = before.velocity.plus(impulse, like.splat(1.0) / payload.mass) - Vec3::from(at3(c.gravity_dt, like));
    let after = PayloadMotion { position: before.position.plus(velocity, dt), velocity, ..before };
    // A body with such a payload diverges in this step and keeps its state.
    let stays = moves & velocity.norm_squared().lt(like.splat(MAX_SPEED_SQUARED));
    state.payloads[index].store(&PayloadMotion::select(stays, &after, &before));

    let com = Vec3::load(token, &state.body_position);
    let moment = impulse.cross(before.position - com);
    let reaction = -impulse;
    let sums = [reaction.x, reaction.y, reaction.z, moment.x, moment.y, moment.z];
    for (cell, more) in state.push.iter_mut().zip(sums) {
        let pushed = L::load(token, cell);
        L::select(moves, pushed + more, pushed).store(cell);
    }
}

#[inline(always)]
fn of_lanes<L: Lane, V: Value<L>>(payload: &Payload<V>, like: L) -> Payload<L> {
    payload.map(
        #[inline(always)]
        |value| value.at(like),
    )
}
