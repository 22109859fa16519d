//! Forces of rolling, spinning and roller friction for motion without slip.
//!
//! They are proportional to loads, which depend on the accelerations and thus on the friction: a linear system of four
//! loads, of the floor and the wheels.

use super::DRY_FRICTION_WIDTH;
use ballbot_base::params::Params;
use ballbot_base::wheels::{WHEELS, Wheels};
use nalgebra::{Matrix3x6, Matrix4, Matrix6x4, Vector3, Vector4, Vector6};

/// Inputs for solving for the accelerations and loads: generalized forces per load of the floor and the wheels.
pub struct Friction {
    /// Generalized force per load of the floor and of each wheel.
    pub per_load: Matrix6x4<f64>,
    /// Force of the rollers on the bot along p_i × d_i per load of wheel i.
    pub along_free: Wheels<f64>,
}

impl Friction {
    /// Friction at the generalized velocity `velocity`. `ball_rate` maps it to the ball's angular velocity (inertial frame),
    /// `free_speeds` to the speeds of the wheels along p_i × d_i against the ball's surface.
    pub fn new(
        params: &Params,
        ball_rate: &Matrix3x6<f64>,
        free_speeds: &Matrix3x6<f64>,
        velocity: &Vector6<f64>,
    ) -> Self {
        let rate = ball_rate * velocity;
        let rolling = rate.xy().norm();
        // tanh(x) / x, which needs no direction for a ball at rest.
        let share = if rolling > 0.0 { (rolling / DRY_FRICTION_WIDTH).tanh() / rolling } else { 0.0 };
        let torque = Vector3::new(
            -params.floor_rolling_friction * share * rate.x,
            -params.floor_rolling_friction * share * rate.y,
            -params.floor_spinning_friction * (rate.z / DRY_FRICTION_WIDTH).tanh(),
        );
        let width = DRY_FRICTION_WIDTH * params.ball_radius;
        let along_free = Wheels::of_column(free_speeds * velocity).map(|speed| {
            let coefficient = params.roller_friction + params.roller_friction_slope * speed.abs();
            -coefficient.min(params.wheel_dynamic_friction) * (speed / width).tanh()
        });
        let mut per_load = Matrix6x4::zeros();
        per_load.set_column(0, &(ball_rate.transpose() * torque));
        for i in 0..WHEELS {
            per_load.set_column(1 + i, &(free_speeds.row(i).transpose() * along_free[i]));
        }
        Self { per_load, along_free }
    }

    /// Forces of the rollers on the bot along p_i × d_i for given loads of the floor and the wheels, N.
    pub fn rollers(&self, loads: &Vector4<f64>) -> Wheels<f64> {
        Wheels::from_fn(|i| self.along_free[i] * loads[1 + i])
    }
}

/// Loads of the floor and the wheels, N: the fixed point of an affine function. A negative load has no friction. NaN
/// without a fixed point.
pub fn consistent(loads: impl Fn(&Vector4<f64>) -> Vector4<f64>) -> Vector4<f64> {
    let alone = loads(&Vector4::zeros());
    let mut matrix = Matrix4::identity();
    for k in 0..4 {
        let unit = Vector4::from_fn(|i, _| f64::from(i == k));
        let column = matrix.column(k) - (loads(&unit) - alone);
        matrix.set_column(k, &column);
    }
    let solution = matrix.lu().solve(&alone);
    solution.map_or_else(|| Vector4::repeat(f64::NAN), |loads| loads.map(|load| if load < 0.0 { 0.0 } else { load }))
}
