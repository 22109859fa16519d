/* ---- The controller. */

typedef struct {
    ballbot_limited last;     /* of the last call */
    ballbot_real integral[2]; /* of what the law integrates, in x and y */
} ballbot_controller;

/* Forgets the past. */
static inline void ballbot_reset(ballbot_controller *controller)
{
    static const ballbot_limited start = {{0, 0, 0}, 1, 1};
    controller->last = start;
    controller->integral[0] = 0;
    controller->integral[1] = 0;
}
