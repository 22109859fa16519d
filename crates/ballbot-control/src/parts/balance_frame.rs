//! The balance frame of a robot, in which controllers measure its tilt.

use crate::Constants;
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Heading, Lane, Quat, Rotation, Vec3};
use ballbot_base::params::Params;
use nalgebra::{UnitQuaternion, Vector3};

/// Rotation from the body frame to the balance frame ([`Params::to_balance_frame`]). The attitude of the balance frame
/// has zero tilt in equilibrium.
#[derive(Clone, Debug)]
pub(crate) struct BalanceFrame {
    rotation: UnitQuaternion<f64>,
    /// Whether balance frame and body frame are equal.
    is_body_frame: bool,
}

/// Attitude quantities of a robot, used by a controller and its limits.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pose<L> {
    /// Attitude of the balance frame.
    pub(crate) attitude: Quat<L>,
    pub(crate) heading: Heading<L>,
    /// Tilt of the balance frame about the axes of the heading frame, rad.
    pub(crate) tilt: [L; 2],
    /// Angular velocity of the body in the balance frame, rad/s.
    pub(crate) rate: Vec3<L>,
}

impl BalanceFrame {
    /// The balance frame of the robot of `params`.
    pub(crate) fn new(params: &Params) -> Self {
        Self { rotation: params.to_balance_frame(), is_body_frame: params.body_com_offset == [0.0; 2] }
    }

    /// Adds the quaternion (w, x, y, z) that rotates vectors of the body frame into the balance frame.
    pub(crate) fn add_to(&self, constants: Constants) -> Constants {
        let q = &self.rotation;
        constants.vector("balance_frame", &[q.w, q.i, q.j, q.k])
    }

    /// A vector of the balance frame in the body frame.
    pub(crate) fn in_body(&self, v: &Vector3<f64>) -> Vector3<f64> {
        self.rotation.inverse_transform_vector(v)
    }

    /// Attitude of the balance frame of a body with the attitude `body`.
    #[inline(always)]
    pub(crate) fn attitude<L: Lane>(&self, body: Quat<L>) -> Quat<L> {
        if self.is_body_frame {
            return body;
        }
        body.times(self.constant(body.w).conjugated())
    }

    /// A vector of the body frame in the balance frame.
    #[inline(always)]
    pub(crate) fn of_body<L: Lane>(&self, v: Vec3<L>) -> Vec3<L> {
        if self.is_body_frame {
            return v;
        }
        let rotation: Rotation<L> = self.constant(v.x).rotation();
        rotation.apply(v)
    }

    /// Attitude quantities of a robot.
    #[inline(always)]
    pub(crate) fn pose<L: Lane>(&self, state: &LaneState<L>) -> Pose<L> {
        let attitude = self.attitude(state.body_quaternion);
        let heading = Heading::new(attitude);
        let [inertial_x, inertial_y] = attitude.tilt_components();
        let tilt = heading.of(inertial_x, inertial_y);
        Pose { attitude, heading, tilt, rate: self.of_body(state.body_angular_velocity) }
    }

    #[inline(always)]
    fn constant<L: Lane>(&self, like: L) -> Quat<L> {
        let q = &self.rotation;
        Quat { w: like.splat(q.w), v: Vec3::new(like.splat(q.i), like.splat(q.j), like.splat(q.k)) }
    }
}
