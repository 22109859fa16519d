//! Correction of the filter by the wheel rates.

use super::Estimator;
use super::belief::Belief;
use super::covariance::{BIAS, SPIN, STATES, VELOCITY, dot};
use super::gate::by_turning;
use crate::sensor::Readings;
use ballbot_base::lanes::{Lane, Vec3};
use ballbot_base::wheels::{WHEELS, WheelMatrix, Wheels};

/// Deviation of a mean rate from the mean of both ends of a step, as a fraction of their difference: motors and models
/// do not accelerate evenly within a step, each wheel in its own way and all alike.
pub(super) const UNEVEN: f64 = 0.1;

impl Estimator {
    /// Corrects the estimates by the wheels that do not slip.
    ///
    /// A wheel rate is the mean over the step, and so is its prediction. The noise of the gyroscope enters the
    /// predictions of both attitude and wheel rates; `shared` is their covariance. The relative error of the rolling is
    /// constant, so averaging readings does not remove it: it is considered with its covariance, not estimated
    /// (Schmidt).
    ///
    /// Hard maneuvers and pushes spin the ball faster than its random walk. So slip shows where two wheels disagree and no
    /// spin would make them agree. If the wheels that agree measure a spin beyond the gate, the spin has jumped, and the jump
    /// is found by generalized least squares.
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
        let changes = expected.wheel_rates.plus(belief.expected, like.splat(-1.0));
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
            s[i][i] = changes[i].squared().mul_add_all(UNEVEN * UNEVEN, s[i][i] + encoder_variance);
        }
        let gate = o.slip_gate * o.slip_gate;
        let mut spinning = Wheels([h[0][SPIN], h[1][SPIN], h[2][SPIN]]);
        let slips = slipping(&s, gate, spinning, changes, innovation);
        for i in 0..WHEELS {
            let change = readings.wheel_rates[i] - belief.wheel_rates[i];
            let turning = by_turning(&self.odometry.rows[i], change_of_gyro);
            let slips = slips[i] | self.jump.exceeded(i, change, turning);
            belief.slipping[i] = L::select(slips, like.splat(1.0), zero);
            innovation[i] = L::select(slips, zero, innovation[i]);
            spinning[i] = L::select(slips, zero, spinning[i]);
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
        let weights = inverse.times(spinning);
        let information = weights.dot(spinning);
        let explained = weights.dot(innovation);
        // The jump is `explained` / `information`, its variance 1 / `information`.
        let jumps = (information * gate).lt(explained.squared());
        let variance = L::select(jumps, like.splat(1.0) / information, zero);
        let jump = explained * variance;
        innovation = innovation.plus(spinning, -jump);
        belief.spin += jump;
        belief.covariance.rows[SPIN][SPIN] += variance;
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

/// Which wheels slip: none if all pairs of wheels agree, else the wheel whose exclusion leaves the pair that agrees best, or
/// all if no pair agrees. Two wheels agree if what of their innovations does not depend on the spin is within the gate, in
/// squared deviations.
#[inline(always)]
fn slipping<L: Lane>(
    s: &WheelMatrix<L>,
    gate: f64,
    spinning: Wheels<L>,
    changes: Wheels<L>,
    innovation: Wheels<L>,
) -> [L::Mask; WHEELS] {
    let mut apart = innovation;
    let mut variance = innovation;
    for k in 0..WHEELS {
        let (i, j) = ((k + 1) % WHEELS, (k + 2) % WHEELS);
        let (a, b) = (spinning[j], -spinning[i]);
        apart[k] = a.mul_add(innovation[i], b * innovation[j]).squared();
        // Common to all wheels.
        let change = a.mul_add(changes[i], b * changes[j]);
        variance[k] = a.squared().mul_add(s[i][i], b.squared().mul_add(s[j][j], a * b * (s[i][j] + s[j][i])));
        variance[k] = change.squared().mul_add_all(UNEVEN * UNEVEN, variance[k]);
    }
    let mut alone = [innovation[0].lt(innovation[0]); WHEELS];
    let (mut all_agree, mut none_agrees) = (!alone[0], !alone[0]);
    for k in 0..WHEELS {
        let (i, j) = ((k + 1) % WHEELS, (k + 2) % WHEELS);
        let agrees = apart[k].le(variance[k] * gate);
        let best =
            (apart[k] * variance[i]).le(apart[i] * variance[k]) & (apart[k] * variance[j]).le(apart[j] * variance[k]);
        alone[k] = agrees & best;
        all_agree = all_agree & agrees;
        none_agrees = none_agrees & !alone[k];
    }
    let mut slips = alone;
    for (slips, alone) in slips.iter_mut().zip(alone) {
        *slips = !all_agree & (alone | none_agrees);
    }
    slips
}
