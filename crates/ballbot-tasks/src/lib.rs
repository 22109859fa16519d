//! Tasks: Markov decision processes on a ballbot, each in one file.
//!
//! A task is a struct of options ([`ballbot_base::fields!`]) that implements [`Task`]. Its computations are written once over
//! lanes. Observation rows and reward terms carry their description next to their value, so that spaces, scaling,
//! bindings and documentation follow from the same line.

#![warn(clippy::print_stdout, clippy::print_stderr, clippy::unwrap_used)]

mod balance;
mod bare;
mod carry;
mod description;
mod goal;
mod heading_motion;
mod metrics;
mod navigate;
mod open_ball_bot;
mod path;
mod push;
mod ride;
mod rows;
mod shared;
mod start;
mod traverse;
mod velocity;

pub use balance::Balance;
pub use bare::Bare;
pub use carry::Carry;
pub use description::TaskDescription;
pub use goal::Goal;
pub use metrics::{Metric, Metrics};
pub use navigate::Navigate;
pub use open_ball_bot::OpenBallBot;
pub use path::Path;
pub use push::Push;
pub use ride::Ride;
pub use rows::{Growth, RewardScales, Row, RowScaling, Rows, SCALED_BOUND, Term, Terms};
pub use rows::{WriteRows, WriteTerms};
pub use shared::limited;
pub use traverse::Traverse;
pub use velocity::Velocity;

use ballbot_base::error::Result;
use ballbot_base::fields::Fields;
use ballbot_base::kinematics::Omniwheels;
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Lane, Memory, Vec3};
use ballbot_base::params::Params;
use ballbot_base::setpoint::Setpoint;
use ballbot_base::state::State;
use ballbot_base::terrain::Terrain;
use ballbot_base::wheels::{WHEELS, Wheels};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;

/// Number of actions: one command for each wheel.
pub const ACTION_LEN: usize = WHEELS;

/// Reason for the termination of an episode whose simulation diverged; shared by all tasks.
pub const DIVERGED: &str = "diverged";

/// A task: where an episode starts, what is observed, what is rewarded, and when it ends.
///
/// ```
/// use ballbot_core::batch::{Autoreset, Batch, EnvConfig, StepResults, register_task, task_kind};
/// use ballbot_core::fields::Limit;
/// use ballbot_core::kinematics::Omniwheels;
/// use ballbot_core::lanes::{Lane, Memory};
/// use ballbot_core::rand_chacha::ChaCha8Rng;
/// use ballbot_core::task::{Row, Rows, Sensed, Step, Task, Term, Terms};
/// use ballbot_core::{Params, Result, State};
///
/// ballbot_core::fields! {
///     /// Options of the task.
///     pub struct Stand {
///         /// First tilt about x.
///         pub reset_tilt: f64 = 0.05, "rad", Limit::NOT_NEGATIVE.to(0.1);
///         /// Tilt above which the episode is terminated.
///         pub fall_tilt: f64 = 0.3, "rad", Limit::from(0.2).to(1.0);
///     }
/// }
///
/// impl Task for Stand {
///     const NAME: &'static str = "stand";
///     const ID: &'static str = "me/Stand-v0";
///     const SUMMARY: &'static str = "Stand upright.";
///     const TERMINATIONS: &'static [(&'static str, &'static str)] = &[("tilt", "the tilt exceeds `fall_tilt`")];
///     const SUCCESS: &'static str = "not terminated";
///
///     fn validate(&self, _: &Params) -> Result<()> {
///         Ok(())
///     }
///
///     fn extreme_starts(&self, params: &Params) -> Vec<State> {
///         vec![State::tilted(params, [self.reset_tilt, 0.0].into(), 0.0)]
///     }
///
///     fn start(&self, params: &Params, _: &Omniwheels, _: &mut ChaCha8Rng) -> State {
///         State::tilted(params, [self.reset_tilt, 0.0].into(), 0.0)
///     }
///
///     fn observe<L: Lane>(&self, sensed: &Sensed<'_, L>, _: &Memory<'_, L>, rows: &mut impl Rows<L>) {
///         let [x, y] = sensed.state.body_quaternion.tilt_components();
///         rows.row(Row::new("tilt about x", "rad", 1.0, 0.1), x);
///         rows.row(Row::new("tilt about y", "rad", 1.0, 0.1), y);
///     }
///
///     fn terminate<L: Lane>(&self, step: &Step<'_, L>) -> L {
///         let zero = step.tilt.zero();
///         L::select(zero.splat(self.fall_tilt).lt(step.tilt), zero.splat(1.0), zero)
///     }
///
///     fn success<L: Lane>(&self, _: &Step<'_, L>, terminated: L::Mask, _: &mut Memory<'_, L>) -> L::Mask {
///         !terminated
///     }
///
///     fn reward<L: Lane>(&self, step: &Step<'_, L>, _: L::Mask, _: &Memory<'_, L>, terms: &mut impl Terms<L>) {
///         terms.term(Term::reward("alive", 1.0, "1"), step.tilt.splat(1.0));
///         terms.term(Term::cost("tilt", 1.0, "tilt²"), step.tilt.squared());
///     }
/// }
///
/// // By its type, or by its name once it is registered.
/// let by_type = Batch::new(&EnvConfig::<Stand>::default(), 8, Autoreset::NextStep, Some(1), 0)?;
/// register_task::<Stand>()?;
/// let mut config = task_kind("stand")?.config();
/// config.set("fall_tilt", &[0.25])?;
/// let mut batch = config.batch(8, Autoreset::NextStep, Some(1), 0)?;
/// assert_eq!(batch.observation_len(), by_type.observation_len());
///
/// let mut results = StepResults::new(&batch);
/// batch.reset(None, &mut results.observations)?;
/// batch.step(&[0.0; 24], &mut results.buffers())?;
/// assert!(results.rewards.iter().all(|reward| *reward < 1.0));
/// # Ok::<(), ballbot_core::Error>(())
/// ```
pub trait Task: Fields + Send + Sync + 'static {
    /// Name, as in `balance`.
    const NAME: &'static str;

    /// Id with Gymnasium, as in `ballbot/Balance-v0`.
    const ID: &'static str;

    /// The goal of the task, in one sentence.
    const SUMMARY: &'static str;

    /// Default length of an episode, in control steps.
    const MAX_EPISODE_STEPS: usize = 1000;

    /// Mean return at which the task counts as solved, if defined.
    const REWARD_THRESHOLD: Option<f64> = None;

    /// Reasons for termination, each with its condition; [`DIVERGED`] is added.
    const TERMINATIONS: &'static [(&'static str, &'static str)];

    /// Condition of success, in one sentence; empty if there is none.
    const SUCCESS: &'static str = "";

    /// The command, as rows of an observation: their bounds apply to a command that is set by hand. The memory begins
    /// with the command.
    const COMMAND: &'static [Row] = &[];

    /// What the command is in space; pages, videos and figures draw and drive it accordingly.
    const GEOMETRY: Option<Geometry> = None;

    /// Whether an episode may begin anywhere, i.e. the task does not depend on the position.
    const ANYWHERE: bool = false;

    /// Whether it has its own ground, [`Task::terrain`].
    const HAS_TERRAIN: bool = false;

    /// Where the memory has the offset of the payload's rest along body x and y, m, if a rider who leans is the first payload; the task then
    /// sees [`Step::lean`].
    const LEAN: Option<[usize; 2]> = None;

    /// How many numbers the task keeps in an episode (the command, counters); zeros before [`Task::command`].
    const MEMORY: usize = 0;

    /// The robot that is simulated in place of `params`.
    fn robot(&self, params: &Params) -> Params {
        params.clone()
    }

    /// Checks options against each other and against the robot, beyond the limits of single options.
    ///
    /// # Errors
    /// [`ballbot_base::Error::OutOfRange`] or [`ballbot_base::Error::Inconsistent`] naming the value and the limit.
    fn validate(&self, params: &Params) -> Result<()>;

    /// The starts that come nearest to the floor: if the model accepts them, it accepts all that [`Task::start`]
    /// samples.
    fn extreme_starts(&self, params: &Params) -> Vec<State>;

    /// Samples the initial state of an episode.
    fn start(&self, params: &Params, wheels: &Omniwheels, rng: &mut ChaCha8Rng) -> State;

    /// Samples a command into the memory at the start of an episode and whenever the last command has run out. Returns
    /// after how many control steps the next command is due; infinity if never.
    fn command(&self, moment: &Moment<'_>, rng: &mut ChaCha8Rng, memory: &mut [f64]) -> f64 {
        let _ = (moment, rng, memory);
        f64::INFINITY
    }

    /// Checks a command that is set by hand, beyond the bounds of its parts.
    ///
    /// # Errors
    /// [`ballbot_base::Error::OutOfRange`] naming the part.
    fn check_command(&self, command: &[f64]) -> Result<()> {
        let _ = command;
        Ok(())
    }

    /// Handles a new command, sampled or set by hand, which is already in the memory.
    fn commanded(&self, moment: &Moment<'_>, memory: &mut [f64]) {
        let _ = (moment, memory);
    }

    /// Gives the metrics of the episode so far, always the same in the same order.
    fn measure(&self, memory: &[f64], control_dt: f64, metrics: &mut impl Metrics) {
        let _ = (memory, control_dt, metrics);
    }

    /// The ground of a robot where none is chosen; `None` for level ground.
    ///
    /// # Errors
    /// The errors of [`Terrain::generate`].
    fn terrain(&self, params: &Params) -> Result<Option<Arc<Terrain>>> {
        let _ = params;
        Ok(None)
    }

    /// The fraction of the commands so far that the episode has completed, for curricula; 1 for tasks that do not
    /// define it.
    fn share(&self, memory: &[f64]) -> f64 {
        let _ = memory;
        1.0
    }

    /// The pushes that are part of the task, on a robot with the nominal `params`.
    fn pushes(&self, params: &Params) -> Option<Pushes> {
        let _ = params;
        None
    }

    /// Setpoint of a classical controller under the current command.
    fn setpoint(&self, memory: &[f64]) -> Setpoint {
        let _ = memory;
        Setpoint::default()
    }

    /// Gives the rows of the observation, always the same in the same order.
    fn observe<L: Lane>(&self, sensed: &Sensed<'_, L>, memory: &Memory<'_, L>, rows: &mut impl Rows<L>);

    /// Advances the memory by a step: motion of the command, and counters.
    #[inline(always)]
    fn advance<L: Lane>(&self, step: &Step<'_, L>, memory: &mut Memory<'_, L>) {
        let _ = (step, memory);
    }

    /// Why the episode is terminated: 0 if it is not, otherwise 1 + the index in [`Task::TERMINATIONS`].
    fn terminate<L: Lane>(&self, step: &Step<'_, L>) -> L;

    /// Whether the episode is a success if it ends here. `terminated` robots have no success; the memory may be
    /// updated.
    fn success<L: Lane>(&self, step: &Step<'_, L>, terminated: L::Mask, memory: &mut Memory<'_, L>) -> L::Mask;

    /// Gives the terms of the reward, always the same in the same order.
    fn reward<L: Lane>(
        &self,
        step: &Step<'_, L>,
        terminated: L::Mask,
        memory: &Memory<'_, L>,
        terms: &mut impl Terms<L>,
    );
}

/// What a command is in space.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Geometry {
    /// Horizontal velocity in the heading frame, m/s, and rate about the vertical, rad/s.
    Velocity,
    /// Point of the inertial xy plane, m.
    Point,
    /// Closed curve as in [`Path`]: speed, and coefficients of its waves.
    Curve,
    /// None, but the task pushes the robot.
    Impulse,
}

impl Geometry {
    /// Name, as in `velocity`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Velocity => "velocity",
            Self::Point => "point",
            Self::Curve => "curve",
            Self::Impulse => "impulse",
        }
    }
}

/// Horizontal pushes at the body's center of mass, in any direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pushes {
    /// Smallest and largest impulse, N·s.
    pub impulse: [f64; 2],
    /// Shortest and longest time between the starts of two pushes, s.
    pub every: [f64; 2],
    /// Time over which a push is spread, s.
    pub duration: f64,
}

/// The moment at which a command is given.
#[derive(Clone, Copy)]
pub struct Moment<'a> {
    /// The true state.
    pub state: &'a LaneState<f64>,
    /// The robot.
    pub params: &'a Params,
    /// Duration of a control step, s.
    pub control_dt: f64,
    /// Level of the terrain tile; 0 without tiles.
    pub level: usize,
    /// The ground; `None` is level.
    pub terrain: Option<&'a Terrain>,
}

/// Input of a task's observation.
pub struct Sensed<'a, L: Lane> {
    /// The state measured by the sensors.
    pub state: &'a LaneState<L>,
    /// The last action, in [-1, 1].
    pub last_action: Wheels<L>,
}

/// A control step that has just been simulated.
pub struct Step<'a, L: Lane> {
    /// The true state at its end.
    pub state: &'a LaneState<L>,
    /// The vertical in the body frame.
    pub up: Vec3<L>,
    /// Tilt from the equilibrium, rad: the angle between the vertical and the line from the ball's center to the body's
    /// center of mass; the tilt of the mast if the center of mass is on it.
    pub tilt: L,
    /// Whether the body or a wheel touches the floor.
    pub on_floor: L::Mask,
    /// Whether the ball, the body or a wheel touches an obstacle.
    pub on_obstacle: L::Mask,
    /// Deflection of the first payload, body axes, m; zero in tasks without [`Task::LEAN`].
    pub lean: Vec3<L>,
    /// The action, in [-1, 1].
    pub action: Wheels<L>,
    /// The previous action.
    pub last_action: Wheels<L>,
    /// The ground; `None` is level.
    pub terrain: Option<&'a Terrain>,
    /// Duration of a control step, s.
    pub control_dt: f64,
}
