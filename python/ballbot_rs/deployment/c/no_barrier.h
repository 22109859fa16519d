static inline ballbot_limited ballbot_limit(
    const ballbot_real desired[3], const ballbot_state *state, const ballbot_pose *pose)
{
    return ballbot_transmitted(desired, state, pose);
}
