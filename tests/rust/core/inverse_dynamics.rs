//! Inverse dynamics against the equations of motion.

use crate::support::general::any_robot_on_rollers;
use crate::support::{any_floor_tilt, any_start, natural_rate, vector};
use ballbot_core::lanes::{Quat, Vec3};
use ballbot_core::models::{BallSpin, BodyMotion, InverseDynamics, SpatialModel, WheelSpin};
use ballbot_core::{Params, Wheels};
use nalgebra::{UnitQuaternion, Vector3, Vector6};
use proptest::prelude::*;

fn vec3(v: &Vector3<f64>) -> Vec3<f64> {
    Vec3::new(v.x, v.y, v.z)
}

fn quat(q: &UnitQuaternion<f64>) -> Quat<f64> {
    Quat { w: q.w, v: Vec3::new(q.i, q.j, q.k) }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, failure_persistence: None, ..ProptestConfig::default() })]

    /// The torques of an acceleration produce that acceleration, on any floor and on rollers at any angle.
    #[test]
    fn torques_give_the_desired_acceleration(
        robot in any_robot_on_rollers(),
        floor_tilt in any_floor_tilt(0.4),
        start in any_start(0.5, 1.0),
        desired in vector(3.0),
    ) {
        let params = Params { wheel_coulomb_friction: 0.0, floor_tilt, ..robot };
        let model = SpatialModel::new(&params, WheelSpin::Absolute, BallSpin::Free);
        let state = start.of(&params);
        let (ball, rate) = (state.ball_angular_velocity, state.body_angular_velocity);
        let velocity = Vector6::new(state.ball_velocity.x, state.ball_velocity.y, rate.x, rate.y, rate.z, ball.z);
        let to_balance = params.to_balance_frame();
        let wheel_speeds = model.wheel_speeds(&state.body_quaternion, &velocity);
        let motion = BodyMotion {
            rotation: quat(&(state.body_quaternion * to_balance.inverse())).rotation(),
            body_rate: vec3(&(to_balance * rate)),
            ball_rate: vec3(&ball),
            wheel_speeds,
        };
        let desired = desired * natural_rate(&params).powi(2);
        let torques = InverseDynamics::new(&params).torques(&motion, vec3(&desired));
        let torques = torques.column();
        let found = model.accelerations(&state.body_quaternion, &velocity, Wheels::of_column(torques));
        let found = to_balance * found.fixed_rows::<3>(2).into_owned();
        // The torques are of the size that brakes the motors' own inertia.
        let driven = model.accelerations(&state.body_quaternion, &velocity, Wheels::of_column(torques * 2.0));
        let size = driven.amax().max(found.amax());
        prop_assert!((found - desired).amax() <= 1e-12 * size, "{found} in place of {desired}, of {size}");
    }
}
