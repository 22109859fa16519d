//! Stages of the caller: reward terms, observation rows and terminations, computed for all robots at once.

use super::batch::Batch;
use super::buffers::StepBuffers;
use super::env::chunk::Chunk;
use crate::task::{Row, RowScaling, TaskDescription, Term, WriteRows};
use ballbot_base::error::{Error, Result, check};
use ballbot_base::interrupt::Stop;
use std::fmt;
use std::ops::Range;
use std::sync::Arc;

/// Numbers of a row of [`RobotRows::truth`]: gravity direction (3, body frame), body rate (3, body frame), wheel speeds
/// (3), wheel angles (3), ball position, velocity and rate (3 each, inertial frame), body quaternion (4, scalar first),
/// last action (3), and center of mass of the body (3, body frame). SI units and radians.
pub const ROBOT_ROW_LEN: usize = 28 + 3;

/// What a [`BatchStage`] adds to a task.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StageLayout {
    /// Name of the task with the stage, if it is not the name of the task.
    pub name: Option<&'static str>,
    /// Terms of the reward, with their scales.
    pub terms: Vec<Term>,
    /// Rows of the observation, after the rows of the task.
    pub rows: Vec<Row>,
    /// Reasons for termination with their conditions.
    pub terminations: Vec<(&'static str, &'static str)>,
    /// Whether the stage decides on success in place of the task.
    pub decides_success: bool,
}

/// The robots of a batch, or some of them, as a stage sees them; each slice has one row per robot.
#[derive(Clone, Copy)]
pub struct RobotRows<'a> {
    /// Indices of the robots in the batch.
    pub indices: &'a [usize],
    /// True states, rows of [`ROBOT_ROW_LEN`].
    pub truth: &'a [f32],
    /// The same as the task observes it: empty if that is the true state.
    pub observed: &'a [f32],
    /// Commands, rows of [`TaskDescription::command`].
    pub commands: &'a [f64],
    /// Steps since the start of the episode.
    pub steps: &'a [i64],
    /// Keys of the random numbers of the current episodes: unique for seed and episode.
    pub keys: &'a [[u32; 3]],
}

/// Where a stage writes its results, one row per robot.
pub struct StageResults<'a> {
    /// Terms of the reward before their scales; finite.
    pub terms: &'a mut [f64],
    /// Reasons for termination: 0, or 1 + the index of the reason in [`StageLayout::terminations`].
    pub terminations: &'a mut [u32],
    /// Whether the episode is a success if it ends here; ignored unless [`StageLayout::decides_success`].
    pub success: &'a mut [bool],
    /// Rows of the observation, from [`RobotRows::observed`]; finite.
    pub rows: &'a mut [f64],
}

/// A stage that runs once a control step on all robots of a batch, after the simulation and the task's own reward and
/// termination, and before the end of episodes.
///
/// It is called in the thread of [`Batch::step`]. If it returns an error, the step is interrupted, and all environments
/// must be reset.
pub trait BatchStage: Send + Sync {
    /// What the stage adds; always the same.
    fn layout(&self) -> &StageLayout;

    /// Episodes begin: writes the first rows of the observation of `robots`.
    ///
    /// # Errors
    /// Any error ends the reset or step.
    fn begin(&self, robots: &RobotRows<'_>, rows: &mut [f64]) -> Result<()>;

    /// A control step of all robots.
    ///
    /// # Errors
    /// As [`BatchStage::begin`].
    fn step(&self, robots: &RobotRows<'_>, results: &mut StageResults<'_>) -> Result<()>;

    /// Writes the rows of the observation that follow from [`RobotRows::truth`], any number of times in a step: where a
    /// command has changed, for privileged observations.
    ///
    /// # Errors
    /// As [`BatchStage::begin`].
    fn observe(&self, robots: &RobotRows<'_>, rows: &mut [f64]) -> Result<()>;
}

/// A [`BatchStage`] in a configuration; equal if it is the same object.
#[derive(Clone)]
pub struct CustomStage(pub Arc<dyn BatchStage>);

impl fmt::Debug for CustomStage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("CustomStage").field(self.0.layout()).finish()
    }
}

impl PartialEq for CustomStage {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl CustomStage {
    /// Checks names and numbers of the layout against a task.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] for a name that is taken, [`Error::OutOfRange`] for a number.
    pub(super) fn check(&self, task: &TaskDescription) -> Result<()> {
        let layout = self.0.layout();
        let mut terms: Vec<_> = task.terms.iter().map(|term| term.name).collect();
        for term in &layout.terms {
            unique("reward term", term.name, &mut terms)?;
            check(format_args!("reward.{}", term.name), term.scale, "within ±1e6", |s| s.abs() <= 1e6)?;
        }
        let mut rows: Vec<_> = task.rows.iter().map(|row| row.name).collect();
        for row in &layout.rows {
            unique("observation row", row.name, &mut rows)?;
            let bound = f64::from(row.bound);
            check(format_args!("bound of {}", row.name), bound, "above 0, at most 1e9", |b| 0.0 < b && b <= 1e9)?;
            check(format_args!("typical magnitude of {}", row.name), row.typical, "from 1e-9 to 1e9", |t| {
                (1e-9..=1e9).contains(&t)
            })?;
        }
        let mut reasons: Vec<_> = task.terminations.iter().map(|(name, _)| *name).collect();
        layout.terminations.iter().try_for_each(|(name, _)| unique("termination", name, &mut reasons))
    }

    /// Adds what the stage adds to the description of a task.
    pub(super) fn extend(&self, task: &mut TaskDescription) {
        let layout = self.0.layout();
        task.name = layout.name.unwrap_or(task.name);
        task.terms.extend(&layout.terms);
        task.scaling.rest.extend(layout.rows.iter().map(|_| 0.0));
        task.scaling.gain.extend(layout.rows.iter().map(|row| row.typical.recip()));
        task.rows.extend(&layout.rows);
        task.terminations.extend(&layout.terminations);
    }
}

/// Adds a name to the names that are taken.
fn unique(what: &str, name: &'static str, taken: &mut Vec<&'static str>) -> Result<()> {
    if taken.contains(&name) {
        return Err(Error::Inconsistent(format!("there is a {what} '{name}' already: choose another name")));
    }
    taken.push(name);
    Ok(())
}

/// Results of a stage for the robots of a chunk.
#[derive(Clone, Copy)]
pub struct ChunkResults<'a> {
    pub terms: &'a [f64],
    pub terminations: &'a [u32],
    pub success: &'a [bool],
    pub rows: &'a [f64],
}

/// A stage with its input and results.
pub(super) struct Staged {
    stage: Arc<dyn BatchStage>,
    command_len: usize,
    is_exact: bool,
    indices: Vec<usize>,
    truth: Vec<f32>,
    observed: Vec<f32>,
    commands: Vec<f64>,
    commands_before: Vec<f64>,
    /// Of one robot.
    command: Vec<f64>,
    steps: Vec<i64>,
    keys: Vec<[u32; 3]>,
    terms: Vec<f64>,
    terminations: Vec<u32>,
    success: Vec<bool>,
    rows: Vec<f64>,
    /// Rows of the robots of a chunk.
    scratch: Vec<f32>,
}

impl Staged {
    pub fn new(stage: &CustomStage, task: &TaskDescription, num_envs: usize, width: usize, is_exact: bool) -> Self {
        let layout = stage.0.layout();
        Self {
            stage: Arc::clone(&stage.0),
            command_len: task.command.len(),
            is_exact,
            indices: Vec::with_capacity(num_envs),
            truth: Vec::with_capacity(num_envs * ROBOT_ROW_LEN),
            observed: Vec::with_capacity(if is_exact { 0 } else { num_envs * ROBOT_ROW_LEN }),
            commands: Vec::with_capacity(num_envs * task.command.len()),
            commands_before: Vec::with_capacity(num_envs * task.command.len()),
            command: vec![0.0; task.command.len()],
            steps: Vec::with_capacity(num_envs),
            keys: Vec::with_capacity(num_envs),
            terms: vec![0.0; num_envs * layout.terms.len()],
            terminations: vec![0; num_envs],
            success: vec![false; num_envs],
            rows: vec![0.0; num_envs * layout.rows.len()],
            scratch: vec![0.0; width * ROBOT_ROW_LEN],
        }
    }

    /// Reads the robots of a range of chunks for which `chosen` holds.
    fn read(
        &mut self,
        chunks: &mut [Box<dyn Chunk>],
        range: Range<usize>,
        width: usize,
        mut chosen: impl FnMut(&mut dyn Chunk, usize, usize) -> bool,
    ) {
        self.indices.clear();
        self.truth.clear();
        self.observed.clear();
        self.commands.clear();
        self.steps.clear();
        self.keys.clear();
        for (chunk, c) in chunks[range.clone()].iter_mut().zip(range) {
            let first = self.indices.len();
            for i in 0..chunk.len() {
                if chosen(&mut **chunk, c * width + i, i) {
                    self.indices.push(c * width + i);
                }
            }
            if self.indices.len() == first {
                continue;
            }
            for observed in [false, true] {
                if observed && self.is_exact {
                    continue;
                }
                chunk.robot_rows(observed, &mut self.scratch);
                let rows = if observed { &mut self.observed } else { &mut self.truth };
                for index in &self.indices[first..] {
                    rows.extend(&self.scratch[index % width * ROBOT_ROW_LEN..][..ROBOT_ROW_LEN]);
                }
            }
            for index in &self.indices[first..] {
                let i = index % width;
                let from = self.commands.len();
                self.commands.resize(from + self.command_len, 0.0);
                chunk.command(i, &mut self.commands[from..]);
                self.steps.push(chunk.steps(i));
                self.keys.push(chunk.key(i));
            }
        }
    }

    fn robots(&self) -> RobotRows<'_> {
        let Self { indices, truth, observed, commands, steps, keys, .. } = self;
        RobotRows { indices, truth, observed, commands, steps, keys }
    }

    /// Rows of an observation per robot.
    fn width(&self) -> usize {
        self.stage.layout().rows.len()
    }

    fn step(&mut self) -> Result<()> {
        let Self { stage, indices, truth, observed, commands, steps, keys, terms, terminations, success, rows, .. } =
            self;
        stage.step(
            &RobotRows { indices, truth, observed, commands, steps, keys },
            &mut StageResults { terms, terminations, success, rows },
        )
    }

    /// Results for `n` robots from `first` on.
    fn results(&self, first: usize, n: usize) -> ChunkResults<'_> {
        let (terms, rows) = (self.stage.layout().terms.len(), self.width());
        ChunkResults {
            terms: &self.terms[first * terms..][..n * terms],
            terminations: &self.terminations[first..][..n],
            success: &self.success[first..][..n],
            rows: &self.rows[first * rows..][..n * rows],
        }
    }
}

/// The rows of a stage as an observation has them from row `first` on: saturated, and scaled if requested.
pub(super) fn saturated<'a>(
    rows: &'a [Row],
    scaling: Option<&'a RowScaling>,
    first: usize,
    values: &'a [f64],
) -> impl Iterator<Item = f64> + 'a {
    rows.iter().zip(values).zip(first..).map(move |((row, value), index)| {
        let mut number = 0.0;
        let scaling = scaling.map(|scaling| (scaling.rest[index], scaling.gain[index]));
        WriteRows::<f64>::write(*row, *value, scaling, &mut number);
        number
    })
}

impl Batch {
    /// The second half of a step whose robots have moved: the stage, the ends of episodes, and new episodes.
    pub(super) fn conclude_staged(&mut self, buffers: &mut StepBuffers<'_>, stop: &Stop) -> Result<()> {
        let Some(mut staged) = self.staged.take() else { return Ok(()) };
        self.interrupted = true;
        let result = self.conclude_with(&mut staged, buffers, stop);
        self.staged = Some(staged);
        result?;
        self.finish(stop)
    }

    fn conclude_with(&mut self, staged: &mut Staged, buffers: &mut StepBuffers<'_>, stop: &Stop) -> Result<()> {
        let (autoreset, width) = (self.autoreset, self.width);
        let all = self.chunks_of(None);
        staged.read(&mut self.chunks, all, width, |_, _, _| true);
        staged.step()?;
        let results = &*staged;
        self.sweep(buffers.reborrow(), stop, |chunk, c, share| {
            chunk.finish(autoreset, Some(results.results(c * width, chunk.len())), share);
        })?;
        if stop.is_set() {
            return Ok(());
        }
        if staged.command_len > 0 {
            let (len, before) = (staged.command_len, std::mem::take(&mut staged.commands));
            staged.commands = std::mem::take(&mut staged.commands_before);
            let mut now = std::mem::take(&mut staged.command);
            let result = self.write_rows(staged, None, Some(&mut *buffers.observations), false, |chunk, index, i| {
                chunk.command(i, &mut now);
                chunk.steps(i) != 0 && now != before[index * len..][..len]
            });
            (staged.commands_before, staged.command) = (before, now);
            result?;
        }
        self.write_rows(staged, None, Some(&mut *buffers.observations), true, |chunk, _, i| chunk.steps(i) == 0)
    }

    /// Computes the rows of one robot again, whose command has changed.
    pub(super) fn renew_staged(&mut self, index: usize) -> Result<()> {
        let Some(mut staged) = self.staged.take() else { return Ok(()) };
        let result = self.write_rows(&mut staged, Some(index), None, false, |_, chosen, _| chosen == index);
        self.staged = Some(staged);
        self.interrupted |= result.is_err();
        result
    }

    /// Begins the episodes of the chosen robots for the stage, and completes their first observations.
    pub(super) fn begin_staged(&mut self, observations: &mut [f32], chosen: impl Fn(usize) -> bool) -> Result<()> {
        let Some(mut staged) = self.staged.take() else { return Ok(()) };
        let before = std::mem::replace(&mut self.interrupted, true);
        let result = self.write_rows(&mut staged, None, Some(observations), true, |_, index, _| chosen(index));
        self.staged = Some(staged);
        result?;
        self.interrupted = before;
        Ok(())
    }

    /// The chunk of one robot, or all chunks: a change of one robot must not cost a look at the others.
    fn chunks_of(&self, index: Option<usize>) -> Range<usize> {
        index.map_or(0..self.chunks.len(), |index| index / self.width..index / self.width + 1)
    }

    /// Writes the rows of the chosen robots, whose episodes begin or whose commands have changed; with `only`, at most
    /// of that robot.
    fn write_rows(
        &mut self,
        staged: &mut Staged,
        only: Option<usize>,
        observations: Option<&mut [f32]>,
        begins: bool,
        chosen: impl FnMut(&mut dyn Chunk, usize, usize) -> bool,
    ) -> Result<()> {
        let (width, len, rows) = (self.width, self.observation_len(), staged.width());
        let range = self.chunks_of(only);
        staged.read(&mut self.chunks, range, width, chosen);
        if staged.indices.is_empty() || (rows == 0 && !begins) {
            return Ok(());
        }
        let mut values = std::mem::take(&mut staged.rows);
        let robots = staged.robots();
        let written = &mut values[..staged.indices.len() * rows];
        let result = if begins {
            staged.stage.begin(&robots, written)
        } else if robots.observed.is_empty() {
            staged.stage.observe(&robots, written)
        } else {
            staged.stage.observe(&RobotRows { truth: robots.observed, ..robots }, written)
        };
        if result.is_ok() && rows > 0 {
            for (index, values) in staged.indices.iter().zip(values.chunks_exact(rows)) {
                self.chunks[index / width].put_rows(index % width, values);
            }
            if let Some(observations) = observations {
                for index in &staged.indices {
                    self.chunks[index / width].observation(index % width, &mut observations[index * len..][..len]);
                }
            }
        }
        staged.rows = values;
        result
    }

    /// The rows of the observations of all environments, computed from the true states, with the same scaling.
    ///
    /// # Errors
    /// [`Error::Length`] unless `out` has [`Batch::privileged_observation_len`] elements per environment; errors of a
    /// [`BatchStage`].
    pub fn privileged_observations(&mut self, out: &mut [f32]) -> Result<()> {
        let len = self.privileged_observation_len();
        self.expect_len("privileged observations", out.len(), self.len() * len)?;
        for (index, row) in out.chunks_exact_mut(len.max(1)).enumerate() {
            self.chunks[index / self.width].privileged_observation(index % self.width, row);
        }
        self.observe_staged(out, None)
    }

    /// Writes the rows of the stage into the privileged observations of one environment, or of all.
    pub(super) fn observe_staged(&mut self, out: &mut [f32], only: Option<usize>) -> Result<()> {
        let Some(mut staged) = self.staged.take() else { return Ok(()) };
        let len = self.privileged_observation_len();
        let rows = staged.width();
        let range = self.chunks_of(only);
        staged.read(&mut self.chunks, range, self.width, |_, index, _| only.is_none_or(|only| only == index));
        let mut values = vec![0.0; staged.indices.len() * rows];
        let result = staged.stage.observe(&staged.robots(), &mut values);
        if result.is_ok() && rows > 0 {
            let first = len - rows;
            let of_each = values.chunks_exact(rows).zip(out.chunks_exact_mut(len));
            for ((values, out), index) in of_each.zip(&staged.indices) {
                let scaling = self.chunks[index / self.width].scaling();
                let numbers = saturated(&staged.stage.layout().rows, scaling, first, values);
                out[first..].iter_mut().zip(numbers).for_each(|(out, number)| *out = number as f32);
            }
        }
        self.staged = Some(staged);
        result
    }
}
