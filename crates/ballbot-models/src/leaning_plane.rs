//! The spatial model in one vertical plane at a large lean.

use super::linear::INPUTS;
use super::{BallSpin, LinearModel, SpatialModel, WheelSpin};
use ballbot_base::params::Params;
use ballbot_base::wheels::Wheels;
use nalgebra::{Matrix4, Matrix4x3, UnitQuaternion, Vector3, Vector6};

/// ẋ = A x + B τ of x = (y, θ, ẏ, θ̇), θ leaning towards positive y, in one vertical plane of the heading frame.
///
/// It is exact at rest at the lean θ: the column of θ in A is the acceleration without torque divided by θ, and B is
/// the acceleration per torque there. At θ = 0 it is the plane's part of the [`LinearModel`].
#[derive(Clone, Debug, PartialEq)]
pub struct LeaningPlane {
    /// State matrix A.
    pub a: Matrix4<f64>,
    /// Input matrix B of the wheel torques.
    pub b: Matrix4x3<f64>,
}

impl LeaningPlane {
    /// The plane of the axis `axis` (0 for x, 1 for y) of the robot of `params` on a level floor at `lean` (rad).
    pub fn new(params: &Params, axis: usize, lean: f64) -> Self {
        if lean == 0.0 {
            return Self::upright(params, axis);
        }
        // Dry friction has no derivative at rest.
        let params = Params { wheel_coulomb_friction: 0.0, ..params.without_losses().on_level_floor() };
        let model = SpatialModel::new(&params, WheelSpin::Absolute, BallSpin::Free);
        let to_balance = params.to_balance_frame();
        // Leaning towards y turns about −x.
        let towards = if axis == 0 { Vector3::y() } else { -Vector3::x() };
        let attitude = UnitQuaternion::from_scaled_axis(towards * lean) * to_balance;
        let accelerations = |speed: f64, rate: f64, torques: Wheels<f64>| {
            let turning = to_balance.inverse_transform_vector(&(towards * rate));
            let mut velocity = Vector6::new(0.0, 0.0, turning.x, turning.y, turning.z, 0.0);
            velocity[axis] = speed;
            let found = model.accelerations(&attitude, &velocity, torques);
            [found[axis], towards.dot(&(to_balance * found.fixed_rows::<3>(2).into_owned()))]
        };
        let free = accelerations(0.0, 0.0, Wheels::default());
        let mut plane = Self { a: Matrix4::zeros(), b: Matrix4x3::zeros() };
        (plane.a[(0, 2)], plane.a[(1, 3)]) = (1.0, 1.0);
        (plane.a[(2, 1)], plane.a[(3, 1)]) = (free[0] / lean, free[1] / lean);
        // Viscous friction is odd in the rates; the quadratic terms are even.
        for (column, [speed, rate]) in [(2, [1.0, 0.0]), (3, [0.0, 1.0])] {
            let ahead = accelerations(speed, rate, Wheels::default());
            let back = accelerations(-speed, -rate, Wheels::default());
            (0..2).for_each(|row| plane.a[(2 + row, column)] = 0.5 * (ahead[row] - back[row]));
        }
        for wheel in 0..INPUTS {
            let driven = accelerations(0.0, 0.0, Wheels::from_fn(|i| f64::from(i == wheel)));
            (0..2).for_each(|row| plane.b[(2 + row, wheel)] = driven[row] - free[row]);
        }
        plane
    }

    fn upright(params: &Params, axis: usize) -> Self {
        let linear = LinearModel::new(params);
        // Indices of the plane's states in the linear model, with the sign of the lean.
        let (places, sign) = if axis == 0 { ([0, 3, 5, 8], 1.0) } else { ([1, 2, 6, 7], -1.0) };
        let signs = [1.0, sign, 1.0, sign];
        Self {
            a: Matrix4::from_fn(|i, j| signs[i] * linear.a[(places[i], places[j])] * signs[j]),
            b: Matrix4x3::from_fn(|i, j| signs[i] * linear.b[(places[i], j)]),
        }
    }
}
