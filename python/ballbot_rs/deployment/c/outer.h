/* ---- The largest speed that a deviation of the position may ask for, and the largest lean that it and a deviation of
 * the velocity may. Both are cut as vectors. Returns the share that is left of the position's. */
static inline ballbot_real ballbot_clip(ballbot_real x[10])
{
    const ballbot_real speed[2] = {
        ballbot_dot(BALLBOT_SPEED_PER_POSITION[0], x, 2), ballbot_dot(BALLBOT_SPEED_PER_POSITION[1], x, 2)};
    const ballbot_real slower = ballbot_share_within(speed, BALLBOT_MAX_SPEED);
    const ballbot_real moving[4] = {slower * x[0], slower * x[1], x[5], x[6]};
    const ballbot_real lean[2] = {
        ballbot_dot(BALLBOT_LEAN_PER_MOTION[0], moving, 4), ballbot_dot(BALLBOT_LEAN_PER_MOTION[1], moving, 4)};
    const ballbot_real less = ballbot_share_within(lean, BALLBOT_MAX_LEAN);
    x[0] = less * moving[0];
    x[1] = less * moving[1];
    x[5] = less * moving[2];
    x[6] = less * moving[3];
    return slower * less;
}
