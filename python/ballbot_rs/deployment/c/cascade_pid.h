#include "planar.h"
#include "deviation.h"
#include "lean_planes.h"
#include "integral.h"
#include "integral_loop.h"

/* ---- The law. Its integrals are of the leans' errors, rad s. */

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
    ballbot_real errors[2];
    int i;
    ballbot_deviation(state, setpoint, &pose, x, forward);
    leaning = ballbot_leaning_of(x);
    ballbot_reference(&leaning, reference);
    for (i = 0; i < 2; i++) {
        errors[i] = reference[i] - leaning.lean[i];
        accelerations[i] = forward[i] + BALLBOT_REFERENCE_GAINS[i] * reference[i] - BALLBOT_LEAN_GAINS[i] * leaning.lean[i]
            - BALLBOT_RATE_GAINS[i] * leaning.rate[i] + BALLBOT_INTEGRAL_GAINS[i] * controller->integral[i];
    }
    ballbot_end_step(controller, state, &pose, x, accelerations, errors, torques);
}
