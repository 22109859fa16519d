#include "planar.h"
#include "deviation.h"
#include "lean_planes.h"
#include "outer.h"
#include "integral.h"

/* ---- The law. Its integral is of the position's deviation, inertial frame, m s. */

/* The fraction of a vector in the heading frame that needs no more lean than the limit of the integral. */
static inline ballbot_real ballbot_lean_share(const ballbot_real lean_per[2][2], const ballbot_real v[2])
{
    const ballbot_real lean[2] = {ballbot_dot(lean_per[0], v, 2), ballbot_dot(lean_per[1], v, 2)};
    return ballbot_share_within(lean, BALLBOT_MAX_INTEGRAL_LEAN);
}

/* The integral is held while torques, speed or lean are cut, and while the position is far off. */
static inline void ballbot_integrate(
    ballbot_controller *controller, const ballbot_state *state, const ballbot_setpoint *setpoint,
    const ballbot_pose *pose)
{
    ballbot_real next[2];
    ballbot_real heading[2];
    ballbot_real share;
    int i;
    for (i = 0; i < 2; i++) {
        const ballbot_real away = state->ball_position[i] - setpoint->position[i];
        next[i] = controller->integral[i] + BALLBOT_CONTROL_DT * away;
    }
    ballbot_in_heading(pose, next[0], next[1], heading);
    share = ballbot_lean_share(BALLBOT_LEAN_PER_INTEGRAL, heading);
    controller->integral[0] = share * next[0];
    controller->integral[1] = share * next[1];
}

/* Wheel torques for the next BALLBOT_CONTROL_DT, N m. */
static inline void ballbot_step(
    ballbot_controller *controller, const ballbot_state *state, const ballbot_setpoint *setpoint,
    ballbot_real torques[3])
{
    const ballbot_pose pose = ballbot_pose_of(state);
    ballbot_real x[10];
    ballbot_real z[2];
    ballbot_real forward[2];
    ballbot_real desired[3];
    ballbot_real left;
    int i;
    ballbot_deviation(state, setpoint, &pose, x, forward);
    left = ballbot_clip(x);
    ballbot_in_heading(&pose, controller->integral[0], controller->integral[1], z);
    ballbot_torques_of(forward, 0, desired);
    for (i = 0; i < 3; i++) {
        desired[i] -= ballbot_dot(BALLBOT_GAIN[i], x, 10) + ballbot_dot(BALLBOT_INTEGRAL_GAIN[i], z, 2);
    }
    controller->last = ballbot_limit(desired, state, &pose);
    if (!(left < 1 || controller->last.share < 1 || ballbot_lean_share(BALLBOT_LEAN_PER_POSITION, x) < 1)) {
        ballbot_integrate(controller, state, setpoint, &pose);
    }
    ballbot_overcome(controller->last.torques, state, torques);
}
