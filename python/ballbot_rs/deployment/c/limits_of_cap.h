static inline ballbot_limited ballbot_limit(
    const ballbot_real wanted[3], const ballbot_state *state, const ballbot_pose *pose)
{
    (void)state;
    (void)pose;
    return ballbot_cap(wanted, BALLBOT_MAX_TORQUE);
}
