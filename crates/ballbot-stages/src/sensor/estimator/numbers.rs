//! The numbers of an estimator by name.

use super::correction::UNEVEN;
use super::{Estimator, MAX_LEAN_BIAS};
use ballbot_base::constants::Constants;

impl Estimator {
    /// The numbers that it computes with: geometry, variances of a step and of the start, and constants of gates and
    /// lean.
    pub fn constants(&self) -> Constants {
        let (o, dt) = (&self.options, self.dt);
        let constants = Constants::default()
            .number("dt", dt)
            .vector("imu_position", &o.imu_position)
            .number("gyro_variance", o.gyro_noise.powi(2))
            .vector("bias_step", &o.gyro_bias_walk.map(|walk| walk * walk * dt))
            .number("velocity_step", (o.accelerometer_noise * dt).powi(2))
            .number("slip_step", o.slip_walk.powi(2) * dt)
            .number("spin_step", o.spin_walk.powi(2) * dt)
            .number("encoder_variance", 2.0 * (o.encoder_noise / dt).powi(2))
            .number("rolling_variance", o.rolling_error.powi(2))
            .number("start_attitude", o.start_attitude.powi(2))
            .vector("start_bias", &o.gyro_bias.map(|sd| sd * sd))
            .number("start_velocity", o.start_velocity.powi(2))
            .number("start_spin", (o.start_velocity / self.odometry.ball_radius).powi(2))
            .number("uneven", UNEVEN.powi(2))
            .number("slip_gate", o.slip_gate.powi(2))
            .number("max_lean_bias", MAX_LEAN_BIAS);
        self.lean.add_to(self.jump.add_to(self.odometry.add_to(constants)))
    }
}
