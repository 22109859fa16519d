//! Pose of a robot for its instruments.

use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Quat, Vec3};
use nalgebra::{Quaternion, Rotation3, UnitQuaternion};
use serde::{Deserialize, Serialize};

/// The ball and the attitude of the body.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct View {
    /// Center of the ball, m.
    pub ball: [f64; 3],
    /// Attitude of the body: w, x, y, z.
    pub attitude: [f64; 4],
    /// Radius of the ball, m.
    pub ball_radius: f64,
}

impl View {
    /// The view of a robot.
    pub fn of(state: &LaneState<f64>, ball_radius: f64) -> Self {
        let Quat { w, v } = state.body_quaternion;
        let ball = state.ball_position;
        Self { ball: [ball.x, ball.y, ball.z], attitude: [w, v.x, v.y, v.z], ball_radius }
    }

    /// Whether all numbers are finite.
    pub fn is_finite(&self) -> bool {
        self.ball.iter().chain(&self.attitude).all(|number| number.is_finite()) && self.ball_radius.is_finite()
    }

    /// Attitude of the body.
    pub fn quaternion(&self) -> Quat<f64> {
        let [w, x, y, z] = self.attitude;
        Quat { w, v: Vec3::new(x, y, z) }
    }

    /// The same as a matrix, from the body frame to the inertial frame.
    pub fn rotation(&self) -> Rotation3<f64> {
        let [w, x, y, z] = self.attitude;
        UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z)).to_rotation_matrix()
    }
}
