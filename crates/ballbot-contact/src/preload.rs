//! The preload of the wheels, as actions of a step.
//!
//! Body and ball pull each other along the mast through the ball's center. Both get their share before the step, so that a
//! step of robots without preload is the same code.

use super::constants::{Constants, at3};
use super::state::ContactState;
use super::types::{Actions, Pose};
use ballbot_base::lanes::{Lane, Value, Vec3};

/// Adds the preload to `actions`, and its moment about the body's CoM to the push of the step; in the floor frame.
#[inline(always)]
pub fn press<L: Lane, V: Value<L>>(
    c: &Constants<V>,
    token: L::Token,
    state: &mut ContactState<L::Cell>,
    actions: &mut Actions<L::Cell>,
) {
    let like = L::load(token, &state.steps);
    let pressed = like.zero().lt(c.has_preload.at(like));
    if !L::any(pressed) {
        return;
    }
    let Pose { ball, body, body_quaternion, .. } = state.pose::<L>(token);
    let rotation = body_quaternion.rotation();
    let from_com = ball - body;
    let offset = from_com + rotation.apply(c.com(like));
    // Farther away the ball has left whatever pressed it on the wheels.
    let held = pressed & offset.norm_squared().le(c.ball_radius.at(like).squared());
    let on_ball = rotation.apply(at3(c.mast, like).into()) * c.preload_impulse.at(like);

    let gravity = Vec3::load(token, &actions.gravity_dt);
    let of_ball = gravity.plus(on_ball, -c.ball_mass_inverse.at(like));
    let of_body = gravity.plus(on_ball, c.body_mass_inverse.at(like));
    Vec3::select(held, of_ball, gravity).store(&mut actions.ball_fall);
    Vec3::select(held, of_body, gravity).store(&mut actions.body_fall);

    let moment = on_ball.cross(from_com);
    let [_, _, _, turn @ ..] = &mut state.push;
    for (cell, moment) in turn.iter_mut().zip([moment.x, moment.y, moment.z]) {
        let before = L::load(token, cell);
        L::select(held, before + moment, before).store(cell);
    }
}
