//! Motors that differ from robot to robot.

use super::Actuator;
use super::chain::{Chain, Curve, SpeedLimit};
use super::line::{DeadTime, Line};
use super::options::MotorOptions;
use ballbot_base::error::{Result, check};
use ballbot_base::lanes::{Lane, Memory, Own};
use ballbot_base::options::OptionTable;
use ballbot_base::params::Params;
use ballbot_base::wheels::Wheels;

/// Constants of one robot, at the start of its memory.
const CONSTANTS: usize = 11;

/// A torque or speed beyond any other.
const NONE: f64 = 1e30;

/// [`super::Motors`] with individual options per robot, equal to the last bit. The memory begins with the constants of
/// the robot.
#[derive(Clone, Debug, PartialEq)]
pub struct IndividualMotors {
    action_torque: f64,
    sim_dt: f64,
    substeps: usize,
    /// Which effects any robot may have.
    lag: bool,
    curve: bool,
    limit: bool,
    line: Option<Line>,
}

impl IndividualMotors {
    /// Motors of robots with options of up to `largest`; as [`super::Motors::new`].
    ///
    /// # Errors
    /// [`ballbot_base::Error::OutOfRange`] for a longest delay that is not a whole number of model steps.
    pub fn new(largest: &MotorOptions, action_torque: f64, sim_dt: f64, substeps: usize) -> Result<Self> {
        let lag = largest.lag > 0.0;
        let longest = DeadTime::new(largest, sim_dt)?;
        let first = CONSTANTS + if lag { 3 } else { 0 };
        Ok(Self {
            action_torque,
            sim_dt,
            substeps,
            lag,
            curve: largest.stall_torque > 0.0,
            limit: largest.speed_limit > 0.0,
            line: (longest.longest() > 0).then(|| Line::new(first, longest, substeps)),
        })
    }

    fn of(&self, options: &MotorOptions, params: &Params) -> Result<(Chain<f64>, DeadTime)> {
        let chain = Chain::new(options, params, self.action_torque, self.sim_dt)?;
        Ok((chain, DeadTime::new(options, self.sim_dt)?))
    }

    /// The constants as [`IndividualMotors::equip`] wrote them.
    #[inline(always)]
    fn chain<L: Lane>(&self, memory: &Memory<'_, L>) -> Chain<Own<L>> {
        let own = |index: usize| Own(memory.get(index));
        Chain {
            torque: Wheels([own(0), own(1), own(2)]),
            share: self.lag.then(|| own(3)),
            curve: self.curve.then(|| Curve { stall: own(4), slope: own(5) }),
            limit: self.limit.then(|| SpeedLimit { speed: own(6), share: own(7) }),
            peak: own(8),
        }
    }
}

impl Actuator for IndividualMotors {
    const MEMORY: usize = CONSTANTS;

    fn is_individual(&self) -> bool {
        true
    }

    fn memory_len(&self) -> usize {
        let lag = if self.lag { 3 } else { 0 };
        CONSTANTS + lag + self.line.map_or(0, |line| line.memory_len())
    }

    fn begin(&self, key: [u32; 2], episode: u32, memory: &mut [f64]) {
        if let Some(line) = self.line {
            line.begin(key, episode, memory);
        }
    }

    fn fits(&self, options: &MotorOptions, params: &Params) -> Result<()> {
        options.validate()?;
        let (chain, time) = self.of(options, params)?;
        chain.check_robot(params, self.sim_dt)?;
        let longest = time.longest() as f64;
        let held = self.line.map_or(time.longest() == 0, |line| line.holds(time));
        check("model steps of a delay", longest, "no more than are kept", |_| held)?;
        Ok(())
    }

    fn equip(&self, options: &MotorOptions, params: &Params, memory: &mut [f64]) {
        let (chain, time) = self.of(options, params).expect("the options have passed `fits`");
        let Curve { stall, slope } = chain.curve.unwrap_or(Curve { stall: NONE, slope: 0.0 });
        // The factor is at least 1 at any speed.
        let SpeedLimit { speed, share } = chain.limit.unwrap_or(SpeedLimit { speed: NONE, share: 1.0 });
        let Wheels([a, b, c]) = chain.torque;
        let times = [time.fixed, time.jitter].map(|steps| steps as f64);
        let lag = chain.share.unwrap_or(0.0);
        memory[..CONSTANTS]
            .copy_from_slice(&[a, b, c, lag, stall, slope, speed, share, chain.peak, times[0], times[1]]);
    }

    #[inline(always)]
    fn torques<L: Lane>(&self, mut commands: Wheels<L>, speeds: Wheels<L>, memory: &mut Memory<'_, L>) -> Wheels<L> {
        if let Some(line) = self.line {
            let (fixed, jitter) = (memory.get(9), memory.get(10));
            commands = line.delayed(commands, fixed, jitter, memory);
        }
        self.chain(memory).torques(commands, speeds, CONSTANTS, memory)
    }
}
