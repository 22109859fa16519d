#include "planar.h"
#include "deviation.h"
#include "lean_planes.h"

/* ---- The controller. */

typedef struct {
    ballbot_limited last;     /* of the last call */
    ballbot_real integral[2]; /* of the lean's error towards x and y of the heading frame, rad s */
} ballbot_controller;

/* Forgets the past. */
static inline void ballbot_reset(ballbot_controller *controller)
{
    static const ballbot_limited start = {{0, 0, 0}, 1, 1};
    controller->last = start;
    controller->integral[0] = 0;
    controller->integral[1] = 0;
}

/* The leans that deviations of position and velocity ask for, cut as a vector. */
static inline void ballbot_reference(const ballbot_leaning *leaning, ballbot_real reference[2])
{
    ballbot_real speed[2];
    ballbot_real share;
    int i;
    for (i = 0; i < 2; i++) {
        speed[i] = leaning->position[i] * BALLBOT_POSITION_GAINS[i] / BALLBOT_VELOCITY_GAINS[i];
    }
    share = ballbot_share_within(speed, BALLBOT_MAX_SPEED);
    for (i = 0; i < 2; i++) {
        reference[i] = -BALLBOT_VELOCITY_GAINS[i] * (speed[i] * share + leaning->velocity[i]);
    }
    share = ballbot_share_within(reference, BALLBOT_MAX_LEAN);
    reference[0] *= share;
    reference[1] *= share;
}

/* Wheel torques for the next BALLBOT_CONTROL_DT, N m. */
static inline void ballbot_step(
    ballbot_controller *controller, const ballbot_state *state, const ballbot_setpoint *setpoint,
    ballbot_real torques[3])
{
    const ballbot_pose pose = ballbot_pose_of(state);
    ballbot_leaning leaning;
    ballbot_real x[10];
    ballbot_real reference[2];
    ballbot_real accelerations[2];
    ballbot_real forward[2];
    ballbot_real desired[3];
    int i;
    ballbot_deviation(state, setpoint, &pose, x, forward);
    leaning = ballbot_leaning_of(x);
    ballbot_reference(&leaning, reference);
    for (i = 0; i < 2; i++) {
        accelerations[i] = forward[i] + BALLBOT_REFERENCE_GAINS[i] * reference[i] - BALLBOT_LEAN_GAINS[i] * leaning.lean[i]
            - BALLBOT_RATE_GAINS[i] * leaning.rate[i] + BALLBOT_INTEGRAL_GAINS[i] * controller->integral[i];
    }
    ballbot_torques_of(accelerations, -BALLBOT_YAW_GAINS[0] * x[4] - BALLBOT_YAW_GAINS[1] * x[9], desired);
    controller->last = ballbot_limit(desired, state, &pose);
    /* A torque that is limited cannot act on the integral: hold it. */
    for (i = 0; i < 2 && !(controller->last.share < 1); i++) {
        controller->integral[i] += BALLBOT_CONTROL_DT * (reference[i] - leaning.lean[i]);
    }
    ballbot_overcome(controller->last.torques, state, torques);
}
