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
    ballbot_leaning leaning;
    ballbot_real x[10];
    ballbot_real s[2]; /* distance from the sliding surface of each plane, rad/s */
    ballbot_real accelerations[2];
    ballbot_real forward[2];
    ballbot_real desired[3];
    ballbot_real length;
    ballbot_real decay;
    int i;
    ballbot_deviation(state, setpoint, &pose, x, forward);
    ballbot_clip(x);
    leaning = ballbot_leaning_of(x);
    for (i = 0; i < 2; i++) {
        s[i] = BALLBOT_ALPHA[i] * (BALLBOT_C1[i] * leaning.position[i] + leaning.velocity[i])
            + BALLBOT_C2[i] * leaning.lean[i] + leaning.rate[i];
    }
    length = ballbot_sqrt(s[0] * s[0] + s[1] * s[1]);
    decay = BALLBOT_REACHING + BALLBOT_SWITCHING / ballbot_max(length, BALLBOT_LAYER);
    for (i = 0; i < 2; i++) {
        accelerations[i] = forward[i] - BALLBOT_LEAN_GAINS[i] * leaning.lean[i] - BALLBOT_VELOCITY_GAINS[i] * leaning.velocity[i]
            - BALLBOT_RATE_GAINS[i] * leaning.rate[i] - BALLBOT_PER_RATE[i] * decay * s[i];
    }
    ballbot_torques_of(accelerations, -BALLBOT_YAW_GAINS[0] * x[4] - BALLBOT_YAW_GAINS[1] * x[9], desired);
    controller->last = ballbot_limit(desired, state, &pose);
    ballbot_overcome(controller->last.torques, state, torques);
}
