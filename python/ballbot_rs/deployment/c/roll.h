/* For a robot that measures no more of its ball than the wheels do: rate and velocity of the ball from attitude, body
 * rate and wheel speeds, for wheels that grip a ball that rolls on a level floor. A wheel that slips is then not seen. */
static inline void ballbot_roll(ballbot_state *state)
{
    ballbot_real rate[3];
    int i;
    for (i = 0; i < 3; i++) {
        rate[i] = state->rate[i] + ballbot_dot(BALLBOT_BALL_RATE_OF_WHEELS[i], state->wheel_speeds, 3);
    }
    ballbot_turned(state->quaternion, rate, state->ball_rate);
    state->ball_velocity[0] = BALLBOT_BALL_RADIUS * state->ball_rate[1];
    state->ball_velocity[1] = -BALLBOT_BALL_RADIUS * state->ball_rate[0];
}
