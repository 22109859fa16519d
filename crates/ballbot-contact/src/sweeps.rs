//! Projected Gauss-Seidel on the rows. It runs together with the contacts of [`super::body_contacts`], which the active
//! set does not contain.

use super::delassus::Delassus;
use super::friction::{Friction, JointFriction, in_disc};
use super::types::PerRow;
use ballbot_base::lanes::{Lane, Value};
use ballbot_base::wheels::{WHEELS, Wheels};

/// Gain per sweep of the low-pass filter from normal impulse to friction bound. Friction of slipping wheels changes the
/// loads of the other wheels by more than the friction itself; with the unfiltered load as bound the sweeps diverge.
/// Chosen by experiment.
const LOAD_FILTER: f64 = 0.33;

impl<L: Lane, V: Value<L>> Delassus<L, V> {
    /// One Gauss-Seidel sweep: updates the impulse of each row, projected onto its bounds, and the residuals.
    #[inline(always)]
    pub fn sweep<const JOINTS: bool>(
        &self,
        friction: &Friction<L>,
        joint_friction: &JointFriction<L>,
        normal_estimate: &mut Wheels<L>,
        impulses: &mut PerRow<L>,
        r: &mut PerRow<L>,
    ) {
        let zero = friction.floor.zero();
        self.sweep_floor(friction.floor, impulses, r);
        for k in 0..WHEELS {
            let new = r.normals[k].neg_mul_add(self.normal_inverse[k], impulses.normals[k]).max(zero);
            let change = new - impulses.normals[k];
            impulses.normals[k] = new;
            self.add_normal::<JOINTS>(k, change, r);
        }
        for (k, normal_estimate) in normal_estimate.iter_mut().enumerate() {
            *normal_estimate = (impulses.normals[k] - *normal_estimate).mul_add_all(LOAD_FILTER, *normal_estimate);
            let limit = friction.wheels[k] * *normal_estimate;
            let stick = r.drives[k].neg_mul_add(self.drive_inverse[k], impulses.drives[k]);
            let new = stick.min(limit).max(-limit);
            let change = new - impulses.drives[k];
            impulses.drives[k] = new;
            self.add_drive::<JOINTS>(k, change, r);
        }
        if JOINTS {
            for k in 0..WHEELS {
                let own = self.joint_joint[k][k];
                let stick = impulses.joints[k] - r.joints[k] / own;
                let dry = stick.min(joint_friction.dry).max(-joint_friction.dry);
                let softness = joint_friction.viscous * own;
                // Adding zero turns −0 into +0, so lanes without friction have the bits of a single robot.
                let new = (softness / (softness + 1.0)).mul_add(stick - dry, dry) + 0.0;
                let change = new - impulses.joints[k];
                impulses.joints[k] = new;
                self.add_joint(k, change, r);
            }
        }
    }

    #[inline(always)]
    fn sweep_floor(&self, friction: L, impulses: &mut PerRow<L>, r: &mut PerRow<L>) {
        let zero = friction.zero();
        let (normal, tangent) = (self.ball_mass.at(zero), self.floor_compliance_inverse.at(zero));
        let new = r.floor[0].mul_add(-normal, impulses.floor[0]).max(zero);
        let change = new - impulses.floor[0];
        impulses.floor[0] = new;
        self.add_floor(0, change, r);

        let x = r.floor[1].mul_add(-tangent, impulses.floor[1]);
        let y = r.floor[2].mul_add(-tangent, impulses.floor[2]);
        let [x, y] = in_disc([x, y], friction * new);
        let (dx, dy) = (x - impulses.floor[1], y - impulses.floor[2]);
        impulses.floor[1] = x;
        impulses.floor[2] = y;
        self.add_floor(1, dx, r);
        self.add_floor(2, dy, r);
    }
}
