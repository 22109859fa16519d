#include "planar.h"
#include "deviation.h"
#include "lean_planes.h"
#include "outer.h"

/* ---- The controller. */

typedef struct {
    ballbot_limited last; /* of the last call */
} ballbot_controller;

/* Forgets the past. */
static inline void ballbot_reset(ballbot_controller *controller)
{
    static const ballbot_limited start = {{0, 0, 0}, 1, 1};
    controller->last = start;
}

/* Wheel torques for the next BALLBOT_CONTROL_DT, N m. */
static inline void ballbot_step(
    ballbot_controller *controller, const ballbot_state *state, const ballbot_setpoint *setpoint,
    ballbot_real torques[3])
{
    const ballbot_pose pose = ballbot_pose_of(state);
    ballbot_real x[10];
    ballbot_real forward[2];
    ballbot_real desired[3];
    int i;
    ballbot_deviation(state, setpoint, &pose, x, forward);
    ballbot_clip(x);
    ballbot_torques_of(forward, 0, desired);
    for (i = 0; i < 3; i++) {
        desired[i] -= ballbot_dot(BALLBOT_GAIN[i], x, 10);
    }
    controller->last = ballbot_limit(desired, state, &pose);
    ballbot_overcome(controller->last.torques, state, torques);
}
