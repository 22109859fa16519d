/* ---- What is wrong with the robot, in the heading frame: position (x, y), tilt (x, y), yaw, then their rates; and what
 * the motors add to the angular accelerations of the leans in the setpoint's motion, rad/s^2. */
static inline void ballbot_deviation(
    const ballbot_state *state, const ballbot_setpoint *setpoint, const ballbot_pose *pose, ballbot_real x[10],
    ballbot_real forward[2])
{
    const ballbot_real yaw = pose->yaw - setpoint->yaw;
    ballbot_real lean[2];
    ballbot_real rate[2];
    int i;
    ballbot_in_heading(
        pose, state->ball_position[0] - setpoint->position[0], state->ball_position[1] - setpoint->position[1], x);
    x[2] = pose->tilt[0];
    x[3] = pose->tilt[1];
    /* Whole turns do not count. */
    x[4] = yaw - 2 * BALLBOT_PI * ballbot_floor((yaw + BALLBOT_PI) / (2 * BALLBOT_PI));
    ballbot_in_heading(
        pose, state->ball_velocity[0] - setpoint->velocity[0], state->ball_velocity[1] - setpoint->velocity[1], x + 5);
    ballbot_in_heading(pose, setpoint->acceleration[0], setpoint->acceleration[1], lean);
    ballbot_in_heading(pose, setpoint->jerk[0], setpoint->jerk[1], rate);
    ballbot_in_heading(pose, setpoint->snap[0], setpoint->snap[1], forward);
    for (i = 0; i < 2; i++) {
        lean[i] *= BALLBOT_LEAN_PER_ACCELERATION[i];
        rate[i] *= BALLBOT_LEAN_PER_ACCELERATION[i];
        forward[i] = BALLBOT_LEAN_PER_ACCELERATION[i] * forward[i] - BALLBOT_TOPPLING_SQUARED[i] * lean[i];
    }
    /* Leaning towards y turns about -x. */
    x[2] += lean[1];
    x[3] -= lean[0];
    x[7] = pose->rate[0] + rate[1];
    x[8] = pose->rate[1] - rate[0];
    x[9] = pose->rate[2] - setpoint->yaw_rate;
}
