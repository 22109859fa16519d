/* ---- Saturation: torques that the wheels can pass on. */

typedef struct {
    ballbot_real torques[3]; /* N m */
    ballbot_real share;      /* of the desired tilt torque that is left, from 0 to 1 */
    ballbot_real yaw_share;  /* of the desired yaw torque that is left, from 0 to 1 */
} ballbot_limited;

static inline ballbot_real ballbot_largest(const ballbot_real v[3])
{
    return ballbot_max(ballbot_max(ballbot_abs(v[0]), ballbot_abs(v[1])), ballbot_abs(v[2]));
}

/* Cut off at a bound, above which a scaled torque may round. */
static inline ballbot_real ballbot_within(ballbot_real torque, ballbot_real bound)
{
    return torque > bound ? bound : torque < -bound ? -bound : torque;
}

/* All torques scaled down together, which keeps their direction. */
static inline ballbot_limited ballbot_cap(const ballbot_real desired[3], ballbot_real bound)
{
    ballbot_limited limited;
    const ballbot_real largest = ballbot_largest(desired);
    int i;
    limited.share = largest > bound ? bound / largest : 1;
    limited.yaw_share = limited.share;
    for (i = 0; i < 3; i++) {
        limited.torques[i] = ballbot_within(limited.share * desired[i], bound);
    }
    return limited;
}

/* Torques with the friction of the joints, which does not reach the ball. */
static inline void ballbot_overcome(
    const ballbot_real wanted[3], const ballbot_state *state, ballbot_real torques[3])
{
    const ballbot_real width = BALLBOT_JOINT_DRY_WIDTH;
    int i;
    for (i = 0; i < 3; i++) {
        const ballbot_real speed = state->wheel_speeds[i];
        const ballbot_real dry = BALLBOT_JOINT_DRY_FRICTION * speed / ballbot_sqrt(speed * speed + width * width);
        torques[i] = ballbot_within(wanted[i] + BALLBOT_JOINT_VISCOUS_FRICTION * speed + dry, BALLBOT_MAX_TORQUE);
    }
}
