//! Derivatives of motions that roll without slip on a plane floor: fewer coordinates, for the design of controllers.

use crate::Jacobian;
use ballbot_base::error::{Error, Result};
use ballbot_base::kinematics::Omniwheels;
use ballbot_base::params::Params;
use nalgebra::{DMatrix, Matrix3, Vector3};

/// Names of the coordinates of rolling, with changes as in [`state_names`](crate::state_names). Attitude of the ball and
/// wheel angles are left out: nothing depends on them.
pub const ROLLING: [&str; 11] = [
    "ball_position_x",
    "ball_position_y",
    "body_rotation_x",
    "body_rotation_y",
    "body_rotation_z",
    "ball_velocity_x",
    "ball_velocity_y",
    "body_angular_velocity_x",
    "body_angular_velocity_y",
    "body_angular_velocity_z",
    "ball_angular_velocity_z",
];

/// Indices of these coordinates among all.
const PLACES: [usize; ROLLING.len()] = [0, 1, 9, 10, 11, 15, 16, 24, 25, 26, 20];

/// Derivatives in the coordinates of rolling.
#[derive(Clone, Debug)]
pub struct RollingJacobian {
    /// The coordinates after the motion by the coordinates before.
    pub a: DMatrix<f64>,
    /// By the torques, per N·m.
    pub b: DMatrix<f64>,
}

impl Jacobian {
    /// The derivatives for changes of the state that keep the ball rolling on a plane floor and the wheels rolling on the
    /// ball: A of all coordinates for such changes, and the rows of [`ROLLING`].
    ///
    /// They need no side of a gap: such a change opens and closes none.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] on a terrain.
    pub fn rolling(&self, params: &Params) -> Result<RollingJacobian> {
        if !self.level {
            return Err(Error::Inconsistent("coordinates of rolling are of a plane floor, not of a terrain".into()));
        }
        let wheels = Omniwheels::new(params);
        let state = &self.start;
        let rotation = state.body_quaternion.to_rotation_matrix().into_inner();
        let radius = params.ball_radius;
        let mut lift = DMatrix::zeros(self.a.ncols(), ROLLING.len());
        for (column, place) in PLACES.into_iter().enumerate() {
            lift[(place, column)] = 1.0;
        }
        let mut ball_rate = Matrix3::zeros();
        ball_rate[(0, 1)] = -1.0 / radius;
        ball_rate[(1, 0)] = 1.0 / radius;
        ball_rate[(2, 2)] = 1.0;
        // The body moves with the ball.
        for i in 0..2 {
            lift[(6 + i, i)] = 1.0;
            lift[(21 + i, 5 + i)] = 1.0;
            lift.fixed_view_mut::<3, 1>(18, 5 + i).copy_from(&ball_rate.column(i));
        }
        // Encoder rates: k U (Rᵀ ω − Ω).
        let to_encoders = wheels.u * params.gear_ratio();
        let in_body = rotation.transpose() * state.ball_angular_velocity;
        let by_ball_rate = to_encoders * rotation.transpose() * ball_rate;
        lift.fixed_view_mut::<3, 3>(27, 2).copy_from(&(to_encoders * in_body.cross_matrix()));
        lift.fixed_view_mut::<3, 2>(27, 5).copy_from(&by_ball_rate.fixed_columns::<2>(0));
        lift.fixed_view_mut::<3, 3>(27, 7).copy_from(&-to_encoders);
        lift.fixed_view_mut::<3, 1>(27, 10).copy_from(&Vector3::from(by_ball_rate.column(2)));
        let rows = |matrix: &DMatrix<f64>| matrix.select_rows(&PLACES);
        Ok(RollingJacobian { a: rows(&(&self.a * lift)), b: rows(&self.b) })
    }
}
