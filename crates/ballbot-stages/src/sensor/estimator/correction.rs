//! Correction of the filter by the wheel rates.

use super::Estimator;
use super::belief::Belief;
use super::covariance::{BIAS, SPIN, STATES, VELOCITY, dot};
use super::gate::by_turning;
use crate::sensor::Readings;
use ballbot_base::lanes::{Lane, Vec3};
use ballbot_base::wheels::{WHEELS, WheelMatrix, Wheels};

/// Deviation of a mean rate from the mean of both ends of a step, as a fraction of their difference: motors and models
/// do not accelerate evenly within a step.
pub(super) const UNEVEN: f64 = 0.1;

impl Estimator {
    /// Corrects the estimates by the wheels that do not slip.
    ///
    /// A wheel rate is the mean over the step, and so is its prediction. The noise of the gyroscope enters the
    /// predictions of both attitude and wheel rates; `shared` is their covariance. The relative error of the rolling is
    /// constant, so averaging readings does not remove it: it is considered with its covariance, not estimated
    /// (Schmidt).
    ///
    /// Hard maneuvers spin the ball faster than its random walk. Only wheels measure the spin, so excluding all of them
    /// would lose it for good: if all surprise, and a jump of the spin explains them, it is a jump of the spin, by
    /// generalized least squares.
    #[inline(always)]
    pub(super) fn correct<L: Lane>(&self, belief: &mut Belief<L>, readings: &Readings<L>) {
        let (dt, o) = (self.dt, &self.options);
        let rotation = belief.attitude.rotation();
        let rate = readings.gyro - belief.gyro_bias;
        let expected = self.expected(belief, &rotation, rate);
        let (like, arm) = (rate.x, self.arm(rate.x));
        let change_of_gyro = (belief.gyro + readings.gyro) * like.splat(0.5) - belief.mean_gyro;
        let gyro_variance = o.gyro_noise * o.gyro_noise;
        let encoder_variance = 2.0 * (o.encoder_noise / dt).powi(2);
        let inverse_radius = 1.0 / self.odometry.ball_radius;

        let zero = like.zero();
        let mut innovation = Wheels::zero(zero);
        // Rows of H, effects of the body rate, columns of P Hᵀ + C and of C.
        let mut h = Wheels::all([zero; STATES]);
        let mut by_rate = Wheels::all(Vec3::zero(like));
        let mut g = Wheels::all([zero; STATES]);
        let mut shared = Wheels::all([zero; STATES]);
        // Wheel rates due to the ball's rolling, and their covariance with its relative error.
        let mut rolling = Wheels::zero(zero);
        let mut of_rolling = Wheels::zero(zero);
        for i in 0..WHEELS {
            let row = &self.odometry.rows[i];
            let own = Vec3::new(like.splat(row[0]), like.splat(row[1]), like.splat(row[2]));
            let c = rotation.apply(own);
            // Effect of the ball's velocity.
            let (mx, my) = (c.y * inverse_radius, c.x * -inverse_radius);
            let turned = c.cross(expected.ball_rate);
            let on_body = rotation.apply_transposed(Vec3::new(mx, my, zero));
            by_rate[i] = -own - arm.cross(on_body);
            h[i] = [
                expected.arm.z.mul_add(my, turned.x),
                expected.arm.z.neg_mul_add(mx, turned.y),
                zero,
                -by_rate[i].x,
                -by_rate[i].y,
                -by_rate[i].z,
                mx,
                my,
                c.z,
            ];
            let common = rotation.apply(by_rate[i]) * like.splat(gyro_variance * dt);
            shared[i][0] = common.x;
            shared[i][1] = common.y;
            shared[i][2] = common.z;
            rolling[i] = c.x.mul_add(expected.ball_rate.x, c.y * expected.ball_rate.y);
            of_rolling[i] = rolling[i].mul_add_all(o.rolling_error * o.rolling_error, dot(&h[i], &belief.cross));
            g[i] = belief.covariance.times(&h[i]);
            for (own, &cross) in g[i].iter_mut().zip(&belief.cross) {
                *own = cross.mul_add(rolling[i], *own);
            }
            for j in 0..3 {
                g[i][j] += shared[i][j];
            }
            let predicted = (expected.wheel_rates[i] + belief.expected[i]) * 0.5;
            innovation[i] = readings.wheel_rates[i] - predicted;
        }

        let mut s = Wheels::all(Wheels::zero(zero));
        for i in 0..WHEELS {
            for j in 0..WHEELS {
                let of_rate = by_rate[i].dot(by_rate[j]) * gyro_variance;
                s[i][j] = dot(&h[i], &g[j]) + dot(&h[j], &shared[i]) + rolling[i] * of_rolling[j] + of_rate;
            }
            let change = expected.wheel_rates[i] - belief.expected[i];
            s[i][i] = change.squared().mul_add_all(UNEVEN * UNEVEN, s[i][i] + encoder_variance);
        }
        let gate = o.slip_gate * o.slip_gate;
        let beyond = beyond_gate(&s, gate, innovation);
        let surprising = beyond[0] & beyond[1] & beyond[2];
        if L::any(surprising) {
            let spinning = Wheels([h[0][SPIN], h[1][SPIN], h[2][SPIN]]);
            let weights = s.inverse().times(spinning);
            let variance = like.splat(1.0) / weights.dot(spinning);
            let jump = weights.dot(innovation) * variance;
            let unexplained = innovation.plus(spinning, -jump);
            let beyond = beyond_gate(&s, gate, unexplained);
            let spun = surprising & !(beyond[0] | beyond[1] | beyond[2]);
            for i in 0..WHEELS {
                innovation[i] = L::select(spun, unexplained[i], innovation[i]);
            }
            belief.spin += L::select(spun, jump, zero);
            belief.covariance.rows[SPIN][SPIN] += L::select(spun, variance, zero);
        }
        let surprising = beyond_gate(&s, gate, innovation);
        for i in 0..WHEELS {
            let change = readings.wheel_rates[i] - belief.wheel_rates[i];
            let turning = by_turning(&self.odometry.rows[i], change_of_gyro);
            let slips = surprising[i] | self.jump.exceeded(i, change, turning);
            belief.slipping[i] = L::select(slips, like.splat(1.0), zero);
            innovation[i] = L::select(slips, zero, innovation[i]);
            of_rolling[i] = L::select(slips, zero, of_rolling[i]);
            for gain in &mut g[i] {
                *gain = L::select(slips, zero, *gain);
            }
            for j in 0..WHEELS {
                let apart = if i == j { like.splat(1.0) } else { zero };
                s[i][j] = L::select(slips, apart, s[i][j]);
                s[j][i] = L::select(slips, apart, s[j][i]);
            }
        }
        let inverse = s.inverse();
        let weighted = inverse.times(innovation);
        let mut error = [zero; STATES];
        for (j, error) in error.iter_mut().enumerate() {
            *error = Wheels([g[0][j], g[1][j], g[2][j]]).dot(weighted);
        }
        let considered = inverse.times(of_rolling);
        for (j, cross) in belief.cross.iter_mut().enumerate() {
            *cross -= Wheels([g[0][j], g[1][j], g[2][j]]).dot(considered);
        }
        belief.covariance.reduce(&g, &inverse);

        let half = like.splat(0.5);
        belief.attitude = belief.attitude.turned(Vec3::new(error[0], error[1], error[2]) * half);
        belief.gyro_bias += Vec3::new(error[BIAS], error[BIAS + 1], error[BIAS + 2]);
        let [vx, vy] = belief.velocity;
        belief.velocity =
            [error[2].neg_mul_add(vy, vx) + error[VELOCITY], error[2].mul_add(vx, vy) + error[VELOCITY + 1]];
        belief.spin += error[SPIN];
    }
}

/// Which innovations are beyond the gate, in squared deviations.
#[inline(always)]
fn beyond_gate<L: Lane>(s: &WheelMatrix<L>, gate: f64, innovation: Wheels<L>) -> [L::Mask; WHEELS] {
    let mut beyond = [innovation[0].lt(innovation[0]); WHEELS];
    for (i, beyond) in beyond.iter_mut().enumerate() {
        *beyond = (s[i][i] * gate).lt(innovation[i].squared());
    }
    beyond
}
