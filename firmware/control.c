#include "parts.h"

#include "control.h"
#include "supervisor.h"

#ifdef BALLBOT_POLICY_KNOWN
#define CONTROL_DT BALLBOT_POLICY_CONTROL_DT
static ballbot_policy control;
#else
#define CONTROL_DT BALLBOT_CONTROL_DT
static ballbot_controller control;
#endif

static ballbot_supervisor supervisor;

_Static_assert((uint32_t)(1e6 * CONTROL_DT + 0.5) == PERIOD_US, "the controller has another rate than the firmware");
_Static_assert(
    (uint32_t)(1e6 * BALLBOT_SUPERVISOR_DT + 0.5) == PERIOD_US, "the supervisor has another rate than the firmware");

static void narrow(const double *from, ballbot_real *to, int count)
{
    while (count--) {
        *to++ = (ballbot_real)*from++;
    }
}

void control_begin(void)
{
#ifdef BALLBOT_POLICY_KNOWN
    ballbot_policy_reset(&control);
#else
    ballbot_reset(&control);
#endif
    ballbot_supervisor_reset(&supervisor);
}

typedef char the_supervisor_must_bridge_what_the_firmware_does[BALLBOT_SUPERVISOR_MOST_MISSED >= LOST ? 1 : -1];

int control_step(const estimate *estimated, const target *wanted, uint32_t periods, double torques[3])
{
    ballbot_setpoint setpoint = {0};
    ballbot_state state;
    ballbot_real found[3];
    int i, status;
    narrow(estimated->quaternion, state.quaternion, 4);
    narrow(estimated->rate, state.rate, 3);
    narrow(estimated->ball_position, state.ball_position, 2);
    narrow(estimated->ball_velocity, state.ball_velocity, 2);
    narrow(estimated->ball_rate, state.ball_rate, 3);
    narrow(estimated->wheel_speeds, state.wheel_speeds, 3);
    narrow(wanted->position, setpoint.position, 2);
    narrow(wanted->velocity, setpoint.velocity, 2);
    narrow(&wanted->yaw, &setpoint.yaw, 1);
    narrow(&wanted->yaw_rate, &setpoint.yaw_rate, 1);
    narrow(wanted->acceleration, setpoint.acceleration, 2);
    narrow(wanted->jerk, setpoint.jerk, 2);
    narrow(wanted->snap, setpoint.snap, 2);
#ifdef BALLBOT_POLICY_KNOWN
    {
        ballbot_real rows[BALLBOT_POLICY_ROWS];
        ballbot_policy_observe(&control, &state, &setpoint, rows);
        ballbot_policy_step(&control, rows, found);
    }
#else
    ballbot_step(&control, &state, &setpoint, found);
#endif
    /* Where readings were missing the last torques acted, and heated the motors. */
    for (; periods > 1; periods--) {
        ballbot_real held[3] = {0};
        ballbot_supervise(&supervisor, &state, 0, held);
    }
    status = ballbot_supervise(&supervisor, &state, 1, found);
    for (i = 0; i < 3; i++) {
        torques[i] = (double)found[i];
    }
    return status < BALLBOT_SUPERVISOR_TILT ? CONTROL_RUNNING
        : status == BALLBOT_SUPERVISOR_NOT_FINITE ? CONTROL_NOT_FINITE
                                                  : CONTROL_LIMIT;
}
