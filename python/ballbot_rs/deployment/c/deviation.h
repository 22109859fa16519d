/* ---- What is wrong with the robot, in the heading frame: position (x, y), tilt (x, y), yaw, then their rates. */

static inline void ballbot_deviation(
    const ballbot_state *state, const ballbot_setpoint *setpoint, const ballbot_pose *pose, ballbot_real x[10])
{
    const ballbot_real yaw = pose->yaw - setpoint->yaw;
    ballbot_in_heading(
        pose, state->ball_position[0] - setpoint->position[0], state->ball_position[1] - setpoint->position[1], x);
    x[2] = pose->tilt[0];
    x[3] = pose->tilt[1];
    /* Whole turns do not count. */
    x[4] = yaw - 2 * BALLBOT_PI * ballbot_floor((yaw + BALLBOT_PI) / (2 * BALLBOT_PI));
    ballbot_in_heading(
        pose, state->ball_velocity[0] - setpoint->velocity[0], state->ball_velocity[1] - setpoint->velocity[1], x + 5);
    x[7] = pose->rate[0];
    x[8] = pose->rate[1];
    x[9] = pose->rate[2];
}
