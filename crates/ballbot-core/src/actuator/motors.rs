//! Motors with dead time, lag, a torque-speed curve and limits.

use super::Actuator;
use super::options::{MotorOptions, qualified};
use crate::error::{Result, check};
use crate::lanes::{Lane, Memory};
use crate::params::Params;

/// Most model steps of a delay.
const MAX_DELAY: f64 = 10_000.0;

/// Share of the speed limit over which the torque fades.
const FADE: f64 = 0.1;

/// Three motors: command → delay → strength → lag → torque-speed curve → speed limit → peak torque, in each model step.
#[derive(Clone, Debug, PartialEq)]
pub struct Motors {
    /// Torque of a command of 1 at each wheel, N·m.
    torque: [f64; 3],
    delay: Option<Delay>,
    /// Share of the distance to its command that the torque goes in a model step: 1 − exp(−dt / lag).
    share: Option<f64>,
    curve: Option<Curve>,
    limit: Option<SpeedLimit>,
    /// N·m.
    peak: f64,
}

/// A dead time, in control steps and the model steps beyond them.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Delay {
    /// Control steps whose commands are over when the delay is.
    steps: usize,
    /// Model steps at the start of a control step in which the command is still one older.
    rest: usize,
    /// Model steps in a control step.
    substeps: usize,
}

/// The torque under the full supply voltage, ±stall − slope · speed.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Curve {
    /// N·m.
    stall: f64,
    /// N·m/(rad/s).
    slope: f64,
}

/// A speed above which no torque acts in the direction of motion.
#[derive(Clone, Copy, Debug, PartialEq)]
struct SpeedLimit {
    /// rad/s.
    speed: f64,
    /// Share of the torque that is left for each rad/s below.
    share: f64,
}

impl Delay {
    /// Commands that are kept of each motor, the present one among them.
    fn commands(self) -> usize {
        self.steps + usize::from(self.rest > 0) + 1
    }
}

impl Motors {
    /// Motors in model steps of `sim_dt` (s), `substeps` to a control step, on robots of which `params` is one; a command
    /// of 1 is `action_torque` (N·m).
    ///
    /// # Errors
    /// Those of [`MotorOptions::validate`]; [`crate::Error::OutOfRange`] for a delay that is no whole number of model steps, and
    /// for motors that [`Motors::check_robot`] refuses.
    pub fn new(
        options: &MotorOptions,
        params: &Params,
        action_torque: f64,
        sim_dt: f64,
        substeps: usize,
    ) -> Result<Self> {
        options.validate()?;
        let MotorOptions { delay, strength, lag, stall_torque, no_load_speed, speed_limit, peak_torque } = *options;
        params.check_torque(qualified("peak_torque"), peak_torque)?;
        let steps = delay / sim_dt;
        check(
            "actuators.delay / sim_dt",
            steps,
            format_args!("a whole number of at most {MAX_DELAY} (delay = {delay} s, sim_dt = {sim_dt} s)"),
            |n| (n - n.round()).abs() <= 1e-6 * n && n <= MAX_DELAY + 0.5,
        )?;
        let steps = steps.round() as usize;
        let motors = Self {
            torque: strength.map(|share| share * action_torque),
            delay: (steps > 0).then(|| Delay { steps: steps / substeps, rest: steps % substeps, substeps }),
            share: (lag > 0.0).then(|| -(-sim_dt / lag).exp_m1()),
            curve: (stall_torque > 0.0).then(|| Curve { stall: stall_torque, slope: stall_torque / no_load_speed }),
            limit: (speed_limit > 0.0).then(|| SpeedLimit { speed: speed_limit, share: 1.0 / (FADE * speed_limit) }),
            peak: if peak_torque > 0.0 { peak_torque } else { params.max_wheel_torque },
        };
        motors.check_robot(params, sim_dt)?;
        Ok(motors)
    }

    /// Checks that the motors fit a robot: their largest torque is within `params.max_wheel_torque`, and a wheel that spins
    /// freely comes to its no-load speed without overshoot.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] naming the value and the limit.
    pub fn check_robot(&self, params: &Params, sim_dt: f64) -> Result<()> {
        // Beyond the no-load speed the back-EMF brakes with more than the command.
        let commanded = self.torque.into_iter().fold(0.0, f64::max);
        let largest = if self.curve.is_some() { self.peak } else { self.peak.min(commanded) };
        params.check_torque("the largest torque of the actuators", largest)?;
        if let Some(Curve { slope, .. }) = self.curve {
            let inertia = params.wheel_inertia;
            check(
                "actuators.stall_torque / actuators.no_load_speed",
                slope,
                format_args!(
                    "at most params.wheel_inertia / sim_dt = {} N·m/(rad/s): a wheel without load would oscillate \
                     (wheel_inertia = {inertia} kg·m², sim_dt = {sim_dt} s)",
                    inertia / sim_dt
                ),
                |slope| slope * sim_dt <= inertia,
            )?;
        }
        Ok(())
    }

    /// The commands of a delay ago. The memory from `first` on has the model step within the control step, then the
    /// commands of this control step and those before it, three each.
    #[inline(always)]
    fn delayed<L: Lane>(&self, delay: Delay, commands: [L; 3], first: usize, memory: &mut Memory<'_, L>) -> [L; 3] {
        let step = memory.get(first);
        let kept = |age: usize, wheel: usize| first + 1 + 3 * age + wheel;
        let begins = step.le(step.zero());
        if L::any(begins) {
            for age in (1..delay.commands()).rev() {
                for wheel in 0..3 {
                    let (newer, own) = (memory.get(kept(age - 1, wheel)), memory.get(kept(age, wheel)));
                    memory.set(kept(age, wheel), L::select(begins, newer, own));
                }
            }
            for (wheel, command) in commands.into_iter().enumerate() {
                let own = memory.get(kept(0, wheel));
                memory.set(kept(0, wheel), L::select(begins, command, own));
            }
        }
        let next = step + 1.0;
        let goes_on = next.lt(step.splat(delay.substeps as f64));
        memory.set(first, L::select(goes_on, next, step.zero()));
        let older = step.lt(step.splat(delay.rest as f64));
        let mut out = commands;
        for (wheel, command) in out.iter_mut().enumerate() {
            *command = memory.get(kept(delay.steps, wheel));
            if delay.rest > 0 {
                *command = L::select(older, memory.get(kept(delay.steps + 1, wheel)), *command);
            }
        }
        out
    }
}

impl Actuator for Motors {
    const HELD: bool = false;
    /// Of motors without lag and delay; see [`Motors::memory_len`].
    const MEMORY: usize = 0;

    /// The torques of the lag, N·m, then the numbers of the delay.
    fn memory_len(&self) -> usize {
        let lag = if self.share.is_some() { 3 } else { 0 };
        lag + self.delay.map_or(0, |delay| 1 + 3 * delay.commands())
    }

    #[inline(always)]
    fn torques<L: Lane>(&self, mut commands: [L; 3], speeds: [L; 3], memory: &mut Memory<'_, L>) -> [L; 3] {
        if let Some(delay) = self.delay {
            let first = if self.share.is_some() { 3 } else { 0 };
            commands = self.delayed(delay, commands, first, memory);
        }
        let mut torques = commands;
        for (wheel, torque) in torques.iter_mut().enumerate() {
            let speed = speeds[wheel];
            *torque = *torque * self.torque[wheel];
            if let Some(share) = self.share {
                let last = memory.get(wheel);
                *torque = (*torque - last).mul_add_all(share, last);
                memory.set(wheel, *torque);
            }
            if let Some(Curve { stall, slope }) = self.curve {
                let forward = speed.mul_add_all(-slope, speed.splat(stall));
                let backward = speed.mul_add_all(-slope, speed.splat(-stall));
                *torque = torque.min(forward).max(backward);
            }
            if let Some(limit) = self.limit {
                let left = (speed.splat(limit.speed) - speed.abs()) * limit.share;
                let faded = *torque * left.min(speed.splat(1.0)).max(speed.zero());
                *torque = L::select((*torque * speed).lt(speed.zero()), *torque, faded);
            }
            *torque = torque.min(speed.splat(self.peak)).max(speed.splat(-self.peak));
        }
        torques
    }
}
