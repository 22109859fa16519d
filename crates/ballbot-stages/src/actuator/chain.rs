//! How a motor processes a command that has arrived: strength → lag → torque-speed curve → speed limit → peak torque.

use super::options::MotorOptions;
use ballbot_base::error::{Result, check};
use ballbot_base::lanes::{Lane, Memory, Value};
use ballbot_base::params::Params;
use ballbot_base::wheels::{WHEELS, Wheels};

/// Fraction of the speed limit over which the torque fades.
const FADE: f64 = 0.1;

/// Constants of three motors, with `V` for all robots (`f64`) or for each; `None` is an effect that no robot has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Chain<V> {
    /// Torque of a command of 1 at each wheel, N·m.
    pub torque: Wheels<V>,
    /// Fraction of the distance to its command that the torque covers in a model step, 1 − exp(−dt / lag); 0: no lag.
    pub share: Option<V>,
    pub curve: Option<Curve<V>>,
    pub limit: Option<SpeedLimit<V>>,
    /// N·m.
    pub peak: V,
}

/// The torque under the full supply voltage, ±stall − slope · speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Curve<V> {
    /// N·m.
    pub stall: V,
    /// N·m/(rad/s).
    pub slope: V,
}

/// A speed above which no torque acts in the direction of motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SpeedLimit<V> {
    /// rad/s.
    pub speed: V,
    /// Fraction of the torque that remains for each rad/s below.
    pub share: V,
}

impl Chain<f64> {
    /// The chain of valid options; a command of 1 is `action_torque` (N·m).
    pub fn new(options: &MotorOptions, params: &Params, action_torque: f64, sim_dt: f64) -> Self {
        let MotorOptions { strength, lag, stall_torque, no_load_speed, speed_limit, peak_torque, .. } = *options;
        Self {
            torque: Wheels(strength).map(|share| share * action_torque),
            share: (lag > 0.0).then(|| -(-sim_dt / lag).exp_m1()),
            curve: (stall_torque > 0.0).then(|| Curve { stall: stall_torque, slope: stall_torque / no_load_speed }),
            limit: (speed_limit > 0.0).then(|| SpeedLimit { speed: speed_limit, share: 1.0 / (FADE * speed_limit) }),
            peak: if peak_torque > 0.0 { peak_torque } else { params.max_wheel_torque },
        }
    }

    /// As [`super::Motors::check_robot`].
    pub fn check_robot(&self, params: &Params, sim_dt: f64) -> Result<()> {
        // Beyond the no-load speed the back-EMF brakes with more torque than commanded.
        let commanded = self.torque.into_iter().fold(0.0, f64::max);
        let largest = if self.curve.is_some() { self.peak } else { self.peak.min(commanded) };
        params.check_torque("the largest torque of the actuators", largest)?;
        if let Some(Curve { slope, .. }) = self.curve {
            let inertia = params.wheel_inertia;
            check(
                "actuators.stall_torque / actuators.no_load_speed",
                slope,
                format_args!(
                    "at most wheel_inertia / sim_dt = {} N·m/(rad/s) of the robot, whose wheels would oscillate without load \
                     (wheel_inertia = {inertia} kg·m², sim_dt = {sim_dt} s); the motors of a preset fit the robot with \
                     its name",
                    inertia / sim_dt
                ),
                |slope| slope * sim_dt <= inertia,
            )?;
        }
        Ok(())
    }
}

impl<V: Copy> Chain<V> {
    /// Count of numbers that [`Chain::torques`] keeps: the torques of the lag, N·m.
    pub fn memory_len(&self) -> usize {
        if self.share.is_some() { WHEELS } else { 0 }
    }

    /// Torques of the next model step; the memory from `first` on holds the torques of the lag.
    #[inline(always)]
    pub fn torques<L: Lane>(
        &self,
        mut torques: Wheels<L>,
        speeds: Wheels<L>,
        first: usize,
        memory: &mut Memory<'_, L>,
    ) -> Wheels<L>
    where
        V: Value<L>,
    {
        for (wheel, torque) in torques.iter_mut().enumerate() {
            let speed = speeds[wheel];
            *torque = *torque * self.torque[wheel].at(speed);
            if let Some(share) = self.share {
                let (last, share) = (memory.get(first + wheel), share.at(speed));
                let lagging = (*torque - last).mul_add(share, last);
                *torque = L::select(share.le(share.zero()), *torque, lagging);
                memory.set(first + wheel, *torque);
            }
            if let Some(Curve { stall, slope }) = self.curve {
                let (stall, slope) = (stall.at(speed), -slope.at(speed));
                *torque = torque.min(speed.mul_add(slope, stall)).max(speed.mul_add(slope, -stall));
            }
            if let Some(limit) = self.limit {
                let left = (limit.speed.at(speed) - speed.abs()) * limit.share.at(speed);
                let faded = *torque * left.min(speed.splat(1.0)).max(speed.zero());
                *torque = L::select((*torque * speed).lt(speed.zero()), *torque, faded);
            }
            let peak = self.peak.at(speed);
            *torque = torque.min(peak).max(-peak);
        }
        torques
    }
}
