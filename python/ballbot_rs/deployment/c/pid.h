/* ---- The controller. */

typedef struct {
    ballbot_limited last;     /* of the last call */
    ballbot_real integral[2]; /* of the tilt's error about x and y, rad s */
    ballbot_real filtered[2]; /* that error behind the derivative's filter, rad */
    int started;              /* whether the filter has a value: it starts at the first error */
} ballbot_controller;

/* Forgets the past. */
static inline void ballbot_reset(ballbot_controller *controller)
{
    static const ballbot_limited start = {{0, 0, 0}, 1, 1};
    int i;
    controller->last = start;
    controller->started = 0;
    for (i = 0; i < 2; i++) {
        controller->integral[i] = 0;
        controller->filtered[i] = 0;
    }
}

/* Wheel torques for the next BALLBOT_CONTROL_DT, N m. */
static inline void ballbot_step(
    ballbot_controller *controller, const ballbot_state *state, const ballbot_setpoint *setpoint,
    ballbot_real torques[3])
{
    const ballbot_pose pose = ballbot_pose_of(state);
    ballbot_real error[2];
    ballbot_real about[2]; /* virtual torque about x and y, N m */
    ballbot_real desired[3];
    int i;
    for (i = 0; i < 2; i++) {
        ballbot_real lag;
        error[i] = setpoint->tilt[i] - pose.tilt[i];
        lag = controller->started ? error[i] - controller->filtered[i] : 0;
        controller->filtered[i] = error[i] - lag + BALLBOT_FILTER_SHARE * lag;
        about[i] = BALLBOT_PROPORTIONAL * error[i] + BALLBOT_INTEGRAL * controller->integral[i]
            + BALLBOT_FILTERED_DERIVATIVE * lag;
    }
    controller->started = 1;
    for (i = 0; i < 3; i++) {
        desired[i] = ballbot_dot(BALLBOT_TORQUES_OF_VIRTUAL[i], about, 2);
    }
    controller->last = ballbot_limit(desired, state, &pose);
    /* A torque that is limited cannot act on the integral: hold it. */
    for (i = 0; i < 2 && !(controller->last.share < 1); i++) {
        controller->integral[i] += BALLBOT_CONTROL_DT * error[i];
    }
    ballbot_overcome(controller->last.torques, state, torques);
}
