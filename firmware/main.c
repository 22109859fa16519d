/* The loop of a robot's computer: readings arrive over the link, torques leave. */
#include <math.h>
#include <stddef.h>

#include "board.h"
#include "cortex.h"
#include "link.h"
#include "parts.h"

/* Running, or why not until the next RESET: after a pause the robot is not where the estimator has it. */
static uint16_t condition = BALLBOT_LINK_STARTING;
static ballbot_link_torques answer = {.sequence = UINT32_MAX};
static int has_answered; /* readings of this simulation */
static estimate estimated;
static double wheel_angles[3]; /* of the last readings that were used */
static uint32_t used;          /* their time, us */
static uint32_t heard;         /* when they came, ms */

static int are_finite(const double *values, int count)
{
    while (count > 0 && isfinite(*values)) {
        values++;
        count--;
    }
    return count == 0;
}

static int are_readable(const ballbot_link_readings *r)
{
    return are_finite(r->gyro, 3) && are_finite(r->specific_force, 3) && are_finite(r->wheel_angles, 3)
        && are_finite(r->position, 2) && are_finite(r->velocity, 2) && are_finite(&r->yaw, 1)
        && are_finite(&r->yaw_rate, 1) && are_finite(r->acceleration, 2) && are_finite(r->jerk, 2)
        && are_finite(r->snap, 2);
}

/* The estimate after readings that are `periods` control steps later than the last ones. */
static void observe(const ballbot_link_readings *readings, uint32_t periods)
{
    double rates[3];
    int i;
    for (i = 0; i < 3; i++) {
        rates[i] = (readings->wheel_angles[i] - wheel_angles[i]) / (1e-6 * PERIOD_US * periods);
        wheel_angles[i] = readings->wheel_angles[i];
    }
    used = readings->time;
    /* Those that are missing count as equal. */
    while (periods-- > 0) {
        estimator_update(readings->gyro, readings->specific_force, rates, &estimated);
    }
}

static int is_off(void)
{
    return condition == BALLBOT_LINK_STARTING || condition == BALLBOT_LINK_STALE;
}

/* The status after readings, and torques, which fall to zero once the supervisor has tripped. */
static uint16_t respond(const ballbot_link_readings *readings, double torques[3])
{
    const target wanted = {
        {readings->position[0], readings->position[1]},
        {readings->velocity[0], readings->velocity[1]},
        readings->yaw,
        readings->yaw_rate,
        {readings->acceleration[0], readings->acceleration[1]},
        {readings->jerk[0], readings->jerk[1]},
        {readings->snap[0], readings->snap[1]}};
    static const uint16_t statuses[] = {
        [CONTROL_RUNNING] = BALLBOT_LINK_RUNNING,
        [CONTROL_LIMIT] = BALLBOT_LINK_LIMIT,
        [CONTROL_NOT_FINITE] = BALLBOT_LINK_NOT_FINITE};
    /* Unsigned, so that it holds where the clock wraps. */
    uint32_t periods = (readings->time - used + PERIOD_US / 2) / PERIOD_US;
    memset(torques, 0, 3 * sizeof *torques);
    if (readings->flags & (BALLBOT_LINK_RESET | BALLBOT_LINK_STOP)) {
        condition = BALLBOT_LINK_STARTING;
    }
    if (!are_readable(readings)) {
        return BALLBOT_LINK_NOT_FINITE;
    }
    if (readings->flags & BALLBOT_LINK_RESET) {
        if (!estimator_begin(readings->specific_force)) {
            return condition;
        }
        control_begin();
        memcpy(wheel_angles, readings->wheel_angles, sizeof wheel_angles);
        periods = 1;
        condition = BALLBOT_LINK_RUNNING;
    } else if (!is_off() && (periods == 0 || periods > 1 + LOST)) {
        condition = BALLBOT_LINK_STALE;
    }
    if (is_off()) {
        return condition;
    }
    observe(readings, periods);
    condition = statuses[control_step(&estimated, &wanted, periods, torques)];
    return condition;
}

static void send(uint16_t status)
{
    uint8_t frame[BALLBOT_LINK_TORQUES_LONGEST];
    int size, i;
    answer.flags = status;
    size = ballbot_link_encode_torques(&answer, frame);
    for (i = 0; i < size; i++) {
        board_send(frame[i]);
    }
}

static void trace(uint32_t count)
{
    int i;
    for (i = 0; TRACE && i < 32; i += 8) {
        board_trace((uint8_t)(count >> i));
    }
}

static void receive(const ballbot_link_readings *readings)
{
    const int stops = readings->flags & BALLBOT_LINK_STOP;
    const int order = stops || !has_answered ? 1 : ballbot_link_order(&answer, readings);
    uint16_t status = answer.flags;
    if (order < 0) {
        return;
    }
    /* If they are repeated, the answer was lost. */
    if (order > 0) {
        const uint32_t before = board_count();
        heard = cortex_milliseconds();
        status = respond(readings, answer.torques);
        trace(board_count() - before);
        answer.sequence = readings->sequence;
        answer.time = readings->time;
        has_answered = !stops;
    }
    send(status);
}

int main(void)
{
    static ballbot_link_decoder decoder;
    static ballbot_link_readings readings;
    board_begin();
    cortex_begin(board_clock);
    /* Ends what a reset may have left of a frame. The first frame answers nothing: the board is up. */
    board_send(0);
    send(condition);
    for (;;) {
        const int byte = cortex_next();
        if (byte >= 0 && ballbot_link_feed(&decoder, (uint8_t)byte) == BALLBOT_LINK_READINGS) {
            ballbot_link_decode_readings(&decoder, &readings);
            receive(&readings);
        }
        if (!is_off() && cortex_milliseconds() - heard > WATCHDOG_MS) {
            condition = BALLBOT_LINK_STALE;
            memset(answer.torques, 0, sizeof answer.torques);
            send(condition);
        }
    }
}
