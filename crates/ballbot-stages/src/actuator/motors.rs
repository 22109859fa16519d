//! Motors with dead time, lag, a torque-speed curve and limits, identical on all robots.

use super::Actuator;
use super::chain::Chain;
use super::line::{DeadTime, Line};
use super::options::MotorOptions;
use ballbot_base::error::Result;
use ballbot_base::lanes::{Lane, Memory};
use ballbot_base::options::OptionTable;
use ballbot_base::params::Params;
use ballbot_base::wheels::{WHEELS, Wheels};

/// Three motors: command → delay → strength → lag → torque-speed curve → speed limit → peak torque, in each model step.
#[derive(Clone, Debug, PartialEq)]
pub struct Motors {
    chain: Chain<f64>,
    wait: Wait,
}

/// The delay of a command to the motors.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Wait {
    None,
    Fixed(Delay),
    Random(Line, DeadTime),
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
        let chain = Chain::new(options, params, action_torque, sim_dt)?;
        let time = DeadTime::new(options, sim_dt)?;
        let wait = match time {
            DeadTime { fixed: 0, jitter: 0 } => Wait::None,
            DeadTime { fixed, jitter: 0 } => {
                Wait::Fixed(Delay { steps: fixed / substeps, rest: fixed % substeps, substeps })
            }
            _ => Wait::Random(Line::new(chain.memory_len(), time, substeps), time),
        };
        let motors = Self { chain, wait };
        motors.check_robot(params, sim_dt)?;
        Ok(motors)
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
    /// Length for motors without lag and delay; see [`Motors::memory_len`].
    const MEMORY: usize = 0;

    /// The torques of the lag, N·m, then the numbers of the delay.
    fn memory_len(&self) -> usize {
        let wait = match self.wait {
            Wait::None => 0,
            Wait::Fixed(delay) => 1 + WHEELS * delay.commands(),
            Wait::Random(line, _) => line.memory_len(),
        };
        self.chain.memory_len() + wait
    }

    fn begin(&self, key: [u32; 2], episode: u32, memory: &mut [f64]) {
        if let Wait::Random(line, _) = self.wait {
            line.begin(key, episode, memory);
        }
    }

    #[inline(always)]
    fn torques<L: Lane>(&self, commands: Wheels<L>, speeds: Wheels<L>, memory: &mut Memory<'_, L>) -> Wheels<L> {
        let arrived = match self.wait {
            Wait::None => commands,
            Wait::Fixed(delay) => Self::delayed(delay, commands, self.chain.memory_len(), memory),
            Wait::Random(line, time) => {
                let (fixed, jitter) = (memory.splat(time.fixed as f64), memory.splat(time.jitter as f64));
                line.delayed(commands, fixed, jitter, memory)
            }
        };
        self.chain.torques(arrived, speeds, 0, memory)
    }
}
