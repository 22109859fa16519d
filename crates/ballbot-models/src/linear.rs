//! The spatial model linearized about its equilibrium on a level floor.

use super::{BallSpin, SpatialModel, WheelSpin};
use ballbot_base::params::Params;
use ballbot_base::wheels::Wheels;
use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector3, Vector6};

/// Number of states: x, y, tilt x, tilt y, yaw and their rates.
pub const STATES: usize = 10;
/// Number of inputs: the three wheel torques.
pub const INPUTS: usize = 3;

/// Linear model ẋ = A x + B τ with x = (x, y, tilt_x, tilt_y, yaw, v_x, v_y, Ω_x, Ω_y, Ω_z) in the heading frame. Tilt,
/// yaw and Ω belong to the balance frame ([`Params::to_balance_frame`]), which is upright in equilibrium and equals the
/// body frame if the center of mass is on the mast. The ball is free to spin about the vertical, as in eq. (7) of the
/// paper. Its spin is not a state: it follows from zero angular momentum of the robot about the vertical, as in motion
/// from rest under motor torques.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearModel {
    /// State matrix A.
    pub a: SMatrix<f64, STATES, STATES>,
    /// Input matrix B.
    pub b: SMatrix<f64, STATES, INPUTS>,
}

impl LinearModel {
    /// λ², the square of the rate at which the robot topples, 1/s².
    pub fn toppling_squared(&self) -> f64 {
        self.a[(8, 3)]
    }

    /// Torques of the wheels that turn the body by 1 rad/s² about each axis of the heading frame, N·m.
    pub fn turning_torques(&self) -> Matrix3<f64> {
        let turning: Matrix3<f64> = self.b.fixed_view::<3, 3>(7, 0).into_owned();
        turning.try_inverse().expect("the wheels turn the body about every axis")
    }

    /// Acceleration of the ball towards x per small lean that the wheels hold, m/(s²·rad).
    pub fn acceleration_per_lean(&self) -> f64 {
        let lever = -(self.b.fixed_view::<2, 3>(5, 0) * self.turning_torques())[(0, 1)];
        self.a[(5, 3)] + lever * self.toppling_squared()
    }

    /// Linear model of `params`. The accelerations of the spatial model at rest are linear in the torques; their odd
    /// part is linear in the rates. The floor is assumed level. Gravity is the torque M_b g l times a small tilt, with
    /// the distance l of the center of mass.
    pub fn new(params: &Params) -> Self {
        // Dry friction has no derivative at rest.
        let model = SpatialModel::new(
            &Params { wheel_coulomb_friction: 0.0, ..params.without_losses().on_level_floor() },
            WheelSpin::Absolute,
            BallSpin::Free,
        );
        let balanced = Balanced::new(&model);
        let at = |velocity: &Vector6<f64>, torques: Wheels<f64>| {
            balanced.accelerations(velocity, torques).fixed_rows::<5>(0).into_owned()
        };
        let ball_spin = balanced.ball_spin();
        let mut a = SMatrix::<f64, STATES, STATES>::zeros();
        let mut b = SMatrix::<f64, STATES, INPUTS>::zeros();
        for i in 0..5 {
            a[(i, 5 + i)] = 1.0;
            // Viscous friction is odd in the rates; the quadratic terms are even.
            let mut unit = Vector6::from_fn(|j, _| f64::from(j == i));
            unit[5] = ball_spin[i];
            let odd = (at(&unit, Wheels::default()) - at(&-unit, Wheels::default())) * 0.5;
            a.fixed_view_mut::<5, 1>(5, 5 + i).copy_from(&odd);
        }
        for i in 0..INPUTS {
            let unit = Wheels::from_fn(|j| f64::from(j == i));
            b.fixed_view_mut::<5, 1>(5, i).copy_from(&at(&Vector6::zeros(), unit));
        }
        let toppling = params.body_mass * params.gravity * params.body_com().norm();
        for i in [2, 3] {
            let per_force = balanced.response(&Vector6::from_fn(|j, _| f64::from(j == i)));
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

/// A spatial model in equilibrium at heading 0, with the body's rates and torques in the balance frame.
struct Balanced<'a> {
    model: &'a SpatialModel,
    /// From the body frame to the balance frame, here the inertial frame.
    attitude: UnitQuaternion<f64>,
}

impl<'a> Balanced<'a> {
    fn new(model: &'a SpatialModel) -> Self {
        Self { model, attitude: model.params().to_balance_frame() }
    }

    /// A generalized velocity or force in the coordinates of the model.
    fn in_body(&self, v: &Vector6<f64>) -> Vector6<f64> {
        with_turning(v, &self.attitude.inverse_transform_vector(&turning(v)))
    }

    /// A generalized velocity or force in the balance frame; the inverse of [`Balanced::in_body`].
    fn in_balance(&self, v: &Vector6<f64>) -> Vector6<f64> {
        with_turning(v, &(self.attitude * turning(v)))
    }

    fn accelerations(&self, velocity: &Vector6<f64>, torques: Wheels<f64>) -> Vector6<f64> {
        self.in_balance(&self.model.accelerations(&self.attitude, &self.in_body(velocity), torques))
    }

    fn response(&self, force: &Vector6<f64>) -> Vector6<f64> {
        self.in_balance(&self.model.response(&self.attitude, &self.in_body(force)))
    }

    /// Spin of the ball about the vertical per each of the other five rates, at zero angular momentum about the
    /// vertical.
    fn ball_spin(&self) -> SVector<f64, 5> {
        if self.model.params().is_symmetric() {
            // Motors turn ball and body in opposite directions; nothing else turns them.
            let turned = self.accelerations(&Vector6::zeros(), Wheels::all(1.0));
            return SVector::from([0.0, 0.0, 0.0, 0.0, turned[5] / turned[4]]);
        }
        // The robot turned as a whole has the momentum row of the angular momentum about the vertical.
        let whole = Vector6::new(0.0, 0.0, 0.0, 0.0, 1.0, 1.0);
        let momentum = self.in_balance(&self.model.momenta(&self.attitude, &self.in_body(&whole)));
        momentum.fixed_rows::<5>(0) / -momentum[5]
    }
}

/// Rates or torques of the body within a generalized velocity or force.
fn turning(v: &Vector6<f64>) -> Vector3<f64> {
    v.fixed_rows::<3>(2).into_owned()
}

fn with_turning(v: &Vector6<f64>, turning: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(v[0], v[1], turning.x, turning.y, turning.z, v[5])
}
