typedef struct {
    ballbot_real past[(BALLBOT_POLICY_OLDEST + 1) * BALLBOT_POLICY_ROWS]; /* scaled observations, a ring */
    ballbot_real action[3];                                               /* of the last call, within [-1, 1] */
    int newest;                                                           /* place of the last observation */
    int oldest;                                                           /* age of the oldest observation */
    int started;                                                          /* whether there was a call */
} ballbot_policy;

/* Forgets the past. */
static inline void ballbot_policy_reset(ballbot_policy *policy)
{
    static const ballbot_policy start = {{0}, {0}, 0, 0, 0};
    *policy = start;
}

/* A row of the observation in its unit, as the environment makes it: saturated and scaled; NaN is 0. */
static inline ballbot_real ballbot_policy_row(int i, ballbot_real value)
{
    const ballbot_real bound = BALLBOT_POLICY_BOUND[i];
    const ballbot_real row = value == value ? ballbot_max(-bound, ballbot_min(bound, value)) : 0;
    const ballbot_real scaled = (row - BALLBOT_POLICY_REST[i]) * BALLBOT_POLICY_GAIN[i];
    return ballbot_max(-BALLBOT_POLICY_SCALED_BOUND, ballbot_min(BALLBOT_POLICY_SCALED_BOUND, scaled));
}

/* Wheel torques for the next BALLBOT_POLICY_CONTROL_DT, N m, from the rows of an observation in their units. */
static inline void ballbot_policy_step(
    ballbot_policy *policy, const ballbot_real rows[BALLBOT_POLICY_ROWS], ballbot_real torques[3])
{
    ballbot_real observation[BALLBOT_POLICY_HISTORY * BALLBOT_POLICY_ROWS]; /* oldest first */
    int i, k;
    if (policy->started) {
        policy->newest = policy->newest < BALLBOT_POLICY_OLDEST ? policy->newest + 1 : 0;
        policy->oldest = policy->oldest < BALLBOT_POLICY_OLDEST ? policy->oldest + 1 : BALLBOT_POLICY_OLDEST;
    }
    for (i = 0; i < BALLBOT_POLICY_ROWS; i++) {
        policy->past[policy->newest * BALLBOT_POLICY_ROWS + i] = ballbot_policy_row(i, rows[i]);
    }
    policy->started = 1;
    for (k = 0; k < BALLBOT_POLICY_HISTORY; k++) {
        /* The first observation also replaces earlier observations. */
        const int age = BALLBOT_POLICY_AGES[k] < policy->oldest ? BALLBOT_POLICY_AGES[k] : policy->oldest;
        const int place = policy->newest - age + (policy->newest < age ? BALLBOT_POLICY_OLDEST + 1 : 0);
        ballbot_real *row = observation + (BALLBOT_POLICY_HISTORY - 1 - k) * BALLBOT_POLICY_ROWS;
        for (i = 0; i < BALLBOT_POLICY_ROWS; i++) {
            row[i] = policy->past[place * BALLBOT_POLICY_ROWS + i];
        }
    }
    ballbot_policy_act(observation, policy->action);
    for (i = 0; i < 3; i++) {
        torques[i] = BALLBOT_POLICY_MAX_TORQUE * policy->action[i];
    }
}
