static inline ballbot_real ballbot_policy_within(ballbot_real value, ballbot_real most)
{
    return ballbot_max(-most, ballbot_min(most, value));
}

/* Adds to the position error in the newest observation its integral, which hardly grows while the ball moves, and limits
 * the sum. */
static inline void ballbot_policy_integrate(ballbot_policy *policy)
{
    ballbot_real *rows = policy->past + policy->newest * BALLBOT_POLICY_ROWS;
    ballbot_real x = rows[BALLBOT_POLICY_VELOCITY[0]] / BALLBOT_POLICY_INTEGRAL_SLOW;
    ballbot_real y = rows[BALLBOT_POLICY_VELOCITY[1]] / BALLBOT_POLICY_INTEGRAL_SLOW;
    const ballbot_real share = BALLBOT_POLICY_INTEGRAL_RATE / (1 + x * x + y * y);
    ballbot_real distance;
    int i;
    for (i = 0; i < 2; i++) {
        ballbot_real *row = rows + BALLBOT_POLICY_POSITION[i];
        const ballbot_real error = ballbot_policy_within(*row, BALLBOT_POLICY_INTEGRAL_LARGEST_ERROR);
        if (policy->started) {
            policy->integral[i] =
                ballbot_policy_within(policy->integral[i] + error * share, BALLBOT_POLICY_INTEGRAL_LARGEST);
        }
        *row += policy->integral[i];
    }
    x = rows[BALLBOT_POLICY_POSITION[0]];
    y = rows[BALLBOT_POLICY_POSITION[1]];
    distance = ballbot_sqrt(x * x + y * y);
    if (distance > BALLBOT_POLICY_INTEGRAL_LARGEST_SHOWN) {
        rows[BALLBOT_POLICY_POSITION[0]] = x * BALLBOT_POLICY_INTEGRAL_LARGEST_SHOWN / distance;
        rows[BALLBOT_POLICY_POSITION[1]] = y * BALLBOT_POLICY_INTEGRAL_LARGEST_SHOWN / distance;
    }
}

