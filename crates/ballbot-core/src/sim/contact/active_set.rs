//! The impulses that meet the contact conditions: a primal-dual active set, which is a semismooth Newton method.
//!
//! Each contact has a mode: open or closed, and sticking or slipping. With the modes given, the conditions are linear.
//! The floor's rows do not couple with each other, so the floor is eliminated in closed form, and the wheel joints by a
//! 3 × 3 matrix. Six equations for the wheels remain. A solution whose modes repeat is exact. The slip direction of the
//! floor is linearized, so it converges quadratically. Derivation: `docs/derivations.md`, "Active set".
//!
//! Newton's method for complementarity as an active set: M. Hintermüller, K. Ito, K. Kunisch, SIAM J. Optim. 13 (2002),
//! pp. 865-888.

mod elimination;
mod search;
#[cfg(test)]
mod tests;

use super::delassus::Delassus;
use super::friction::{Friction, JointFriction, in_disc};
use super::types::PerRow;
use crate::lanes::{Lane, Mat3, Value, Vec3};

use elimination::{Floor, Joints, System};
use search::search;

/// Largest violation of a condition in an accepted solution, as a share of the impulses.
const TOLERANCE: f64 = 1e-12;

/// Largest sine of the change of the floor's slip direction in an accepted solution. The error of the impulses is of
/// second order in it.
const DIRECTION_TOLERANCE: f64 = 1e-7;

/// Largest share of the bound of friction in a step after which a robot is taken to grip again.
const GRIP_SHARE: f64 = 1.0 - 1e-9;

/// Largest number of changes of the modes in a round. Chosen by experiment.
const MOST_STEPS: usize = 5;

/// Changes of the modes with full weight of the slip speeds. Chosen by experiment.
const DIRECT_STEPS: usize = 3;

/// Weight of the slip speeds in later changes ([`Conditions::solve`]). Chosen by experiment.
const CAREFUL_WEIGHT: f64 = 0.1;

/// Largest number of rounds before all modes are tried. Chosen by experiment.
const ROUNDS: usize = 3;

/// Gauss-Seidel sweeps between two rounds. Chosen by experiment.
const SWEEPS: usize = 8;

/// The conditions of one step.
#[derive(Clone, Copy)]
pub struct Conditions<'a, L, V> {
    pub delassus: &'a Delassus<L, V>,
    /// Residuals without impulses.
    pub residuals: &'a PerRow<L>,
    pub friction: &'a Friction<L>,
    pub joint_friction: &'a JointFriction<L>,
    /// Impulse of a wheel's static load in a step, N·s.
    pub static_impulse: L,
}

/// What each contact does.
#[derive(Clone, Copy)]
pub struct Modes<L: Lane> {
    pub wheels: WheelModes<L>,
    pub floor: FloorMode<L>,
    pub joints: JointModes<L>,
}

/// Modes of the wheels on the ball.
#[derive(Clone, Copy)]
pub struct WheelModes<L: Lane> {
    pub closed: [L::Mask; 3],
    pub slips: [L::Mask; 3],
    /// Drive impulse per normal impulse of a slipping wheel.
    pub slopes: [L; 3],
}

/// Mode of the ball on the floor.
#[derive(Clone, Copy, PartialEq)]
pub struct FloorMode<L: Lane> {
    pub closed: L::Mask,
    pub slips: L::Mask,
    /// Direction of the friction of a slipping ball; zero for a sticking one.
    pub direction: [L; 2],
    /// Change of the friction per change of the sticking friction across the direction; 1 for a sticking ball.
    pub share: L,
}

/// Modes of dry joint friction.
#[derive(Clone, Copy, PartialEq)]
pub struct JointModes<L: Lane> {
    pub sticks: [L::Mask; 3],
    /// Angular impulse of dry friction of a moving joint.
    pub dry: [L; 3],
}

/// The impulses of a step.
pub struct Solution<L: Lane> {
    pub impulses: PerRow<L>,
    /// Robots whose modes did not repeat, so that all modes were tried.
    pub searched: L::Mask,
    /// Robots without modes that meet the conditions; their impulses are within the bounds of friction.
    pub unsolved: L::Mask,
}

/// The solution of the conditions with given modes.
pub struct Attempt<L: Lane> {
    /// Impulses within the bounds of friction.
    pub impulses: PerRow<L>,
    /// Impulses from which the next modes follow; see [`Modes::of`].
    pub trial: PerRow<L>,
    /// Largest violation of a condition, N·s; not positive for a solution, NaN without one.
    pub violation: L,
    /// Whether the conditions are met.
    pub solved: L::Mask,
    /// Whether the impulses are finite.
    pub finite: L::Mask,
}

impl<L: Lane> Modes<L> {
    /// Modes from trial impulses, which are those that would bring each row to rest by itself: impulse less residual
    /// times the row's mass.
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
            closed: [closed(0), closed(1), closed(2)],
            // An open wheel has no drive impulse, which is a slope times no load.
            slips: [slips(0) | !closed(0), slips(1) | !closed(1), slips(2) | !closed(2)],
            slopes: [slope(0), slope(1), slope(2)],
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
    fn of(trial: &[L; 3], friction: &JointFriction<L>) -> Self {
        let zero = friction.dry.zero();
        let sticks = |i: usize| trial[i].abs().le(friction.dry) & zero.lt(friction.dry);
        let dry = |i: usize| L::select(trial[i].lt(zero), -friction.dry, friction.dry);
        Self { sticks: [sticks(0), sticks(1), sticks(2)], dry: [dry(0), dry(1), dry(2)] }
    }
}

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

    /// Trial impulses at those of the last step. Robots that gripped in the last step are taken to grip in this one,
    /// where the trial impulses are those of the last step.
    #[inline(always)]
    fn first_trial<const JOINTS: bool>(&self, last: &PerRow<L>) -> PerRow<L> {
        let friction = self.friction;
        let zero = friction.floor.zero();
        let [z, x, y] = last.floor;
        let limit = friction.floor * z * GRIP_SHARE;
        let mut grip = zero.lt(z) & x.mul_add(x, y.squared()).le(limit.squared());
        for i in 0..3 {
            let limit = friction.wheels[i] * last.normals[i] * GRIP_SHARE;
            grip = grip & zero.lt(last.normals[i]) & last.drives[i].abs().le(limit);
        }
        if !JOINTS && !L::any(!grip) {
            return *last;
        }
        let mut residuals = *self.residuals;
        self.delassus.add_effect::<JOINTS>(last, &mut residuals);
        let trial = self.trial::<JOINTS>(last, &residuals);
        PerRow { joints: trial.joints, ..PerRow::select(grip, last, &trial) }
    }

    /// Trial impulses after sweeps, from impulses whose modes cycle.
    #[inline(always)]
    fn swept<const JOINTS: bool>(&self, open: L::Mask, impulses: &mut PerRow<L>) -> PerRow<L> {
        let mut residuals = *self.residuals;
        self.delassus.add_effect::<JOINTS>(impulses, &mut residuals);
        let (mut swept, mut estimate) = (*impulses, impulses.normals);
        for _ in 0..SWEEPS {
            let friction = (self.friction, self.joint_friction);
            self.delassus.sweep::<JOINTS>(friction.0, friction.1, &mut estimate, &mut swept, &mut residuals);
        }
        *impulses = PerRow::select(open, &swept, impulses);
        self.trial::<JOINTS>(&swept, &residuals)
    }

    /// Trial impulses at `impulses` and the residuals with them.
    #[inline(always)]
    pub fn trial<const JOINTS: bool>(&self, impulses: &PerRow<L>, residuals: &PerRow<L>) -> PerRow<L> {
        let d = self.delassus;
        let like = self.friction.floor;
        let (normal, tangent) = (d.ball_mass.at(like), d.floor_compliance_inverse.at(like));
        let wheel = |inverse: &[L; 3], impulses: &[L; 3], r: &[L; 3]| {
            let one = |i: usize| r[i].neg_mul_add(inverse[i], impulses[i]);
            [one(0), one(1), one(2)]
        };
        PerRow {
            floor: [
                residuals.floor[0].neg_mul_add(normal, impulses.floor[0]),
                residuals.floor[1].neg_mul_add(tangent, impulses.floor[1]),
                residuals.floor[2].neg_mul_add(tangent, impulses.floor[2]),
            ],
            normals: wheel(&d.normal_inverse, &impulses.normals, &residuals.normals),
            drives: wheel(&d.drive_inverse, &impulses.drives, &residuals.drives),
            joints: if JOINTS { self.joint_trial(impulses.joints, residuals.joints) } else { impulses.joints },
        }
    }

    #[inline(always)]
    fn joint_trial(&self, impulses: [L; 3], residuals: [L; 3]) -> [L; 3] {
        let own = &self.delassus.joint_joint;
        let one = |i: usize| impulses[i] - residuals[i] / own[i][i];
        [one(0), one(1), one(2)]
    }

    /// Solves the conditions with given modes. `weight` is that of the slip speeds in the trial impulses: with a small
    /// one a wheel that slips the wrong way sticks before it slips the other way.
    #[inline(always)]
    fn solve<const JOINTS: bool>(&self, floor: &Floor<L>, modes: &Modes<L>, weight: f64) -> Attempt<L> {
        let like = self.friction.floor;
        let mut system = floor.eliminated(self, &modes.floor);
        let joints = Joints::new::<JOINTS, V>(self, &modes.joints);
        if JOINTS {
            system = joints.eliminated(self.delassus, &system);
        }
        let (normals, drives) = system.solve(&modes.wheels);
        let joint_impulses = if JOINTS { joints.impulses(normals, drives) } else { Vec3::zero(like) };
        let floor_trial = floor.trial(self.delassus, normals, drives);
        self.judge::<JOINTS>(modes, weight, &system, (normals, drives, joint_impulses), floor_trial)
    }

    /// The ball on the floor, with the equations of the wheels' rows.
    #[inline(always)]
    fn floor(&self) -> Floor<L> {
        let d = self.delassus;
        let mixed = Mat3::from(d.normal_drive);
        let wheels = System {
            normal_normal: d.normal_normal.into(),
            normal_drive: mixed,
            drive_normal: mixed.transposed(),
            drive_drive: d.drive_drive.into(),
            normals: self.residuals.normals.into(),
            drives: self.residuals.drives.into(),
        };
        Floor::new(self, wheels)
    }

    /// Bounds the impulses and measures how far they violate the conditions.
    #[inline(always)]
    fn judge<const JOINTS: bool>(
        &self,
        modes: &Modes<L>,
        weight: f64,
        system: &System<L>,
        (normals, drives, joints): (Vec3<L>, Vec3<L>, Vec3<L>),
        floor_trial: [L; 3],
    ) -> Attempt<L> {
        let friction = self.friction;
        let zero = friction.floor.zero();
        let WheelModes { closed, slips, slopes } = &modes.wheels;
        let (normals, drives) = ([normals.x, normals.y, normals.z], [drives.x, drives.y, drives.z]);

        let mut trial = PerRow { floor: floor_trial, normals, drives, joints: [joints.x, joints.y, joints.z] };
        // Rows that stick or are closed have no residual.
        if L::any(slips[0] | slips[1] | slips[2]) {
            let (normal_residuals, drive_residuals) = system.residuals(normals.into(), drives.into());
            let n = [normal_residuals.x, normal_residuals.y, normal_residuals.z];
            let d = [drive_residuals.x, drive_residuals.y, drive_residuals.z];
            for i in 0..3 {
                let open = n[i].neg_mul_add(self.delassus.normal_inverse[i], normals[i]);
                trial.normals[i] = L::select(closed[i], normals[i], open);
                let slipping = (d[i] * weight).neg_mul_add(self.delassus.drive_inverse[i], drives[i]);
                trial.drives[i] = L::select(slips[i], slipping, drives[i]);
            }
        }

        let mut violation = self.floor_violation(&modes.floor, floor_trial);
        let mut size = floor_trial[0].abs();
        for i in 0..3 {
            size += normals[i].abs() + drives[i].abs();
            let normal = L::select(closed[i], -trial.normals[i], trial.normals[i]);
            let limit = friction.wheels[i] * normals[i];
            let slipping = limit - L::select(slopes[i].lt(zero), -trial.drives[i], trial.drives[i]);
            let drive = L::select(slips[i], slipping, drives[i].abs() - limit);
            violation = violation.max(normal).max(L::select(closed[i], drive, normal));
        }
        if JOINTS {
            let impulses = PerRow { floor: floor_trial, normals, drives, joints: [joints.x, joints.y, joints.z] };
            violation = violation.max(self.joint_violation(&modes.joints, &mut trial, &impulses));
        }
        let tolerance = (self.static_impulse + size) * TOLERANCE;
        let bounded = |i: usize| {
            let normal = normals[i].max(zero);
            let limit = friction.wheels[i] * normal;
            (normal, drives[i].min(limit).max(-limit))
        };
        let [(n0, d0), (n1, d1), (n2, d2)] = [bounded(0), bounded(1), bounded(2)];
        let load = floor_trial[0].max(zero);
        let [x, y] = in_disc([floor_trial[1], floor_trial[2]], friction.floor * load);
        Attempt {
            impulses: PerRow {
                floor: [load, x, y],
                normals: [n0, n1, n2],
                drives: [d0, d1, d2],
                joints: [joints.x + 0.0, joints.y + 0.0, joints.z + 0.0],
            },
            trial,
            // Numbers that are not finite are in the sum, and no comparison with them is true.
            solved: violation.le(tolerance),
            finite: size.le(size.splat(f64::MAX)),
            violation,
        }
    }

    /// Violation of the joints' conditions; completes the trial impulses of moving joints.
    #[inline(always)]
    fn joint_violation(&self, modes: &JointModes<L>, trial: &mut PerRow<L>, impulses: &PerRow<L>) -> L {
        let d = self.delassus;
        let (normals, drives) = (Vec3::from(impulses.normals), Vec3::from(impulses.drives));
        let joints = Vec3::from(impulses.joints);
        let dry = self.joint_friction.dry;
        let zero = dry.zero();
        let mut violation = zero;
        for i in 0..3 {
            let rate = self.residuals.joints[i]
                + Vec3::from(d.joint_normal[i]).dot(normals)
                + Vec3::from(d.joint_drive[i]).dot(drives)
                + Vec3::from(d.joint_joint[i]).dot(joints);
            let moving = impulses.joints[i] - rate / d.joint_joint[i][i];
            trial.joints[i] = L::select(modes.sticks[i], impulses.joints[i], moving);
            let along = L::select(modes.dry[i].lt(zero), -moving, moving);
            let over = L::select(modes.sticks[i], impulses.joints[i].abs() - dry, dry - along);
            // A joint without dry friction has no condition.
            violation = violation.max(L::select(zero.lt(dry), over, zero));
        }
        violation
    }

    #[inline(always)]
    fn floor_violation(&self, mode: &FloorMode<L>, [normal, x, y]: [L; 3]) -> L {
        let limit = self.friction.floor * normal;
        let closed = L::select(mode.closed, -normal, normal);
        let squared = x.mul_add(x, y.squared());
        let over = squared.sqrt() - limit;
        let [dx, dy] = mode.direction;
        let along = limit - dx.mul_add(x, dy * y);
        let across = dx.mul_add(y, -(dy * x));
        let turned = (squared * (DIRECTION_TOLERANCE * DIRECTION_TOLERANCE)).lt(across.squared());
        let slipping = L::select(turned, across.abs(), along);
        let tangent = L::select(mode.slips, slipping, over);
        L::select(mode.closed, closed.max(tangent), closed)
    }
}
