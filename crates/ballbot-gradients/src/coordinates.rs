//! Coordinates of small changes of a state: like its numbers, but three for an attitude, a rotation vector.

use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Quat, Vec3};
use ballbot_base::wheels::Wheels;

/// Number of coordinates.
pub const COORDINATES: usize = 30;

/// Number of contact forces: three normal forces and three tractions of the wheels, the force of the floor.
pub const FORCES: usize = 9;

/// The contact forces of the last step on which the losses of a step depend, of the floor and the wheels' normals.
pub(crate) const LOADS: [usize; 6] = [6, 7, 8, 0, 1, 2];

/// The coordinates that are independent without slip.
pub(crate) const INDEPENDENT: [usize; 17] = [0, 1, 3, 4, 5, 9, 10, 11, 12, 13, 14, 15, 16, 20, 24, 25, 26];

/// The states of a [`Jacobian`](crate::Jacobian), which depend on the model and the robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coordinates {
    /// All 30 coordinates, of `contact`.
    All,
    /// Also contact forces of the last step, on which losses ([`Params::has_losses`](ballbot_base::Params::has_losses))
    /// depend.
    AllWithLoads,
    /// The 17 that are independent without slip, of `spatial` and `planar`.
    WithoutSlip,
}

impl Coordinates {
    /// Of `contact`, for a robot with or without losses.
    pub fn of_contact(has_losses: bool) -> Self {
        if has_losses { Self::AllWithLoads } else { Self::All }
    }

    /// Number of states.
    pub fn count(self) -> usize {
        match self {
            Self::All => COORDINATES,
            Self::AllWithLoads => COORDINATES + LOADS.len(),
            Self::WithoutSlip => INDEPENDENT.len(),
        }
    }

    /// Names of the states, the rows of A and columns of A and C.
    pub fn names(self) -> Vec<String> {
        let all = coordinate_names();
        match self {
            Self::All => all,
            Self::AllWithLoads => {
                let forces = force_names();
                all.into_iter().chain(LOADS.map(|force| forces[force].clone())).collect()
            }
            Self::WithoutSlip => INDEPENDENT.map(|place| all[place].clone()).into(),
        }
    }

    /// Index among the states of a coordinate of all.
    pub(crate) fn index_of(self, place: usize) -> Option<usize> {
        match self {
            Self::All | Self::AllWithLoads => Some(place),
            Self::WithoutSlip => INDEPENDENT.iter().position(|independent| *independent == place),
        }
    }
}

const AXES: [&str; 3] = ["x", "y", "z"];

/// Names of the coordinates. A change of the ball's attitude is a rotation vector in the inertial frame, of the body's
/// attitude in the body frame, as the angular velocities.
fn coordinate_names() -> Vec<String> {
    let vector = |name: &str| AXES.map(|axis| format!("{name}_{axis}"));
    let wheels = |name: &str| [0, 1, 2].map(|i| format!("{name}_{i}"));
    [
        vector("ball_position"),
        vector("ball_rotation"),
        vector("body_position"),
        vector("body_rotation"),
        wheels("wheel_angle"),
        vector("ball_velocity"),
        vector("ball_angular_velocity"),
        vector("body_velocity"),
        vector("body_angular_velocity"),
        wheels("wheel_speed"),
    ]
    .concat()
}

/// Names of the contact forces.
pub fn force_names() -> Vec<String> {
    let wheels = |name: &str| [0, 1, 2].map(|i| format!("{name}_{i}"));
    [wheels("wheel_normal_force"), wheels("wheel_traction"), AXES.map(|axis| format!("floor_force_{axis}"))].concat()
}

/// Derivative of the numbers of a state with respect to a coordinate.
pub(crate) fn along(state: &LaneState<f64>, coordinate: usize) -> LaneState<f64> {
    let mut out = LaneState::default();
    let (group, i) = (coordinate / 3, coordinate % 3);
    let unit = {
        let mut unit = [0.0; 3];
        unit[i] = 1.0;
        unit
    };
    let (vector, wheels) = (Vec3::from(unit), Wheels(unit));
    let half = Quat { w: 0.0, v: vector * 0.5 };
    match group {
        0 => out.ball_position = vector,
        1 => out.ball_quaternion = half.times(state.ball_quaternion),
        2 => out.body_position = vector,
        3 => out.body_quaternion = state.body_quaternion.times(half),
        4 => out.wheel_angles = wheels,
        5 => out.ball_velocity = vector,
        6 => out.ball_angular_velocity = vector,
        7 => out.body_velocity = vector,
        8 => out.body_angular_velocity = vector,
        _ => out.wheel_speeds = wheels,
    }
    out
}

/// The coordinates of a change of a state.
pub(crate) fn coordinates(state: &LaneState<f64>, change: &LaneState<f64>) -> [f64; COORDINATES] {
    let ball = change.ball_quaternion.times(state.ball_quaternion.conjugated()).v * 2.0;
    let body = state.body_quaternion.conjugated().times(change.body_quaternion).v * 2.0;
    let groups: [[f64; 3]; COORDINATES / 3] = [
        change.ball_position.into(),
        ball.into(),
        change.body_position.into(),
        body.into(),
        change.wheel_angles.0,
        change.ball_velocity.into(),
        change.ball_angular_velocity.into(),
        change.body_velocity.into(),
        change.body_angular_velocity.into(),
        change.wheel_speeds.0,
    ];
    let mut out = [0.0; COORDINATES];
    for (place, value) in out.iter_mut().zip(groups.iter().flatten()) {
        *place = *value;
    }
    out
}
