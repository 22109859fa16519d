/* ---- Measurements and setpoint. */
#ifndef BALLBOT_STATE_KNOWN
#define BALLBOT_STATE_KNOWN

/* The inertial frame has z up and the floor at z = 0; docs/conventions.md of ballbot has all frames and signs. */
typedef struct {
    ballbot_real quaternion[4];    /* attitude (w, x, y, z) of the body: turns its vectors into the inertial frame */
    ballbot_real rate[3];          /* angular velocity of the body, body frame, rad/s: what a gyroscope reads */
    ballbot_real ball_position[2]; /* center of the ball (x, y), inertial frame, m */
    ballbot_real ball_velocity[2]; /* its velocity, inertial frame, m/s */
    ballbot_real ball_rate[3];     /* angular velocity of the ball, inertial frame, rad/s; see ballbot_roll */
    ballbot_real wheel_speeds[3];  /* rates of the wheels relative to the body, as encoders read them, rad/s */
} ballbot_state;

/* Begin with `ballbot_setpoint setpoint = {0};`, so that a part that is new in a later version is zero. */
typedef struct {
    ballbot_real position[2]; /* of the ball's center, inertial frame, m */
    ballbot_real velocity[2]; /* of the ball's center, inertial frame, m/s */
    ballbot_real yaw;         /* heading, rad, of any number of turns */
    ballbot_real tilt[2];     /* about the x and y axes of the heading frame, rad */
    /* Of a motion, else zero: acceleration of its flat output, inertial frame, m/s^2, and its derivatives. */
    ballbot_real acceleration[2];
    ballbot_real jerk[2];
    ballbot_real snap[2];
    ballbot_real yaw_rate; /* rad/s */
} ballbot_setpoint;

/* A vector of the body in the inertial frame. */
static inline void ballbot_turned(const ballbot_real q[4], const ballbot_real v[3], ballbot_real turned[3])
{
    /* v + 2 w (u x v) + 2 u x (u x v), q = (w, u) */
    const ballbot_real cross[3] = {
        2 * (q[2] * v[2] - q[3] * v[1]), 2 * (q[3] * v[0] - q[1] * v[2]), 2 * (q[1] * v[1] - q[2] * v[0])};
    turned[0] = v[0] + q[0] * cross[0] + q[2] * cross[2] - q[3] * cross[1];
    turned[1] = v[1] + q[0] * cross[1] + q[3] * cross[0] - q[1] * cross[2];
    turned[2] = v[2] + q[0] * cross[2] + q[1] * cross[1] - q[2] * cross[0];
}

#endif
