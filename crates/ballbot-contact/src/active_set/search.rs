//! Search through all modes of the wheels, for robots whose modes do not repeat.

use super::conditions::{Conditions, Solution};
use super::modes::{FloorMode, JointModes, Modes, WheelModes};
use crate::delassus::Delassus;
use crate::friction::{Friction, JointFriction};
use crate::types::PerRow;
use ballbot_base::lanes::{Cell, Lane, Value, run_one};
use ballbot_base::wheels::{WHEELS, Wheels};

/// Largest number of changes of the modes of floor and joints for given modes of the wheels.
const MOST_STEPS: usize = 8;

/// Modes of one wheel, as closed, slips and the sign of its slope, in the order of the search.
const MODES: [(bool, bool, f64); 4] = [(true, false, 1.0), (true, true, 1.0), (true, true, -1.0), (false, true, 1.0)];

/// Conditions in memory.
struct Stored<C> {
    delassus: Delassus<C, C>,
    residuals: PerRow<C>,
    friction: Friction<C>,
    joint_friction: JointFriction<C>,
    static_impulse: C,
}

/// Searches for robots with `open`; the others keep `impulses`.
#[inline(always)]
pub fn search<const JOINTS: bool, L: Lane, V: Value<L>>(
    conditions: &Conditions<L, V>,
    open: L::Mask,
    impulses: PerRow<L>,
    token: L::Token,
) -> Solution<L> {
    let like = conditions.static_impulse;
    let store = |value: &L| {
        let mut cell = L::Cell::default();
        value.store(&mut cell);
        cell
    };
    let stored = Stored {
        delassus: conditions.delassus.map(store, |constant| store(&constant.at(like))),
        residuals: conditions.residuals.map(store),
        friction: conditions.friction.map(store),
        joint_friction: conditions.joint_friction.map(store),
        static_impulse: store(&like),
    };
    let mut found = impulses.map(store);
    let mut unsolved = store(&L::select(open, like.splat(1.0), like.zero()));
    each::<JOINTS, L::Cell>(&stored, &mut unsolved, &mut found);
    Solution { impulses: found.load(token), searched: open, unsolved: like.zero().lt(L::load(token, &unsolved)) }
}

/// Searches for the robots with 1 in `unsolved`, and leaves 1 for those without solution.
#[cold]
#[inline(never)]
fn each<const JOINTS: bool, C: Cell>(stored: &Stored<C>, unsolved: &mut C, impulses: &mut PerRow<C>) {
    for i in 0..C::WIDTH {
        if unsolved.get(i) == 0.0 {
            continue;
        }
        let conditions = Conditions {
            delassus: &stored.delassus.map(|cell| cell.get(i), |cell| cell.get(i)),
            residuals: &stored.residuals.lane(i),
            friction: &stored.friction.lane(i),
            joint_friction: &stored.joint_friction.lane(i),
            static_impulse: stored.static_impulse.get(i),
        };
        let last = impulses.lane(i);
        let (found, solved) = run_one(
            #[inline(always)]
            || best::<JOINTS>(&conditions, last),
        );
        if solved {
            unsolved.set(i, 0.0);
        }
        impulses.set_lane(i, &found);
    }
}

/// The first solution in the order of the modes. Without a solution, the impulses that violate the conditions least;
/// `last` if no impulses are finite. Also returns whether they are a solution.
#[inline(always)]
fn best<const JOINTS: bool>(conditions: &Conditions<f64, f64>, last: PerRow<f64>) -> (PerRow<f64>, bool) {
    let mut best = (last, f64::INFINITY);
    let (friction, floor) = (conditions.friction, conditions.floor());
    // Most often floor and joints need at most one mode change.
    for most_steps in [2, MOST_STEPS] {
        for code in 0..MODES.len().pow(WHEELS as u32) {
            let wheels = Wheels([code % 4, code / 4 % 4, code / 16]).map(
                #[inline(always)]
                |mode| MODES[mode],
            );
            let Wheels([(c0, s0, d0), (c1, s1, d1), (c2, s2, d2)]) = wheels;
            let [m0, m1, m2] = friction.wheels.0;
            let mut modes = Modes {
                wheels: WheelModes {
                    closed: Wheels([c0, c1, c2]),
                    slips: Wheels([s0, s1, s2]),
                    slopes: Wheels([d0 * m0, d1 * m1, d2 * m2]),
                },
                floor: FloorMode { closed: true, slips: false, direction: [0.0; 2], share: 1.0 },
                // Without dry friction a joint cannot stick.
                joints: JointModes {
                    sticks: Wheels::all(0.0 < conditions.joint_friction.dry),
                    dry: Wheels::all(conditions.joint_friction.dry),
                },
            };
            for _ in 0..most_steps {
                let attempt = conditions.solve::<JOINTS>(&floor, &modes, 1.0);
                if attempt.solved {
                    return (attempt.impulses, true);
                }
                if attempt.violation < best.1 && attempt.finite {
                    best = (attempt.impulses, attempt.violation);
                }
                let next = Modes::of(&attempt.trial, friction, conditions.joint_friction);
                if next.floor == modes.floor && next.joints == modes.joints {
                    break;
                }
                modes = Modes { wheels: modes.wheels, ..next };
            }
        }
    }
    (best.0, false)
}
