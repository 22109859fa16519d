/* ---- The vertical planes of x and y of the heading frame: deviations of ball and lean, both towards positive x or y. */

typedef struct {
    ballbot_real position[2];
    ballbot_real velocity[2];
    ballbot_real lean[2];
    ballbot_real rate[2];
} ballbot_leaning;

static inline ballbot_leaning ballbot_leaning_of(const ballbot_real x[10])
{
    const ballbot_leaning leaning = {{x[0], x[1]}, {x[5], x[6]}, {x[3], -x[2]}, {x[8], -x[7]}};
    return leaning;
}

/* Wheel torques of accelerations of the leans and of the yaw. */
static inline void ballbot_torques_of(
    const ballbot_real accelerations[2], ballbot_real turning, ballbot_real desired[3])
{
    const ballbot_real about[3] = {-accelerations[1], accelerations[0], turning};
    int i;
    for (i = 0; i < 3; i++) {
        desired[i] = ballbot_dot(BALLBOT_TORQUES_OF_ACCELERATION[i], about, 3);
    }
}
