//! The time step of the contact model. One step, with sections of `docs/derivations.md` in parentheses:
//!
//! ```text
//! velocities = braked(velocities)         rolling, spinning and roller friction               (Losses)
//! rows(pose)                              gaps, normals, drive directions, arms               (Rows)
//! if a rare contact is near: further sweeps with it, by body_contacts                         (Rare contacts)
//! mu   = stribeck(slip(velocities))       friction coefficients at the start of the step      (Friction law)
//! free = velocities + dt M^-1 forces      gravity, motors, push, drag, gyroscopic torque      (Free velocities)
//! W    = J M^-1 J^T                       change of row velocities per impulse                (Delassus matrix)
//! r    = J free + b(gap)                  residuals without impulses                          (Rows)
//! repeat until the modes of the contacts stay:                                                (Active set)
//!     impulses = solution of the linear equations of these modes
//!     modes    = open, sticking or slipping, from the impulses and r + W impulses
//! velocities = free + M^-1 J^T impulses   velocities at the end of the step                   (Active set)
//! pose       = pose + dt velocities       attitudes by rotation vectors                       (Semi-implicit Euler)
//! ```
//!
//! The floor is the plane z = 0. On a terrain a step is computed in the frame of the ground under the ball: [`Footing`].

#[cfg(test)]
mod flops;

use super::active_set::Conditions;
use super::body_contacts::Near;
use super::constants::{Constants, InLanes, at3};
use super::delassus::Delassus;
use super::footing::Footing;
use super::friction::{Friction, JointFriction};
use super::losses::brake;
use super::phases::{Start, finish, free_velocities};
use super::state::{ContactState, Torques};
use super::types::Actions;
use crate::lanes::{Eight, Lane, Scalar, Value, Vec3, Wide, run_one};
use fearless_simd::Simd;

/// Advances one robot by `steps` time steps under constant torques, on level ground without a `footing`.
pub fn advance(
    c: &Constants<f64>,
    state: &mut ContactState<f64>,
    footing: Option<&mut Footing<f64>>,
    torques: &Torques<f64>,
    steps: usize,
) {
    run_one(
        #[inline(always)]
        || several::<f64, f64>(c, Scalar, state, footing, torques, steps),
    );
}

/// Advances eight robots. The result for each is that of [`advance`] to the last bit.
#[inline(always)]
pub fn advance_wide<S: Simd, V: InLanes>(
    simd: S,
    constants: &Constants<V>,
    state: &mut ContactState<Eight>,
    footing: Option<&mut Footing<Eight>>,
    torques: &Torques<Eight>,
    steps: usize,
) {
    V::with(
        constants,
        simd,
        #[inline(always)]
        |c| several::<Wide<S>, V::Wide<S>>(c, simd, state, footing, torques, steps),
    );
}

#[inline(always)]
fn several<L: Lane, V: Value<L>>(
    c: &Constants<V>,
    token: L::Token,
    state: &mut ContactState<L::Cell>,
    mut footing: Option<&mut Footing<L::Cell>>,
    torques: &Torques<L::Cell>,
    steps: usize,
) {
    let mut actions = Actions { torques: *torques, gravity_dt: *torques };
    let like = L::load(token, &state.steps);
    Vec3::from(at3(c.gravity_dt, like)).store(&mut actions.gravity_dt);
    let unusual = L::any(like.zero().lt(c.unusual.at(like)));
    for _ in 0..steps {
        // Apart from the step, which so keeps its registers on level ground.
        if let Some(footing) = &mut footing {
            L::rarely(
                token,
                #[inline(always)]
                || footing.enter(c, token, state, &mut actions.gravity_dt),
            );
        }
        let on_rollers = unusual
            && L::rarely(
                token,
                #[inline(always)]
                || brake_or_roll::<L, V>(c, token, state, footing.as_deref(), &actions),
            );
        if !on_rollers {
            step::<L, V, false>(c, token, state, footing.as_deref(), &actions);
        }
        if let Some(footing) = &footing {
            L::rarely(
                token,
                #[inline(always)]
                || footing.leave::<L>(token, state),
            );
        }
    }
}

/// Brakes robots with losses. If some have wheels with a ripple, it makes the step of all, and returns true.
#[inline(always)]
fn brake_or_roll<L: Lane, V: Value<L>>(
    c: &Constants<V>,
    token: L::Token,
    state: &mut ContactState<L::Cell>,
    footing: Option<&Footing<L::Cell>>,
    actions: &Actions<L::Cell>,
) -> bool {
    brake(c, token, state);
    let ripple = c.ripple_amplitude.at(L::load(token, &state.steps));
    let any = L::any(ripple.zero().lt(ripple));
    if any {
        step::<L, V, true>(c, token, state, footing, actions);
    }
    any
}

/// One step of all robots of the lanes, in the frame of the floor; with `RIPPLE` the wheels of some of them are not round.
#[inline(always)]
fn step<L: Lane, V: Value<L>, const RIPPLE: bool>(
    c: &Constants<V>,
    token: L::Token,
    state: &mut ContactState<L::Cell>,
    footing: Option<&Footing<L::Cell>>,
    actions: &Actions<L::Cell>,
) {
    let start = Start::new::<RIPPLE, V>(c, token, state);
    let near = Near::new(c, &start, token, state, footing);
    if L::any(near.mask) {
        // Nothing but references to memory goes there, so that the usual step keeps its numbers in registers.
        L::rarely(
            token,
            #[inline(always)]
            || {
                let start = Start::new::<RIPPLE, V>(c, token, state);
                let near = Near::new(c, &start, token, state, footing);
                step_from::<L, V, RIPPLE, true>(c, token, state, actions, &start, &near);
            },
        );
    } else {
        step_from::<L, V, RIPPLE, false>(c, token, state, actions, &start, &near);
    }
}

#[inline(always)]
fn step_from<L: Lane, V: Value<L>, const RIPPLE: bool, const NEAR: bool>(
    c: &Constants<V>,
    token: L::Token,
    state: &mut ContactState<L::Cell>,
    actions: &Actions<L::Cell>,
    start: &Start<L>,
    near: &Near<'_, L>,
) {
    let joints = JointFriction::new(c, start.rows.floor_gap);
    // Rows of joints without friction change no bits; so ripple needs no step of its own without them.
    if RIPPLE || joints.any() {
        step_with::<L, V, true, RIPPLE, NEAR>(c, token, state, actions, start, &joints, near);
    } else {
        step_with::<L, V, false, RIPPLE, NEAR>(c, token, state, actions, start, &joints, near);
    }
}

#[inline(always)]
fn step_with<L: Lane, V: Value<L>, const JOINTS: bool, const RIPPLE: bool, const NEAR: bool>(
    c: &Constants<V>,
    token: L::Token,
    state: &mut ContactState<L::Cell>,
    actions: &Actions<L::Cell>,
    start: &Start<L>,
    joint_friction: &JointFriction<L>,
    near: &Near<'_, L>,
) {
    let friction = Friction::new(c, &start.rows, &start.velocities);
    let mut velocities = free_velocities(c, token, state, start, actions);
    let like = velocities.ball.x;
    let conditions = Conditions {
        delassus: &Delassus::new::<JOINTS, RIPPLE>(c, &start.rows),
        residuals: &start.rows.residuals::<RIPPLE, V>(c, &velocities),
        friction: &friction,
        joint_friction,
        static_impulse: c.static_wheel_load.at(like) * c.sim_dt.at(like),
    };
    let mut impulses = state.impulses(token);
    let mut open = L::load(token, &state.diverged).le(like.zero());
    if NEAR {
        open = open & !near.coupled;
    }
    if !NEAR || L::any(open) {
        let solution = conditions.solution::<JOINTS>(token, &impulses, open);
        impulses = solution.impulses;
        if L::any(solution.searched) {
            let one = like.splat(1.0);
            count(token, L::select(solution.searched, one, like.zero()), &mut state.searched_steps);
            count(token, L::select(solution.unsolved, one, like.zero()), &mut state.unsolved_steps);
        }
    }
    start.rows.apply::<JOINTS, RIPPLE, V>(c, &impulses, &mut velocities);
    let on_floor = if NEAR {
        near.solve::<V, JOINTS, RIPPLE>(c, start, &conditions, (&mut impulses, &mut velocities))
    } else {
        like.zero()
    };
    finish(c, token, state, start, (&velocities, &impulses), on_floor);
}

#[inline(always)]
fn count<L: Lane>(token: L::Token, more: L, cell: &mut L::Cell) {
    (L::load(token, cell) + more).store(cell);
}
