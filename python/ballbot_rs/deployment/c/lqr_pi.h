#include "planar.h"
#include "deviation.h"
#include "lean_planes.h"
#include "outer.h"
#include "integral.h"
#include "integral_loop.h"

/* ---- The law. Its integrals are of the virtual wheels' rate errors, rad. */

/* Rates of the virtual wheels beyond the setpoint's motion, from deviations before they are cut. */
static inline void ballbot_wheel_rates(
    const ballbot_state *state, const ballbot_pose *pose, const ballbot_leaning *leaning, ballbot_real rates[2])
{
    const ballbot_real tilting[2] = {pose->rate[1], -pose->rate[0]};
    ballbot_real moving[2];
    int i;
    ballbot_in_heading(pose, state->ball_velocity[0], state->ball_velocity[1], moving);
    for (i = 0; i < 2; i++) {
        const ballbot_real setpoint[2] = {moving[i] - leaning->velocity[i], tilting[i] - leaning->rate[i]};
        rates[i] = ballbot_dot(BALLBOT_VIRTUAL_WHEEL[i], state->wheel_speeds, 3)
            - ballbot_dot(BALLBOT_WHEEL_RATES[i], setpoint, 2);
    }
}

/* Wheel torques for the next BALLBOT_CONTROL_DT, N m. */
static inline void ballbot_step(
    ballbot_controller *controller, const ballbot_state *state, const ballbot_setpoint *setpoint,
    ballbot_real torques[3])
{
    const ballbot_pose pose = ballbot_pose_of(state);
    ballbot_leaning leaning;
    ballbot_real x[10];
    ballbot_real accelerations[2];
    ballbot_real errors[2];
    ballbot_real measured[2];
    int i;
    ballbot_deviation(state, setpoint, &pose, x, accelerations);
    leaning = ballbot_leaning_of(x);
    ballbot_wheel_rates(state, &pose, &leaning, measured);
    ballbot_clip(x);
    leaning = ballbot_leaning_of(x);
    for (i = 0; i < 2; i++) {
        const ballbot_real outer[5] = {
            leaning.position[i], leaning.lean[i], leaning.velocity[i], leaning.rate[i], controller->integral[i]};
        errors[i] = -ballbot_dot(BALLBOT_OUTER_GAINS[i], outer, 5) - measured[i];
        accelerations[i] +=
            BALLBOT_INNER_GAINS[i][0] * errors[i] + BALLBOT_INNER_GAINS[i][1] * controller->integral[i];
    }
    ballbot_end_step(controller, state, &pose, x, accelerations, errors, torques);
}
