/* ---- Attitude by the balance frame, which is upright in equilibrium, where the center of mass is above the ball. */

typedef struct {
    ballbot_real cos_yaw;
    ballbot_real sin_yaw;
    ballbot_real yaw;     /* rad, in (-pi, pi] */
    ballbot_real tilt[2]; /* rotation vector from the vertical about the x and y axes of the heading frame, rad */
    ballbot_real rate[3]; /* angular velocity, balance frame, rad/s */
} ballbot_pose;

/* Components in the heading frame of a horizontal vector of the inertial frame. */
static inline void ballbot_in_heading(const ballbot_pose *pose, ballbot_real x, ballbot_real y, ballbot_real out[2])
{
    out[0] = pose->cos_yaw * x + pose->sin_yaw * y;
    out[1] = pose->cos_yaw * y - pose->sin_yaw * x;
}

static inline ballbot_real ballbot_yaw(ballbot_real w, ballbot_real z)
{
    /* A quaternion and its negative are one attitude; the one with z >= 0 is used. */
    const ballbot_real yaw = 2 * ballbot_atan2(ballbot_abs(z), z < 0 ? -w : w);
    return yaw > BALLBOT_PI ? yaw - 2 * BALLBOT_PI : yaw;
}

static inline ballbot_pose ballbot_pose_of(const ballbot_state *state)
{
    ballbot_pose pose;
    const ballbot_real *b = BALLBOT_BALANCE_FRAME;
    const ballbot_real *q = state->quaternion;
    /* The attitude of the balance frame: q times the conjugate of b. */
    const ballbot_real w = q[0] * b[0] + q[1] * b[1] + q[2] * b[2] + q[3] * b[3];
    const ballbot_real x = q[1] * b[0] - q[0] * b[1] - q[2] * b[3] + q[3] * b[2];
    const ballbot_real y = q[2] * b[0] - q[0] * b[2] - q[3] * b[1] + q[1] * b[3];
    const ballbot_real z = q[3] * b[0] - q[0] * b[3] - q[1] * b[2] + q[2] * b[1];
    const ballbot_real length = w * w + z * z;
    const ballbot_real up_x = 2 * (x * z + w * y);
    const ballbot_real up_y = 2 * (y * z - w * x);
    const ballbot_real sine = ballbot_sqrt(up_x * up_x + up_y * up_y);
    const ballbot_real tilt = ballbot_atan2(sine, 1 - 2 * (x * x + y * y));
    /* Upside down the yaw is undefined. */
    pose.cos_yaw = length > 0 ? (w * w - z * z) / length : 1;
    pose.sin_yaw = length > 0 ? 2 * w * z / length : 0;
    pose.yaw = ballbot_yaw(w, z);
    if (sine > 0) {
        ballbot_in_heading(&pose, -up_y * tilt / sine, up_x * tilt / sine, pose.tilt);
    } else {
        ballbot_in_heading(&pose, tilt, 0, pose.tilt);
    }
    ballbot_turned(b, state->rate, pose.rate);
    return pose;
}
