//! Modes of the contacts, and their computation from trial impulses.

use crate::friction::{Friction, JointFriction};
use crate::types::PerRow;
use ballbot_base::lanes::Lane;
use ballbot_base::wheels::Wheels;

/// Mode of each contact.
#[derive(Clone, Copy)]
pub struct Modes<L: Lane> {
    pub wheels: WheelModes<L>,
    pub floor: FloorMode<L>,
    pub joints: JointModes<L>,
}

/// Modes of the wheels on the ball.
#[derive(Clone, Copy)]
pub struct WheelModes<L: Lane> {
    pub closed: Wheels<L::Mask>,
    pub slips: Wheels<L::Mask>,
    /// Drive impulse per normal impulse of a slipping wheel.
    pub slopes: Wheels<L>,
}

/// Mode of the ball on the floor.
#[derive(Clone, Copy, PartialEq)]
pub struct FloorMode<L: Lane> {
    pub closed: L::Mask,
    pub slips: L::Mask,
    /// Direction of the friction of a slipping ball; zero for a sticking ball.
    pub direction: [L; 2],
    /// Change of the friction per change of the sticking friction across the direction; 1 for a sticking ball.
    pub share: L,
}

/// Modes of dry joint friction.
#[derive(Clone, Copy, PartialEq)]
pub struct JointModes<L: Lane> {
    pub sticks: Wheels<L::Mask>,
    /// Angular impulse of dry friction of a moving joint.
    pub dry: Wheels<L>,
}

impl<L: Lane> Modes<L> {
    /// Modes from trial impulses. A trial impulse would bring its row to rest by itself: impulse minus residual times
    /// the row's mass.
    #[inline(always)]
    pub fn of(trial: &PerRow<L>, friction: &Friction<L>, joint_friction: &JointFriction<L>) -> Self {
        Self {
            wheels: WheelModes::of(trial, friction),
            floor: FloorMode::of(trial.floor, friction.floor),
            joints: JointModes::of(&trial.joints, joint_friction),
        }
    }
}

impl<L: Lane> WheelModes<L> {
    #[inline(always)]
    fn of(trial: &PerRow<L>, friction: &Friction<L>) -> Self {
        let zero = friction.floor.zero();
        let closed = |i: usize| zero.lt(trial.normals[i]);
        let slips = |i: usize| (friction.wheels[i] * trial.normals[i].max(zero)).lt(trial.drives[i].abs());
        let slope = |i: usize| L::select(trial.drives[i].lt(zero), -friction.wheels[i], friction.wheels[i]);
        Self {
            closed: Wheels::from_fn(closed),
            // An open wheel has zero drive impulse: a slope times zero load.
            slips: Wheels([slips(0) | !closed(0), slips(1) | !closed(1), slips(2) | !closed(2)]),
            slopes: Wheels::from_fn(slope),
        }
    }
}

impl<L: Lane> FloorMode<L> {
    #[inline(always)]
    pub fn of([normal, x, y]: [L; 3], friction: L) -> Self {
        let (zero, one) = (friction.zero(), friction.splat(1.0));
        let closed = zero.lt(normal);
        let limit = friction * normal.max(zero);
        let squared = x.mul_add(x, y.squared());
        let slips = limit.squared().lt(squared);
        let mut mode = Self { closed, slips, direction: [zero; 2], share: one };
        // The branch skips a root and a division; lanes that stick keep their bits either way.
        if L::any(slips & closed) {
            let inverse = one / squared.sqrt();
            mode.direction = [L::select(slips, x * inverse, zero), L::select(slips, y * inverse, zero)];
            mode.share = L::select(slips, limit * inverse, one);
        }
        mode
    }
}

impl<L: Lane> JointModes<L> {
    #[inline(always)]
    fn of(trial: &Wheels<L>, friction: &JointFriction<L>) -> Self {
        let zero = friction.dry.zero();
        let sticks = |i: usize| trial[i].abs().le(friction.dry) & zero.lt(friction.dry);
        let dry = |i: usize| L::select(trial[i].lt(zero), -friction.dry, friction.dry);
        Self { sticks: Wheels::from_fn(sticks), dry: Wheels::from_fn(dry) }
    }
}
