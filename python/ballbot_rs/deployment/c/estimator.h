/* ---- The estimator. Its nine errors: attitude (3), bias of the gyroscope (3), velocity (2), spin of the ball. */

typedef struct {
    ballbot_real attitude[4];      /* body to inertial frame */
    ballbot_real gyro_bias[3];     /* body frame, rad/s */
    ballbot_real velocity[2];      /* of the IMU, inertial frame, m/s */
    ballbot_real spin;             /* of the ball about the vertical, rad/s */
    ballbot_real position[2];      /* of the ball, inertial frame, m */
    ballbot_real lean[2];          /* state of the observer of the lean bias */
    ballbot_real lean_bias[2];     /* lean in which the robot is in equilibrium, heading frame, rad */
    ballbot_real gyro[3];          /* last reading, rad/s */
    ballbot_real mean_gyro[3];     /* its mean over the last step, rad/s */
    ballbot_real wheel_rates[3];   /* last reading, rad/s */
    ballbot_real expected[3];      /* wheel rates that follow from the estimates, rad/s */
    ballbot_real covariance[9][9]; /* of the errors */
    ballbot_real cross[9];         /* covariance of the errors with the relative error of the rolling */
    int slipping[3];               /* whether a wheel slipped in the last step */
    int begun;                     /* whether there was a reading */
} ballbot_estimator;

/* Motion of ball and wheels that follows from the estimates. */
typedef struct {
    ballbot_real matrix[3][3];   /* of the attitude */
    ballbot_real rate[3];        /* of the body, body frame, rad/s */
    ballbot_real arm[3];         /* velocity of the IMU relative to the ball, inertial frame, m/s */
    ballbot_real velocity[2];    /* of the ball, m/s */
    ballbot_real ball_rate[3];   /* inertial frame, rad/s */
    ballbot_real wheel_rates[3]; /* rad/s */
} ballbot_expected;

static inline ballbot_expected ballbot_expected_of(const ballbot_estimator *e, const ballbot_real gyro[3])
{
    ballbot_expected out;
    ballbot_real v[3];
    int i;
    ballbot_matrix(e->attitude, out.matrix);
    for (i = 0; i < 3; i++) {
        out.rate[i] = gyro[i] - e->gyro_bias[i];
    }
    ballbot_cross(out.rate, BALLBOT_ESTIMATOR_IMU_POSITION, v);
    ballbot_times(out.matrix, v, out.arm);
    out.velocity[0] = e->velocity[0] - out.arm[0];
    out.velocity[1] = e->velocity[1] - out.arm[1];
    out.ball_rate[0] = -out.velocity[1] / BALLBOT_ESTIMATOR_BALL_RADIUS;
    out.ball_rate[1] = out.velocity[0] / BALLBOT_ESTIMATOR_BALL_RADIUS;
    out.ball_rate[2] = e->spin;
    ballbot_times_transposed(out.matrix, out.ball_rate, v);
    for (i = 0; i < 3; i++) {
        v[i] -= out.rate[i];
    }
    for (i = 0; i < 3; i++) {
        out.wheel_rates[i] = ballbot_dot(BALLBOT_ESTIMATOR_WHEELS_OF_BALL[i], v, 3);
    }
    return out;
}

/* Components in the heading frame of a horizontal vector of the inertial frame, or back for `side` = -1. */
static inline void ballbot_headed(
    const ballbot_real q[4], ballbot_real x, ballbot_real y, ballbot_real side, ballbot_real out[2])
{
    const ballbot_real length = q[0] * q[0] + q[3] * q[3];
    const ballbot_real cos_yaw = length > 0 ? (q[0] * q[0] - q[3] * q[3]) / length : 1;
    const ballbot_real sin_yaw = length > 0 ? side * 2 * q[0] * q[3] / length : 0;
    out[0] = cos_yaw * x + sin_yaw * y;
    out[1] = cos_yaw * y - sin_yaw * x;
}

/* Angular momentum about the floor contact by the weight's torque per lean, heading frame, s. */
static inline void ballbot_momentum(const ballbot_estimator *e, const ballbot_expected *now, ballbot_real out[2])
{
    ballbot_real v[2];
    ballbot_real lean[2];
    const ballbot_real rate_x = ballbot_dot(now->matrix[0], now->rate, 3);
    const ballbot_real rate_y = ballbot_dot(now->matrix[1], now->rate, 3);
    ballbot_headed(e->attitude, now->velocity[0], now->velocity[1], 1, v);
    ballbot_headed(e->attitude, rate_y, -rate_x, 1, lean);
    out[0] = BALLBOT_ESTIMATOR_ROLLING * v[0] + BALLBOT_ESTIMATOR_LEANING[0] * lean[0];
    out[1] = BALLBOT_ESTIMATOR_ROLLING * v[1] + BALLBOT_ESTIMATOR_LEANING[1] * lean[1];
}

/* Begins: the robot is believed to be in this state, within the deviations of the start. */
static inline void ballbot_estimator_begin(ballbot_estimator *e, const ballbot_state *start)
{
    ballbot_expected now;
    int i, j;
    e->begun = 0;
    e->spin = start->ball_rate[2];
    e->attitude[0] = start->quaternion[0];
    for (i = 0; i < 3; i++) {
        e->attitude[i + 1] = start->quaternion[i + 1];
        e->gyro_bias[i] = 0;
        e->gyro[i] = start->rate[i];
        e->mean_gyro[i] = start->rate[i];
        e->wheel_rates[i] = start->wheel_speeds[i];
        e->slipping[i] = 0;
    }
    for (i = 0; i < 2; i++) {
        e->velocity[i] = 0;
        e->position[i] = start->ball_position[i];
        e->lean_bias[i] = 0;
    }
    for (i = 0; i < 9; i++) {
        e->cross[i] = 0;
        for (j = 0; j < 9; j++) {
            e->covariance[i][j] = 0;
        }
        e->covariance[i][i] = i < 3 ? BALLBOT_ESTIMATOR_START_ATTITUDE
            : i < 6                 ? BALLBOT_ESTIMATOR_START_BIAS[i - 3]
            : i < 8                 ? BALLBOT_ESTIMATOR_START_VELOCITY
                                    : BALLBOT_ESTIMATOR_START_SPIN;
    }
    now = ballbot_expected_of(e, start->rate);
    for (i = 0; i < 2; i++) {
        e->velocity[i] = start->ball_velocity[i] + now.arm[i];
    }
    now = ballbot_expected_of(e, start->rate);
    for (i = 0; i < 3; i++) {
        e->expected[i] = now.wheel_rates[i];
    }
    ballbot_momentum(e, &now, e->lean);
    e->lean[0] *= BALLBOT_ESTIMATOR_PER_TIME;
    e->lean[1] *= BALLBOT_ESTIMATOR_PER_TIME;
}
