//! Commands in transit to the motors, each with a separate dead time.

use super::options::MotorOptions;
use ballbot_base::error::{Result, check};
use ballbot_base::lanes::{Cell, Lane, Memory, philox};
use ballbot_base::wheels::Wheels;

/// Maximum number of model steps of a dead time.
const MAX_STEPS: f64 = 10_000.0;

/// Separates these random numbers from the numbers of other stages under the same key.
const STREAM: u32 = u32::from_le_bytes(*b"wait");

/// Dead time of a command and the largest random addition to it, model steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct DeadTime {
    pub fixed: usize,
    pub jitter: usize,
}

impl DeadTime {
    /// # Errors
    /// [`ballbot_base::Error::OutOfRange`] for a time that is not a whole number of model steps, or longer than what is kept.
    pub fn new(options: &MotorOptions, sim_dt: f64) -> Result<Self> {
        let whole = |name: &str, seconds: f64| {
            let steps = seconds / sim_dt;
            let near = [steps.floor(), steps.ceil()].map(|n| n.min(MAX_STEPS) * sim_dt);
            check(
                format_args!("actuators.{name} / sim_dt"),
                steps,
                format_args!(
                    "a whole number of at most {MAX_STEPS} ({name} = {seconds} s, sim_dt = {sim_dt} s; valid near it: {} s and {} s)",
                    near[0], near[1]
                ),
                |n| (n - n.round()).abs() <= 1e-6 * n && n <= MAX_STEPS + 0.5,
            )?;
            Ok(steps.round() as usize)
        };
        Ok(Self { fixed: whole("delay", options.delay)?, jitter: whole("delay_jitter", options.delay_jitter)? })
    }

    /// The longest dead time.
    pub fn longest(self) -> usize {
        self.fixed + self.jitter
    }
}

/// A delay line of commands, one per control step. The memory holds the model step within the control step; with
/// jitter, two words of a key, the episode and the count of commands so far; then, for the current command and each
/// earlier one, the model step after the command at which it arrives, and its three numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Line {
    /// Index of its numbers in the memory.
    pub first: usize,
    /// Commands that are kept, including the current one.
    commands: usize,
    /// Model steps in a control step.
    substeps: usize,
    jitter: bool,
}

/// Numbers of the key, in the order of the memory.
const KEY: usize = 4;

impl Line {
    /// A line for dead times of up to `longest`.
    pub fn new(first: usize, longest: DeadTime, substeps: usize) -> Self {
        let commands = longest.longest().div_ceil(substeps) + 1;
        Self { first, commands, substeps, jitter: longest.jitter > 0 }
    }

    pub fn memory_len(&self) -> usize {
        1 + self.key_len() + 4 * self.commands
    }

    /// Whether it can keep commands for as long as a dead time requires.
    pub fn holds(&self, time: DeadTime) -> bool {
        time.longest() <= (self.commands - 1) * self.substeps && (self.jitter || time.jitter == 0)
    }

    fn key_len(&self) -> usize {
        if self.jitter { KEY } else { 0 }
    }

    /// Begins an episode, in a memory of zeros.
    pub fn begin(&self, key: [u32; 2], episode: u32, memory: &mut [f64]) {
        if self.jitter {
            let numbers = [key[0], key[1], episode].map(f64::from);
            memory[self.first + 1..][..numbers.len()].copy_from_slice(&numbers);
        }
    }

    /// The newest command that has arrived; zeros before the first.
    #[inline(always)]
    pub fn delayed<L: Lane>(&self, commands: Wheels<L>, fixed: L, jitter: L, memory: &mut Memory<'_, L>) -> Wheels<L> {
        let step = memory.get(self.first);
        let kept = |age: usize| self.first + 1 + self.key_len() + 4 * age;
        // Robots are driven together: their control steps coincide.
        let begins = step.le(step.zero());
        if L::any(begins) {
            for age in (1..self.commands).rev() {
                for k in 0..4 {
                    let newer = memory.get(kept(age - 1) + k);
                    memory.set(kept(age) + k, newer);
                }
            }
            let mut arrives = fixed;
            if self.jitter {
                // Uniform over 0, 1, ..., jitter once it is rounded up.
                let share = self.next_share(memory);
                arrives += share.mul_add(jitter + 1.0, share.splat(-1.0)).max(share.zero());
            }
            memory.set(kept(0), arrives);
            for (wheel, command) in commands.into_iter().enumerate() {
                memory.set(kept(0) + 1 + wheel, command);
            }
        }
        let next = step + 1.0;
        let continues = next.lt(step.splat(self.substeps as f64));
        memory.set(self.first, L::select(continues, next, step.zero()));
        let oldest = kept(self.commands - 1);
        let mut out = memory.wheels(oldest + 1);
        for age in (0..self.commands - 1).rev() {
            let arrived = memory.get(kept(age)).le(step + (age * self.substeps) as f64);
            for (wheel, command) in out.iter_mut().enumerate() {
                *command = L::select(arrived, memory.get(kept(age) + 1 + wheel), *command);
            }
        }
        out
    }

    /// A random number in [0, 1) for the next command of each robot.
    #[inline(always)]
    fn next_share<L: Lane>(&self, memory: &mut Memory<'_, L>) -> L {
        let first = self.first + 1;
        let mut numbers = [L::Cell::default(); 4];
        for (k, cell) in numbers.iter_mut().enumerate() {
            memory.get(first + k).store(cell);
        }
        let mut words = L::Cell::default();
        for i in 0..L::Cell::WIDTH {
            let [low, high, episode, count] = numbers.map(|cell| cell.get(i) as u32);
            words.set(i, f64::from(philox([low, high], [count, episode, STREAM, 0])[0]));
        }
        let count = memory.get(first + 3) + 1.0;
        memory.set(first + 3, count);
        memory.load(&words) * (0.5 / f64::from(1u32 << 31))
    }
}
