//! Motors with dead time, lag, a torque-speed curve and limits.

use super::Actuator;
use super::chain::{Chain, Curve, SpeedLimit};
use super::line::{DeadTime, Line};
use super::options::MotorOptions;
use ballbot_base::error::{Result, check};
use ballbot_base::lanes::{Lane, Memory, Own, Scalar, lane_struct};
use ballbot_base::options::OptionTable;
use ballbot_base::params::Params;
use ballbot_base::wheels::{WHEELS, Wheels};

/// A torque or speed beyond any other.
const NONE: f64 = 1e30;

/// Three motors: command → delay → strength → lag → torque-speed curve → speed limit → peak torque, in each model step.
/// Motors that differ from robot to robot give the torques of equal motors to the last bit.
#[derive(Clone, Debug, PartialEq)]
pub struct Motors {
    action_torque: f64,
    sim_dt: f64,
    /// The motors of all robots; if they differ, the effects that any robot may have.
    chain: Chain<f64>,
    wait: Wait,
    /// Whether the memory of each robot begins with its [`OwnMotors`].
    individual: bool,
}

lane_struct! {
    /// Constants of the motors of one robot, where robots differ.
    struct OwnMotors<T> {
        torque: Wheels<T>,
        lag_share: T,
        stall: T,
        slope: T,
        speed: T,
        speed_share: T,
        peak: T,
        delay: T,
        jitter: T,
    }
}

/// The delay of a command to the motors.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Wait {
    None,
    Fixed(Delay),
    Kept(Line, DeadTime),
}

/// A dead time, in control steps and the model steps beyond them.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Delay {
    /// Whole control steps in the delay.
    steps: usize,
    /// Model steps at the start of a control step in which the previous command still applies.
    rest: usize,
    /// Model steps in a control step.
    substeps: usize,
}

impl Delay {
    /// Commands that are kept for each motor, including the current one.
    fn commands(self) -> usize {
        self.steps + usize::from(self.rest > 0) + 1
    }
}

impl Motors {
    /// Motors in model steps of `sim_dt` (s), `substeps` to a control step, on robots such as `params`; a command of 1
    /// is `action_torque` (N·m).
    ///
    /// # Errors
    /// The errors of [`OptionTable::validate`]; [`ballbot_base::Error::OutOfRange`] for a delay that is not a whole
    /// number of model steps, and for motors that [`Motors::check_robot`] rejects.
    pub fn new(
        options: &MotorOptions,
        params: &Params,
        action_torque: f64,
        sim_dt: f64,
        substeps: usize,
    ) -> Result<Self> {
        options.validate()?;
        options.check_peak(params)?;
        let chain = Chain::new(options, params, action_torque, sim_dt);
        let time = DeadTime::new(options, sim_dt)?;
        let wait = match time {
            DeadTime { fixed: 0, jitter: 0 } => Wait::None,
            DeadTime { fixed, jitter: 0 } => {
                Wait::Fixed(Delay { steps: fixed / substeps, rest: fixed % substeps, substeps })
            }
            _ => Wait::Kept(Line::new(chain.memory_len(), time, substeps), time),
        };
        let motors = Self { action_torque, sim_dt, chain, wait, individual: false };
        motors.check_robot(params, sim_dt)?;
        Ok(motors)
    }

    /// Motors of robots with individual options of up to `largest` ([`Actuator::equip`]).
    ///
    /// # Errors
    /// [`ballbot_base::Error::OutOfRange`] for a longest delay that is not a whole number of model steps.
    pub fn individual(
        largest: &MotorOptions,
        params: &Params,
        action_torque: f64,
        sim_dt: f64,
        substeps: usize,
    ) -> Result<Self> {
        let chain = Chain::new(largest, params, action_torque, sim_dt);
        let time = DeadTime::new(largest, sim_dt)?;
        let first = OwnMotors::<f64>::LEN + chain.memory_len();
        let wait = if time.longest() > 0 { Wait::Kept(Line::new(first, time, substeps), time) } else { Wait::None };
        Ok(Self { action_torque, sim_dt, chain, wait, individual: true })
    }

    fn of(&self, options: &MotorOptions, params: &Params) -> Result<(Chain<f64>, DeadTime)> {
        options.check_peak(params)?;
        let chain = Chain::new(options, params, self.action_torque, self.sim_dt);
        Ok((chain, DeadTime::new(options, self.sim_dt)?))
    }

    /// Checks that the motors fit a robot: their largest torque is within `params.max_wheel_torque`, and a wheel that spins
    /// freely comes to its no-load speed without overshoot.
    ///
    /// # Errors
    /// [`ballbot_base::Error::OutOfRange`] naming the value and the limit.
    pub fn check_robot(&self, params: &Params, sim_dt: f64) -> Result<()> {
        self.chain.check_robot(params, sim_dt)
    }

    /// The commands of a delay ago. The memory from `first` on holds the model step within the control step, then the
    /// commands of this control step and earlier ones, three each.
    #[inline(always)]
    fn delayed<L: Lane>(delay: Delay, commands: Wheels<L>, first: usize, memory: &mut Memory<'_, L>) -> Wheels<L> {
        let step = memory.get(first);
        let kept = |age: usize, wheel: usize| first + 1 + WHEELS * age + wheel;
        let begins = step.le(step.zero());
        if L::any(begins) {
            for age in (1..delay.commands()).rev() {
                for wheel in 0..WHEELS {
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
        let continues = next.lt(step.splat(delay.substeps as f64));
        memory.set(first, L::select(continues, next, step.zero()));
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
    /// Length for equal motors without lag and delay; see [`Motors::memory_len`].
    const MEMORY: usize = 0;

    fn is_individual(&self) -> bool {
        self.individual
    }

    /// The constants of a robot whose motors differ, the torques of the lag, N·m, then the numbers of the delay.
    fn memory_len(&self) -> usize {
        let own = if self.individual { OwnMotors::<f64>::LEN } else { 0 };
        let wait = match self.wait {
            Wait::None => 0,
            Wait::Fixed(delay) => 1 + WHEELS * delay.commands(),
            Wait::Kept(line, _) => line.memory_len(),
        };
        own + self.chain.memory_len() + wait
    }

    fn begin(&self, key: [u32; 2], episode: u32, memory: &mut [f64]) {
        if let Wait::Kept(line, _) = self.wait {
            line.begin(key, episode, memory);
        }
    }

    fn fits(&self, options: &MotorOptions, params: &Params) -> Result<()> {
        if !self.individual {
            return Ok(());
        }
        options.validate()?;
        let (chain, time) = self.of(options, params)?;
        chain.check_robot(params, self.sim_dt)?;
        let longest = time.longest();
        let held = if let Wait::Kept(line, _) = self.wait { line.holds(time) } else { longest == 0 };
        check("model steps of a delay", longest as f64, "no more than are kept", |_| held)?;
        Ok(())
    }

    fn equip(&self, options: &MotorOptions, params: &Params, memory: &mut [f64]) {
        if !self.individual {
            return;
        }
        let (chain, time) = self.of(options, params).expect("the options have passed `fits`");
        let Curve { stall, slope } = chain.curve.unwrap_or(Curve { stall: NONE, slope: 0.0 });
        // The factor is at least 1 at any speed.
        let limit = chain.limit.unwrap_or(SpeedLimit { speed: NONE, share: 1.0 });
        let own = OwnMotors {
            torque: chain.torque,
            lag_share: chain.share.unwrap_or(0.0),
            stall,
            slope,
            speed: limit.speed,
            speed_share: limit.share,
            peak: chain.peak,
            delay: time.fixed as f64,
            jitter: time.jitter as f64,
        };
        Memory::<f64>::new(Scalar, memory).set_group(0, &own);
    }

    #[inline(always)]
    fn torques<L: Lane>(&self, commands: Wheels<L>, speeds: Wheels<L>, memory: &mut Memory<'_, L>) -> Wheels<L> {
        if self.individual {
            let own: OwnMotors<L> = memory.group(0);
            let arrived = match self.wait {
                Wait::Kept(line, _) => line.delayed(commands, own.delay, own.jitter, memory),
                _ => commands,
            };
            let chain = Chain {
                torque: own.torque.map(Own),
                share: self.chain.share.map(|_| Own(own.lag_share)),
                curve: self.chain.curve.map(|_| Curve { stall: Own(own.stall), slope: Own(own.slope) }),
                limit: self.chain.limit.map(|_| SpeedLimit { speed: Own(own.speed), share: Own(own.speed_share) }),
                peak: Own(own.peak),
            };
            return chain.torques(arrived, speeds, OwnMotors::<L>::LEN, memory);
        }
        let arrived = match self.wait {
            Wait::None => commands,
            Wait::Fixed(delay) => Self::delayed(delay, commands, self.chain.memory_len(), memory),
            Wait::Kept(line, time) => {
                let (fixed, jitter) = (memory.splat(time.fixed as f64), memory.splat(time.jitter as f64));
                line.delayed(commands, fixed, jitter, memory)
            }
        };
        self.chain.torques(arrived, speeds, 0, memory)
    }
}
