//! The payloads that move on the body, of one robot or of eight: each a point mass on springs and dampers along the body axes.
//!
//! With the deflection d of the payload from its place, body axes, and the rest r(t) of its springs, the force on the
//! payload is F = p − k (d − r) − c (d' − r'), each axis for itself. r is the sum of a sine and of an offset that a rider holds
//! between two control steps, at the rate 0. p holds the payload at its place while the robot is at
//! rest in equilibrium on a level floor. The body gets −F at the payload, so momentum and angular momentum are kept. Payloads
//! act on each other only through the body.

use crate::lane_state::LaneState;
use crate::lanes::{Lane, Vec3, lane_struct, run_one, sin_cos};
use crate::params::Params;
use serde::{Deserialize, Serialize};
use std::array;
use std::f64::consts::TAU;

/// Most payloads of a robot.
pub const PAYLOADS: usize = 2;

lane_struct! {
    /// Constants of a payload; body axes.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct Payload<T> {
        /// Mass, kg; 0 for none.
        pub mass: T,
        /// Place of the payload at rest, m.
        pub place: [T; 3],
        stiffness: [T; 3],
        damping: [T; 3],
        /// Force p.
        hold: [T; 3],
        amplitude: [T; 3],
        /// 2π over the period, rad/s.
        rate: T,
        phases: [T; 3],
    }
}

lane_struct! {
    /// Position and velocity of a payload, inertial frame, and what moves its rest.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
    pub struct PayloadMotion<T> {
        /// m.
        pub position: Vec3<T>,
        /// m/s.
        pub velocity: Vec3<T>,
        /// Offset of the rest of the springs, body axes, m.
        pub offset: [T; 3],
    }
}

lane_struct! {
    /// Deflection of a payload from its place, body axes.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct Deflection<T> {
        /// m.
        pub position: Vec3<T>,
        /// m/s, as the body sees it.
        pub velocity: Vec3<T>,
    }
}

impl Payload<f64> {
    /// The payloads of a robot.
    pub fn of(params: &Params) -> [Self; PAYLOADS] {
        params.payloads().map(|payload| Self {
            mass: payload.mass,
            place: payload.position,
            stiffness: payload.stiffness,
            damping: payload.damping,
            hold: (params.com_direction() * (payload.mass * params.gravity)).into(),
            amplitude: payload.amplitude,
            rate: TAU / payload.period,
            phases: payload.phases,
        })
    }
}

impl PayloadMotion<f64> {
    /// Payloads at their places, moving with the body.
    pub fn at_places(payloads: &[Payload<f64>; PAYLOADS], body: &LaneState<f64>) -> [Self; PAYLOADS] {
        payloads.map(|payload| Self::at_place(&payload, body))
    }

    fn at_place(payload: &Payload<f64>, body: &LaneState<f64>) -> Self {
        if payload.mass == 0.0 {
            return Self::default();
        }
        run_one(
            #[inline(always)]
            || payload.at_place(body),
        )
    }

    /// Motions when payloads change: they keep their deflections, and a new payload begins at its place.
    #[must_use]
    pub fn all_changed(
        motions: &[Self; PAYLOADS],
        before: &[Payload<f64>; PAYLOADS],
        after: &[Payload<f64>; PAYLOADS],
        body: &LaneState<f64>,
    ) -> [Self; PAYLOADS] {
        array::from_fn(|i| motions[i].changed(&before[i], &after[i], body))
    }

    /// Motions with other deflections; the rests of the springs stay.
    #[must_use]
    pub fn all_deflected(
        motions: &[Self; PAYLOADS],
        payloads: &[Payload<f64>; PAYLOADS],
        body: &LaneState<f64>,
        deflections: &[Deflection<f64>; PAYLOADS],
    ) -> [Self; PAYLOADS] {
        array::from_fn(|i| motions[i].deflected(&payloads[i], body, &deflections[i]))
    }

    fn deflected(&self, payload: &Payload<f64>, body: &LaneState<f64>, deflection: &Deflection<f64>) -> Self {
        run_one(
            #[inline(always)]
            || {
                let arm = Vec3::from(payload.place) + deflection.position;
                let rotation = body.body_quaternion.rotation();
                let rate = body.body_angular_velocity.cross(arm) + deflection.velocity;
                Self {
                    position: body.body_position + rotation.apply(arm),
                    velocity: body.body_velocity + rotation.apply(rate),
                    ..*self
                }
            },
        )
    }

    fn changed(&self, before: &Payload<f64>, after: &Payload<f64>, body: &LaneState<f64>) -> Self {
        let place = Self::at_place(after, body);
        if before.mass == 0.0 {
            return place;
        }
        let from = Self::at_place(before, body);
        Self {
            position: moved(self.position, from.position, place.position),
            velocity: moved(self.velocity, from.velocity, place.velocity),
            offset: self.offset,
        }
    }
}

fn moved(now: Vec3<f64>, from: Vec3<f64>, to: Vec3<f64>) -> Vec3<f64> {
    run_one(
        #[inline(always)]
        || now + (to - from),
    )
}

impl Deflection<f64> {
    /// Position, then velocity.
    pub fn to_array(&self) -> [f64; 6] {
        let Self { position: p, velocity: v } = self;
        [p.x, p.y, p.z, v.x, v.y, v.z]
    }

    /// From [`Deflection::to_array`].
    pub fn from_array([x, y, z, vx, vy, vz]: [f64; 6]) -> Self {
        Self { position: Vec3::new(x, y, z), velocity: Vec3::new(vx, vy, vz) }
    }

    /// Deflections of the payloads of a robot; zeros for none.
    pub fn of_all(
        payloads: &[Payload<f64>; PAYLOADS],
        body: &LaneState<f64>,
        motions: &[PayloadMotion<f64>; PAYLOADS],
    ) -> [Self; PAYLOADS] {
        array::from_fn(|i| Self::of(&payloads[i], body, &motions[i]))
    }

    /// Deflection of a payload; zeros for none.
    pub fn of(payload: &Payload<f64>, body: &LaneState<f64>, motion: &PayloadMotion<f64>) -> Self {
        if payload.mass == 0.0 {
            return Self::default();
        }
        run_one(
            #[inline(always)]
            || payload.deflection(body, motion),
        )
    }
}

impl<L: Lane> Payload<L> {
    /// Mask of the robots that have a payload.
    #[inline(always)]
    pub fn exists(&self) -> L::Mask {
        self.mass.zero().lt(self.mass)
    }

    /// The payload at its place, moving with the body; the rest of its springs is there.
    #[inline(always)]
    pub fn at_place(&self, body: &LaneState<L>) -> PayloadMotion<L> {
        let place = Vec3::from(self.place);
        let rotation = body.body_quaternion.rotation();
        PayloadMotion {
            position: body.body_position + rotation.apply(place),
            velocity: body.body_velocity + rotation.apply(body.body_angular_velocity.cross(place)),
            offset: [self.mass.zero(); 3],
        }
    }

    /// The deflection of a payload.
    #[inline(always)]
    pub fn deflection(&self, body: &LaneState<L>, payload: &PayloadMotion<L>) -> Deflection<L> {
        let rotation = body.body_quaternion.rotation();
        let arm = rotation.apply_transposed(payload.position - body.body_position);
        let velocity = rotation.apply_transposed(payload.velocity - body.body_velocity);
        Deflection {
            position: arm - Vec3::from(self.place),
            velocity: velocity - body.body_angular_velocity.cross(arm),
        }
    }

    /// Displacement and velocity of the rest of the springs along axis `i` at `time`, s.
    #[inline(always)]
    fn rest(&self, i: usize, time: L) -> [L; 2] {
        let (sin, cos) = sin_cos(time.mul_add(self.rate, self.phases[i]));
        [self.amplitude[i] * sin, self.amplitude[i] * self.rate * cos]
    }

    /// Force on the payload, body axes, N, at `time` since the reset, s, with the rest of its springs at an additional `offset`, m.
    #[inline(always)]
    pub fn force(&self, deflection: &Deflection<L>, offset: [L; 3], time: L) -> Vec3<L> {
        let Deflection { position: d, velocity: v } = deflection;
        let [x, y, z] = offset;
        Vec3::new(
            self.along(0, d.x - x, v.x, time),
            self.along(1, d.y - y, v.y, time),
            self.along(2, d.z - z, v.z, time),
        )
    }

    #[inline(always)]
    fn along(&self, i: usize, d: L, v: L, time: L) -> L {
        let [rest, rate] = self.rest(i, time);
        self.hold[i] - self.stiffness[i] * (d - rest) - self.damping[i] * (v - rate)
    }

    /// Kinetic energy, potential energy under the gravity −`up`, m/s², zero at the origin, and energy of the springs, J: with the
    /// payload at its place and the springs' rest there, the energy of a point mass on the body.
    #[inline(always)]
    pub fn energy(&self, body: &LaneState<L>, payload: &PayloadMotion<L>, up: Vec3<L>, time: L) -> L {
        let Deflection { position: d, .. } = self.deflection(body, payload);
        let mut springs = -Vec3::from(self.hold).dot(d);
        for (i, d) in [d.x, d.y, d.z].into_iter().enumerate() {
            let [rest, _] = self.rest(i, time);
            springs += self.stiffness[i] * (d - payload.offset[i] - rest).squared() * 0.5;
        }
        let kinetic = self.mass * payload.velocity.norm_squared() * 0.5;
        kinetic + self.mass * up.dot(payload.position) + springs
    }
}
