/* The lean bias: a low-pass of the lean less the change of the momentum. */
static inline void ballbot_observe_lean(ballbot_estimator *e, ballbot_expected *now)
{
    const ballbot_real turning = ballbot_dot(now->matrix[2], now->rate, 3);
    ballbot_real com[3];
    ballbot_real lean[2];
    ballbot_real momentum[2];
    ballbot_real towards[2];
    int i;
    ballbot_momentum(e, now, momentum);
    ballbot_times(now->matrix, BALLBOT_ESTIMATOR_COM, com);
    ballbot_headed(e->attitude, com[0], com[1], 1, lean);
    /* The heading frame turns. */
    towards[0] = lean[0] + turning * momentum[1];
    towards[1] = lean[1] - turning * momentum[0];
    for (i = 0; i < 2; i++) {
        const ballbot_real per_time = BALLBOT_ESTIMATOR_PER_TIME * momentum[i];
        e->lean[i] += BALLBOT_ESTIMATOR_LEAN_SHARE * (towards[i] - (e->lean[i] - per_time));
        e->lean_bias[i] = e->lean[i] - per_time;
    }
}

/* The position, by the wheel rates, or by the velocity where a wheel slips. */
static inline void ballbot_move(
    ballbot_estimator *e, const ballbot_real gyro[3], const ballbot_real wheel_rates[3], const ballbot_real force[3],
    ballbot_real middle[3][3], const ballbot_real velocity[2])
{
    const ballbot_real dt = BALLBOT_ESTIMATOR_DT;
    const int slips = ballbot_any_slips(e);
    ballbot_real relative[3];
    ballbot_real rate[3];
    ballbot_real rolled[2];
    int i;
    for (i = 0; i < 3; i++) {
        relative[i] = ballbot_dot(BALLBOT_ESTIMATOR_BALL_OF_WHEELS[i], wheel_rates, 3);
        relative[i] += (e->gyro[i] + gyro[i]) / 2 - e->gyro_bias[i];
    }
    ballbot_times(middle, relative, rate);
    rolled[0] = BALLBOT_ESTIMATOR_BALL_RADIUS * rate[1];
    rolled[1] = -BALLBOT_ESTIMATOR_BALL_RADIUS * rate[0];
    for (i = 0; i < 2; i++) {
        e->position[i] += dt * (slips ? velocity[i] - dt * force[i] / 2 : rolled[i]);
    }
}

static inline void ballbot_state_of(const ballbot_estimator *e, const ballbot_expected *now, ballbot_state *state)
{
    int i;
    state->quaternion[0] = e->attitude[0];
    for (i = 0; i < 3; i++) {
        state->quaternion[i + 1] = e->attitude[i + 1];
        state->rate[i] = now->rate[i];
        state->ball_rate[i] = now->ball_rate[i];
        state->wheel_speeds[i] = e->wheel_rates[i];
    }
    for (i = 0; i < 2; i++) {
        state->ball_position[i] = e->position[i];
        state->ball_velocity[i] = now->velocity[i];
    }
}

/* The state after the readings at the end of a step: of the gyroscope (rad/s) and of the accelerometer (acceleration less
 * gravity, m/s^2), both in the body frame, and the changes of the wheel angles over the step divided by it (rad/s). The
 * first readings are those at the start. */
static inline void ballbot_estimator_update(
    ballbot_estimator *e, const ballbot_real gyro[3], const ballbot_real specific_force[3],
    const ballbot_real wheel_rates[3], ballbot_state *state)
{
    ballbot_real force[3];
    ballbot_real middle[3][3];
    ballbot_expected now;
    int i;
    if (e->begun) {
        ballbot_predict(e, gyro, specific_force, force, middle);
        ballbot_correct(e, gyro, wheel_rates);
        now = ballbot_expected_of(e, gyro);
        ballbot_move(e, gyro, wheel_rates, force, middle, now.velocity);
        ballbot_observe_lean(e, &now);
    }
    for (i = 0; i < 3; i++) {
        e->mean_gyro[i] = e->begun ? (e->gyro[i] + gyro[i]) / 2 : gyro[i];
        e->gyro[i] = gyro[i];
        e->wheel_rates[i] = wheel_rates[i];
        if (e->begun) {
            e->expected[i] = now.wheel_rates[i];
        }
    }
    if (!e->begun) {
        now = ballbot_expected_of(e, gyro);
        e->begun = 1;
    }
    ballbot_state_of(e, &now, state);
}

/* Turns the attitude back by the lean bias: a controller then holds the equilibrium of the robot as it is, with a center of
 * mass that is not where its parameters say, or on a slope, without an integral. */
static inline void ballbot_estimator_balance(const ballbot_estimator *e, ballbot_state *state)
{
    const ballbot_real most = BALLBOT_ESTIMATOR_MAX_LEAN_BIAS;
    ballbot_real lean[2];
    ballbot_real back[3] = {0, 0, 0};
    ballbot_real small[4];
    lean[0] = ballbot_max(-most, ballbot_min(most, e->lean_bias[0]));
    lean[1] = ballbot_max(-most, ballbot_min(most, e->lean_bias[1]));
    ballbot_headed(state->quaternion, lean[0], lean[1], -1, lean);
    /* Leaning towards +x is a rotation about +y. */
    back[0] = lean[1];
    back[1] = -lean[0];
    ballbot_small(back, 1, small);
    ballbot_product(small, state->quaternion, state->quaternion);
}
