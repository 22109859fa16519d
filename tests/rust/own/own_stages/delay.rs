//! A sensor that measures the state of the previous control step.

use ballbot_core::lanes::{Lane, Memory, Quat, Vec3};
use ballbot_core::sensor::Sensor;
use ballbot_core::{LaneState, Wheels};

#[derive(Clone)]
pub struct Delay;

/// How many numbers a state has.
const NUMBERS: usize = 32;
/// Whether there was a reading, after the numbers of the last state.
const STARTED: usize = NUMBERS;
/// The last state that was output.
const GIVEN: usize = STARTED + 1;

impl Sensor for Delay {
    const MEMORY: usize = GIVEN + NUMBERS;

    #[inline(always)]
    fn read<L: Lane>(&self, state: &LaneState<L>, memory: &mut Memory<'_, L>) -> LaneState<L> {
        let started = state.ball_position.x.zero().lt(memory.get(STARTED));
        let mut measured = numbers(state);
        for (i, number) in measured.iter_mut().enumerate() {
            let last = L::select(started, memory.get(i), *number);
            memory.set(i, *number);
            memory.set(GIVEN + i, last);
            *number = last;
        }
        memory.set(STARTED, memory.splat(1.0));
        from_numbers(&measured)
    }

    #[inline(always)]
    fn last<L: Lane>(&self, state: &LaneState<L>, memory: &mut Memory<'_, L>) -> LaneState<L> {
        let mut given = numbers(state);
        for (i, number) in given.iter_mut().enumerate() {
            *number = memory.get(GIVEN + i);
        }
        from_numbers(&given)
    }
}

#[inline(always)]
fn numbers<L: Lane>(s: &LaneState<L>) -> [L; NUMBERS] {
    let (p, v, w) = (s.ball_position, s.ball_velocity, s.ball_angular_velocity);
    let (bp, bv, bw) = (s.body_position, s.body_velocity, s.body_angular_velocity);
    let (q, bq) = (s.ball_quaternion, s.body_quaternion);
    let (Wheels([a, b, c]), Wheels([d, e, f])) = (s.wheel_angles, s.wheel_speeds);
    [
        p.x, p.y, p.z, q.w, q.v.x, q.v.y, q.v.z, v.x, v.y, v.z, w.x, w.y, w.z, bp.x, bp.y, bp.z, bq.w, bq.v.x, bq.v.y,
        bq.v.z, bv.x, bv.y, bv.z, bw.x, bw.y, bw.z, a, b, c, d, e, f,
    ]
}

#[inline(always)]
fn from_numbers<L: Lane>(n: &[L; NUMBERS]) -> LaneState<L> {
    let vector = |i: usize| Vec3::new(n[i], n[i + 1], n[i + 2]);
    let quaternion = |i: usize| Quat { w: n[i], v: Vec3::new(n[i + 1], n[i + 2], n[i + 3]) };
    LaneState {
        ball_position: vector(0),
        ball_quaternion: quaternion(3),
        ball_velocity: vector(7),
        ball_angular_velocity: vector(10),
        body_position: vector(13),
        body_quaternion: quaternion(16),
        body_velocity: vector(20),
        body_angular_velocity: vector(23),
        wheel_angles: Wheels([n[26], n[27], n[28]]),
        wheel_speeds: Wheels([n[29], n[30], n[31]]),
    }
}
