/* ---- The supervisor. */

/* What it found in a step. From BALLBOT_SUPERVISOR_TILT on it has tripped, until a reset. */
enum {
    BALLBOT_SUPERVISOR_OFF,       /* there was no reset */
    BALLBOT_SUPERVISOR_RUNNING,   /* torques pass as they are */
    BALLBOT_SUPERVISOR_TORQUE,    /* reduced to the largest torque */
    BALLBOT_SUPERVISOR_HEAT,      /* reduced, since a motor is at its largest heat */
    BALLBOT_SUPERVISOR_HELD,      /* the last torques, since readings are missing or a number is not finite */
    BALLBOT_SUPERVISOR_TILT,      /* tripped: tilt and tilt rate were beyond what can be recovered */
    BALLBOT_SUPERVISOR_SPEED,     /* tripped: a wheel is too fast */
    BALLBOT_SUPERVISOR_STALE,     /* tripped: readings were missing for too long */
    BALLBOT_SUPERVISOR_NOT_FINITE /* tripped: numbers were not finite for too long */
};

/* Begin with `ballbot_supervisor supervisor = {0};`, which is off, with cold motors. */
typedef struct {
    ballbot_real torques[3]; /* of the last step with usable readings, N m */
    ballbot_real heat[3];    /* of each motor, 1 at its limit */
    ballbot_real share;      /* of the torques: 1 until it trips, then falling to 0 */
    int missed;              /* steps in a row without usable readings */
    int beyond;              /* steps in a row with a tilt and a rate that cannot be recovered */
    int status;              /* of the last step */
} ballbot_supervisor;

/* Begins, also after a trip. Motors stay as hot as they are. */
static inline void ballbot_supervisor_reset(ballbot_supervisor *supervisor)
{
    int i;
    for (i = 0; i < 3; i++) {
        supervisor->torques[i] = 0;
    }
    supervisor->share = 1;
    supervisor->missed = 0;
    supervisor->beyond = 0;
    supervisor->status = BALLBOT_SUPERVISOR_RUNNING;
}

static inline int ballbot_supervisor_finite(const ballbot_real *values, int count)
{
    while (count > 0 && isfinite(*values)) {
        values++;
        count--;
    }
    return count == 0;
}

/* Whether a quaternion is an attitude: of unit length, not as a driver leaves it that has not begun. */
static inline int ballbot_supervisor_is_attitude(const ballbot_real q[4])
{
    return ballbot_abs(ballbot_dot(q, q, 4) - 1) < (ballbot_real)0.1;
}

/* Whether tilt and tilt rate can be recovered: |tilt / BALLBOT_SUPERVISOR_MAX_TILT + rate / _MAX_TILT_RATE| <= 1. */
static inline int ballbot_supervisor_recovers(const ballbot_state *state)
{
    const ballbot_real *mast = BALLBOT_SUPERVISOR_MAST;
    const ballbot_real *q = state->quaternion;
    /* The vertical in the body frame, and the axis of the tilt from it to the mast. */
    const ballbot_real up[3] = {
        2 * (q[1] * q[3] - q[0] * q[2]), 2 * (q[2] * q[3] + q[0] * q[1]), 1 - 2 * (q[1] * q[1] + q[2] * q[2])};
    const ballbot_real axis[3] = {
        up[1] * mast[2] - up[2] * mast[1], up[2] * mast[0] - up[0] * mast[2], up[0] * mast[1] - up[1] * mast[0]};
    const ballbot_real sine = ballbot_sqrt(ballbot_dot(axis, axis, 3));
    const ballbot_real cosine = ballbot_dot(up, mast, 3);
    const ballbot_real angle = sine > 0 ? ballbot_atan2(sine, cosine) / sine : 1;
    const ballbot_real turning = ballbot_dot(up, state->rate, 3);
    ballbot_real sum[3];
    int i;
    for (i = 0; i < 3; i++) {
        sum[i] = angle * axis[i] / BALLBOT_SUPERVISOR_MAX_TILT
            + (state->rate[i] - turning * up[i]) / BALLBOT_SUPERVISOR_MAX_TILT_RATE;
    }
    return cosine > 0 && ballbot_dot(sum, sum, 3) <= 1;
}

/* The largest torque of a motor with which its heat stays within 1, N m. */
static inline ballbot_real ballbot_supervisor_cool(ballbot_real heat)
{
    const ballbot_real reserve = (1 - heat) * (BALLBOT_SUPERVISOR_HEATING_TIME / BALLBOT_SUPERVISOR_DT);
    return BALLBOT_SUPERVISOR_CONTINUOUS_TORQUE * ballbot_sqrt(ballbot_max(heat + reserve, 0));
}

/* Why the robot must stop, or else that it is running or holds its last torques. */
static inline int ballbot_supervisor_judge(ballbot_supervisor *supervisor, const ballbot_state *state, int finite)
{
    int i;
    if (supervisor->missed > BALLBOT_SUPERVISOR_MOST_MISSED) {
        return finite ? BALLBOT_SUPERVISOR_STALE : BALLBOT_SUPERVISOR_NOT_FINITE;
    }
    if (supervisor->missed > 0) {
        return BALLBOT_SUPERVISOR_HELD;
    }
    /* Wheels that slip after a push return some of the rate when they grip again: it must last. */
    supervisor->beyond = ballbot_supervisor_recovers(state) ? 0 : supervisor->beyond + 1;
    if (supervisor->beyond >= BALLBOT_SUPERVISOR_TILT_STEPS) {
        return BALLBOT_SUPERVISOR_TILT;
    }
    for (i = 0; i < 3; i++) {
        if (ballbot_abs(state->wheel_speeds[i]) > BALLBOT_SUPERVISOR_MAX_SPEED) {
            return BALLBOT_SUPERVISOR_SPEED;
        }
    }
    return BALLBOT_SUPERVISOR_RUNNING;
}

/* The torques of the supervisor within the limits of the motors, scaled together, which keeps their direction; whether
 * torque or heat limits them, else `status`. */
static inline int ballbot_supervisor_limit(const ballbot_supervisor *supervisor, int status, ballbot_real torques[3])
{
    const ballbot_real *wanted = supervisor->torques;
    ballbot_real bounds[3];
    ballbot_real share = 1;
    int i;
    for (i = 0; i < 3; i++) {
        const ballbot_real cool = ballbot_supervisor_cool(supervisor->heat[i]);
        bounds[i] = ballbot_min(cool, BALLBOT_SUPERVISOR_MAX_TORQUE);
        if (share * ballbot_abs(wanted[i]) > bounds[i]) {
            share = bounds[i] / ballbot_abs(wanted[i]);
            if (status <= BALLBOT_SUPERVISOR_HEAT) {
                status = cool < BALLBOT_SUPERVISOR_MAX_TORQUE ? BALLBOT_SUPERVISOR_HEAT : BALLBOT_SUPERVISOR_TORQUE;
            }
        }
    }
    for (i = 0; i < 3; i++) {
        /* Scaled torques may round above a bound. */
        torques[i] = ballbot_max(-bounds[i], ballbot_min(bounds[i], share * wanted[i]));
    }
    return status;
}

/* Replaces the torques of a controller for the next BALLBOT_SUPERVISOR_DT, N m, by torques within the limits. `fresh`:
 * whether there were readings in this step. Returns the status. */
static inline int ballbot_supervise(
    ballbot_supervisor *supervisor, const ballbot_state *state, int fresh, ballbot_real torques[3])
{
    const int finite = ballbot_supervisor_is_attitude(state->quaternion) && ballbot_supervisor_finite(state->rate, 3)
        && ballbot_supervisor_finite(state->wheel_speeds, 3) && ballbot_supervisor_finite(torques, 3);
    const int usable = fresh && finite;
    int i;
    if (usable) {
        supervisor->missed = 0;
    } else if (supervisor->missed <= BALLBOT_SUPERVISOR_MOST_MISSED) {
        supervisor->missed++;
    }
    for (i = 0; i < 3 && usable; i++) {
        supervisor->torques[i] = torques[i];
    }
    if (supervisor->status != BALLBOT_SUPERVISOR_OFF && supervisor->status < BALLBOT_SUPERVISOR_TILT) {
        supervisor->status = ballbot_supervisor_judge(supervisor, state, finite);
    }
    if (supervisor->status >= BALLBOT_SUPERVISOR_TILT) {
        supervisor->share = ballbot_max(supervisor->share - BALLBOT_SUPERVISOR_DT / BALLBOT_SUPERVISOR_RAMP_TIME, 0);
    }
    if (supervisor->status == BALLBOT_SUPERVISOR_OFF) {
        supervisor->share = 0;
    } else {
        supervisor->status = ballbot_supervisor_limit(supervisor, supervisor->status, torques);
    }
    for (i = 0; i < 3; i++) {
        ballbot_real load;
        torques[i] = supervisor->share > 0 ? supervisor->share * torques[i] : 0;
        load = torques[i] / BALLBOT_SUPERVISOR_CONTINUOUS_TORQUE;
        supervisor->heat[i] +=
            (load * load - supervisor->heat[i]) * (BALLBOT_SUPERVISOR_DT / BALLBOT_SUPERVISOR_HEATING_TIME);
    }
    return supervisor->status;
}
