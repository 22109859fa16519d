//! The time step of the contact model. One step, with sections of `docs/derivations.md` in parentheses:
//!
//! ```text
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
//! Robots with rolling, spinning or roller friction have more rows and another solver of them (Losses).

#[cfg(test)]
mod flops;

use super::body_contacts::Near;
use super::constants::{Constants, InLanes};
use super::ending::ended;
use super::friction::JointFriction;
use super::lossy::lossy_step;
use super::phases::{Start, finish};
use super::state::{ContactState, Torques};
use crate::lanes::{Eight, Lane, Scalar, Value, Wide, run_one};
use fearless_simd::Simd;

/// Advances one robot by `steps` time steps under constant torques.
pub fn advance(c: &Constants<f64>, state: &mut ContactState<f64>, torques: &Torques<f64>, steps: usize) {
    run_one(
        #[inline(always)]
        || {
            for _ in 0..steps {
                step::<f64, f64>(c, Scalar, state, torques);
            }
        },
    );
}

/// Advances eight robots. The result for each is that of [`advance`] to the last bit.
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
                step::<Wide<S>, V::Wide<S>>(c, simd, state, torques);
            }
        },
    );
}

/// One step of all robots of the lanes.
#[inline(always)]
fn step<L: Lane, V: Value<L>>(
    c: &Constants<V>,
    token: L::Token,
    state: &mut ContactState<L::Cell>,
    torques: &Torques<L::Cell>,
) {
    let zero = L::from_f64(token, 0.0);
    if L::any(zero.lt(c.lossy.at(zero))) {
        L::rarely(
            token,
            #[inline(always)]
            || lossy_step::<L, V>(c, token, state, torques),
        );
        return;
    }
    let start = Start::new(c, token, state);
    let near = Near::new(c, &start, token, &state.push);
    if L::any(near.mask) {
        // Nothing but references to memory goes there, so that the usual step keeps its numbers in registers.
        L::rarely(
            token,
            #[inline(always)]
            || {
                let start = Start::new(c, token, state);
                let near = Near::new(c, &start, token, &state.push);
                step_from::<L, V, true>(c, token, state, torques, &start, &near);
            },
        );
    } else {
        step_from::<L, V, false>(c, token, state, torques, &start, &near);
    }
}

#[inline(always)]
fn step_from<L: Lane, V: Value<L>, const NEAR: bool>(
    c: &Constants<V>,
    token: L::Token,
    state: &mut ContactState<L::Cell>,
    torques: &Torques<L::Cell>,
    start: &Start<L>,
    near: &Near<L>,
) {
    let joints = JointFriction::new(c, start.rows.floor_gap);
    let end = if joints.any() {
        ended::<L, V, true, NEAR>(c, token, state, torques, start, &joints, near, None)
    } else {
        ended::<L, V, false, NEAR>(c, token, state, torques, start, &joints, near, None)
    };
    finish(c, token, state, start, (&end.velocities, &end.impulses), end.on_floor);
}
