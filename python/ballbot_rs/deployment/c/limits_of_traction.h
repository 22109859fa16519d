/* Speeds of the ball's surface relative to the wheels' surfaces, m/s. */
static inline void ballbot_slip(const ballbot_state *state, ballbot_real slip[3])
{
    const ballbot_real *q = state->quaternion;
    const ballbot_real inverse[4] = {q[0], -q[1], -q[2], -q[3]};
    ballbot_real relative[3];
    int i;
    ballbot_turned(inverse, state->ball_rate, relative);
    for (i = 0; i < 3; i++) {
        relative[i] -= state->rate[i];
    }
    for (i = 0; i < 3; i++) {
        slip[i] = ballbot_dot(BALLBOT_SURFACE[i], relative, 3) - BALLBOT_WHEEL_RADIUS * state->wheel_speeds[i];
    }
}

/* Torques while a wheel slips, where the maps below do not hold: a torque that drives a wheel into slip is reduced, to
 * zero at most. */
static inline ballbot_limited ballbot_regrip(const ballbot_real desired[3], const ballbot_real slip[3])
{
    ballbot_limited limited = ballbot_cap(desired, ballbot_min(BALLBOT_MAX_TORQUE, BALLBOT_SLIPPING_TORQUE));
    int i;
    for (i = 0; i < 3; i++) {
        const ballbot_real torque = limited.torques[i];
        if (torque * slip[i] < 0) {
            limited.torques[i] += ballbot_within(BALLBOT_GRIP * slip[i], ballbot_abs(torque));
        }
    }
    return limited;
}

/* By how much torques raise a condition, N. In single precision the rounding of a sum that is zero would be taken for a
 * rise: a condition at its bound allows none. */
static inline ballbot_real ballbot_rise(const ballbot_real row[3], const ballbot_real torques[3])
{
    const ballbot_real rise = ballbot_dot(row, torques, 3);
    ballbot_real size = 0;
    int i;
    for (i = 0; i < 3; i++) {
        size += ballbot_abs(row[i] * torques[i]);
    }
    return BALLBOT_IS_FLOAT && rise < (ballbot_real)1e-6 * size ? 0 : rise;
}

/* By how much torques must be divided, at least 1, to be added to others, at which the conditions have these constants. */
static inline ballbot_real ballbot_excess(
    const ballbot_real constants[9], const ballbot_real others[3], const ballbot_real torques[3])
{
    ballbot_real excess = 1;
    int i;
    for (i = 0; i < 9; i++) {
        const ballbot_real margin = ballbot_max(-constants[i], BALLBOT_LEAST_MARGIN);
        excess = ballbot_max(ballbot_rise(BALLBOT_TRACTION_ROWS[i] + 3, torques) / margin, excess);
    }
    for (i = 0; i < 3; i++) {
        const ballbot_real towards = torques[i] < 0 ? -others[i] : others[i];
        const ballbot_real margin = ballbot_max(BALLBOT_MAX_TORQUE - towards, BALLBOT_LEAST_MARGIN);
        excess = ballbot_max(ballbot_abs(torques[i]) / margin, excess);
    }
    return excess;
}

/* The largest fraction of the desired torques with which no wheel slips or lifts and no motor exceeds its limit.
 * Each row of BALLBOT_TRACTION_ROWS (at rest, per tilt, per torque of each wheel, per squared tilt rate) is a condition
 * c + g . torques <= 0 in N. The yaw torque is given up first: it balances nothing. */
static inline ballbot_limited ballbot_transmitted(
    const ballbot_real desired[3], const ballbot_state *state, const ballbot_pose *pose)
{
    static const ballbot_real none[3] = {0, 0, 0};
    const ballbot_real squared = pose->rate[0] * pose->rate[0] + pose->rate[1] * pose->rate[1];
    const ballbot_real turning = ballbot_dot(BALLBOT_YAW_OF_TORQUES, desired, 3);
    ballbot_limited limited;
    ballbot_real constants[9];
    ballbot_real yaw[3];
    ballbot_real tilting[3];
    ballbot_real slip[3];
    int fits = ballbot_largest(desired) <= BALLBOT_MAX_TORQUE;
    int i;
    for (i = 0; i < 9; i++) {
        const ballbot_real *row = BALLBOT_TRACTION_ROWS[i];
        constants[i] = row[0] + ballbot_dot(row + 1, pose->tilt, 2) + row[6] * squared;
        fits = fits && ballbot_dot(row + 3, desired, 3) + constants[i] <= 0;
    }
    ballbot_slip(state, slip);
    if (ballbot_largest(slip) > BALLBOT_SLIPPING) {
        return ballbot_regrip(desired, slip);
    }
    limited.share = 1;
    limited.yaw_share = 1;
    for (i = 0; i < 3; i++) {
        limited.torques[i] = desired[i];
        yaw[i] = turning * BALLBOT_TORQUES_OF_YAW[i];
        tilting[i] = desired[i] - yaw[i];
    }
    /* Torques that are no numbers pass through. */
    if (fits || desired[0] != desired[0] || desired[1] != desired[1] || desired[2] != desired[2]) {
        return limited;
    }
    limited.share = 1 / ballbot_excess(constants, none, tilting);
    for (i = 0; i < 3; i++) {
        tilting[i] *= limited.share;
    }
    for (i = 0; i < 9; i++) {
        constants[i] += ballbot_dot(BALLBOT_TRACTION_ROWS[i] + 3, tilting, 3);
    }
    limited.yaw_share = 1 / ballbot_excess(constants, tilting, yaw);
    for (i = 0; i < 3; i++) {
        limited.torques[i] = ballbot_within(tilting[i] + limited.yaw_share * yaw[i], BALLBOT_MAX_TORQUE);
    }
    return limited;
}
