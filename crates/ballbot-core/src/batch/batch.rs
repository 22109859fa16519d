//! Many environments in step.

use super::autoreset::Autoreset;
use super::buffers::StepBuffers;
use super::config::EnvConfig;
use super::env::Environments;
use super::env::chunk::Chunk;
use super::env::robots::Single;
use super::env::task_step::TaskStep;
use super::events::{Plan, Stages};
use super::history::History;
use super::integral::Integral;
use super::pieces::pieces;
use super::stage::Staged;
use crate::actuator::Actuator;
use crate::perception::Perception;
use crate::robot::{Ballbot, ModelKind, check_restored};
use crate::sensor::Sensor;
use crate::task::{ACTION_LEN, RowScaling, Task, TaskDescription};
use ballbot_base::error::{Error, Result};
use ballbot_base::force::Force;
use ballbot_base::interrupt::{Stop, Watch};
use ballbot_base::lanes::EIGHT;
use ballbot_base::memory::require_memory;
use ballbot_base::params::Params;
use ballbot_base::state::{Contacts, State};
use ballbot_base::terrain::Ground;
use ballbot_base::thread_pool::{WorkerThreads, thread_count};
use ballbot_lanes::ContactLanes;
use nalgebra::Vector3;
use std::slice;
use std::sync::{Arc, Mutex, PoisonError};

/// Environments of one task that are stepped together, on the requested number of threads. Environment i is seeded with
/// `seed + i`. Results do not depend on the number of threads.
/// ```
/// use ballbot_core::ModelKind;
/// use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, StepResults, Under};
/// use ballbot_core::control::Lqr;
/// use ballbot_core::task::ACTION_LEN;
///
/// let config = BalanceConfig { model: ModelKind::Contact, ..BalanceConfig::default() };
/// let mut batch = Batch::new(&config, 64, Autoreset::SameStep, None, 0)?;
/// let mut results = StepResults::new(&batch);
/// batch.reset(None, &mut results.observations)?;
/// let lqr = Lqr::new(&config.params, batch.control_dt())?;
/// let mut actions = vec![0.0; batch.len() * ACTION_LEN];
/// for _ in 0..200 {
///     batch.control(&Under::new(&lqr), &mut actions)?;
///     batch.step(&actions, &mut results.buffers())?;
///     assert!(!results.terminated.contains(&true));
/// }
/// # Ok::<(), ballbot_core::Error>(())
/// ```
pub struct Batch {
    pub(super) description: TaskDescription,
    model: ModelKind,
    sim_dt: f64,
    control_dt: f64,
    substeps: usize,
    max_episode_steps: usize,
    scaled: bool,
    pub(super) history: History,
    len: usize,
    pub(super) perception: Option<Arc<Perception>>,
    pub(super) plan: Option<Arc<Plan>>,
    /// Options of the stages before events.
    pub(super) stages: Stages,
    /// Environments in order, `width` per chunk; the last chunk may have fewer.
    pub(super) chunks: Vec<Box<dyn Chunk>>,
    pub(super) width: usize,
    pub(super) autoreset: Autoreset,
    /// Threads of a step, including the caller's.
    pub(super) threads: usize,
    /// Worker threads.
    pub(super) helpers: WorkerThreads,
    /// The stage of the caller, if there is one.
    pub(super) staged: Option<Box<Staged>>,
    /// Whether a step was interrupted: some robots have moved, others have not.
    pub(super) interrupted: bool,
}

/// Maximum number of environments of a batch.
const MAX_ENVS: usize = 1 << 20;

/// Minimum work for each worker thread, s.
const WORK_PER_THREAD: f64 = 50e-6;

/// Number of pieces of a step per thread, to even out the cost of falling robots and busy processors.
const PIECES_PER_THREAD: usize = 8;

/// Checks a number of environments.
fn check_count(num_envs: usize) -> Result<()> {
    if num_envs == 0 {
        return Err(Error::Inconsistent("num_envs = 0, it must be at least 1".into()));
    }
    if num_envs > MAX_ENVS {
        return Err(Error::Inconsistent(format!("num_envs = {num_envs}, it must be at most {MAX_ENVS}")));
    }
    Ok(())
}

/// What environments of the same robot share.
struct Alike<T, A, S> {
    config: Arc<EnvConfig<T>>,
    step: Arc<TaskStep<T, S>>,
    actuator: A,
    plan: Option<Arc<Plan>>,
    params: Arc<Params>,
    ground: Option<Arc<Ground>>,
}

impl<T: Task, A: Actuator, S: Sensor> Alike<T, A, S> {
    /// `config` is valid and has all options.
    fn new(config: EnvConfig<T>, actuator: A, sensor: S) -> Result<Self> {
        let config = Arc::new(config);
        Ok(Self {
            step: Arc::new(TaskStep::new(&actuator, sensor, &config.description(), &config)?),
            actuator,
            plan: config.plan()?,
            params: Arc::new(config.params.clone()),
            ground: config.ground()?,
            config,
        })
    }

    /// `used` environments that are stepped together.
    fn chunk(&self, used: usize, seed: u64) -> Result<Box<dyn Chunk>> {
        let Self { config, step, actuator, plan, params, ground } = self;
        Ok(match config.model {
            ModelKind::Contact => {
                let mut robots = ContactLanes::new(params, config.sim_dt);
                robots.set_ground(ground.as_ref());
                Box::new(Environments::new(config, step, actuator.clone(), robots, plan.as_ref(), used, seed)?)
            }
            model => {
                let mut robot = Ballbot::new(params, model, config.sim_dt)?;
                if ground.is_some() {
                    robot.set_ground(ground.as_ref())?;
                }
                let robot = Single::new(robot);
                Box::new(Environments::new(config, step, actuator.clone(), robot, plan.as_ref(), used, seed)?)
            }
        })
    }
}

impl Batch {
    /// How many neighbors in a batch have the same robot, if robots are given to [`Batch::of_robots`].
    pub const SAME_ROBOT: usize = EIGHT;

    /// `num_envs` environments on up to `num_threads` threads; `None` means one per core. There are never more threads
    /// than environments (groups of eight in the contact model), and fewer where waking a thread would not pay off.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] for zero environments or threads, or more than 2²⁰ or 256; errors of
    /// [`EnvConfig::validate`] and [`Ballbot::new`]; [`Error::Memory`] if there is not enough memory for the
    /// environments; [`Error::Interrupted`] in [`crate::stoppable`].
    pub fn new<T: Task>(
        config: &EnvConfig<T>,
        num_envs: usize,
        autoreset: Autoreset,
        num_threads: Option<usize>,
        seed: u64,
    ) -> Result<Self> {
        Self::of_robots(config, slice::from_ref(&config.params), num_envs, autoreset, num_threads, seed)
    }

    /// [`Batch::new`] with different robots in place of [`EnvConfig::params`], [`Batch::SAME_ROBOT`] neighbors of each: after
    /// the last robot the first robot follows. Whatever options follow from a robot follow from its own robot.
    ///
    /// # Errors
    /// As [`Batch::new`], for any robot; [`Error::Inconsistent`] if there is none, or more than there is room for.
    pub fn of_robots<T: Task>(
        config: &EnvConfig<T>,
        robots: &[Params],
        num_envs: usize,
        autoreset: Autoreset,
        num_threads: Option<usize>,
        seed: u64,
    ) -> Result<Self> {
        check_count(num_envs)?;
        if robots.is_empty() {
            return Err(Error::Inconsistent("there is no robot, expected at least one".into()));
        }
        let alike = |params: &Params| {
            let config = EnvConfig { params: params.clone(), ..config.clone() }.resolved()?;
            config.validate_resolved()?;
            let (actuator, sensor) = (config.drive()?, config.onboard()?);
            Alike::new(config, actuator, sensor)
        };
        let room = num_envs.div_ceil(Self::SAME_ROBOT);
        if robots.len() > room {
            return Err(Error::Inconsistent(format!(
                "robot has {} entries, but num_envs = {num_envs} has room for {room}: {} neighbors have the same robot, so \
                 it must be at least {}",
                robots.len(),
                Self::SAME_ROBOT,
                Self::SAME_ROBOT * (robots.len() - 1) + 1
            )));
        }
        let kinds = match robots {
            [robot] => vec![alike(robot)?],
            robots => {
                let numbered = |(i, robot)| {
                    let of = |error| Error::Inconsistent(format!("robot {i} of {}: {error}", robots.len()));
                    alike(robot).map_err(of)
                };
                robots.iter().enumerate().map(numbered).collect::<Result<_>>()?
            }
        };
        Self::build(&kinds, num_envs, autoreset, num_threads, seed)
    }

    /// [`Batch::new`] with custom stages between action and torque, in place of [`EnvConfig::actuators`], and between
    /// state and observation, in place of [`EnvConfig::sensors`].
    ///
    /// # Errors
    /// As [`Batch::new`]; [`Error::Inconsistent`] for events on `max_wheel_torque` or the actuators unless
    /// [`Actuator::is_individual`].
    pub fn with_stages<T: Task, A: Actuator, S: Sensor>(
        config: &EnvConfig<T>,
        actuator: &A,
        sensor: &S,
        num_envs: usize,
        autoreset: Autoreset,
        num_threads: Option<usize>,
        seed: u64,
    ) -> Result<Self> {
        check_count(num_envs)?;
        let config = config.resolved()?;
        config.validate_resolved()?;
        let kind = Alike::new(config, actuator.clone(), sensor.clone())?;
        Self::build(&[kind], num_envs, autoreset, num_threads, seed)
    }

    /// Builds the batch from valid configurations.
    fn build<T: Task, A: Actuator, S: Sensor>(
        kinds: &[Alike<T, A, S>],
        num_envs: usize,
        autoreset: Autoreset,
        num_threads: Option<usize>,
        seed: u64,
    ) -> Result<Self> {
        let threads = thread_count(num_threads)?;
        let Alike { config, step, plan, .. } = &kinds[0];
        let description = config.description();
        let of_events = plan.as_ref().map_or(0, |plan| plan.bytes());
        let seen = step.perception.as_ref().map_or(0, |perception| perception.bytes());
        require_memory(
            format_args!("num_envs = {num_envs}"),
            num_envs,
            config.model.bytes() + step.sizes().numbers() * size_of::<f64>() + step.observed_bytes() + of_events + seen,
        )?;
        let width = if config.model == ModelKind::Contact { EIGHT } else { 1 };
        let mut watch = Watch::new();
        let chunk = |first: usize| -> Result<Box<dyn Chunk>> {
            watch.check()?;
            let used = (num_envs - first).min(width);
            kinds[first / Self::SAME_ROBOT % kinds.len()].chunk(used, seed.wrapping_add(first as u64))
        };
        let chunks = (0..num_envs).step_by(width).map(chunk).collect::<Result<Vec<_>>>()?;
        let threads = threads.min(chunks.len());
        let substeps = config.substeps()?;
        let seconds = (num_envs * substeps) as f64 * config.model.step_seconds();
        let helpers = (threads - 1).min((seconds / WORK_PER_THREAD) as usize);
        let staged = config
            .stage
            .as_ref()
            .map(|stage| Box::new(Staged::new(stage, &description, num_envs, width, step.sensor.is_exact())));
        Ok(Self {
            description,
            model: config.model,
            sim_dt: config.sim_dt,
            control_dt: config.control_dt,
            substeps,
            max_episode_steps: config.max_episode_steps,
            perception: step.perception.clone(),
            scaled: config.scale_observations,
            history: config.history.clone(),
            len: num_envs,
            plan: plan.clone(),
            stages: config.stages(),
            chunks,
            width,
            autoreset,
            threads,
            helpers: WorkerThreads::new(helpers),
            staged,
            interrupted: false,
        })
    }

    /// Number of environments.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Always false: a batch has at least one environment.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Number of threads that step the environments.
    pub fn num_threads(&self) -> usize {
        self.threads
    }

    /// What happens when an episode ends.
    pub fn autoreset(&self) -> Autoreset {
        self.autoreset
    }

    /// The task.
    pub fn task(&self) -> &TaskDescription {
        &self.description
    }

    /// Whether observations are scaled.
    pub fn scale_observations(&self) -> bool {
        self.scaled
    }

    /// Model of the robots.
    pub fn model(&self) -> ModelKind {
        self.model
    }

    /// Time step of the model, s.
    pub fn sim_dt(&self) -> f64 {
        self.sim_dt
    }

    /// Time between two actions, s.
    pub fn control_dt(&self) -> f64 {
        self.control_dt
    }

    /// Model steps in one control step.
    pub fn substeps(&self) -> usize {
        self.substeps
    }

    /// Steps after which an episode is truncated.
    pub fn max_episode_steps(&self) -> usize {
        self.max_episode_steps
    }

    /// Torque of an action of 1 of one environment, N·m.
    ///
    /// # Errors
    /// As [`Batch::state`].
    pub fn max_wheel_torque(&self, index: usize) -> Result<f64> {
        let (chunk, _) = self.locate(index)?;
        Ok(self.chunks[chunk].action_torque())
    }

    /// Scaling of the rows of an observation of one environment; `None` if they are not scaled.
    ///
    /// # Errors
    /// As [`Batch::state`].
    pub fn row_scaling(&self, index: usize) -> Result<Option<&RowScaling>> {
        let (chunk, _) = self.locate(index)?;
        Ok(self.chunks[chunk].scaling())
    }

    /// The integral of the position error that one environment adds to its observation, if there is one.
    ///
    /// # Errors
    /// As [`Batch::state`].
    pub fn integral(&self, index: usize) -> Result<Option<&Integral>> {
        let (chunk, _) = self.locate(index)?;
        Ok(self.chunks[chunk].integral())
    }

    /// State of the robot of one environment.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] if there is no such environment.
    pub fn state(&self, index: usize) -> Result<State> {
        let (chunk, i) = self.locate(index)?;
        Ok(self.chunks[chunk].state(i))
    }

    /// States of all robots, in order.
    pub fn states(&self) -> impl Iterator<Item = State> {
        self.places().map(|(chunk, i)| self.chunks[chunk].state(i))
    }

    /// Contact forces of the last model step of one robot.
    ///
    /// # Errors
    /// As [`Batch::state`].
    pub fn contacts(&self, index: usize) -> Result<Contacts> {
        let (chunk, i) = self.locate(index)?;
        Ok(self.chunks[chunk].contacts(i))
    }

    /// Reward terms of the last step of one environment, in the order of [`TaskDescription::terms`].
    ///
    /// # Errors
    /// As [`Batch::state`]; [`Error::Length`] unless `out` has one element per term.
    pub fn reward_terms(&self, index: usize, out: &mut [f64]) -> Result<()> {
        let (chunk, i) = self.locate(index)?;
        self.expect_len("reward terms", out.len(), self.description.terms.len())?;
        self.chunks[chunk].reward_terms(i, out);
        Ok(())
    }

    /// Applies an impulse to the body of one robot; see [`Ballbot::push`].
    ///
    /// # Errors
    /// As [`Batch::state`] and [`Ballbot::push`].
    pub fn push(&mut self, index: usize, impulse: &Vector3<f64>, point: Option<&Vector3<f64>>) -> Result<()> {
        let (chunk, i) = self.locate(index)?;
        self.chunks[chunk].push(i, impulse, point)
    }

    /// Replaces the external force on the body of one robot; see [`Ballbot::apply_force`].
    ///
    /// # Errors
    /// As [`Batch::state`] and [`Ballbot::apply_force`].
    pub fn apply_force(&mut self, index: usize, force: &Force) -> Result<()> {
        let (chunk, i) = self.locate(index)?;
        self.chunks[chunk].apply_force(i, force)
    }

    /// Estimates of the horizontal external forces on the robots, inertial frame, N, at the last call of
    /// [`Batch::control`]; `None` unless its controller has an estimate ([`Law::force_index`](crate::control::Law::force_index)).
    pub fn outside_forces(&self) -> Option<Vec<[f64; 2]>> {
        self.places().map(|(chunk, i)| self.chunks[chunk].outside_force(i)).collect()
    }

    /// Whether a step or reset was interrupted, so that all environments must be reset before the next step.
    pub fn is_interrupted(&self) -> bool {
        self.interrupted
    }

    /// Requires a reset of all environments before the next step: for a copy, by [`Batch::save`] and [`Batch::load`], of
    /// an interrupted batch.
    pub fn interrupt(&mut self) {
        self.interrupted = true;
    }

    /// The complete state of one environment, as bytes for [`Batch::load`].
    ///
    /// # Errors
    /// As [`Batch::state`].
    pub fn save(&self, index: usize) -> Result<Vec<u8>> {
        let (chunk, i) = self.locate(index)?;
        Ok(self.chunks[chunk].save(i))
    }

    /// Continues one environment from bytes of [`Batch::save`] of an environment with the same task, model and time
    /// step; they include the robot's parameters. A controller's memory of the robot is reset.
    ///
    /// # Errors
    /// As [`Batch::state`]; [`Error::Decode`] if the bytes are not such a snapshot, or its numbers are not finite. The
    /// environment is then unchanged.
    pub fn load(&mut self, index: usize, bytes: &[u8]) -> Result<()> {
        let (chunk, i) = self.locate(index)?;
        let chunk = &mut self.chunks[chunk];
        let before = chunk.save(i);
        chunk.load(i, bytes)?;
        if let Err(error) = check_restored(&chunk.state(i), &chunk.contacts(i)) {
            chunk.load(i, &before)?;
            return Err(error);
        }
        Ok(())
    }

    /// The chunk of an environment, and its index in the chunk.
    pub(super) fn locate(&self, index: usize) -> Result<(usize, usize)> {
        self.check_index(index)?;
        Ok((index / self.width, index % self.width))
    }

    /// Checks that environment `index` exists.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] if it does not.
    pub fn check_index(&self, index: usize) -> Result<()> {
        if index < self.len {
            return Ok(());
        }
        Err(Error::OutOfRange {
            name: "environment index".into(),
            value: index as f64,
            limit: format!("below num_envs = {}", self.len),
        })
    }

    /// All environments: their chunks and indices.
    pub(super) fn places(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let width = self.width;
        (0..self.len).map(move |index| (index / width, index % width))
    }

    /// Spreads the ends of the current episodes evenly over the length of an episode, so that environments reset
    /// together are not truncated together.
    pub fn stagger(&mut self) {
        let n = self.len();
        let steps = self.max_episode_steps as u128;
        for (index, (chunk, i)) in self.places().enumerate() {
            self.chunks[chunk].shorten(i, (steps * (index as u128 + 1) / n as u128) as usize);
        }
    }

    /// Steps every environment. `actions` has one row of three per environment, in [-1, 1].
    ///
    /// # Errors
    /// [`Error::Length`] for buffers of the wrong length, [`Error::OutOfRange`] for an action that is not finite,
    /// [`Error::Inconsistent`] with [`Autoreset::Disabled`] where an episode is over. Nothing has moved in these cases.
    /// [`Error::Interrupted`] in [`crate::stoppable`]: some environments have moved, and all must be reset.
    pub fn step(&mut self, actions: &[f32], buffers: &mut StepBuffers<'_>) -> Result<()> {
        self.check_actions(actions)?;
        self.check_buffers(buffers)?;
        self.check_running()?;
        let (autoreset, width) = (self.autoreset, self.width);
        let stop = self.stop()?;
        let of_chunk = |c: usize| {
            let rest = &actions[c * width * ACTION_LEN..];
            &rest[..rest.len().min(width * ACTION_LEN)]
        };
        if self.staged.is_some() {
            self.sweep(buffers.reborrow(), &stop, |chunk, c, _| chunk.advance(autoreset, of_chunk(c)))?;
            self.finish(&stop)?;
            return self.conclude_staged(buffers, &stop);
        }
        self.sweep(buffers.reborrow(), &stop, |chunk, c, share| chunk.step(autoreset, of_chunk(c), share))?;
        self.finish(&stop)
    }

    /// Does `work` on every chunk, with its index and its part of the buffers, on all threads.
    pub(super) fn sweep(
        &mut self,
        buffers: StepBuffers<'_>,
        stop: &Stop,
        work: impl Fn(&mut dyn Chunk, usize, StepBuffers<'_>) + Sync,
    ) -> Result<()> {
        let width = self.width;
        let sweep = |chunks: &mut [Box<dyn Chunk>], first: usize, buffers: StepBuffers<'_>| {
            let mut watch = Watch::new();
            for (k, (chunk, share)) in pieces(chunks, 1, width, buffers).enumerate() {
                if stop.look(&mut watch) {
                    return;
                }
                work(&mut *chunk[0], first + k, share);
            }
        };
        if self.helpers.count() == 0 {
            sweep(&mut self.chunks, 0, buffers);
            return Ok(());
        }
        let per_piece = self.chunks_per_piece();
        let shares = Mutex::new(pieces(&mut self.chunks, per_piece, width, buffers).enumerate());
        self.helpers.share(|| {
            let next = || shares.lock().unwrap_or_else(PoisonError::into_inner).next();
            while let Some((k, (chunks, share))) = next() {
                sweep(chunks, k * per_piece, share);
            }
        })
    }

    /// How the caller may stop a step that is about to begin.
    ///
    /// # Errors
    /// [`Error::Interrupted`] if it is to be stopped already; nothing has moved then.
    pub(super) fn stop(&self) -> Result<Stop> {
        Watch::new().check()?;
        Ok(Stop::default())
    }

    /// Concludes a step.
    ///
    /// # Errors
    /// [`Error::Interrupted`] if it was stopped.
    pub(super) fn finish(&mut self, stop: &Stop) -> Result<()> {
        self.interrupted = stop.is_set();
        if self.interrupted { Err(Error::Interrupted) } else { Ok(()) }
    }

    pub(super) fn chunks_per_piece(&self) -> usize {
        self.chunks.len().div_ceil(PIECES_PER_THREAD * (self.helpers.count() + 1))
    }

    pub(super) fn check_actions(&self, actions: &[f32]) -> Result<()> {
        self.expect_len("actions", actions.len(), self.len() * ACTION_LEN)?;
        if let Some(i) = actions.iter().position(|a| !a.is_finite()) {
            return Err(Error::OutOfRange {
                name: format!("actions[{}, {}]", i / ACTION_LEN, i % ACTION_LEN),
                value: f64::from(actions[i]),
                limit: "finite".into(),
            });
        }
        Ok(())
    }

    pub(super) fn check_buffers(&self, buffers: &StepBuffers<'_>) -> Result<()> {
        let (n, width) = (self.len(), self.observation_len());
        self.expect_len("observations", buffers.observations.len(), n * width)?;
        self.expect_len("final observations", buffers.final_observations.len(), n * width)?;
        for len in [buffers.rewards.len(), buffers.terminated.len(), buffers.truncated.len(), buffers.outcomes.len()] {
            self.expect_len("a step buffer", len, n)?;
        }
        Ok(())
    }

    /// Checks that every environment can be stepped.
    pub(super) fn check_running(&self) -> Result<()> {
        if self.interrupted {
            return Err(Error::Inconsistent(
                "the last step was interrupted: reset all environments before they are stepped".into(),
            ));
        }
        if self.autoreset == Autoreset::NextStep && !self.chunks.iter().any(|chunk| chunk.begun()) {
            return Err(Error::Inconsistent("step before the first reset".into()));
        }
        if self.autoreset == Autoreset::NextStep { Ok(()) } else { self.check_episodes() }
    }

    /// Checks that every environment is in an episode.
    pub(super) fn check_episodes(&self) -> Result<()> {
        if let Some((chunk, i)) = self.chunks.iter().enumerate().find_map(|(c, chunk)| Some((c, chunk.first_over()?))) {
            let i = chunk * self.width + i;
            return Err(Error::Inconsistent(format!(
                "the episode of environment {i} is over (or has not begun): reset it before it is stepped"
            )));
        }
        Ok(())
    }

    pub(super) fn expect_len(&self, name: &str, found: usize, expected: usize) -> Result<()> {
        if found == expected { Ok(()) } else { Err(Error::Length { name: name.into(), found, expected }) }
    }
}
