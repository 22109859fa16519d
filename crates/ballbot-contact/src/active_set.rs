//! The impulses that meet the contact conditions: a primal-dual active set, which is a semismooth Newton method.
//!
//! Each contact has a mode: open or closed, and sticking or slipping. For given modes the conditions are linear. The
//! floor's rows do not couple with each other, so the floor is eliminated in closed form, and the wheel joints by a 3 ×
//! 3 matrix. Six equations for the wheels remain. A solution whose modes repeat is exact. The slip direction of the
//! floor is linearized, so it converges quadratically. Derivation: `docs/derivations.md`, "Active set".
//!
//! Newton's method for complementarity as an active set: M. Hintermüller, K. Ito, K. Kunisch, SIAM J. Optim. 13 (2002),
//! pp. 865-888.

mod attempt;
mod conditions;
mod elimination;
mod modes;
mod search;

pub use conditions::{Conditions, Solution};
pub use modes::Modes;

use super::types::{PerRow, select3};
use ballbot_base::lanes::{Lane, Value};
use ballbot_base::wheels::Wheels;
use search::search;

/// Largest fraction of the friction bound in a step after which a robot is taken to grip again.
const GRIP_SHARE: f64 = 1.0 - 1e-9;

/// Largest number of changes of the modes per round. Chosen by experiment.
const MOST_STEPS: usize = 5;

/// Changes of the modes with full weight of the slip speeds. Chosen by experiment.
const DIRECT_STEPS: usize = 3;

/// Weight of the slip speeds in later changes ([`Conditions::solve`]). Chosen by experiment.
const CAREFUL_WEIGHT: f64 = 0.1;

/// Largest number of rounds before all modes are tried. Chosen by experiment.
const ROUNDS: usize = 3;

/// Gauss-Seidel sweeps between two rounds. Chosen by experiment.
const SWEEPS: usize = 8;

impl<L: Lane, V: Value<L>> Conditions<'_, L, V> {
    /// Impulses of the robots in `open` that meet the conditions, by steps from `warm`; the others keep `warm`.
    #[inline(always)]
    pub fn solution<const JOINTS: bool>(&self, token: L::Token, warm: &PerRow<L>, mut open: L::Mask) -> Solution<L> {
        let floor = self.floor();
        let mut impulses = *warm;
        for round in 0..ROUNDS {
            let mut trial =
                if round == 0 { self.first_trial::<JOINTS>(warm) } else { self.swept::<JOINTS>(open, &mut impulses) };
            for step in 0..MOST_STEPS {
                let weight = if round == 0 && step < DIRECT_STEPS { 1.0 } else { CAREFUL_WEIGHT };
                let modes = Modes::of(&trial, self.friction, self.joint_friction);
                let attempt = self.solve::<JOINTS>(&floor, &modes, weight);
                // Robots whose conditions are met keep their impulses while their neighbors continue.
                impulses = PerRow::select(open & attempt.finite, &attempt.impulses, &impulses);
                open = open & !attempt.solved;
                if !L::any(open) {
                    return Solution { impulses, searched: open, unsolved: open };
                }
                trial = attempt.trial;
            }
        }
        search::<JOINTS, L, V>(self, open, impulses, token)
    }

    /// Trial impulses from the impulses of the last step. Robots that gripped in the last step are taken to grip in
    /// this step: their trial impulses are the impulses of the last step. With friction above 1, several modes may meet
    /// the conditions; then each wheel keeps its mode, so that a robot does not change mode without a cause.
    #[inline(always)]
    fn first_trial<const JOINTS: bool>(&self, last: &PerRow<L>) -> PerRow<L> {
        let friction = self.friction;
        let (zero, one) = (friction.floor.zero(), friction.floor.splat(1.0));
        let [z, x, y] = last.floor;
        let limit = friction.floor * z * GRIP_SHARE;
        let grips_floor = zero.lt(z) & x.mul_add(x, y.squared()).le(limit.squared());
        let mut grips = Wheels::all(grips_floor);
        let (mut all, mut several) = (grips_floor, one.lt(friction.floor));
        for (i, grip) in grips.iter_mut().enumerate() {
            let limit = friction.wheels[i] * last.normals[i] * GRIP_SHARE;
            *grip = zero.lt(last.normals[i]) & last.drives[i].abs().le(limit);
            all = all & *grip;
            several = several | one.lt(friction.wheels[i]);
        }
        if !JOINTS && !L::any(!all) {
            return *last;
        }
        let mut residuals = *self.residuals;
        self.delassus.add_effect::<JOINTS>(last, &mut residuals);
        let trial = self.trial::<JOINTS>(last, &residuals);
        let mut first = PerRow { joints: trial.joints, ..PerRow::select(all, last, &trial) };
        if L::any(several) {
            first.floor = select3(several & grips_floor, last.floor, first.floor);
            first.normals = Wheels::select(several, last.normals, first.normals);
            for (i, grip) in grips.into_iter().enumerate() {
                // Twice the bound of friction for a wheel that slipped.
                let kept = L::select(grip, last.drives[i], last.drives[i] + last.drives[i]);
                first.drives[i] = L::select(several, kept, first.drives[i]);
            }
        }
        first
    }

    /// Trial impulses after sweeps, for impulses whose modes cycle.
    #[inline(always)]
    fn swept<const JOINTS: bool>(&self, open: L::Mask, impulses: &mut PerRow<L>) -> PerRow<L> {
        let mut residuals = *self.residuals;
        self.delassus.add_effect::<JOINTS>(impulses, &mut residuals);
        let (mut swept, mut estimate) = (*impulses, impulses.normals);
        for _ in 0..SWEEPS {
            self.delassus.sweep::<JOINTS>(
                self.friction,
                self.joint_friction,
                &mut estimate,
                &mut swept,
                &mut residuals,
            );
        }
        *impulses = PerRow::select(open, &swept, impulses);
        self.trial::<JOINTS>(&swept, &residuals)
    }
}
