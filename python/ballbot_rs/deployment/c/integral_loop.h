/* ---- The end of a step: the torques of the leans' accelerations and of a PD of the yaw, within the limits, and the integrals of
 * errors in the planes of x and y. */
static inline void ballbot_end_step(
    ballbot_controller *controller, const ballbot_state *state, const ballbot_pose *pose, const ballbot_real x[10],
    const ballbot_real accelerations[2], const ballbot_real errors[2], ballbot_real torques[3])
{
    const ballbot_real turning = -BALLBOT_YAW_GAINS[0] * x[4] - BALLBOT_YAW_GAINS[1] * x[9];
    ballbot_real desired[3];
    int i;
    ballbot_torques_of(accelerations, turning, desired);
    controller->last = ballbot_limit(desired, state, pose);
    /* A torque that is limited cannot act on the error: hold its integral. */
    for (i = 0; i < 2 && !(controller->last.share < 1); i++) {
        controller->integral[i] += BALLBOT_CONTROL_DT * errors[i];
    }
    ballbot_overcome(controller->last.torques, state, torques);
}
