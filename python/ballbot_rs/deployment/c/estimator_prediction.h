/* What a step does to the errors: effects of an error of the body rate on attitude (3) and velocity (2), and the change of
 * the velocity by an error of the tilt. */
typedef struct {
    ballbot_real rate[5][3];
    ballbot_real pull;
} ballbot_transition;

static inline void ballbot_transit(const ballbot_transition *f, const ballbot_real x[9], ballbot_real out[9])
{
    int i;
    for (i = 0; i < 9; i++) {
        out[i] = x[i];
    }
    for (i = 0; i < 3; i++) {
        out[i] += ballbot_dot(f->rate[i], x + 3, 3);
    }
    out[6] += f->pull * x[1] + ballbot_dot(f->rate[3], x + 3, 3);
    out[7] += -f->pull * x[0] + ballbot_dot(f->rate[4], x + 3, 3);
}

/* Whether a wheel slipped in the last step. */
static inline int ballbot_any_slips(const ballbot_estimator *e)
{
    return e->slipping[0] || e->slipping[1] || e->slipping[2];
}

/* P becomes F P F' + Q. */
static inline void ballbot_advance(ballbot_real p[9][9], const ballbot_transition *f, int slips)
{
    static const int driven[5] = {0, 1, 2, 6, 7};
    const ballbot_real velocity_step = BALLBOT_ESTIMATOR_VELOCITY_STEP + (slips ? BALLBOT_ESTIMATOR_SLIP_STEP : 0);
    ballbot_real half[9][9];
    ballbot_real column[9];
    int i, j;
    for (i = 0; i < 9; i++) {
        ballbot_transit(f, p[i], half[i]);
    }
    for (i = 0; i < 9; i++) {
        for (j = 0; j < 9; j++) {
            column[j] = half[j][i];
        }
        ballbot_transit(f, column, p[i]);
    }
    for (i = 0; i < 5; i++) {
        for (j = 0; j < 5; j++) {
            p[driven[i]][driven[j]] += BALLBOT_ESTIMATOR_GYRO_VARIANCE * ballbot_dot(f->rate[i], f->rate[j], 3);
        }
    }
    for (i = 3; i < 6; i++) {
        p[i][i] += BALLBOT_ESTIMATOR_BIAS_STEP[i - 3];
    }
    p[6][6] += velocity_step;
    p[7][7] += velocity_step;
    p[8][8] += BALLBOT_ESTIMATOR_SPIN_STEP;
}

/* Moves attitude and velocity by a step; gives the specific force in the inertial frame, m/s^2, and the rotation in the
 * middle of the step. */
static inline void ballbot_predict(
    ballbot_estimator *e, const ballbot_real gyro[3], const ballbot_real specific_force[3], ballbot_real force[3],
    ballbot_real middle[3][3])
{
    const ballbot_real dt = BALLBOT_ESTIMATOR_DT;
    ballbot_real first[3];
    ballbot_real last[3];
    ballbot_real turn[3];
    ballbot_real small[4];
    ballbot_real halfway[4];
    ballbot_transition f;
    ballbot_real cross[9];
    int i;
    for (i = 0; i < 3; i++) {
        first[i] = e->gyro[i] - e->gyro_bias[i];
        last[i] = gyro[i] - e->gyro_bias[i];
    }
    /* The rotation vector of a rate that changes linearly. */
    ballbot_cross(first, last, turn);
    for (i = 0; i < 3; i++) {
        turn[i] = dt * (first[i] + last[i]) / 2 + dt * dt * turn[i] / 12;
    }
    ballbot_small(turn, 1 / (ballbot_real)2, small);
    ballbot_product(e->attitude, small, halfway);
    ballbot_matrix(halfway, middle);
    ballbot_small(turn, 1, small);
    ballbot_product(e->attitude, small, e->attitude);
    ballbot_times(middle, specific_force, force);
    f.pull = dt * force[2];
    for (i = 0; i < 3; i++) {
        f.rate[0][i] = -dt * middle[0][i];
        f.rate[1][i] = -dt * middle[1][i];
        f.rate[2][i] = -dt * middle[2][i];
        /* An error of the yaw turns the velocity with it, which is no error in the heading frame. */
        f.rate[3][i] = f.rate[2][i] * e->velocity[1] + f.rate[1][i] * f.pull / 2;
        f.rate[4][i] = -f.rate[2][i] * e->velocity[0] - f.rate[0][i] * f.pull / 2;
    }
    e->velocity[0] += dt * force[0];
    e->velocity[1] += dt * force[1];
    ballbot_advance(e->covariance, &f, ballbot_any_slips(e));
    ballbot_transit(&f, e->cross, cross);
    for (i = 0; i < 9; i++) {
        e->cross[i] = cross[i];
    }
}
