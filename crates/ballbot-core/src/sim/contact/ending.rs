//! Velocities and impulses at the end of a step.

use super::active_set::Conditions;
use super::body_contacts::Near;
use super::constants::Constants;
use super::delassus::Delassus;
use super::friction::{Friction, JointFriction};
use super::phases::{Start, free_velocities};
use super::state::{ContactState, Torques};
use super::types::{PerRow, Velocities};
use crate::lanes::{Lane, Value};

/// The end of a step, before the robot is moved.
pub struct End<L> {
    pub velocities: Velocities<L>,
    pub impulses: PerRow<L>,
    /// 1 for robots that touch the floor, else 0.
    pub on_floor: L,
}

impl<L: Lane> End<L> {
    /// Selection of `yes` where `mask` is true, of `no` elsewhere.
    #[inline(always)]
    pub fn select(mask: L::Mask, yes: &Self, no: &Self) -> Self {
        Self {
            velocities: Velocities::select(mask, &yes.velocities, &no.velocities),
            impulses: PerRow::select(mask, &yes.impulses, &no.impulses),
            on_floor: L::select(mask, yes.on_floor, no.on_floor),
        }
    }
}

/// The end of a step of the robots in `robots`, of all of them without; it means nothing for the others.
#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "a step has these parts, and a struct of them would be in memory")]
pub fn ended<L: Lane, V: Value<L>, const JOINTS: bool, const NEAR: bool>(
    c: &Constants<V>,
    token: L::Token,
    state: &mut ContactState<L::Cell>,
    torques: &Torques<L::Cell>,
    start: &Start<L>,
    joint_friction: &JointFriction<L>,
    near: &Near<L>,
    robots: Option<L::Mask>,
) -> End<L> {
    let friction = Friction::new(c, &start.rows, &start.velocities);
    let mut velocities = free_velocities(c, token, state, start, torques);
    let like = velocities.ball.x;
    let conditions = Conditions {
        delassus: &Delassus::new::<JOINTS>(c, &start.rows),
        residuals: &start.rows.residuals(c, &velocities),
        friction: &friction,
        joint_friction,
        static_impulse: c.static_wheel_load.at(like) * c.sim_dt.at(like),
    };
    let mut impulses = state.impulses(token);
    let mut open = L::load(token, &state.diverged).le(like.zero());
    if let Some(robots) = robots {
        open = open & robots;
    }
    if NEAR {
        open = open & !near.coupled;
    }
    if !NEAR || L::any(open) {
        let solution = conditions.solution::<JOINTS>(token, &impulses, open);
        impulses = solution.impulses;
        if L::any(solution.searched) {
            count(token, solution.searched, like, &mut state.searched_steps);
            count(token, solution.unsolved, like, &mut state.unsolved_steps);
        }
    }
    start.rows.apply::<JOINTS, V>(c, &impulses, &mut velocities);
    let on_floor = if NEAR {
        near.solve::<V, JOINTS>(c, start, &conditions, None, (&mut impulses, &mut velocities))
    } else {
        like.zero()
    };
    End { velocities, impulses, on_floor }
}

/// Adds one for the robots in `mask`.
#[inline(always)]
pub fn count<L: Lane>(token: L::Token, mask: L::Mask, like: L, cell: &mut L::Cell) {
    (L::load(token, cell) + L::select(mask, like.splat(1.0), like.zero())).store(cell);
}
