/* What the wheels tell: rows of H, effects of the body rate, G = P H' + C and C, the covariance of the noise of the
 * gyroscope in the prediction of attitude and wheel rates; wheel rates by the ball's rolling, and their covariance with
 * its relative error, which is considered, not estimated; effect of the ball's spin, 0 for a wheel that slips. */
typedef struct {
    ballbot_real h[3][9];
    ballbot_real by_rate[3][3];
    ballbot_real g[3][9];
    ballbot_real shared[3][9];
    ballbot_real rolling[3];
    ballbot_real of_rolling[3];
    ballbot_real innovation[3];
    ballbot_real spinning[3];
    ballbot_real s[3][3];
} ballbot_measurement;

static inline void ballbot_measure_wheel(
    const ballbot_estimator *e, ballbot_expected *now, int i, ballbot_measurement *m)
{
    const ballbot_real dt = BALLBOT_ESTIMATOR_DT;
    const ballbot_real *own = BALLBOT_ESTIMATOR_WHEELS_OF_BALL[i];
    ballbot_real c[3];
    ballbot_real turned[3];
    ballbot_real on_body[3];
    ballbot_real lever[3];
    ballbot_real by_velocity[3] = {0, 0, 0};
    int j;
    ballbot_times(now->matrix, own, c);
    by_velocity[0] = c[1] / BALLBOT_ESTIMATOR_BALL_RADIUS;
    by_velocity[1] = -c[0] / BALLBOT_ESTIMATOR_BALL_RADIUS;
    ballbot_cross(c, now->ball_rate, turned);
    ballbot_times_transposed(now->matrix, by_velocity, on_body);
    ballbot_cross(BALLBOT_ESTIMATOR_IMU_POSITION, on_body, lever);
    for (j = 0; j < 3; j++) {
        m->by_rate[i][j] = -own[j] - lever[j];
        m->h[i][3 + j] = -m->by_rate[i][j];
    }
    m->h[i][0] = turned[0] + now->arm[2] * by_velocity[1];
    m->h[i][1] = turned[1] - now->arm[2] * by_velocity[0];
    m->h[i][2] = 0;
    m->h[i][6] = by_velocity[0];
    m->h[i][7] = by_velocity[1];
    m->h[i][8] = c[2];
    m->rolling[i] = ballbot_dot(c, now->ball_rate, 2);
    m->of_rolling[i] = ballbot_dot(m->h[i], e->cross, 9) + BALLBOT_ESTIMATOR_ROLLING_VARIANCE * m->rolling[i];
    ballbot_times(now->matrix, m->by_rate[i], m->shared[i]);
    for (j = 0; j < 9; j++) {
        m->shared[i][j] = j < 3 ? BALLBOT_ESTIMATOR_GYRO_VARIANCE * dt * m->shared[i][j] : 0;
        m->g[i][j] = m->shared[i][j] + ballbot_dot(e->covariance[j], m->h[i], 9) + e->cross[j] * m->rolling[i];
    }
}

/* The inverse of a matrix by cofactors. */
static inline void ballbot_inverse(ballbot_real s[3][3], ballbot_real inverse[3][3])
{
    ballbot_real cofactors[3][3];
    ballbot_real determinant;
    int i, j;
    ballbot_cross(s[1], s[2], cofactors[0]);
    ballbot_cross(s[2], s[0], cofactors[1]);
    ballbot_cross(s[0], s[1], cofactors[2]);
    determinant = ballbot_dot(s[0], cofactors[0], 3);
    for (i = 0; i < 3; i++) {
        for (j = 0; j < 3; j++) {
            inverse[i][j] = cofactors[j][i] / determinant;
        }
    }
}

/* Which wheels slip: none if all pairs of wheels agree, else the wheel whose exclusion leaves the pair that agrees best, or
 * all if no pair agrees. Two wheels agree if what of their innovations does not depend on the spin is within the gate. */
static inline void ballbot_find_slip(const ballbot_measurement *m, const ballbot_real changes[3], int slips[3])
{
    ballbot_real apart[3];
    ballbot_real variance[3];
    int agrees[3];
    int alone[3];
    int k;
    for (k = 0; k < 3; k++) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        const ballbot_real a = m->h[j][8], b = -m->h[i][8];
        apart[k] = a * m->innovation[i] + b * m->innovation[j];
        apart[k] *= apart[k];
        /* Common to all wheels. */
        variance[k] = a * changes[i] + b * changes[j];
        variance[k] *= BALLBOT_ESTIMATOR_UNEVEN * variance[k];
        variance[k] += a * a * m->s[i][i] + b * b * m->s[j][j] + a * b * (m->s[i][j] + m->s[j][i]);
        agrees[k] = apart[k] <= BALLBOT_ESTIMATOR_SLIP_GATE * variance[k];
    }
    for (k = 0; k < 3; k++) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        alone[k] = agrees[k] && apart[k] * variance[i] <= apart[i] * variance[k]
            && apart[k] * variance[j] <= apart[j] * variance[k];
    }
    for (k = 0; k < 3; k++) {
        slips[k] = !(agrees[0] && agrees[1] && agrees[2]) && (alone[k] || !(alone[0] || alone[1] || alone[2]));
    }
}

/* Takes the wheels that slip out: those that disagree, and those that change faster than friction allows. */
static inline void ballbot_gate(
    ballbot_estimator *e, const ballbot_real gyro[3], const ballbot_real wheel_rates[3], const ballbot_real changes[3],
    ballbot_measurement *m)
{
    ballbot_real change_of_gyro[3];
    int i, j;
    ballbot_find_slip(m, changes, e->slipping);
    for (i = 0; i < 3; i++) {
        change_of_gyro[i] = (e->gyro[i] + gyro[i]) / 2 - e->mean_gyro[i];
    }
    for (i = 0; i < 3; i++) {
        const ballbot_real turning = -ballbot_dot(BALLBOT_ESTIMATOR_WHEELS_OF_BALL[i], change_of_gyro, 3);
        const ballbot_real jump = ballbot_abs(wheel_rates[i] - e->wheel_rates[i] - turning);
        e->slipping[i] = e->slipping[i] || jump > BALLBOT_ESTIMATOR_LARGEST_CHANGE[i];
        m->spinning[i] = e->slipping[i] ? 0 : m->h[i][8];
        if (!e->slipping[i]) {
            continue;
        }
        m->innovation[i] = 0;
        m->of_rolling[i] = 0;
        for (j = 0; j < 9; j++) {
            m->g[i][j] = 0;
        }
        for (j = 0; j < 3; j++) {
            m->s[i][j] = i == j;
            m->s[j][i] = i == j;
        }
    }
}

/* Hard maneuvers and pushes spin the ball faster than its random walk: if the spin surprises, it has jumped, by generalized
 * least squares. */
static inline void ballbot_explain_by_spin(ballbot_estimator *e, ballbot_real inverse[3][3], ballbot_measurement *m)
{
    ballbot_real weights[3];
    ballbot_real information, explained;
    int i;
    ballbot_times(inverse, m->spinning, weights);
    information = ballbot_dot(weights, m->spinning, 3);
    explained = ballbot_dot(weights, m->innovation, 3);
    if (explained * explained <= BALLBOT_ESTIMATOR_SLIP_GATE * information) {
        return;
    }
    for (i = 0; i < 3; i++) {
        m->innovation[i] -= m->spinning[i] * explained / information;
    }
    e->spin += explained / information;
    e->covariance[8][8] += 1 / information;
}

/* P becomes P - G S^-1 G', and the estimates get their share of the innovation. */
static inline void ballbot_apply(ballbot_estimator *e, ballbot_measurement *m)
{
    const ballbot_real vx = e->velocity[0];
    const ballbot_real vy = e->velocity[1];
    ballbot_real inverse[3][3];
    ballbot_real weighted[3];
    ballbot_real considered[3];
    ballbot_real error[9];
    ballbot_real small[4];
    int i, j;
    ballbot_inverse(m->s, inverse);
    ballbot_explain_by_spin(e, inverse, m);
    ballbot_times(inverse, m->innovation, weighted);
    ballbot_times(inverse, m->of_rolling, considered);
    for (i = 0; i < 9; i++) {
        const ballbot_real column[3] = {m->g[0][i], m->g[1][i], m->g[2][i]};
        ballbot_real gain[3];
        ballbot_times(inverse, column, gain);
        error[i] = ballbot_dot(column, weighted, 3);
        e->cross[i] -= ballbot_dot(column, considered, 3);
        for (j = i; j < 9; j++) {
            e->covariance[i][j] -= gain[0] * m->g[0][j] + gain[1] * m->g[1][j] + gain[2] * m->g[2][j];
            e->covariance[j][i] = e->covariance[i][j];
        }
    }
    ballbot_small(error, 1, small);
    ballbot_product(small, e->attitude, e->attitude);
    for (i = 0; i < 3; i++) {
        e->gyro_bias[i] += error[3 + i];
    }
    e->velocity[0] = vx - error[2] * vy + error[6];
    e->velocity[1] = vy + error[2] * vx + error[7];
    e->spin += error[8];
}

static inline void ballbot_correct(
    ballbot_estimator *e, const ballbot_real gyro[3], const ballbot_real wheel_rates[3])
{
    ballbot_expected now = ballbot_expected_of(e, gyro);
    ballbot_measurement m;
    ballbot_real changes[3];
    int i, j;
    for (i = 0; i < 3; i++) {
        changes[i] = now.wheel_rates[i] - e->expected[i];
        ballbot_measure_wheel(e, &now, i, &m);
        m.innovation[i] = wheel_rates[i] - (now.wheel_rates[i] + e->expected[i]) / 2;
    }
    for (i = 0; i < 3; i++) {
        for (j = 0; j < 3; j++) {
            m.s[i][j] = ballbot_dot(m.h[i], m.g[j], 9) + ballbot_dot(m.h[j], m.shared[i], 9)
                + m.rolling[i] * m.of_rolling[j]
                + BALLBOT_ESTIMATOR_GYRO_VARIANCE * ballbot_dot(m.by_rate[i], m.by_rate[j], 3);
        }
        m.s[i][i] += BALLBOT_ESTIMATOR_ENCODER_VARIANCE + BALLBOT_ESTIMATOR_UNEVEN * changes[i] * changes[i];
    }
    ballbot_gate(e, gyro, wheel_rates, changes, &m);
    ballbot_apply(e, &m);
}
