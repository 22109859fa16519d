/* ---- The robot as the rows of an observation show it. */

typedef struct {
    ballbot_real gravity[3];   /* direction of gravity, body frame */
    ballbot_real position[2];  /* of the ball from the setpoint, heading frame, m */
    ballbot_real velocity[2];  /* of the ball, heading frame, m/s */
    ballbot_real commanded[2]; /* velocity of the setpoint, heading frame, m/s */
    ballbot_real yaw_rate;     /* of the heading, rad/s */
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
    const ballbot_real *from[3] = {away, state->ball_velocity, setpoint->velocity};
    ballbot_real *to[3] = {view.position, view.velocity, view.commanded};
    int i;
    view.gravity[0] = 2 * (w * y - x * z);
    view.gravity[1] = -2 * (y * z + w * x);
    view.gravity[2] = 2 * (x * x + y * y) - 1;
    for (i = 0; i < 3; i++) {
        to[i][0] = cos_yaw * from[i][0] + sin_yaw * from[i][1];
        to[i][1] = cos_yaw * from[i][1] - sin_yaw * from[i][0];
    }
    view.yaw_rate = -ballbot_dot(view.gravity, state->rate, 3);
    return view;
}
