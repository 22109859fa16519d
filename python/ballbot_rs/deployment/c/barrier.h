#include "planar.h"

/* ---- A control barrier for the speed of the ball and the distance to a boundary, in x and y of the inertial frame. A
 * backup law brakes with a small lean, or returns where the ball would stop outside. Torques are changed only if the
 * state after this sample would be less safe under the backup law than after a sample of the backup law itself. */

#define BALLBOT_BARRIER_COUNT 18

/* Position, lean, velocity and rate of the lean, in both axes. */
typedef struct {
    ballbot_real state[2][4];
    ballbot_real speeds[2][BALLBOT_BARRIER_COUNT]; /* in the tests, after a sample of the backup law */
    ballbot_real backup[2];                        /* lean accelerations of the backup law, rad/s^2 */
    ballbot_real low[2];                           /* bounds of the change from them */
    ballbot_real high[2];
    ballbot_real bounds[BALLBOT_BARRIER_COUNT]; /* of the speed in the tests, m/s */
} ballbot_barrier;

static inline ballbot_real ballbot_length(const ballbot_real v[2])
{
    return ballbot_sqrt(v[0] * v[0] + v[1] * v[1]);
}

static inline ballbot_real ballbot_between(ballbot_real value, ballbot_real low, ballbot_real high)
{
    return ballbot_min(ballbot_max(value, low), high);
}

/* Components in the inertial frame of a vector of the heading frame. */
static inline void ballbot_in_inertial(const ballbot_pose *pose, ballbot_real x, ballbot_real y, ballbot_real out[2])
{
    out[0] = pose->cos_yaw * x - pose->sin_yaw * y;
    out[1] = pose->sin_yaw * x + pose->cos_yaw * y;
}

static inline void ballbot_backup(ballbot_barrier *barrier)
{
    ballbot_real returning[2];
    ballbot_real commanded[2];
    ballbot_real share;
    int a;
    for (a = 0; a < 2; a++) {
        const ballbot_real stop = ballbot_dot(BALLBOT_BARRIER_STOPS[a], barrier->state[a], 4);
        const ballbot_real inside = ballbot_between(stop, BALLBOT_BARRIER_WITHIN[a][0], BALLBOT_BARRIER_WITHIN[a][1]);
        returning[a] = BALLBOT_BARRIER_RETURN_RATE * (inside - stop);
    }
    share = ballbot_share_within(returning, BALLBOT_BARRIER_RETURN_SPEED);
    for (a = 0; a < 2; a++) {
        commanded[a] = BALLBOT_BARRIER_GAINS[a][1] * (barrier->state[a][2] - share * returning[a]);
    }
    share = ballbot_share_within(commanded, BALLBOT_BARRIER_LARGEST);
    for (a = 0; a < 2; a++) {
        const ballbot_real *gains = BALLBOT_BARRIER_GAINS[a];
        barrier->backup[a] =
            -gains[0] * barrier->state[a][1] - gains[2] * barrier->state[a][3] - share * commanded[a];
    }
}

/* Narrows the bounds of the change in an axis such that it displaces a place to within `limits`, or no farther beyond
 * them. */
static inline void ballbot_narrow(
    ballbot_barrier *barrier, int a, ballbot_real displaced, ballbot_real place, const ballbot_real limits[2])
{
    const ballbot_real least = ballbot_min(limits[0], place) - place;
    const ballbot_real most = ballbot_max(limits[1], place) - place;
    if (ballbot_abs(displaced) > BALLBOT_BARRIER_LEAST_DISPLACED) {
        const ballbot_real low = (displaced > 0 ? least : most) / displaced;
        const ballbot_real high = (displaced > 0 ? most : least) / displaced;
        barrier->low[a] = ballbot_max(barrier->low[a], low);
        barrier->high[a] = ballbot_min(barrier->high[a], high);
    }
}

/* Speeds and bounds in an axis, from the state after a sample of the backup law. */
static inline void ballbot_test(ballbot_barrier *barrier, int a)
{
    ballbot_real after[4];
    ballbot_real place;
    int i;
    for (i = 0; i < 4; i++) {
        const ballbot_real *motion = BALLBOT_BARRIER_MOTION[i];
        after[i] = ballbot_dot(motion, barrier->state[a], 4) + motion[4] * barrier->backup[a];
    }
    barrier->low[a] = -BALLBOT_BARRIER_FREE;
    barrier->high[a] = BALLBOT_BARRIER_FREE;
    /* Each test has its own bound: with the farthest for all, a ball beyond a limit could stay so in every test. */
    for (i = 0; i < BALLBOT_BARRIER_COUNT; i++) {
        const ballbot_real *test = BALLBOT_BARRIER_TESTS[a * BALLBOT_BARRIER_COUNT + i];
        place = ballbot_dot(test, after, 4);
        barrier->speeds[a][i] = ballbot_dot(test + 4, after, 4);
        ballbot_narrow(barrier, a, test[8], place, BALLBOT_BARRIER_BOUNDARY[a]);
    }
    place = ballbot_dot(BALLBOT_BARRIER_STOPS[a], after, 4);
    ballbot_narrow(barrier, a, BALLBOT_BARRIER_STOPS[a][4], place, BALLBOT_BARRIER_WITHIN[a]);
}

/* The velocity in a test after a change. */
static inline void ballbot_speed(
    const ballbot_barrier *barrier, const ballbot_real change[2], int i, ballbot_real velocity[2])
{
    int a;
    for (a = 0; a < 2; a++) {
        const ballbot_real gained = BALLBOT_BARRIER_TESTS[a * BALLBOT_BARRIER_COUNT + i][9];
        velocity[a] = barrier->speeds[a][i] + gained * change[a];
    }
}

/* Moves a change to the linear bound of the test that is farthest beyond it. */
static inline void ballbot_project(const ballbot_barrier *barrier, ballbot_real change[2])
{
    ballbot_real step[2] = {0, 0};
    ballbot_real farthest = 0;
    int a;
    int i;
    for (i = 0; i < BALLBOT_BARRIER_COUNT; i++) {
        const ballbot_real bound = barrier->bounds[i];
        ballbot_real velocity[2];
        ballbot_real length;
        ballbot_speed(barrier, change, i, velocity);
        length = ballbot_length(velocity);
        if (length > bound) {
            const ballbot_real slope[2] = {
                velocity[0] * BALLBOT_BARRIER_TESTS[i][9],
                velocity[1] * BALLBOT_BARRIER_TESTS[BALLBOT_BARRIER_COUNT + i][9]};
            const ballbot_real squared = ballbot_max(slope[0] * slope[0] + slope[1] * slope[1], (ballbot_real)1e-30);
            const ballbot_real beyond = (length - bound) * length;
            if (beyond / ballbot_sqrt(squared) > farthest) {
                farthest = beyond / ballbot_sqrt(squared);
                step[0] = beyond / squared * slope[0];
                step[1] = beyond / squared * slope[1];
            }
        }
    }
    for (a = 0; a < 2; a++) {
        change[a] = ballbot_between(change[a] - step[a], barrier->low[a], barrier->high[a]);
    }
}

/* The share of a change that stays within the bounds of the speed. A chord is an upper bound, since the speed is convex. */
static inline ballbot_real ballbot_share_of_change(const ballbot_barrier *barrier, const ballbot_real change[2])
{
    ballbot_real share = 1;
    int i;
    for (i = 0; i < BALLBOT_BARRIER_COUNT; i++) {
        const ballbot_real unchanged[2] = {barrier->speeds[0][i], barrier->speeds[1][i]};
        /* Rounding must not decide whether a change that ends at the bound is kept. */
        const ballbot_real bound = BALLBOT_BARRIER_SLACK * barrier->bounds[i];
        ballbot_real changed[2];
        ballbot_speed(barrier, change, i, changed);
        if (ballbot_length(changed) > bound) {
            share = ballbot_min(
                share, (bound - ballbot_length(unchanged)) / (ballbot_length(changed) - ballbot_length(unchanged)));
        }
    }
    return share;
}

/* Changes torques that do not respect the barrier to nearly the nearest ones that do; returns whether it did. */
static inline int ballbot_guard(ballbot_real torques[3], const ballbot_state *state, const ballbot_pose *pose)
{
    ballbot_barrier barrier;
    ballbot_real lean[2];
    ballbot_real rate[2];
    ballbot_real wanted[2];
    ballbot_real change[2];
    ballbot_real share;
    int changes = 0;
    int a;
    int i;
    /* Leaning towards y turns about -x. */
    ballbot_in_inertial(pose, pose->tilt[1], -pose->tilt[0], lean);
    ballbot_in_inertial(pose, pose->rate[1], -pose->rate[0], rate);
    ballbot_in_inertial(
        pose, ballbot_dot(BALLBOT_BARRIER_ACCELERATIONS[0], torques, 3),
        ballbot_dot(BALLBOT_BARRIER_ACCELERATIONS[1], torques, 3), wanted);
    for (a = 0; a < 2; a++) {
        barrier.state[a][0] = state->ball_position[a];
        barrier.state[a][1] = lean[a];
        barrier.state[a][2] = state->ball_velocity[a];
        barrier.state[a][3] = rate[a];
    }
    ballbot_backup(&barrier);
    for (a = 0; a < 2; a++) {
        ballbot_test(&barrier, a);
        change[a] = wanted[a] - barrier.backup[a];
        changes = changes || change[a] < barrier.low[a] || barrier.high[a] < change[a];
    }
    for (i = 0; i < BALLBOT_BARRIER_COUNT; i++) {
        ballbot_real velocity[2] = {barrier.speeds[0][i], barrier.speeds[1][i]};
        barrier.bounds[i] = ballbot_max(BALLBOT_BARRIER_SPEED, ballbot_length(velocity));
        ballbot_speed(&barrier, change, i, velocity);
        changes = changes || barrier.bounds[i] < ballbot_length(velocity);
    }
    if (!changes) {
        return 0;
    }
    for (a = 0; a < 2; a++) {
        change[a] = ballbot_between(change[a], barrier.low[a], barrier.high[a]);
    }
    for (i = 0; i < 3; i++) {
        ballbot_project(&barrier, change);
    }
    share = ballbot_share_of_change(&barrier, change);
    for (a = 0; a < 2; a++) {
        change[a] = barrier.backup[a] + share * change[a] - wanted[a];
    }
    ballbot_in_heading(pose, change[0], change[1], change);
    for (i = 0; i < 3; i++) {
        torques[i] += ballbot_dot(BALLBOT_BARRIER_TORQUES[i], change, 2);
    }
    return 1;
}

static inline ballbot_limited ballbot_limit(
    const ballbot_real desired[3], const ballbot_state *state, const ballbot_pose *pose)
{
    ballbot_real torques[3] = {desired[0], desired[1], desired[2]};
    const int changed = ballbot_guard(torques, state, pose);
    ballbot_limited limited = ballbot_transmitted(torques, state, pose);
    /* A law with an integral holds it. */
    limited.share = changed ? 0 : limited.share;
    return limited;
}
