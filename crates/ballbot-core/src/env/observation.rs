//! What the robot senses, as float32.

use super::ACTION_LEN;
use crate::lane_state::LaneState;
use crate::lanes::{Lane, Quat};

/// One number of the observation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObservationRow {
    /// What it is.
    pub name: &'static str,
    /// Its unit, empty for a pure number.
    pub unit: &'static str,
    /// Bound of its magnitude; beyond it the sensor saturates.
    pub bound: f32,
}

/// How many numbers an observation has.
pub const OBSERVATION_LEN: usize = 16;

const fn row(name: &'static str, unit: &'static str, bound: f32) -> ObservationRow {
    ObservationRow { name, unit, bound }
}

/// The observation, row by row. The heading frame has the robot's yaw and a vertical z axis; positions and velocities are
/// relative to the setpoint. Nothing depends on where the setpoint is or where the robot faces.
pub const OBSERVATION: [ObservationRow; OBSERVATION_LEN] = [
    row("gravity direction, body x", "", 1.0),
    row("gravity direction, body y", "", 1.0),
    row("gravity direction, body z", "", 1.0),
    row("body rate about body x", "rad/s", 20.0),
    row("body rate about body y", "rad/s", 20.0),
    row("body rate about body z", "rad/s", 20.0),
    row("wheel speed 0", "rad/s", 200.0),
    row("wheel speed 1", "rad/s", 200.0),
    row("wheel speed 2", "rad/s", 200.0),
    row("ball position from the setpoint, heading x", "m", 10.0),
    row("ball position from the setpoint, heading y", "m", 10.0),
    row("ball velocity, heading x", "m/s", 10.0),
    row("ball velocity, heading y", "m/s", 10.0),
    row("last action, wheel 0", "", 1.0),
    row("last action, wheel 1", "", 1.0),
    row("last action, wheel 2", "", 1.0),
];

/// The observation of `state`, saturated at its bounds. A number that is not one reads as zero: it ends its episode, and
/// nothing of the kind may reach a learner.
#[inline(always)]
pub(super) fn observe<L: Lane>(
    state: &LaneState<L>,
    setpoint: &[f64; 2],
    last_action: &[L; ACTION_LEN],
) -> [L; OBSERVATION_LEN] {
    let q = state.body_quaternion;
    let up = q.rotation().rows[2];
    let rate = state.body_angular_velocity;
    let heading = Heading::new(q);
    let position = heading.of(state.ball_position.x - setpoint[0], state.ball_position.y - setpoint[1]);
    let velocity = heading.of(state.ball_velocity.x, state.ball_velocity.y);
    let [w0, w1, w2] = state.wheel_speeds;
    let [a0, a1, a2] = *last_action;
    let mut sensed = [
        -up.x,
        -up.y,
        -up.z,
        rate.x,
        rate.y,
        rate.z,
        w0,
        w1,
        w2,
        position[0],
        position[1],
        velocity[0],
        velocity[1],
        a0,
        a1,
        a2,
    ];
    let zero = up.x.zero();
    for (value, row) in sensed.iter_mut().zip(&OBSERVATION) {
        let bound = zero.splat(f64::from(row.bound));
        let number = value.le(*value);
        *value = L::select(number, value.min(bound).max(-bound), zero);
    }
    sensed
}

/// Cosine and sine of the yaw.
struct Heading<L> {
    cos: L,
    sin: L,
}

impl<L: Lane> Heading<L> {
    /// The yaw is 2 atan2(z, w).
    #[inline(always)]
    fn new(q: Quat<L>) -> Self {
        let (ww, zz) = (q.w.squared(), q.v.z.squared());
        let norm = ww + zz;
        // Upside down there is no yaw.
        let turned = norm.zero().lt(norm);
        let one = norm.splat(1.0);
        let inverse = one / L::select(turned, norm, one);
        let wz = q.w * q.v.z;
        Self { cos: L::select(turned, (ww - zz) * inverse, one), sin: (wz + wz) * inverse }
    }

    /// A horizontal vector of the inertial frame, in the heading frame.
    #[inline(always)]
    fn of(&self, x: L, y: L) -> [L; 2] {
        [self.cos.mul_add(x, self.sin * y), self.cos.mul_add(y, -(self.sin * x))]
    }
}
