//! An external force on the body over time.

use crate::error::{Result, check};
use crate::lanes::{Lane, Scalar, Vec3, lane_struct};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Limits of a force, N and m, of its phase, rad, and of its times, s: far beyond what a robot survives.
const MAX_FORCE: f64 = 1e5;
const MAX_ARM: f64 = 100.0;
const MAX_PHASE: f64 = 1e3;
const MAX_TIME: f64 = 1e9;

/// An external force on the body, from now on: constant, or a sine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Force {
    /// The force, of a sine its amplitude; inertial frame, N.
    pub force: Vector3<f64>,
    /// Its point, body frame, m; the CoM of the body if `None`.
    pub point: Option<Vector3<f64>>,
    /// Frequency f of a force times sin(2πft + `phase`), with t from its start, Hz; 0 is a constant force.
    pub frequency: f64,
    /// Phase of a sine at its start, rad.
    pub phase: f64,
    /// Time from now to its start, s, in whole time steps.
    pub delay: f64,
    /// Time over which it acts, s, in whole time steps; infinity is until another force or a reset.
    pub duration: f64,
}

impl Force {
    /// A constant force (inertial frame, N) at `point` (body frame, m; the CoM if `None`), until another force or a reset.
    pub fn constant(force: Vector3<f64>, point: Option<Vector3<f64>>) -> Self {
        Self { force, point, frequency: 0.0, phase: 0.0, delay: 0.0, duration: f64::INFINITY }
    }

    /// Checks its numbers, for time steps of `sim_dt` seconds.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] for a force above 1e5 N, a point farther than 100 m, a frequency that is negative or
    /// above half the rate of the time steps, a phase beyond ±1e3 rad or of a constant force, a time that is
    /// negative or above 1e9 s, or a duration other than 0 that rounds to no time step.
    pub fn validate(&self, sim_dt: f64) -> Result<()> {
        let Self { force, point, frequency, phase, delay, duration } = self;
        for (name, vector, most) in [("force", Some(force), MAX_FORCE), ("point", point.as_ref(), MAX_ARM)] {
            for (i, &value) in vector.into_iter().flatten().enumerate() {
                check(format_args!("{name}[{i}]"), value, format_args!("within ±{most}"), |v| v.abs() <= most)?;
            }
        }
        let fastest = 0.5 / sim_dt;
        let limit = format_args!("from 0 to {fastest} Hz, half the rate of the time steps");
        check("frequency", *frequency, limit, |f| (0.0..=fastest).contains(&f))?;
        check("phase", *phase, format_args!("within ±{MAX_PHASE} rad"), |phase| phase.abs() <= MAX_PHASE)?;
        check("phase", *phase, "0 rad, as a constant force has no phase", |phase| *frequency > 0.0 || phase == 0.0)?;
        check("delay", *delay, format_args!("from 0 to {MAX_TIME:e} s"), |t| (0.0..=MAX_TIME).contains(&t))?;
        if *duration == f64::INFINITY {
            return Ok(());
        }
        check("duration", *duration, format_args!("from 0 to {MAX_TIME:e} s, or infinity"), |t| {
            (0.0..=MAX_TIME).contains(&t)
        })?;
        let half = 0.5 * sim_dt;
        check("duration", *duration, format_args!("0, or at least {half} s, half a time step"), |t| {
            t == 0.0 || t >= half
        })?;
        Ok(())
    }
}

lane_struct! {
    /// A [`Force`] as it acts, time step by time step: a sine is a phasor that turns with each step.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
    pub struct HeldForce<T> {
        /// Impulse of a step where `wave` is 1, inertial frame, N·s.
        pub impulse: [T; 3],
        /// Its point, body frame, m.
        pub point: [T; 3],
        /// Sine and cosine of the phase in the middle of the next step; 1 and 0 of a constant force.
        pub wave: [T; 2],
        /// Sine and cosine of the angle by which the phase turns in a step.
        pub turn: [T; 2],
        /// Steps until it begins.
        pub wait: T,
        /// Steps in which it acts after that; 0 is none.
        pub left: T,
    }
}

impl HeldForce<f64> {
    /// A valid force on a body with its CoM at `com` (body frame, m), in time steps of `sim_dt` seconds.
    ///
    /// The impulse of a step is the integral of the force over it, so the impulse of a sine over any number of steps is
    /// exact.
    pub fn new(force: &Force, com: &Vector3<f64>, sim_dt: f64) -> Self {
        let Force { force, point, frequency, phase, delay, duration } = force;
        let half = 0.5 * TAU * frequency * sim_dt;
        // The mean of a sine over a step is its value in the middle of the step times this.
        let share = if half > 0.0 { half.sin() / half } else { 1.0 };
        let is_constant = *frequency == 0.0;
        let wave = if is_constant { [1.0, 0.0] } else { [(phase + half).sin(), (phase + half).cos()] };
        Self {
            impulse: (force * (share * sim_dt)).into(),
            point: (*point.as_ref().unwrap_or(com)).into(),
            wave,
            turn: [(2.0 * half).sin(), (2.0 * half).cos()],
            wait: (delay / sim_dt).round(),
            left: if *force == Vector3::zeros() { 0.0 } else { (duration / sim_dt).round() },
        }
    }

    /// Whether it acts now or later.
    pub fn is_on(&self) -> bool {
        self.left > 0.0
    }

    /// The impulse of the next step, inertial frame, N·s; moves on to the step after it.
    pub fn next_impulse(&mut self) -> Vector3<f64> {
        let (impulse, _) = self.advance::<f64>(Scalar);
        Vector3::new(impulse.x, impulse.y, impulse.z)
    }
}

impl<T: crate::lanes::Cell> HeldForce<T> {
    /// The impulse of the next step, inertial frame, N·s, and where it acts; moves on to the step after it.
    #[inline(always)]
    pub fn advance<L: Lane<Cell = T>>(&mut self, token: L::Token) -> (Vec3<L>, L::Mask) {
        let held = self.load::<L>(token);
        let zero = held.left.zero();
        let waits = zero.lt(held.wait);
        let acts = zero.lt(held.left) & !waits;
        let [sine, cosine] = held.wave;
        let [turn_sine, turn_cosine] = held.turn;
        let turned = [sine.mul_add(turn_cosine, cosine * turn_sine), cosine.mul_add(turn_cosine, -(sine * turn_sine))];
        for (cell, (next, now)) in self.wave.iter_mut().zip(turned.into_iter().zip(held.wave)) {
            L::select(acts, next, now).store(cell);
        }
        L::select(waits, held.wait - 1.0, held.wait).store(&mut self.wait);
        L::select(acts, held.left - 1.0, held.left).store(&mut self.left);
        (Vec3::from(held.impulse) * L::select(acts, sine, zero), acts)
    }
}
