/* Scales a vector to at most some length. */
static inline void ballbot_policy_within(ballbot_real v[2], ballbot_real most)
{
    const ballbot_real length = ballbot_sqrt(v[0] * v[0] + v[1] * v[1]);
    if (length > most) {
        v[0] *= most / length;
        v[1] *= most / length;
    }
}

/* Adds to the position error in the newest observation its integral, which hardly grows while the ball moves, and limits
 * the sum. */
static inline void ballbot_policy_integrate(ballbot_policy *policy)
{
    ballbot_real *rows = policy->past + policy->newest * BALLBOT_POLICY_ROWS;
    ballbot_real *x = rows + BALLBOT_POLICY_POSITION[0], *y = rows + BALLBOT_POLICY_POSITION[1];
    const ballbot_real vx = rows[BALLBOT_POLICY_VELOCITY[0]] / BALLBOT_POLICY_INTEGRAL_SLOW;
    const ballbot_real vy = rows[BALLBOT_POLICY_VELOCITY[1]] / BALLBOT_POLICY_INTEGRAL_SLOW;
    const ballbot_real share = BALLBOT_POLICY_INTEGRAL_RATE / (1 + vx * vx + vy * vy);
    ballbot_real error[2], shown[2];
    error[0] = *x;
    error[1] = *y;
    if (policy->started) {
        ballbot_policy_within(error, BALLBOT_POLICY_INTEGRAL_LARGEST_ERROR);
        policy->integral[0] += error[0] * share;
        policy->integral[1] += error[1] * share;
        ballbot_policy_within(policy->integral, BALLBOT_POLICY_INTEGRAL_LARGEST);
    }
    shown[0] = *x + policy->integral[0];
    shown[1] = *y + policy->integral[1];
    ballbot_policy_within(shown, BALLBOT_POLICY_INTEGRAL_LARGEST_SHOWN);
    *x = shown[0];
    *y = shown[1];
}

