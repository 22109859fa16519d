//! Deviation of a robot from its setpoint, in the coordinates of the linear model.

use super::balance_frame::{BalanceFrame, Pose};
use super::lean_planes::LeanPlanes;
use crate::{Constants, LaneSetpoint};
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Heading, Lane, wrapped_angle};
use ballbot_base::params::Params;
use ballbot_models::linear::STATES;

/// Frame and vertical planes of the controllers.
#[derive(Clone, Debug)]
pub(crate) struct Tracking {
    pub(crate) frame: BalanceFrame,
    pub(crate) planes: LeanPlanes,
}

/// Lean of the setpoint's motion, in the planes of x and y.
pub(crate) struct LeanReference<L> {
    /// Lean, rad.
    pub(crate) lean: [L; 2],
    /// Rate, rad/s.
    pub(crate) rate: [L; 2],
    /// Acceleration, rad/s².
    pub(crate) acceleration: [L; 2],
}

/// Deviation of a robot from its setpoint.
pub(crate) struct Deviation<L> {
    /// Deviation from the motion of the setpoint, in the linear model's coordinates.
    pub(crate) x: [L; STATES],
    /// Angular accelerations of the leans by the motors in that motion, rad/s².
    pub(crate) forward: [L; 2],
    pub(crate) pose: Pose<L>,
}

impl Tracking {
    pub(crate) fn new(params: &Params) -> Self {
        Self { frame: BalanceFrame::new(params), planes: LeanPlanes::new(params) }
    }

    /// Adds the balance frame, the factors from the setpoint's motion to lean and torques, and torques per
    /// acceleration.
    pub(crate) fn add_to(&self, constants: Constants) -> Constants {
        let [x, y] = &self.planes.planes;
        let constants = self.frame.add_to(constants);
        let constants = constants
            .vector("lean_per_acceleration", &[x.acceleration.recip(), y.acceleration.recip()])
            .vector("toppling_squared", &[x.toppling_squared(), y.toppling_squared()]);
        self.planes.add_to(constants)
    }

    /// The setpoint's lean for a robot with this heading.
    #[inline(always)]
    pub(crate) fn lean<L: Lane>(&self, heading: &Heading<L>, setpoint: &LaneSetpoint<L>) -> LeanReference<L> {
        let [x, y] = &self.planes.planes;
        let per_acceleration = [x.acceleration.recip(), y.acceleration.recip()];
        LeanReference {
            lean: scaled(heading, setpoint.acceleration, per_acceleration),
            rate: scaled(heading, setpoint.jerk, per_acceleration),
            acceleration: scaled(heading, setpoint.snap, per_acceleration),
        }
    }

    /// [`Deviation::forward`] for a lean.
    #[inline(always)]
    pub(crate) fn forward<L: Lane>(&self, reference: &LeanReference<L>) -> [L; 2] {
        let mut forward = reference.acceleration;
        for (axis, plane) in self.planes.planes.iter().enumerate() {
            forward[axis] = reference.lean[axis].mul_add_all(-plane.toppling_squared(), forward[axis]);
        }
        forward
    }

    /// Deviation of a robot from its setpoint.
    #[inline(always)]
    pub(crate) fn deviation<L: Lane>(&self, state: &LaneState<L>, setpoint: &LaneSetpoint<L>) -> Deviation<L> {
        let pose = self.frame.pose(state);
        let Pose { attitude, heading, tilt: [tilt_x, tilt_y], rate } = pose;
        let (p, v) = (state.ball_position, state.ball_velocity);
        let [x, y] = heading.of(p.x - setpoint.position[0], p.y - setpoint.position[1]);
        let [vx, vy] = heading.of(v.x - setpoint.velocity[0], v.y - setpoint.velocity[1]);
        let yaw = wrapped_angle(attitude.yaw() - setpoint.yaw);
        let reference = self.lean(&heading, setpoint);
        let [lean_x, lean_y] = reference.lean;
        let [rate_x, rate_y] = reference.rate;
        // Leaning towards y turns about −x.
        let tilt = [tilt_x + lean_y, tilt_y - lean_x];
        let turning = [rate.x + rate_y, rate.y - rate_x, rate.z - setpoint.yaw_rate];
        Deviation {
            x: [x, y, tilt[0], tilt[1], yaw, vx, vy, turning[0], turning[1], turning[2]],
            forward: self.forward(&reference),
            pose,
        }
    }

    /// [`Deviation::forward`] for the motion `delay` seconds later.
    #[inline(always)]
    pub(crate) fn forward_after<L: Lane>(
        &self,
        heading: &Heading<L>,
        setpoint: &LaneSetpoint<L>,
        delay: f64,
    ) -> [L; 2] {
        let mut later = setpoint.acceleration;
        for (axis, later) in later.iter_mut().enumerate() {
            let changing = setpoint.snap[axis].mul_add_all(0.5 * delay, setpoint.jerk[axis]);
            *later = changing.mul_add_all(delay, *later);
        }
        self.forward(&self.lean(heading, &LaneSetpoint { acceleration: later, ..*setpoint }))
    }
}

/// A horizontal vector of the inertial frame in the heading frame, times a factor in each plane.
#[inline(always)]
fn scaled<L: Lane>(heading: &Heading<L>, [x, y]: [L; 2], factors: [f64; 2]) -> [L; 2] {
    let [x, y] = heading.of(x, y);
    [x * factors[0], y * factors[1]]
}
