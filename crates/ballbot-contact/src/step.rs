//! The time step of the contact model. One step, with sections of `docs/derivations.md` in parentheses:
//!
//! ```text
//! velocities = braked(velocities)         rolling, spinning and roller friction               (Losses)
//! forces    += preload                    of the wheels, between body and ball                (Preload)
//! forces    += reaction                   of payloads, which move on their springs              (Payload)
//! forces    += force                      from outside, on the body                           (Outside force)
//! rows(pose)                              gaps, normals, drive directions, arms               (Rows)
//! mu   = stribeck(slip(velocities))       friction coefficients at the start of the step      (Friction law)
//! free = velocities + dt M^-1 forces      gravity, motors, push, drag, gyroscopic torque      (Free velocities)
//! W    = J M^-1 J^T                       change of row velocities per impulse                (Delassus matrix)
//! r    = J free + b(gap)                  residuals without impulses                          (Rows)
//! repeat until the modes of the contacts stay:                                                (Active set)
//!     impulses = solution of the linear equations of these modes
//!     modes    = open, sticking or slipping, from the impulses and r + W impulses
//! velocities = free + M^-1 J^T impulses   velocities at the end of the step                   (Active set)
//! if a rare contact closes with them: sweeps with it, by body_contacts                        (Rare contacts)
//! pose       = pose + dt velocities       attitudes by rotation vectors                       (Semi-implicit Euler)
//! ```
//!
//! The floor is the plane z = 0. On a terrain a step is computed in the frame of the ground under the ball: [`Footing`].

use super::active_set::{Conditions, Solution};
use super::body_contacts::{self, Near};
use super::constants::{Constants, InLanes, at3};
use super::delassus::Delassus;
use super::footing::Footing;
use super::friction::{Friction, JointFriction};
use super::held_force::hold;
use super::losses::brake;
use super::payload::carry;
use super::phases::{Start, finish, free_velocities};
use super::preload::press;
use super::state::ContactState;
use super::types::{Actions, Velocities};
use ballbot_base::lanes::{Eight, Lane, Own, Registers, Scalar, Value, Vec3, Wide, run_one};
use ballbot_base::payload::PAYLOADS;
use ballbot_base::wheels::Wheels;

/// Advances one robot by `steps` time steps under constant torques, on level ground without a `footing`.
pub fn advance(
    c: &Constants<f64>,
    state: &mut ContactState<f64>,
    footing: Option<&mut Footing<f64>>,
    torques: Wheels<f64>,
    steps: usize,
) {
    run_one(
        #[inline(always)]
        || several::<f64, f64>(c, Scalar, state, footing, &torques, steps),
    );
}

/// Advances eight robots. Each result equals the result of [`advance`] to the last bit.
#[inline(always)]
pub fn advance_wide<S: Registers, V: InLanes>(
    simd: S,
    constants: &Constants<V>,
    state: &mut ContactState<Eight>,
    footing: Option<&mut Footing<Eight>>,
    torques: &Wheels<Eight>,
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
    torques: &Wheels<L::Cell>,
    steps: usize,
) {
    let like = L::load(token, &state.steps);
    let mut gravity_dt = [L::Cell::default(); 3];
    Vec3::from(at3(c.gravity_dt, like)).store(&mut gravity_dt);
    let mut actions = Actions::new(gravity_dt, *torques);
    let zero = like.zero();
    // A second payload comes with a first.
    let carries = L::any(zero.lt(c.payloads[0].mass.at(like)));
    // One test of a step: a press or a force is rare.
    let is_loaded = L::any(zero.lt(c.has_preload.at(like)) | zero.lt(L::load(token, &state.force.left)));
    let has_losses_or_rollers = L::any(zero.lt(c.has_losses_or_rollers.at(like)));
    for _ in 0..steps {
        if carries {
            for index in 0..PAYLOADS {
                L::rarely(
                    token,
                    #[inline(always)]
                    || carry(c, token, state, index),
                );
            }
        }
        // Separate from the step, so that the step keeps its registers on level ground.
        if let Some(footing) = &mut footing {
            L::rarely(
                token,
                #[inline(always)]
                || footing.begin(c, token, state, &mut actions),
            );
        }
        if is_loaded {
            L::rarely(
                token,
                #[inline(always)]
                || {
                    press(c, token, state, &mut actions);
                    hold(c, token, state, footing.as_deref());
                },
            );
        }
        let on_rollers = has_losses_or_rollers
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
                || footing.end::<L>(token, state),
            );
        }
    }
}

/// Brakes robots with losses. If some have wheels with a ripple or with inclined rollers, it also runs the step of all
/// robots and returns true.
#[inline(always)]
fn brake_or_roll<L: Lane, V: Value<L>>(
    c: &Constants<V>,
    token: L::Token,
    state: &mut ContactState<L::Cell>,
    footing: Option<&Footing<L::Cell>>,
    actions: &Actions<L::Cell>,
) -> bool {
    brake(c, token, state);
    // Constants that robots share have neither: `LaneConstants::of_all`.
    if !V::PER_ROBOT {
        return false;
    }
    let ripple = c.ripple_amplitude.at(L::load(token, &state.steps));
    let any = L::any(ripple.zero().lt(ripple) | ripple.zero().lt(c.inclined.at(ripple)));
    if any {
        step::<L, V, true>(c, token, state, footing, actions);
    }
    any
}

/// One step of all robots of the lanes, in the floor frame; with `RIPPLE` the wheels of some robots are not round, or their
/// rollers are inclined.
#[inline(always)]
pub fn step<L: Lane, V: Value<L>, const RIPPLE: bool>(
    c: &Constants<V>,
    token: L::Token,
    state: &mut ContactState<L::Cell>,
    footing: Option<&Footing<L::Cell>>,
    actions: &Actions<L::Cell>,
) {
    let start = Start::new::<RIPPLE, V>(c, token, state);
    let near = Near::new(c, &start, token, state, footing);
    if L::any(near.mask) {
        // Only references to memory are passed, so that the usual step keeps its numbers in registers.
        L::rarely(
            token,
            #[inline(always)]
            || step_near::<L>(&c.stored(L::load(token, &state.steps)), token, state, footing, actions),
        );
        return;
    }
    let joints = JointFriction::new(c, start.rows.floor_gap);
    // Joint rows without friction change no bits, so ripple needs no separate step without joint friction.
    if RIPPLE || joints.any() {
        step_with::<L, V, true, RIPPLE>(c, token, state, actions, &start, &joints);
    } else {
        step_with::<L, V, false, RIPPLE>(c, token, state, actions, &start, &joints);
    }
}

#[inline(always)]
fn step_with<L: Lane, V: Value<L>, const JOINTS: bool, const RIPPLE: bool>(
    c: &Constants<V>,
    token: L::Token,
    state: &mut ContactState<L::Cell>,
    actions: &Actions<L::Cell>,
    start: &Start<L>,
    joint_friction: &JointFriction<L>,
) {
    let (velocities, solution) = solve::<L, V, JOINTS, RIPPLE>(c, token, state, actions, start, joint_friction);
    count_searches(token, &solution, state);
    finish(c, token, state, start, (&velocities, &solution.impulses), start.rows.floor_gap.zero());
}

/// A step of robots, some of which are near a rare contact. It is compiled once for each kind of lanes, with all rows
/// that any of the robots may have: for the other robots these rows change no bits.
#[cold]
#[inline(never)]
fn step_near<L: Lane>(
    constants: &Constants<L::Cell>,
    token: L::Token,
    state: &mut ContactState<L::Cell>,
    footing: Option<&Footing<L::Cell>>,
    actions: &Actions<L::Cell>,
) {
    let mut without = state.clone();
    step_without_rare_contacts::<L>(constants, token, state, &mut without, actions);
    body_contacts::finish_near::<L>(constants, token, state, &without, footing, actions);
}

/// Gives `without` the velocities and impulses of `state` after a step in which no rare contact touches.
#[inline(never)]
fn step_without_rare_contacts<L: Lane>(
    constants: &Constants<L::Cell>,
    token: L::Token,
    state: &ContactState<L::Cell>,
    without: &mut ContactState<L::Cell>,
    actions: &Actions<L::Cell>,
) {
    L::rarely(
        token,
        #[inline(always)]
        || {
            let c = &constants.owned::<L>(token);
            let start = Start::new::<true, Own<L>>(c, token, state);
            let joints = JointFriction::new(c, start.rows.floor_gap);
            let (velocities, solution) = solve::<L, Own<L>, true, true>(c, token, state, actions, &start, &joints);
            count_searches(token, &solution, without);
            without.set_velocities(&velocities);
            without.set_impulses(&solution.impulses);
        },
    );
}

/// Velocities and impulses at the end of a step in which no rare contact touches.
#[inline(always)]
fn solve<L: Lane, V: Value<L>, const JOINTS: bool, const RIPPLE: bool>(
    c: &Constants<V>,
    token: L::Token,
    state: &ContactState<L::Cell>,
    actions: &Actions<L::Cell>,
    start: &Start<L>,
    joint_friction: &JointFriction<L>,
) -> (Velocities<L>, Solution<L>) {
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
    let open = L::load(token, &state.diverged).le(like.zero());
    let solution = conditions.solution::<JOINTS>(token, &state.impulses(token), open);
    start.rows.apply::<JOINTS, RIPPLE, V>(c, &solution.impulses, &mut velocities);
    (velocities, solution)
}

#[inline(always)]
pub fn count_searches<L: Lane>(token: L::Token, solution: &Solution<L>, state: &mut ContactState<L::Cell>) {
    if L::any(solution.searched) {
        let zero = solution.impulses.floor[0].zero();
        let one = zero.splat(1.0);
        count(token, L::select(solution.searched, one, zero), &mut state.searched_steps);
        count(token, L::select(solution.unsolved, one, zero), &mut state.unsolved_steps);
    }
}

#[inline(always)]
fn count<L: Lane>(token: L::Token, more: L, cell: &mut L::Cell) {
    (L::load(token, cell) + more).store(cell);
}
