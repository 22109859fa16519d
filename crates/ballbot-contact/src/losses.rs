//! Rolling and spinning friction of the ball on the floor, and friction of the rollers.
//!
//! Their impulses act before the rest of the step, with the loads of the previous step. Each removes at most the
//! fraction of its speed that all together can remove without adding energy: see `docs/derivations.md`.

use super::constants::{Constants, at3};
use super::phases::Start;
use super::state::ContactState;
use super::types::Velocities;
use ballbot_base::lanes::{Lane, Value, Vec3};
use ballbot_base::wheels::WHEELS;

/// Brakes the robots that have these losses.
#[inline(always)]
pub fn brake<L: Lane, V: Value<L>>(c: &Constants<V>, token: L::Token, state: &mut ContactState<L::Cell>) {
    let share = c.loss_share.at(L::load(token, &state.steps));
    let zero = share.zero();
    if !L::any(zero.lt(share)) {
        return;
    }
    let Start { velocities: before, rows, rotation, .. } = Start::new::<false, V>(c, token, state);
    let like = before.ball.x;
    let inclined = zero.lt(c.inclined.at(like));
    let any_inclined = L::any(inclined);
    let rows = rows.with_inclined_rollers(c, &rotation);
    let tiny = like.splat(f64::MIN_POSITIVE);
    let loads = state.impulses::<L>(token);
    let mut after = before;

    // Fractions of the ball's rates.
    let floor_load = loads.floor[0].max(zero);
    let Vec3 { x, y, z } = before.ball_rate;
    let rolling = x.mul_add(x, y.squared()).sqrt();
    let of_rolling = (c.rolling_loss.at(like) * floor_load / rolling.max(tiny)).min(share);
    let of_spinning = (c.spinning_loss.at(like) * floor_load / z.abs().max(tiny)).min(share);
    after.ball_rate =
        Vec3::new(of_rolling.neg_mul_add(x, x), of_rolling.neg_mul_add(y, y), of_spinning.neg_mul_add(z, z));

    let mut impulse = Vec3::zero(like);
    let (mut on_ball, mut on_body) = (impulse, impulse);
    for i in 0..WHEELS {
        let direction = rows.turns[i];
        let mut arm = rows.free_arm(c, &rotation, i);
        let mut rim = zero;
        if any_inclined {
            // A wheel with inclined rollers also moves along their free direction where it turns.
            let [cos, sin] = c.roller_axis;
            let (cos, sin) = (cos.at(like), sin.at(like));
            rim = L::select(inclined, -rows.spin_shares[i] * sin / cos * c.wheel_radius.at(like), zero);
            arm = Vec3::select(inclined, arm.plus(c.u(i, like), rim), arm);
        }
        let moved = arm.scaled_by(at3(c.body_inertia_inverse, like));
        let mut compliance = moved.dot(arm) + c.relative_mass_inverse.at(like) + c.ball_surface_compliance.at(like);
        let of_body = direction.dot(before.body - before.ball) + arm.dot(before.body_rate);
        let mut speed = rows.drives[i].dot(before.ball_rate).mul_add(c.ball_radius.at(like), of_body);
        if any_inclined {
            let with_spin = rim.squared().mul_add(c.wheel_inertia_inverse.at(like), compliance);
            compliance = L::select(inclined, with_spin, compliance);
            speed = L::select(inclined, rim.mul_add(before.spins[i], speed), speed);
        }
        let grown = speed.abs().mul_add(c.roller_friction_slope.at(like), c.roller_friction.at(like));
        let most = grown.min(c.wheel_dynamic_friction.at(like)) * loads.normals[i].max(zero);
        let amount = speed * -(most / speed.abs().max(tiny)).min(share / compliance);
        impulse = impulse.plus(direction, amount);
        on_ball = on_ball.plus(rows.drives[i], amount);
        on_body = on_body.plus(arm, amount);
        if any_inclined {
            let spin = (rim * amount).mul_add(c.wheel_inertia_inverse.at(like), after.spins[i]);
            after.spins[i] = L::select(inclined, spin, after.spins[i]);
        }
    }
    after.ball = after.ball.plus(impulse, -c.ball_mass_inverse.at(like));
    after.ball_rate = after.ball_rate.plus(on_ball, c.ball_rim_ratio.at(like));
    after.body = after.body.plus(impulse, c.body_mass_inverse.at(like));
    after.body_rate += on_body.scaled_by(at3(c.body_inertia_inverse, like));

    let moves = zero.lt(share) & L::load(token, &state.diverged).le(zero);
    state.set_velocities(&Velocities::select(moves, &after, &before));
}
