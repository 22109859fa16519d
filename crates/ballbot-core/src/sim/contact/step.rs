//! One time step, and many.

#[cfg(test)]
mod flops;

use super::body_contacts;
use super::constants::{Constants, InLanes};
use super::phases::{Start, finish, free_velocities, friction};
use super::solve::{Delassus, JointFriction, MOST_SWEEPS, SWEEPS};
use super::state::{ContactState, Torques};
use super::types::{PerRow, select3};
use crate::lanes::{EIGHT, Eight, Lane, Scalar, Value, Wide, run_one};
use fearless_simd::Simd;

/// Advances one robot by `steps` time steps under constant torques.
pub fn advance(c: &Constants<f64>, state: &mut ContactState<f64>, torques: &Torques<f64>, steps: usize) {
    run_one(
        #[inline(always)]
        || {
            for _ in 0..steps {
                advance_one(c, state, torques);
            }
        },
    );
}

#[inline(always)]
fn advance_one(c: &Constants<f64>, state: &mut ContactState<f64>, torques: &Torques<f64>) {
    if !step::<f64, f64>(c, Scalar, state, torques) {
        body_contacts::step(c, state, torques);
    }
}

/// Advances eight robots; each moves as [`advance`] would move it, to the last bit.
#[inline(always)]
pub fn advance_wide<S: Simd, V: InLanes>(
    simd: S,
    constants: &Constants<V>,
    state: &mut ContactState<Eight>,
    torques: &Torques<Eight>,
    steps: usize,
) {
    V::with(
        constants,
        simd,
        #[inline(always)]
        |c| {
            for _ in 0..steps {
                if !step::<Wide<S>, V::Wide<S>>(c, simd, state, torques) {
                    one_by_one(constants, state, torques);
                }
            }
        },
    );
}

/// A step of eight robots, one after the other.
#[cold]
pub fn one_by_one<V: InLanes>(constants: &Constants<V>, state: &mut ContactState<Eight>, torques: &Torques<Eight>) {
    for i in 0..EIGHT {
        let mut one = state.lane(i);
        let c = constants.map(|value| value.lane(i));
        advance(&c, &mut one, &[torques[0].0[i], torques[1].0[i], torques[2].0[i]], 1);
        state.set_lane(i, &one);
    }
}

/// One step of robots that need no contact of [`body_contacts`]; false, and nothing done, if one does.
#[inline(always)]
fn step<L: Lane, V: Value<L>>(
    c: &Constants<V>,
    token: L::Token,
    state: &mut ContactState<L::Cell>,
    torques: &Torques<L::Cell>,
) -> bool {
    let start = Start::new(c, token, state);
    if L::any(body_contacts::near(c, &start, token, &state.push)) {
        return false;
    }
    let joint_friction = JointFriction::new(c, start.rows.floor_gap);
    if joint_friction.any() {
        step_on_ball::<L, V, true>(c, token, state, torques, &start, &joint_friction);
    } else {
        step_on_ball::<L, V, false>(c, token, state, torques, &start, &joint_friction);
    }
    true
}

#[inline(always)]
fn step_on_ball<L: Lane, V: Value<L>, const JOINTS: bool>(
    c: &Constants<V>,
    token: L::Token,
    state: &mut ContactState<L::Cell>,
    torques: &Torques<L::Cell>,
    start: &Start<L>,
    joint_friction: &JointFriction<L>,
) {
    let friction = friction(c, &start.rows, &start.velocities);
    let free = free_velocities(c, token, state, start, torques);
    let delassus = Delassus::new::<JOINTS>(c, &start.rows);
    let mut impulses = state.impulses(token);
    let mut residuals = start.rows.residuals(c, &free);
    delassus.add_effect::<JOINTS>(&impulses, &mut residuals);
    let mut normal_estimate = impulses.normals;
    let mut old = impulses;
    for _ in 0..SWEEPS {
        old = impulses;
        delassus.sweep::<JOINTS>(&friction, joint_friction, &mut normal_estimate, &mut impulses, &mut residuals);
    }
    let mut open = Delassus::<L, V>::unsettled(c, &old, &impulses);
    let mut sweeps = SWEEPS;
    while L::any(open) && sweeps < MOST_SWEEPS {
        // Robots that have settled keep what they have, whatever their neighbors need.
        let (old, old_residuals, old_estimate) = (impulses, residuals, normal_estimate);
        delassus.sweep::<JOINTS>(&friction, joint_friction, &mut normal_estimate, &mut impulses, &mut residuals);
        let still = Delassus::<L, V>::unsettled(c, &old, &impulses);
        impulses = PerRow::select(open, &impulses, &old);
        residuals = PerRow::select(open, &residuals, &old_residuals);
        normal_estimate = select3(open, normal_estimate, old_estimate);
        open = open & still;
        sweeps += 1;
    }
    finish::<L, V, JOINTS>(c, token, state, start, (free, impulses), free.ball.x.zero());
}
