#include "parts.h"

#include "estimator.h"

_Static_assert(
    (uint32_t)(1e6 * BALLBOT_ESTIMATOR_DT + 0.5) == PERIOD_US, "the estimator has another rate than the firmware");

static ballbot_estimator estimator;

static void widen(const ballbot_real *from, double *to, int count)
{
    while (count--) {
        *to++ = (double)*from++;
    }
}

int estimator_begin(const double specific_force[3])
{
    /* The shortest rotation of its direction to the vertical. */
    const double x = specific_force[0], y = specific_force[1];
    const double z = specific_force[2] + sqrt(x * x + y * y + specific_force[2] * specific_force[2]);
    const double length = sqrt(x * x + y * y + z * z);
    const ballbot_state start = {
        {(ballbot_real)(z / length), (ballbot_real)(y / length), (ballbot_real)(-x / length), 0}, {0}, {0}, {0}, {0}, {0}};
    if (!(z > 0)) {
        return 0;
    }
    ballbot_estimator_begin(&estimator, &start);
    return 1;
}

void estimator_update(
    const double gyro[3], const double specific_force[3], const double wheel_rates[3], estimate *estimated)
{
    ballbot_real readings[9];
    ballbot_state state;
    int i;
    for (i = 0; i < 3; i++) {
        readings[i] = (ballbot_real)gyro[i];
        readings[3 + i] = (ballbot_real)specific_force[i];
        readings[6 + i] = (ballbot_real)wheel_rates[i];
    }
    ballbot_estimator_update(&estimator, readings, readings + 3, readings + 6, &state);
    widen(state.quaternion, estimated->quaternion, 4);
    widen(state.rate, estimated->rate, 3);
    widen(state.ball_position, estimated->ball_position, 2);
    widen(state.ball_velocity, estimated->ball_velocity, 2);
    widen(state.ball_rate, estimated->ball_rate, 3);
    widen(state.wheel_speeds, estimated->wheel_speeds, 3);
}
