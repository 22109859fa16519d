//! Prediction step of the filter from gyroscope and accelerometer.

use super::Estimator;
use super::belief::Belief;
use super::covariance::{StepNoise, Transition};
use crate::sensor::Readings;
use ballbot_base::lanes::{Lane, Rotation, Vec3};

impl Estimator {
    /// Propagates attitude and velocity by a step. Returns the specific force of the IMU, inertial frame, m/s², and the
    /// rotation in the middle of the step.
    #[inline(always)]
    pub(super) fn predict<L: Lane>(&self, belief: &mut Belief<L>, readings: &Readings<L>) -> (Vec3<L>, Rotation<L>) {
        let dt = self.dt;
        let (first, last) = (belief.gyro - belief.gyro_bias, readings.gyro - belief.gyro_bias);
        // The rotation vector of a rate that changes linearly, to the fourth order.
        let coning = first.cross(last);
        let turn = (first + last) * first.x.splat(0.5 * dt);
        let turn = turn.plus(coning, first.x.splat(dt * dt / 12.0));
        let middle = belief.attitude.turned_in_own_frame(turn * turn.x.splat(0.25)).rotation();
        belief.attitude = belief.attitude.turned_in_own_frame(turn * turn.x.splat(0.5));

        let force = middle.apply(readings.specific_force);
        let [vx, vy] = belief.velocity;
        let pull = force.z * dt;
        let half_pull = pull * 0.5;
        let [x, y, z] = middle.rows;
        let (x, y) = (x * pull.splat(-dt), y * pull.splat(-dt));
        let turning = z * pull.splat(dt);
        let transition = Transition {
            rate: [
                x,
                y,
                -turning,
                // A yaw error rotates the velocity too, which is not an error in the heading frame.
                (turning * -vy).plus(y, half_pull),
                (turning * vx).plus(x, -half_pull),
            ],
            pull,
        };
        belief.velocity = [force.x.mul_add_all(dt, vx), force.y.mul_add_all(dt, vy)];
        let o = &self.options;
        belief.cross = transition.apply(&belief.cross);
        let by_force = (o.accelerometer_noise * dt).powi(2);
        let by_slip = o.slip_walk * o.slip_walk * dt;
        let velocity = L::select(belief.any_slips(), pull.splat(by_force + by_slip), pull.splat(by_force));
        belief.covariance.advance(
            &transition,
            &StepNoise {
                rate: o.gyro_noise * o.gyro_noise,
                bias: o.gyro_bias_walk.map(|walk| walk * walk * dt),
                velocity,
                spin: o.spin_walk * o.spin_walk * dt,
            },
        );
        (force, middle)
    }
}
