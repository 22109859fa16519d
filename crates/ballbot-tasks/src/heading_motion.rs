//! A commanded motion of the ball along the axes of a heading that turns.

use super::Moment;
use ballbot_base::lanes::{Heading, Lane, Memory, sin_cos_of_step};
use ballbot_base::setpoint::Setpoint;
use nalgebra::Vector2;

/// How many numbers it keeps: place in the inertial frame; velocity and its first two derivatives along the axes of the
/// heading; cosine and sine of the heading.
pub(super) const LEN: usize = 10;

/// Offsets of its parts.
const VELOCITY: usize = 2;
const FIRST: usize = 4;
const SECOND: usize = 6;
const COS: usize = 8;
const SIN: usize = 9;

/// The motion whose numbers begin at an index of a memory.
#[derive(Clone, Copy)]
pub(super) struct HeadingMotion(pub usize);

impl HeadingMotion {
    /// Begins with the motion of the robot at the start of an episode.
    pub(super) fn begin(self, moment: &Moment<'_>, memory: &mut [f64]) {
        let Self(at) = self;
        if [memory[at + COS], memory[at + SIN]] == [0.0; 2] {
            let (position, velocity) = (moment.state.ball_position, moment.state.ball_velocity);
            let heading = Heading::new(moment.state.body_quaternion);
            let [forward, sideways] = heading.of(velocity.x, velocity.y);
            memory[at..at + LEN].copy_from_slice(&[
                position.x,
                position.y,
                forward,
                sideways,
                0.0,
                0.0,
                0.0,
                0.0,
                heading.cos,
                heading.sin,
            ]);
        }
    }

    /// The motion under a `rate` of the heading, rad/s; `third` gives the third derivative of an axis' velocity, from velocity and
    /// its first two derivatives.
    pub(super) fn setpoint(self, memory: &[f64], rate: f64, third: impl Fn(usize, f64, f64, f64) -> f64) -> Setpoint {
        let Self(at) = self;
        let two = |first: usize| Vector2::new(memory[at + first], memory[at + first + 1]);
        let across = |v: Vector2<f64>| rate * Vector2::new(-v.y, v.x);
        let (cos, sin) = (memory[at + COS], memory[at + SIN]);
        let inertial = |v: Vector2<f64>| Vector2::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y);
        let (velocity, first, second) = (two(VELOCITY), two(FIRST), two(SECOND));
        let third = Vector2::from_fn(|i, _| third(i, velocity[i], first[i], second[i]));
        let twice = |v: Vector2<f64>| -rate * rate * v;
        Setpoint {
            position: two(0),
            velocity: inertial(velocity),
            acceleration: inertial(first + across(velocity)),
            jerk: inertial(second + 2.0 * across(first) + twice(velocity)),
            snap: inertial(third + 3.0 * across(second) + 3.0 * twice(first) + across(twice(velocity))),
            yaw: sin.atan2(cos),
            yaw_rate: rate,
            ..Setpoint::default()
        }
    }

    /// Velocity, m/s, along an axis of the heading, and its first two derivatives.
    #[inline(always)]
    pub(super) fn along<L: Lane>(self, memory: &Memory<'_, L>, axis: usize) -> [L; 3] {
        let Self(at) = self;
        [VELOCITY, FIRST, SECOND].map(
            #[inline(always)]
            |part| memory.get(at + part + axis),
        )
    }

    /// Turns the heading at a `rate`, rad/s, over a step, and moves on; `third` gives the third derivative of an axis' velocity, from
    /// velocity and its first two derivatives.
    #[inline(always)]
    pub(super) fn advance<L: Lane>(
        self,
        memory: &mut Memory<'_, L>,
        rate: L,
        dt: f64,
        third: impl Fn(usize, L, L, L) -> L,
    ) {
        let Self(at) = self;
        let (sin, cos) = sin_cos_of_step(rate * dt);
        let (was_cos, was_sin) = (memory.get(at + COS), memory.get(at + SIN));
        let (cos, sin) = (was_cos * cos - was_sin * sin, was_sin * cos + was_cos * sin);
        // Keeps the length 1 over repeated rotations.
        let length = (cos.squared() + sin.squared()).sqrt().max(rate.splat(1e-300));
        let (cos, sin) = (cos / length, sin / length);
        memory.set(at + COS, cos);
        memory.set(at + SIN, sin);
        let mut moved = [rate.zero(); 2];
        for (i, moved) in moved.iter_mut().enumerate() {
            let [velocity, first, second] = self.along(memory, i);
            let second = second + third(i, velocity, first, second) * dt;
            let first = first + second * dt;
            let velocity = velocity + first * dt;
            memory.set(at + SECOND + i, second);
            memory.set(at + FIRST + i, first);
            memory.set(at + VELOCITY + i, velocity);
            *moved = velocity;
        }
        let [vx, vy] = moved;
        memory.set(at, memory.get(at) + (cos * vx - sin * vy) * dt);
        memory.set(at + 1, memory.get(at + 1) + (sin * vx + cos * vy) * dt);
    }
}
