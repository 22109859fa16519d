//! The spatial model linearized about rest upright, for any robot.

use super::{BallSpin, SpatialModel, WheelSpin};
use crate::params::Params;
use nalgebra::{SMatrix, UnitQuaternion, Vector3, Vector6};

/// Number of states: x, y, tilt x, tilt y, yaw and their rates.
pub const STATES: usize = 10;
/// Number of inputs: the three wheel torques.
pub const INPUTS: usize = 3;

/// ẋ = A x + B τ with x = (x, y, tilt_x, tilt_y, yaw, v_x, v_y, Ω_x, Ω_y, Ω_z) in the heading frame. The
/// ball is free to spin about the vertical, as in eq. (7) of the paper, and has done so from rest: its spin is what keeps
/// the robot's angular momentum about the vertical at zero.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearModel {
    /// A.
    pub a: SMatrix<f64, STATES, STATES>,
    /// B.
    pub b: SMatrix<f64, STATES, INPUTS>,
}

impl LinearModel {
    /// Derivatives of the spatial model's accelerations, taken where they are linear: torques and rates enter linearly
    /// at rest, and gravity turns a small tilt into M_b g l times that tilt.
    pub fn new(params: &Params) -> Self {
        // Dry friction has no derivative at rest.
        let model = SpatialModel::new(
            &Params { wheel_coulomb_friction: 0.0, ..params.clone() },
            WheelSpin::Absolute,
            BallSpin::Free,
        );
        let upright = UnitQuaternion::identity();
        let at = |velocity: &Vector6<f64>, torques: &Vector3<f64>| {
            model.accelerations(&upright, velocity, torques).fixed_rows::<5>(0).into_owned()
        };
        // The motors turn ball and body against each other.
        let turned = model.accelerations(&upright, &Vector6::zeros(), &Vector3::repeat(1.0));
        let ball_spin = turned[5] / turned[4];
        let mut a = SMatrix::<f64, STATES, STATES>::zeros();
        let mut b = SMatrix::<f64, STATES, INPUTS>::zeros();
        for i in 0..5 {
            a[(i, 5 + i)] = 1.0;
            // Viscous friction is odd in the rates, what is quadratic in them is even.
            let mut unit = Vector6::from_fn(|j, _| f64::from(j == i));
            unit[5] = unit[4] * ball_spin;
            let odd = (at(&unit, &Vector3::zeros()) - at(&-unit, &Vector3::zeros())) * 0.5;
            a.fixed_view_mut::<5, 1>(5, 5 + i).copy_from(&odd);
        }
        for i in 0..INPUTS {
            let unit = Vector3::from_fn(|j, _| f64::from(j == i));
            b.fixed_view_mut::<5, 1>(5, i).copy_from(&at(&Vector6::zeros(), &unit));
        }
        let toppling = params.body_mass * params.gravity * params.body_com_height;
        for i in [2, 3] {
            let per_force = model.response(&upright, &Vector6::from_fn(|j, _| f64::from(j == i)));
            a.fixed_view_mut::<5, 1>(5, i).copy_from(&(per_force.fixed_rows::<5>(0) * toppling));
        }
        Self { a, b }
    }

    /// Exact discretization for inputs held constant over `dt` seconds.
    pub fn discretize(&self, dt: f64) -> (SMatrix<f64, STATES, STATES>, SMatrix<f64, STATES, INPUTS>) {
        let mut block = SMatrix::<f64, { STATES + INPUTS }, { STATES + INPUTS }>::zeros();
        block.fixed_view_mut::<STATES, STATES>(0, 0).copy_from(&(self.a * dt));
        block.fixed_view_mut::<STATES, INPUTS>(0, STATES).copy_from(&(self.b * dt));
        let exponential = block.exp();
        (
            exponential.fixed_view::<STATES, STATES>(0, 0).into_owned(),
            exponential.fixed_view::<STATES, INPUTS>(0, STATES).into_owned(),
        )
    }
}
