/* The exported parts. Each is a separate C file, since the estimator may need double precision where the controller does
 * with single: between them all numbers are double. */
#ifndef PARTS_H
#define PARTS_H

#include <stdint.h>

/* As `ballbot_state` of the exported headers. */
typedef struct {
    double quaternion[4];
    double rate[3];
    double ball_position[2];
    double ball_velocity[2];
    double ball_rate[3];
    double wheel_speeds[3];
} estimate;

/* A robot at rest at the origin with the heading 0; the accelerometer gives its attitude. Returns whether one follows: not
 * from no force, nor from a force straight down. */
int estimator_begin(const double specific_force[3]);
void estimator_update(
    const double gyro[3], const double specific_force[3], const double wheel_rates[3], estimate *estimated);

/* Of a controller or of a policy, for which velocity and yaw rate are the command of its task. */
typedef struct {
    double position[2];
    double velocity[2];
    double yaw;
    double yaw_rate;
    double acceleration[2];
    double jerk[2];
    double snap[2];
} target;

void control_begin(void);

/* Most control steps in a row whose readings may be missing. */
enum { LOST = 3 };

/* The torques within the limits of the supervisor, `periods` control steps after the last; returns its status, of enum
 * `verdict`. */
int control_step(const estimate *estimated, const target *wanted, uint32_t periods, double torques[3]);

/* What becomes of the torques: they are used, or used until they have fallen to zero, since a limit was exceeded or numbers
 * were not finite. */
enum verdict { CONTROL_RUNNING, CONTROL_LIMIT, CONTROL_NOT_FINITE };

#endif
