//! The time step where a robot of the lanes has rolling, spinning or roller friction.

use super::active_set::Conditions;
use super::body_contacts::Near;
use super::constants::Constants;
use super::delassus::Delassus;
use super::ending::{End, count, ended};
use super::friction::{Friction, JointFriction};
use super::losses::{Lossy, Rollers, all_impulses, apply, parted, problem, speeds};
use super::phases::{Start, finish, free_velocities};
use super::state::{ContactState, Torques};
use crate::lanes::{Lane, Value};

/// One step of all robots of the lanes. Those without losses have the step of lanes without any.
#[inline(always)]
pub fn lossy_step<L: Lane, V: Value<L>>(
    c: &Constants<V>,
    token: L::Token,
    state: &mut ContactState<L::Cell>,
    torques: &Torques<L::Cell>,
) {
    let start = Start::new(c, token, state);
    let near = Near::new(c, &start, token, &state.push);
    let zero = start.rows.floor_gap.zero();
    let lossy = zero.lt(c.lossy.at(zero));
    let mut end = lossy_end(c, token, state, torques, &start, &near, lossy);
    if L::any(!lossy) {
        let joints = JointFriction::new(c, start.rows.floor_gap);
        let other = ended::<L, V, true, true>(c, token, state, torques, &start, &joints, &near, Some(!lossy));
        end = End::select(lossy, &end, &other);
    }
    finish(c, token, state, &start, (&end.velocities, &end.impulses), end.on_floor);
}

/// The end of a step of the robots in `lossy`.
#[inline(always)]
fn lossy_end<L: Lane, V: Value<L>>(
    c: &Constants<V>,
    token: L::Token,
    state: &mut ContactState<L::Cell>,
    torques: &Torques<L::Cell>,
    start: &Start<L>,
    near: &Near<L>,
    lossy: L::Mask,
) -> End<L> {
    let friction = Friction::new(c, &start.rows, &start.velocities);
    let joint_friction = JointFriction::new(c, start.rows.floor_gap);
    let mut velocities = free_velocities(c, token, state, start, torques);
    let like = velocities.ball.x;
    let delassus = Delassus::new::<true>(c, &start.rows);
    let rollers = Rollers::new(c, start);
    let residuals = speeds(c, &start.rows, &rollers, &velocities);
    let problem = problem(c, start, &rollers, &delassus, (&friction, &joint_friction), residuals);

    let mut impulses = state.impulses(token);
    let mut extra = [[like.zero(); 3]; 2];
    let open = lossy & L::load(token, &state.diverged).le(like.zero()) & !near.coupled;
    if L::any(open) {
        let solution = problem.solution(&all_impulses(c, &impulses, &extra), open);
        (impulses, extra) = parted(c, &solution.impulses);
        if L::any(solution.unsolved) {
            count(token, solution.unsolved, like, &mut state.searched_steps);
            count(token, solution.unsolved, like, &mut state.unsolved_steps);
        }
    }
    start.rows.apply::<true, V>(c, &impulses, &mut velocities);
    apply(c, &rollers, &extra, &mut velocities);
    let mut on_floor = like.zero();
    if L::any(near.mask) {
        let conditions = Conditions {
            delassus: &delassus,
            residuals: &start.rows.residuals(c, &velocities),
            friction: &friction,
            joint_friction: &joint_friction,
            static_impulse: problem.static_impulse,
        };
        let losses = Lossy { problem: &problem, rollers: &rollers, extra };
        on_floor = near.solve::<V, true>(c, start, &conditions, Some(&losses), (&mut impulses, &mut velocities));
    }
    End { velocities, impulses, on_floor }
}
