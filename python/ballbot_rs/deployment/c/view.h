/* ---- The robot as the rows of an observation show it. */

typedef struct {
    ballbot_real gravity[3];  /* direction of gravity, body frame */
    ballbot_real position[2]; /* of the ball from the setpoint, heading frame, m */
    ballbot_real velocity[2]; /* of the ball, heading frame, m/s */
} ballbot_view;

static inline ballbot_view ballbot_view_of(const ballbot_state *state, const ballbot_setpoint *setpoint)
{
    ballbot_view view;
    const ballbot_real w = state->quaternion[0];
    const ballbot_real x = state->quaternion[1];
    const ballbot_real y = state->quaternion[2];
    const ballbot_real z = state->quaternion[3];
    const ballbot_real length = w * w + z * z;
    /* Upside down the heading is undefined. */
    const ballbot_real cos_yaw = length > 0 ? (w * w - z * z) / length : 1;
    const ballbot_real sin_yaw = length > 0 ? 2 * w * z / length : 0;
    const ballbot_real away[2] = {
        state->ball_position[0] - setpoint->position[0], state->ball_position[1] - setpoint->position[1]};
    view.gravity[0] = 2 * (w * y - x * z);
    view.gravity[1] = -2 * (y * z + w * x);
    view.gravity[2] = 2 * (x * x + y * y) - 1;
    view.position[0] = cos_yaw * away[0] + sin_yaw * away[1];
    view.position[1] = cos_yaw * away[1] - sin_yaw * away[0];
    view.velocity[0] = cos_yaw * state->ball_velocity[0] + sin_yaw * state->ball_velocity[1];
    view.velocity[1] = cos_yaw * state->ball_velocity[1] - sin_yaw * state->ball_velocity[0];
    return view;
}
