//! Derivatives of motions that roll without slip on a plane floor: fewer coordinates, for the design of controllers.

use crate::Jacobian;
use crate::contact::Column;
use crate::coordinates::{COORDINATES, Coordinates, FORCES, along};
use ballbot_base::error::{Error, Result};
use ballbot_base::kinematics::Omniwheels;
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::DualCell;
use ballbot_base::params::Params;
use ballbot_base::state::State;
use ballbot_base::wheels::WHEELS;
use nalgebra::{DMatrix, Matrix3, Vector3};

/// Names of the coordinates of rolling, with changes as in [`Coordinates::names`](crate::Coordinates::names). Attitude of the ball and
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
    /// The contact forces of the last step, [`force_names`](crate::force_names), by the coordinates before.
    pub c: DMatrix<f64>,
    /// By the torques, per N·m.
    pub d: DMatrix<f64>,
}

/// A state with the derivative of each number along a coordinate of [`ROLLING`], while the others of them stay.
pub fn along_rolling(state: &LaneState<f64>, coordinate: usize) -> LaneState<DualCell<f64>> {
    let mut cells = state.map(|value| DualCell { value: *value, derivatives: 0.0 });
    cells.zip_mut(&along(state, PLACES[coordinate]), |cell, slope| cell.derivatives = *slope);
    cells
}

/// The coordinates of the change from a state to another.
pub fn rolling_change(from: &LaneState<f64>, to: &LaneState<f64>) -> [f64; ROLLING.len()] {
    let turned = from.body_quaternion.conjugated().times(to.body_quaternion);
    let sine = turned.v.dot(turned.v).sqrt();
    // The angle over the sine of its half.
    let per_sine = if sine > 0.0 { 2.0 * (sine * turned.w.signum()).atan2(turned.w.abs()) / sine } else { 2.0 };
    let rotation = turned.v * per_sine;
    let (position, velocity) = (to.ball_position - from.ball_position, to.ball_velocity - from.ball_velocity);
    let rate = to.body_angular_velocity - from.body_angular_velocity;
    [
        position.x,
        position.y,
        rotation.x,
        rotation.y,
        rotation.z,
        velocity.x,
        velocity.y,
        rate.x,
        rate.y,
        rate.z,
        to.ball_angular_velocity.z - from.ball_angular_velocity.z,
    ]
}

/// Coordinates that do nothing but move the robot over a level floor.
pub(crate) const SHORTCUTS: usize = 2;

/// Changes of all coordinates that keep the ball and the wheels rolling on a plane floor, by the coordinates of
/// [`ROLLING`].
pub(crate) fn lift(params: &Params, state: &State) -> DMatrix<f64> {
    let wheels = Omniwheels::new(params);
    let rotation = state.body_quaternion.to_rotation_matrix().into_inner();
    let radius = params.ball_radius;
    let mut lift = DMatrix::zeros(COORDINATES, ROLLING.len());
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
    lift
}

impl RollingJacobian {
    /// From the columns of the coordinates after the first [`SHORTCUTS`], and of the torques.
    pub(crate) fn of(columns: &[Column]) -> Self {
        let (states, torques) = columns.split_at(ROLLING.len() - SHORTCUTS);
        let mut out = Self {
            a: DMatrix::identity(ROLLING.len(), ROLLING.len()),
            b: DMatrix::zeros(ROLLING.len(), WHEELS),
            c: DMatrix::zeros(FORCES, ROLLING.len()),
            d: DMatrix::zeros(FORCES, WHEELS),
        };
        for (columns, first, a, c) in
            [(states, SHORTCUTS, &mut out.a, &mut out.c), (torques, 0, &mut out.b, &mut out.d)]
        {
            for (column, i) in columns.iter().zip(first..) {
                a.column_mut(i).iter_mut().zip(PLACES).for_each(|(cell, place)| *cell = column.state[place]);
                c.column_mut(i).copy_from_slice(&column.forces);
            }
        }
        out
    }

    pub(crate) fn is_finite(&self) -> bool {
        let Self { a, b, c, d } = self;
        [a, b, c, d].into_iter().flatten().all(|number| number.is_finite())
    }
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
        let places: Vec<_> = PLACES.into_iter().filter_map(|place| self.coordinates.index_of(place)).collect();
        let rows = |matrix: &DMatrix<f64>| matrix.select_rows(&places);
        let [a, c] = if self.coordinates == Coordinates::WithoutSlip {
            [&self.a, &self.c].map(|matrix| matrix.select_columns(&places))
        } else {
            // Loads of the last step stay.
            let lift = lift(params, &self.start);
            [&self.a, &self.c].map(|matrix| matrix.columns(0, COORDINATES) * &lift)
        };
        Ok(RollingJacobian { a: rows(&a), b: rows(&self.b), c, d: self.d.clone() })
    }
}
