//! Compensation of the friction of the wheel joints, which does not reach the ball.

use super::limits::within;
use crate::Constants;
use ballbot_base::lanes::Lane;
use ballbot_base::params::Params;
use ballbot_base::wheels::{WHEELS, Wheels};

/// Speed of a wheel below which less than 0.7 of its dry friction is compensated, rad/s: at rest, where friction may act
/// either way, nothing is.
const DRY_WIDTH: f64 = 1.0;

/// Friction of the wheel joints of a robot.
#[derive(Clone, Copy, Debug)]
pub(crate) struct JointFriction {
    /// N·m/(rad/s).
    viscous: f64,
    /// N·m.
    dry: f64,
}

impl JointFriction {
    /// The friction of a robot, and the robot without it.
    pub(crate) fn of(params: &Params) -> (Self, Params) {
        let friction = Self { viscous: params.wheel_viscous_friction, dry: params.wheel_coulomb_friction };
        (friction, Params { wheel_viscous_friction: 0.0, wheel_coulomb_friction: 0.0, ..params.clone() })
    }

    /// The dry friction of a joint, N·m.
    pub(crate) fn dry(self) -> f64 {
        self.dry
    }

    /// Adds its numbers.
    pub(crate) fn add_to(self, constants: Constants) -> Constants {
        let constants = constants.number("joint_viscous_friction", self.viscous);
        constants.number("joint_dry_friction", self.dry).number("joint_dry_width", DRY_WIDTH)
    }

    /// Fraction of the dry friction of a wheel at `speed` (rad/s) that may act without being compensated.
    #[inline(always)]
    pub(crate) fn dry_left<L: Lane>(speed: L) -> L {
        let size = speed.mul_add(speed, speed.splat(DRY_WIDTH * DRY_WIDTH)).sqrt();
        speed.splat(1.0) - speed.abs() / size
    }

    /// Torques with the friction of wheels at `speeds` (rad/s) added, within ±`most` (N·m); NaN passes through.
    #[inline(always)]
    pub(crate) fn compensated<L: Lane>(&self, mut torques: Wheels<L>, speeds: &Wheels<L>, most: f64) -> Wheels<L> {
        if self.viscous == 0.0 && self.dry == 0.0 {
            return torques;
        }
        for i in 0..WHEELS {
            let speed = speeds[i];
            let size = speed.mul_add(speed, speed.splat(DRY_WIDTH * DRY_WIDTH)).sqrt();
            torques[i] = within(torques[i] + speed * self.viscous + speed / size * self.dry, speed.splat(most));
        }
        torques
    }
}
