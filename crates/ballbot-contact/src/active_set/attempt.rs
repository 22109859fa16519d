//! Solution of the contact conditions for given modes, and its violation of them.

use super::conditions::Conditions;
use super::elimination::{Floor, Joints, System};
use super::modes::{FloorMode, JointModes, Modes, WheelModes};
use crate::friction::in_disc;
use crate::types::PerRow;
use ballbot_base::lanes::{Lane, Value};
use ballbot_base::wheels::{WHEELS, Wheels};

/// Largest violation of a condition in an accepted solution, as a fraction of the impulses.
const TOLERANCE: f64 = 1e-13;

/// Largest sine of the change of the floor's slip direction in an accepted solution. The error of the impulses is of
/// second order in it.
const DIRECTION_TOLERANCE: f64 = 1e-7;

/// Solution of the conditions for given modes.
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

impl<L: Lane, V: Value<L>> Conditions<'_, L, V> {
    /// Trial impulses from `impulses` and their residuals.
    #[inline(always)]
    pub fn trial<const JOINTS: bool>(&self, impulses: &PerRow<L>, residuals: &PerRow<L>) -> PerRow<L> {
        let d = self.delassus;
        let like = self.friction.floor;
        let (normal, tangent) = (d.ball_mass.at(like), d.floor_compliance_inverse.at(like));
        PerRow {
            floor: [
                residuals.floor[0].neg_mul_add(normal, impulses.floor[0]),
                residuals.floor[1].neg_mul_add(tangent, impulses.floor[1]),
                residuals.floor[2].neg_mul_add(tangent, impulses.floor[2]),
            ],
            normals: wheel_trial(&d.normal_inverse, &impulses.normals, &residuals.normals),
            drives: wheel_trial(&d.drive_inverse, &impulses.drives, &residuals.drives),
            joints: if JOINTS { self.joint_trial(impulses.joints, residuals.joints) } else { impulses.joints },
        }
    }

    #[inline(always)]
    fn joint_trial(&self, impulses: Wheels<L>, residuals: Wheels<L>) -> Wheels<L> {
        let own = &self.delassus.joint_joint;
        let [a, b, c] = impulses.0;
        Wheels([a - residuals[0] / own[0][0], b - residuals[1] / own[1][1], c - residuals[2] / own[2][2]])
    }

    /// Solves the conditions for given modes. `weight` multiplies the slip speeds in the trial impulses: with a small
    /// weight, a wheel that slips the wrong way sticks before it slips the other way.
    #[inline(always)]
    pub fn solve<const JOINTS: bool>(&self, floor: &Floor<L>, modes: &Modes<L>, weight: f64) -> Attempt<L> {
        let like = self.friction.floor;
        let mut system = floor.eliminated(self, &modes.floor);
        let joints = Joints::new::<JOINTS, V>(self, &modes.joints);
        if JOINTS {
            system = joints.eliminated(self.delassus, &system);
        }
        let (normals, drives) = system.solve(&modes.wheels);
        let joint_impulses = if JOINTS { joints.impulses(normals, drives) } else { Wheels::zero(like) };
        let floor_trial = floor.trial(self.delassus, normals, drives);
        self.bound_impulses::<JOINTS>(modes, weight, &system, (normals, drives, joint_impulses), floor_trial)
    }

    /// The ball on the floor, with the equations of the wheel rows.
    #[inline(always)]
    pub fn floor(&self) -> Floor<L> {
        let d = self.delassus;
        let wheels = System {
            normal_normal: d.normal_normal,
            normal_drive: d.normal_drive,
            drive_normal: d.normal_drive.transposed(),
            drive_drive: d.drive_drive,
            normals: self.residuals.normals,
            drives: self.residuals.drives,
        };
        Floor::new(self, wheels)
    }

    /// Bounds the impulses and measures their violation of the conditions.
    #[inline(always)]
    fn bound_impulses<const JOINTS: bool>(
        &self,
        modes: &Modes<L>,
        weight: f64,
        system: &System<L>,
        (normals, drives, joints): (Wheels<L>, Wheels<L>, Wheels<L>),
        floor_trial: [L; 3],
    ) -> Attempt<L> {
        let friction = self.friction;
        let zero = friction.floor.zero();
        let WheelModes { closed, slips, slopes } = &modes.wheels;

        let solution = PerRow { floor: floor_trial, normals, drives, joints };
        let mut trial = solution;
        // Rows that stick or are closed have zero residual.
        if L::any(slips[0] | slips[1] | slips[2]) {
            let (n, d) = system.residuals(normals, drives);
            for i in 0..WHEELS {
                let open = n[i].neg_mul_add(self.delassus.normal_inverse[i], normals[i]);
                trial.normals[i] = L::select(closed[i], normals[i], open);
                let slipping = (d[i] * weight).neg_mul_add(self.delassus.drive_inverse[i], drives[i]);
                trial.drives[i] = L::select(slips[i], slipping, drives[i]);
            }
        }

        let mut violation = self.floor_violation(&modes.floor, floor_trial);
        let mut size = floor_trial[0].abs();
        for i in 0..WHEELS {
            size += normals[i].abs() + drives[i].abs();
            let normal = L::select(closed[i], -trial.normals[i], trial.normals[i]);
            let limit = friction.wheels[i] * normals[i];
            let slipping = limit - L::select(slopes[i].lt(zero), -trial.drives[i], trial.drives[i]);
            let drive = L::select(slips[i], slipping, drives[i].abs() - limit);
            violation = violation.max(normal).max(L::select(closed[i], drive, normal));
        }
        if JOINTS {
            violation = violation.max(self.joint_violation(&modes.joints, &mut trial, &solution));
        }
        let tolerance = (self.static_impulse + size) * TOLERANCE;
        let mut bounded = [normals, drives];
        for i in 0..WHEELS {
            let normal = normals[i].max(zero);
            let limit = friction.wheels[i] * normal;
            bounded[0][i] = normal;
            bounded[1][i] = drives[i].min(limit).max(-limit);
        }
        let [bounded_normals, bounded_drives] = bounded;
        let load = floor_trial[0].max(zero);
        let [x, y] = in_disc([floor_trial[1], floor_trial[2]], friction.floor * load);
        Attempt {
            impulses: PerRow {
                floor: [load, x, y],
                normals: bounded_normals,
                drives: bounded_drives,
                joints: joints.map(
                    #[inline(always)]
                    |impulse| impulse + 0.0,
                ),
            },
            trial,
            // Non-finite numbers are in the sum, and every comparison with them is false.
            solved: violation.le(tolerance),
            finite: size.le(size.splat(f64::MAX)),
            violation,
        }
    }

    /// Violation of the joint conditions; completes the trial impulses of moving joints.
    #[inline(always)]
    fn joint_violation(&self, modes: &JointModes<L>, trial: &mut PerRow<L>, impulses: &PerRow<L>) -> L {
        let d = self.delassus;
        let dry = self.joint_friction.dry;
        let zero = dry.zero();
        let mut violation = zero;
        for i in 0..WHEELS {
            let rate = self.residuals.joints[i]
                + d.joint_normal[i].dot(impulses.normals)
                + d.joint_drive[i].dot(impulses.drives)
                + d.joint_joint[i].dot(impulses.joints);
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
        // A ball that does not reach the limit does not define a direction.
        let slipping = L::select(turned, along.max(across.abs()), along);
        let tangent = L::select(mode.slips, slipping, over);
        L::select(mode.closed, closed.max(tangent), closed)
    }
}

/// Trial impulses of rows with one row per wheel.
// Not a closure: a large closure is not inlined, and its operations are then calls.
#[inline(always)]
fn wheel_trial<L: Lane>(inverse: &Wheels<L>, Wheels([a, b, c]): &Wheels<L>, r: &Wheels<L>) -> Wheels<L> {
    Wheels([r[0].neg_mul_add(inverse[0], *a), r[1].neg_mul_add(inverse[1], *b), r[2].neg_mul_add(inverse[2], *c)])
}
