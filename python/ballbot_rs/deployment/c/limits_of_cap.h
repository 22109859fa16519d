static inline ballbot_limited ballbot_transmitted(
    const ballbot_real desired[3], const ballbot_state *state, const ballbot_pose *pose)
{
    (void)state;
    (void)pose;
    return ballbot_cap(desired, BALLBOT_MAX_TORQUE);
}
