//! `Batch`: the environments behind every Python front end.

pub(crate) mod events;
pub(crate) mod infos;
pub(crate) mod networks;
pub(crate) mod options;
pub(crate) mod perception;
pub(crate) mod rollout;
pub(crate) mod stage;
pub(crate) mod tasks;

use crate::batch::events::draws;
use crate::batch::infos::StepInfos;
use crate::batch::networks::networks;
use crate::batch::options::{configure, history_object, resolved};
use crate::batch::perception::perceived;
use crate::batch::rollout::{CONTACT_PARTS, ClosedLoop, Driver, Stepped, Targets, record_names};
use crate::batch::stage::PyStage;
use crate::control::controllers::{controller_of, setpoints};
use crate::dynamics::jacobian::{self, PyJacobians};
use crate::errors::{call, not_pickled, to_python};
use crate::exclusive::Exclusive;
use crate::robot::params::{PyParams, Robot, several};
use crate::robot::payloads::{NUMBERS, deflections_of, numbers_of, payload_index};
use crate::robot::sensors::readings;
use crate::robot::state::{PyContacts, PyState};
use crate::robot::terrain::PyTerrain;
use crate::signals::interruptible;
use crate::values::convert::{
    OPTION_COUNT, elements, finite_elements, objects, optional_vector, outside_force, read_elements, shaped, vector,
};
use crate::values::fields::field_dict;
use crate::values::numbers::{count, index, optional_index, optional_real, optional_whole, real, seed, seeds, whole};
use ballbot_core::batch::{Autoreset, Batch, Episode, Outcome, Outside, ResetRequest, StepBuffers, Under, task_kind};
use ballbot_core::control::MOTION_PARTS;
use ballbot_core::perception::Perception;
use ballbot_core::task::{ACTION_LEN, Row, SCALED_BOUND};
use ballbot_core::{Contacts, PAYLOADS, State, require_memory};
use numpy::{Element, PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::exceptions::PyTypeError;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList, PyTuple};
use pyo3::{PyTraverseError, PyVisit};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Environments of one task that are stepped together in Rust; the basis of all front ends.
///
/// ```python
/// batch = bb.Batch(64, "balance", robot="kugle", seed=1)
/// observations = batch.reset()
/// for _ in range(10):
///     observations, rewards, terminated, truncated = batch.step(np.zeros((64, 3)))
/// ```
///
/// Environment i, seeded with `seed + i`, gives the same results as on its own, bit for bit, for any `num_threads`.
///
/// Args:
///     num_envs: number of robots, at most 2^20.
///     task: name of the task, one of `TASKS`.
///     autoreset: "same_step", "next_step" or "disabled": when an environment is reset after its episode has ended.
///     num_threads: threads that step the robots, at most 256; None uses all cores.
///     seed: seed of the first environment.
///     stage: what Python adds to the task; the front ends make it from functions and from tasks in Python.
///     options: `robot` (as in `Ballbot`, or a list of them: eight neighbors have the same robot),
///         `model`, `sim_dt`, `control_dt` (s), `max_episode_steps`,
///         `max_wheel_torque` (N·m; None: set by traction), `actuators` (a dict of options, a name or a TOML file;
///         None: ideal motors), `sensors` (as `actuators`; None: no sensors), `terrain`, instruments by their names
///         in `INSTRUMENTS` (dicts of options; None means the robots have none), `level`, `observation`
///         ("ground_truth" or "sensors"), `history` (how many of the last observations are stacked, or their
///         ages in control steps),
///         `scale_observations`, `reward` (scales by term), `events` (as in `load_events`: randomization and pushes),
///         and the options of the task.
///
/// Raises:
///     ValueError: an unknown name, or a number out of range; the message has the value and the limit.
///     TypeError: an unknown option.
///     MemoryError: the environments need more memory than is available.
///     RuntimeError: from any method, while another thread is in a method.
#[pyclass(name = "Batch", module = "ballbot_rs", frozen)]
pub(crate) struct PyBatch {
    inner: Exclusive<Inner>,
    options: Py<PyDict>,
    stage: Option<Arc<PyStage>>,
}

/// State that only one thread at a time may change.
struct Inner {
    batch: Batch,
    actions: Vec<f32>,
    outcomes: Vec<Outcome>,
    final_observations: Vec<f32>,
    infos: StepInfos,
}

type Array1<'py, T> = Bound<'py, PyArray1<T>>;
type Array2<'py, T> = Bound<'py, PyArray2<T>>;

/// Result of a step: observations, rewards, terminated, truncated.
type Step<'py> = (Array2<'py, f32>, Array1<'py, f64>, Array1<'py, bool>, Array1<'py, bool>);

/// Rows that are written between two checks of Python's signals.
const ROWS_PER_SIGNAL_CHECK: usize = 4096;

/// A fresh array that `fill` writes into, row by row.
fn rows<'py, T: Element + Copy + Default>(
    py: Python<'py>,
    n: usize,
    width: usize,
    mut fill: impl FnMut(usize, &mut [T]) -> PyResult<()>,
) -> PyResult<Array2<'py, T>> {
    require_memory("the array", n * width, size_of::<T>()).map_err(to_python)?;
    let array = PyArray2::<T>::zeros(py, [n, width], false);
    if width > 0 {
        let mut writable = array.readwrite();
        for (i, row) in writable.as_slice_mut()?.chunks_exact_mut(width).enumerate() {
            if i % ROWS_PER_SIGNAL_CHECK == ROWS_PER_SIGNAL_CHECK - 1 {
                py.check_signals()?;
            }
            fill(i, row)?;
        }
    }
    Ok(array)
}

/// Metrics of one environment.
fn metrics_of(batch: &Batch, index: usize) -> PyResult<Vec<f64>> {
    let mut values = vec![0.0; batch.task().metrics.len()];
    batch.metrics(index, &mut values).map_err(to_python)?;
    Ok(values)
}

/// The reason for termination as a number: 0 for none, otherwise 1 + its index in the task's reasons.
fn termination_code(batch: &Batch, outcome: &Outcome) -> i64 {
    let reasons = &batch.task().terminations;
    let found = outcome.terminated.and_then(|name| reasons.iter().position(|(known, _)| *known == name));
    found.map_or(0, |index| index as i64 + 1)
}

/// Starts by environment, None where there is none.
fn starts(value: &Bound<'_, PyAny>, n: usize) -> PyResult<Vec<Option<State>>> {
    let state = |one: &Bound<'_, PyAny>| Ok(one.extract::<Option<PyRef<'_, PyState>>>()?.map(|start| start.0.clone()));
    objects("starts", value, n)?.iter().map(state).collect()
}

/// Error that ends a step with a motion from Python.
struct Failure(PyErr);

impl From<PyErr> for Failure {
    fn from(error: PyErr) -> Self {
        Self(error)
    }
}

impl From<ballbot_core::Error> for Failure {
    fn from(error: ballbot_core::Error) -> Self {
        Self(to_python(error))
    }
}

impl PyBatch {
    /// Results of `step`, from any kind of step.
    fn stepped<'py>(
        &self,
        py: Python<'py>,
        actions: &Bound<'py, PyAny>,
        step: impl FnOnce(&mut Batch, &[f32], &mut StepBuffers<'_>) -> PyResult<()>,
    ) -> PyResult<Step<'py>> {
        let mut inner = self.inner.write()?;
        let Inner { batch, actions: values, outcomes, final_observations, .. } = &mut *inner;
        let n = batch.len();
        read_elements("actions", actions, &[Some(n), Some(ACTION_LEN)], n * ACTION_LEN, values)?;
        let observations = PyArray2::zeros(py, [n, batch.observation_len()], false);
        let rewards = PyArray1::zeros(py, n, false);
        let (terminated, truncated) = (PyArray1::zeros(py, n, false), PyArray1::zeros(py, n, false));
        {
            let (mut o, mut r) = (observations.readwrite(), rewards.readwrite());
            let (mut te, mut tr) = (terminated.readwrite(), truncated.readwrite());
            let mut buffers = StepBuffers {
                observations: o.as_slice_mut()?,
                rewards: r.as_slice_mut()?,
                terminated: te.as_slice_mut()?,
                truncated: tr.as_slice_mut()?,
                final_observations,
                outcomes,
            };
            self.or_raised(step(batch, values, &mut buffers))?;
        }
        Ok((observations, rewards, terminated, truncated))
    }

    /// A result, with the exception of the stage in place of the error that it caused.
    fn or_raised<T>(&self, result: PyResult<T>) -> PyResult<T> {
        result.map_err(|error| match &self.stage {
            Some(stage) => stage.error(error),
            None => error,
        })
    }
}

#[pymethods]
impl PyBatch {
    #[new]
    #[pyo3(signature = (num_envs, task="balance", *, autoreset="same_step", num_threads=None, seed=0, stage=None, **options))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn new(
        py: Python<'_>,
        #[pyo3(from_py_with = whole)] num_envs: i64,
        task: &str,
        autoreset: &str,
        #[pyo3(from_py_with = optional_whole)] num_threads: Option<i64>,
        #[pyo3(from_py_with = seed)] seed: u64,
        stage: Option<&Bound<'_, PyAny>>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let num_envs = count("num_envs", num_envs, 1)?;
        let num_threads = num_threads.map(|n| count("num_threads", n, 1)).transpose()?;
        let kind = task_kind(task).map_err(to_python)?;
        let (mut config, description) = (kind.config(), kind.description());
        let mut robots = Vec::new();
        for (name, value) in options.into_iter().flatten() {
            let name: String = name.extract()?;
            match (name.as_str(), value.cast::<PyList>()) {
                ("robot", Ok(list)) => robots = several(list)?,
                _ => configure(config.as_mut(), &description, &name, &value)?,
            }
        }
        match robots.first() {
            Some(first) => config.set_params(first.clone()),
            None => robots.push(config.params().clone()),
        }
        let stage = stage.map(PyStage::new).transpose()?;
        config.set_stage(stage.as_ref().map(PyStage::shared));
        let autoreset: Autoreset = autoreset.parse().map_err(to_python)?;
        let (config, batch) = interruptible(py, move || {
            let batch = config.batch_of(&robots, num_envs, autoreset, num_threads, seed)?;
            Ok((config, batch))
        })?;
        let options = resolved(py, config.as_ref(), batch.task())?.unbind();
        let inner = Inner {
            actions: Vec::with_capacity(num_envs * ACTION_LEN),
            outcomes: vec![Outcome::default(); num_envs],
            final_observations: vec![0.0; num_envs * batch.observation_len()],
            infos: StepInfos::default(),
            batch,
        };
        Ok(Self { inner: Exclusive::new("environment", inner), options, stage })
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        visit.call(&self.options)?;
        if let Some(stage) = &self.stage {
            stage.traverse(&visit)?;
        }
        // An environment in use is not garbage.
        self.inner.read().map_or(Ok(()), |inner| inner.infos.traverse(&visit))
    }

    fn __clear__(&self) {
        if let Ok(mut inner) = self.inner.write() {
            inner.infos.clear();
        }
    }

    /// Number of environments.
    #[getter]
    fn num_envs(&self) -> PyResult<usize> {
        Ok(self.inner.read()?.batch.len())
    }

    /// Number of threads that step the environments.
    #[getter]
    fn num_threads(&self) -> PyResult<usize> {
        Ok(self.inner.read()?.batch.num_threads())
    }

    /// Name of the task.
    #[getter]
    fn task(&self) -> PyResult<&'static str> {
        Ok(self.inner.read()?.batch.task().name)
    }

    /// When an environment is reset after its episode has ended.
    #[getter]
    fn autoreset(&self) -> PyResult<&'static str> {
        Ok(self.inner.read()?.batch.autoreset().name())
    }

    /// All options of the task and of its environment with the values in use, except `robot` and `model`.
    #[getter]
    fn options<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let options = self.options.bind(py).copy()?;
        for (name, value) in self.options.bind(py) {
            if let Ok(part) = value.cast::<PyDict>() {
                options.set_item(name, part.copy()?)?;
            }
        }
        if let Some(events) = options.get_item("events")? {
            options.set_item("events", py.import("copy")?.call_method1("deepcopy", (events,))?)?;
        }
        Ok(options)
    }

    /// Model of the robots.
    #[getter]
    fn model(&self) -> PyResult<&'static str> {
        Ok(self.inner.read()?.batch.model().name())
    }

    /// Time step of the model, s.
    #[getter]
    fn sim_dt(&self) -> PyResult<f64> {
        Ok(self.inner.read()?.batch.sim_dt())
    }

    /// Time between two actions, s.
    #[getter]
    fn control_dt(&self) -> PyResult<f64> {
        Ok(self.inner.read()?.batch.control_dt())
    }

    /// Model steps in one control step.
    #[getter]
    fn substeps(&self) -> PyResult<usize> {
        Ok(self.inner.read()?.batch.substeps())
    }

    /// Torque of an action of 1, N·m; of the first robot, if there are several.
    #[getter]
    fn max_wheel_torque(&self) -> PyResult<f64> {
        self.inner.read()?.batch.max_wheel_torque(0).map_err(to_python)
    }

    /// Torque of an action of 1 of each robot, shape (num_envs,), N·m.
    #[getter]
    fn action_torques<'py>(&self, py: Python<'py>) -> PyResult<Array1<'py, f64>> {
        let inner = self.inner.read()?;
        let torques = (0..inner.batch.len()).map(|i| inner.batch.max_wheel_torque(i));
        Ok(PyArray1::from_vec(py, torques.collect::<Result<_, _>>().map_err(to_python)?))
    }

    /// Gain from each row of an observation, less its value at rest, to the scaled row, shape (rows,); of the first robot,
    /// if there are several. Ones without `scale_observations`.
    #[getter]
    fn observation_gains<'py>(&self, py: Python<'py>) -> PyResult<Array1<'py, f64>> {
        let inner = self.inner.read()?;
        let scaling = inner.batch.row_scaling(0).map_err(to_python)?;
        let ones = || vec![1.0; inner.batch.task().rows.len()];
        Ok(PyArray1::from_vec(py, scaling.map_or_else(ones, |scaling| scaling.gain.clone())))
    }

    /// Integral action in the observation of the first robot, in multiples of the rows' typical magnitudes; None without
    /// `integral_rate`. `rate`: growth in a control step per error at rest; `slow`: speed of the ball at which it is half as
    /// large; `largest_error`: largest error that is integrated; `largest`: largest integral; `largest_shown`: largest error
    /// that is observed.
    #[getter]
    fn integral(&self) -> PyResult<Option<BTreeMap<&'static str, f64>>> {
        let inner = self.inner.read()?;
        Ok(inner.batch.integral(0).map_err(to_python)?.map(|integral| integral.numbers().into_iter().collect()))
    }

    /// Steps after which an episode is truncated.
    #[getter]
    fn max_episode_steps(&self) -> PyResult<usize> {
        Ok(self.inner.read()?.batch.max_episode_steps())
    }

    /// How many of the last observations are stacked, or the list of their ages in control steps.
    #[getter]
    fn history<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        history_object(py, self.inner.read()?.batch.history())
    }

    /// Length of an observation: its rows at each age of `history`, newest last; then the readings of the instruments.
    #[getter]
    fn observation_len(&self) -> PyResult<usize> {
        Ok(self.inner.read()?.batch.observation_len())
    }

    /// Whether observations are scaled.
    #[getter]
    fn scale_observations(&self) -> PyResult<bool> {
        Ok(self.inner.read()?.batch.scale_observations())
    }

    /// Bound of the magnitude of each row of an observation, shape (rows,), float32.
    #[getter]
    fn observation_bounds<'py>(&self, py: Python<'py>) -> PyResult<Array1<'py, f32>> {
        let inner = self.inner.read()?;
        let scaled = inner.batch.scale_observations();
        let bound = |row: &Row| if scaled { SCALED_BOUND } else { row.bound };
        Ok(PyArray1::from_iter(py, inner.batch.task().rows.iter().map(bound)))
    }

    /// The object that the keyword argument `stage` was; None without it.
    #[getter]
    fn stage(&self, py: Python<'_>) -> Option<Py<PyAny>> {
        self.stage.as_ref().map(|stage| stage.object(py))
    }

    /// Names of the reasons for termination with their conditions: of the task, then of the stage.
    #[getter]
    fn terminations(&self) -> PyResult<Vec<(&'static str, &'static str)>> {
        Ok(self.inner.read()?.batch.task().terminations.clone())
    }

    /// Whether an exception ended a step or a reset, so that all environments must be reset before the next step.
    #[getter]
    fn is_interrupted(&self) -> PyResult<bool> {
        Ok(self.inner.read()?.batch.is_interrupted())
    }

    /// Requires a reset of all environments before the next step: for a copy of an interrupted batch from snapshots.
    fn interrupt(&self) -> PyResult<()> {
        self.inner.write()?.batch.interrupt();
        Ok(())
    }

    /// Begins episodes and returns the observations of all environments, shape (num_envs, observation_len), float32.
    ///
    /// Everything is checked before anything changes.
    ///
    /// Args:
    ///     mask: which environments to reset, shape (num_envs,), bool; None resets all.
    ///     seeds: one per environment for its random numbers, from its next reset on; None leaves them unchanged.
    ///     starts: one `State` per environment; None samples one.
    ///
    /// Raises:
    ///     ValueError: a wrong shape, or a state that the model cannot represent.
    #[pyo3(signature = (mask=None, seeds=None, starts=None))]
    fn reset<'py>(
        &self,
        py: Python<'py>,
        mask: Option<&Bound<'py, PyAny>>,
        seeds: Option<&Bound<'py, PyAny>>,
        starts: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Array2<'py, f32>> {
        let mut inner = self.inner.write()?;
        let Inner { batch, outcomes, .. } = &mut *inner;
        let mask = mask.map(|m| shaped::<bool, 1>("reset_mask", m, [batch.len()])).transpose()?;
        let seeds = seeds.map(|seeds| self::seeds(seeds, batch.len())).transpose()?;
        let starts = starts.map(|starts| self::starts(starts, batch.len())).transpose()?;
        let request = ResetRequest { mask: mask.as_deref(), seeds: seeds.as_deref(), starts: starts.as_deref() };
        let observations = PyArray2::zeros(py, [batch.len(), batch.observation_len()], false);
        let mut writable = observations.readwrite();
        let rows = writable.as_slice_mut()?;
        self.or_raised(interruptible(py, || batch.reset_with(&request, rows)))?;
        drop(writable);
        for (i, outcome) in outcomes.iter_mut().enumerate() {
            if request.mask.is_none_or(|mask| mask[i]) {
                *outcome = Outcome::default();
            }
        }
        Ok(observations)
    }

    /// Spreads the ends of the current episodes evenly, so that environments reset together are not truncated together.
    fn stagger(&self) -> PyResult<()> {
        self.inner.write()?.batch.stagger();
        Ok(())
    }

    /// Applies actions, shape (num_envs, 3) in [-1, 1], for one control step.
    ///
    /// Returns:
    ///     Observations (num_envs, observation_len) float32, rewards (num_envs,) float64, terminated and truncated
    ///     (num_envs,) bool; all fresh.
    ///
    /// Raises:
    ///     ValueError: a wrong shape, an action that is not finite, or an episode that is over; nothing has moved in
    ///         these cases.
    ///     KeyboardInterrupt: Ctrl-C during a long step. Some robots have moved; all must be reset.
    fn step<'py>(&self, py: Python<'py>, actions: &Bound<'py, PyAny>) -> PyResult<Step<'py>> {
        self.stepped(py, actions, |batch, values, buffers| interruptible(py, || batch.step(values, buffers)))
    }

    /// As `step`, with a motion that another engine simulates; the task still computes commands, rewards, observations
    /// and episode ends.
    ///
    /// Args:
    ///     actions: as in `step`.
    ///     motion: called once, after the events of the step, with the states of all robots, shape (num_envs, 32), rows
    ///         as `State.to_array`, and the pushes on the bodies over the first time step, shape (num_envs, 6): an
    ///         impulse (N·s) and its moment about the center of mass (N·m·s), both in the inertial frame. Returns the
    ///         states at the end. A state that is not finite or out of bounds ends its episode as diverged.
    ///
    /// Models without slip (`planar`, `spatial`) are rejected. Contact forces are unknown, as is contact of the body
    /// with the floor; the options `actuators` have no effect.
    ///
    /// Raises:
    ///     ValueError: as `step`. Also for a wrong shape of states or a quaternion without unit length; after these,
    ///         and after any exception of `motion`, all environments must be reset.
    fn step_with<'py>(
        &self,
        py: Python<'py>,
        actions: &Bound<'py, PyAny>,
        motion: &Bound<'py, PyAny>,
    ) -> PyResult<Step<'py>> {
        self.stepped(py, actions, |batch, values, buffers| {
            let outside = |robots: &Outside| -> Result<Vec<State>, Failure> {
                let n = robots.states.len();
                let states = rows(py, n, State::LEN, |i, row| {
                    row.copy_from_slice(&robots.states[i].to_array());
                    Ok(())
                })?;
                let pushes = rows(py, n, 6, |i, row| {
                    row.copy_from_slice(&robots.pushes[i]);
                    Ok(())
                })?;
                let after = motion.call1((states, pushes))?;
                let numbers = shaped::<f64, 2>("states", &after, [n, State::LEN])?;
                Ok(numbers.as_chunks::<{ State::LEN }>().0.iter().map(State::from_array).collect())
            };
            batch.step_with(values, buffers, outside).map_err(|Failure(error)| error)
        })
    }

    /// Last observations of the episodes that the last step ended, shape (num_envs, observation_len); other rows are
    /// meaningless.
    fn final_observations<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py, f32>> {
        let inner = self.inner.read()?;
        let shape = [inner.batch.len(), inner.batch.observation_len()];
        PyArray1::from_slice(py, &inner.final_observations).reshape(shape)
    }

    /// Infos of the last step for Stable-Baselines3, one dict per environment: `TimeLimit.truncated`, `is_success` and
    /// `termination` (as in `endings`); where an episode ended also `terminal_observation` and its metrics, 0 where
    /// `metrics` has NaN.
    ///
    /// Dicts that a caller still holds, or has added entries to, are not reused.
    fn infos<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let mut inner = self.inner.write()?;
        let Inner { batch, outcomes, final_observations, infos, .. } = &mut *inner;
        let width = batch.observation_len();
        let infos = infos.list(py, outcomes)?;
        for (i, outcome) in outcomes.iter().enumerate().filter(|(_, outcome)| outcome.done()) {
            let last = &final_observations[i * width..(i + 1) * width];
            let info = PyDict::new(py);
            info.set_item(intern!(py, "TimeLimit.truncated"), outcome.truncated)?;
            info.set_item(intern!(py, "is_success"), outcome.success)?;
            info.set_item(intern!(py, "termination"), termination_code(batch, outcome))?;
            info.set_item(intern!(py, "terminal_observation"), PyArray1::from_slice(py, last))?;
            let values = metrics_of(batch, i)?;
            for (metric, value) in batch.task().metrics.iter().zip(values) {
                info.set_item(metric.name, if value.is_finite() { value } else { 0.0 })?;
            }
            infos.set_item(i, info)?;
        }
        Ok(infos)
    }

    /// Whether each environment is a success if its episode ends with the last step, shape (num_envs,), bool, and the
    /// reasons for termination as indices into `TASKS[task]["terminations"]` plus one, int64, 0 where there is none.
    fn endings<'py>(&self, py: Python<'py>) -> PyResult<(Array1<'py, bool>, Array1<'py, i64>)> {
        let inner = self.inner.read()?;
        let success = PyArray1::from_iter(py, inner.outcomes.iter().map(|o| o.success));
        let codes = inner.outcomes.iter().map(|outcome| termination_code(&inner.batch, outcome));
        Ok((success, PyArray1::from_iter(py, codes)))
    }

    /// The same for environment `index`: whether it is a success, and the name of the reason or None.
    fn ending(&self, #[pyo3(from_py_with = index)] index: usize) -> PyResult<(bool, Option<&'static str>)> {
        let inner = self.inner.read()?;
        inner.batch.check_index(index).map_err(to_python)?;
        let outcome = inner.outcomes[index];
        Ok((outcome.success, outcome.terminated))
    }

    /// Reward terms of the last step: of environment `index` as a dict, or of all, shape (num_envs, terms), in the order of
    /// `TASKS[task]["rewards"]`. Zeros right after a reset.
    #[pyo3(signature = (index=None))]
    fn reward_terms<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = optional_index)] index: Option<usize>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let inner = self.inner.read()?;
        let batch = &inner.batch;
        let terms = &batch.task().terms;
        let Some(index) = index else {
            let read = |i, row: &mut [f64]| batch.reward_terms(i, row).map_err(to_python);
            return Ok(rows(py, batch.len(), terms.len(), read)?.into_any());
        };
        let mut values = vec![0.0; terms.len()];
        batch.reward_terms(index, &mut values).map_err(to_python)?;
        let dict = PyDict::new(py);
        for (term, value) in terms.iter().zip(values) {
            dict.set_item(term.name, value)?;
        }
        Ok(dict.into_any())
    }

    /// The current command: of environment `index`, shape (k,), or of all, shape (num_envs, k), its parts as in
    /// `TASKS[task]["command"]`.
    #[pyo3(signature = (index=None))]
    fn command<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = optional_index)] index: Option<usize>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let inner = self.inner.read()?;
        let batch = &inner.batch;
        let width = batch.task().command.len();
        let Some(index) = index else {
            return Ok(rows(py, batch.len(), width, |i, row| batch.command(i, row).map_err(to_python))?.into_any());
        };
        let mut values = vec![0.0; width];
        batch.command(index, &mut values).map_err(to_python)?;
        Ok(PyArray1::from_vec(py, values).into_any())
    }

    /// Sets the command of environment `index`, shape (k,), until the end of its episode. The next observation shows
    /// it, and so does `observations`.
    ///
    /// Raises:
    ///     ValueError: the task has no command, the command has the wrong shape, or a number is beyond its bound.
    ///         After an exception of a function of `stage` all environments must be reset.
    fn set_command(&self, #[pyo3(from_py_with = index)] index: usize, command: &Bound<'_, PyAny>) -> PyResult<()> {
        let mut inner = self.inner.write()?;
        let len = inner.batch.task().command.len();
        let command = finite_elements("command", command, &[(len > 0).then_some(len)], OPTION_COUNT)?;
        self.or_raised(inner.batch.set_command(index, &command).map_err(to_python))
    }

    /// Current setpoint of the task for the robot of environment `index`, by part, as `Controller` takes it, or of all:
    /// the first axis of each part is the environments.
    #[pyo3(signature = (index=None))]
    fn setpoint<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = optional_index)] index: Option<usize>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let batch = &mut self.inner.write()?.batch;
        let dict = PyDict::new(py);
        let Some(index) = index else {
            let setpoints: Vec<_> =
                (0..batch.len()).map(|i| batch.setpoint(i).map_err(to_python)).collect::<PyResult<_>>()?;
            for name in MOTION_PARTS {
                let values: Vec<_> = setpoints.iter().flat_map(|setpoint| setpoint.part(name)).copied().collect();
                let width = values.len() / setpoints.len();
                let array = PyArray1::from_vec(py, values);
                match width {
                    1 => dict.set_item(name, array)?,
                    _ => dict.set_item(name, array.reshape([setpoints.len(), width])?)?,
                }
            }
            return Ok(dict);
        };
        let setpoint = batch.setpoint(index).map_err(to_python)?;
        for name in MOTION_PARTS {
            match setpoint.part(name) {
                [number] => dict.set_item(name, number)?,
                numbers => dict.set_item(name, PyArray1::from_slice(py, numbers))?,
            }
        }
        Ok(dict)
    }

    /// Metrics of the current episode of environment `index` so far, as a dict, or of all, shape (num_envs, metrics),
    /// in the order of `TASKS[task]["metrics"]`; before its first step, metrics of the last episode. NaN where there is
    /// no metric, or the episode is too short for it.
    #[pyo3(signature = (index=None))]
    fn metrics<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = optional_index)] index: Option<usize>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let inner = self.inner.read()?;
        let batch = &inner.batch;
        let metrics = &batch.task().metrics;
        let Some(index) = index else {
            let read = |i, row: &mut [f64]| batch.metrics(i, row).map_err(to_python);
            return Ok(rows(py, batch.len(), metrics.len(), read)?.into_any());
        };
        let dict = PyDict::new(py);
        for (metric, value) in metrics.iter().zip(metrics_of(batch, index)?) {
            dict.set_item(metric.name, value)?;
        }
        Ok(dict.into_any())
    }

    /// Metrics of the current episodes so far, shape (num_envs, metrics), as in infos: 0 before the first step of an
    /// episode and where `metrics` has NaN.
    fn running_metrics<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py, f64>> {
        let batch = &mut self.inner.write()?.batch;
        let array = PyArray2::zeros(py, [batch.len(), batch.task().metrics.len()], false);
        batch.running_metrics(array.readwrite().as_slice_mut()?).map_err(to_python)?;
        Ok(array)
    }

    /// State of the robot of environment `index`.
    fn state(&self, #[pyo3(from_py_with = index)] index: usize) -> PyResult<PyState> {
        self.inner.read()?.batch.state(index).map(PyState).map_err(to_python)
    }

    /// States of all robots, shape (num_envs, 32), float64, rows as `State.to_array` lays them out.
    fn states<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py, f64>> {
        let inner = self.inner.read()?;
        let mut states = inner.batch.states();
        rows(py, inner.batch.len(), State::LEN, |_, row| {
            row.copy_from_slice(&states.next().unwrap_or_else(|| unreachable!("one state a row")).to_array());
            Ok(())
        })
    }

    /// Last observations of all environments, shape (num_envs, observation_len), float32; zeros before the first reset.
    fn observations<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py, f32>> {
        let inner = self.inner.read()?;
        let read = |i, row: &mut [f32]| inner.batch.observation(i, row).map_err(to_python);
        rows(py, inner.batch.len(), inner.batch.observation_len(), read)
    }

    /// Rows of the observations computed from the true states, float32, with the same scaling: for critics. With
    /// `observation="ground_truth"` and `history=1` they equal the observations.
    ///
    /// Of all environments, shape (num_envs, k), or of environment `index`, shape (k,).
    #[pyo3(signature = (index=None))]
    fn privileged_observations<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = optional_index)] index: Option<usize>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let batch = &mut self.inner.write()?.batch;
        let (n, width) = (batch.len(), batch.privileged_observation_len());
        let Some(index) = index else {
            let array = rows(py, n, width, |_, _: &mut [f32]| Ok(()))?;
            self.or_raised(batch.privileged_observations(array.readwrite().as_slice_mut()?).map_err(to_python))?;
            return Ok(array.into_any());
        };
        let mut row = vec![0.0; width];
        self.or_raised(batch.privileged_observation(index, &mut row).map_err(to_python))?;
        Ok(PyArray1::from_vec(py, row).into_any())
    }

    /// States estimated from the last readings of the sensors, as the task observes them, shape (num_envs, 32),
    /// float64, rows as `State.to_array` lays them out. Compared with `states()` they show the errors of the estimator.
    /// Wheel angles are the readings, which count from the start of the episode; in `states()` they continue from the
    /// initial state of the episode. Before the first reset these are the states of the robots at rest.
    ///
    /// Raises:
    ///     ValueError: the task observes the true state (`observation="sensors"` makes it observe the estimates).
    fn estimates<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py, f64>> {
        let inner = self.inner.read()?;
        rows(py, inner.batch.len(), State::LEN, |i, row| {
            row.copy_from_slice(&inner.batch.estimate(i).map_err(to_python)?.to_array());
            Ok(())
        })
    }

    /// The same for the robot of environment `index`, as a `State`; compare with `state`.
    ///
    /// Raises:
    ///     ValueError: as `estimates`.
    fn estimate(&self, #[pyo3(from_py_with = index)] index: usize) -> PyResult<PyState> {
        self.inner.read()?.batch.estimate(index).map(PyState).map_err(to_python)
    }

    /// Last readings of the sensors, latency included, by name: `gyro` (rad/s), `specific_force` (m/s²), both in the body
    /// frame, `wheel_angles` (rad, since the start of the episode) and `wheel_rates` (rad/s).
    ///
    /// Of all environments, shape (num_envs, 3) each, or of environment `index`, shape (3,). Before the first reset
    /// these are readings of the robots at rest.
    ///
    /// Raises:
    ///     ValueError: the robots have no sensors (`sensors=`).
    #[pyo3(signature = (index=None))]
    fn readings<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = optional_index)] index: Option<usize>,
    ) -> PyResult<Bound<'py, PyDict>> {
        readings(py, &self.inner.read()?.batch, index)
    }

    /// Parts of an observation by name, in order, with their shapes: `state` (its rows at each age of `history`), and the
    /// instruments of the robots, as in `perceived`.
    #[getter]
    fn observation_layout<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let inner = self.inner.read()?;
        let batch = &inner.batch;
        let layout = PyDict::new(py);
        let seen = batch.perception();
        let state = batch.observation_len() - seen.map_or(0, |seen| seen.width());
        layout.set_item("state", (state,))?;
        for channel in seen.map_or(&[][..], Perception::channels) {
            layout.set_item(channel.name(), PyTuple::new(py, channel.shape())?)?;
        }
        Ok(layout)
    }

    /// Last readings of an instrument, float32, in its unit (docs/perception.md). Shape (num_envs, ...) as in
    /// `observation_layout`, or (...) of environment `index`; zeros before the first reset.
    ///
    /// Raises:
    ///     ValueError: there is no such instrument, or the robots do not have it.
    #[pyo3(signature = (name, index=None))]
    fn perceived<'py>(
        &self,
        py: Python<'py>,
        name: &str,
        #[pyo3(from_py_with = optional_index)] index: Option<usize>,
    ) -> PyResult<Bound<'py, PyAny>> {
        perceived(py, &self.inner.read()?.batch, name, index)
    }

    /// Levels of the tiles that the current episodes began on, shape (num_envs,), int64; 0 for terrains without tiles.
    fn levels<'py>(&self, py: Python<'py>) -> PyResult<Array1<'py, i64>> {
        let inner = self.inner.read()?;
        let level = |i| inner.batch.level(i).map(|level| level as i64).map_err(to_python);
        Ok(PyArray1::from_vec(py, (0..inner.batch.len()).map(level).collect::<PyResult<_>>()?))
    }

    /// Contact forces of the last model step: of environment `index` as `Contacts`, or of all as a dict of arrays.
    ///
    /// `wheel_normal_forces`, `wheel_tractions` (N), `wheel_slip_speeds` (m/s), `floor_force`, `bot_floor_force` and
    /// `obstacle_force` (N) have the shape (num_envs, 3), `floor_slip_velocity` (m/s) (num_envs, 2), `bot_on_floor`,
    /// `on_obstacle`, `searched_steps` and `unsolved_steps` (num_envs,); see `Contacts`.
    #[pyo3(signature = (index=None))]
    fn contacts<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = optional_index)] index: Option<usize>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let inner = self.inner.read()?;
        let batch = &inner.batch;
        let n = batch.len();
        if let Some(index) = index {
            let contacts = batch.contacts(index).map_err(to_python)?;
            let params = batch.params(index).map_err(to_python)?.clone();
            return Ok(PyContacts { contacts, params }.into_pyobject(py)?.into_any());
        }
        let all: Vec<Contacts> = interruptible(py, || (0..n).map(|i| batch.contacts(i)).collect())?;
        let dict = PyDict::new(py);
        for part in &CONTACT_PARTS {
            let write = |i: usize, row: &mut [f64]| {
                row.copy_from_slice(&(part.of)(&all[i]));
                Ok(())
            };
            dict.set_item(part.name, rows(py, n, 3, write)?)?;
        }
        let slip = |i: usize, row: &mut [f64]| {
            row.copy_from_slice(all[i].floor_slip_velocity.as_slice());
            Ok(())
        };
        dict.set_item("floor_slip_velocity", rows(py, n, 2, slip)?)?;
        dict.set_item("bot_on_floor", PyArray1::from_iter(py, all.iter().map(|c| c.bot_on_floor)))?;
        dict.set_item("on_obstacle", PyArray1::from_iter(py, all.iter().map(|c| c.on_obstacle)))?;
        dict.set_item("searched_steps", PyArray1::from_iter(py, all.iter().map(|c| c.searched_steps)))?;
        dict.set_item("unsolved_steps", PyArray1::from_iter(py, all.iter().map(|c| c.unsolved_steps)))?;
        Ok(dict.into_any())
    }

    /// The ground; None is level. Of the first robot, if there are several and the ground follows from the robot.
    #[getter]
    fn terrain(&self) -> PyResult<Option<PyTerrain>> {
        Ok(self.inner.read()?.batch.terrain().map(|terrain| PyTerrain(Arc::clone(terrain))))
    }

    /// Moves a state on level ground of the robot of environment `index` to the same place on its ground, as starts are
    /// moved: the ball touches the ground and rolls with the same horizontal velocity, and the static lean there is
    /// added to the tilt. On level ground the state is unchanged.
    #[pyo3(signature = (state, index=0))]
    fn on_ground(&self, state: &PyState, #[pyo3(from_py_with = index)] index: usize) -> PyResult<PyState> {
        self.inner.read()?.batch.on_ground(index, &state.0).map(PyState).map_err(to_python)
    }

    /// Parameters of the robot of environment `index`.
    #[pyo3(signature = (index=0))]
    fn params(&self, #[pyo3(from_py_with = index)] index: usize) -> PyResult<PyParams> {
        Ok(PyParams(self.inner.read()?.batch.params(index).map_err(to_python)?.clone()))
    }

    /// Parameters of the robot of environment `index` without events: initial, or set by `set_params`.
    #[pyo3(signature = (index=0))]
    fn nominal_params(&self, #[pyo3(from_py_with = index)] index: usize) -> PyResult<PyParams> {
        Ok(PyParams(self.inner.read()?.batch.nominal_params(index).map_err(to_python)?.clone()))
    }

    /// Current draws of the events, by term, with the id (`"body_mass:1"`) where one was given.
    ///
    /// Of all environments, shape (num_envs,), or (num_envs, k) for terms of k numbers; of environment `index` a number
    /// or shape (k,). NaN where nothing was sampled, as before the first event of an episode. With "abs" a draw is the
    /// value, with "add" it is added to the nominal value, with "scale" it multiplies it. For a push it is the impulse
    /// (N·s; m/s with "scale"), the azimuth (rad) and the height (m; NaN is the center of mass); for a force the same with the
    /// force (N; m/s² with "scale").
    #[pyo3(signature = (index=None))]
    fn draws<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = optional_index)] index: Option<usize>,
    ) -> PyResult<Bound<'py, PyDict>> {
        draws(py, &self.inner.read()?.batch, index)
    }

    /// How many samples of the events of environment `index` gave an invalid robot and were repeated, since its seed.
    #[pyo3(signature = (index=0))]
    fn repeated_draws(&self, #[pyo3(from_py_with = index)] index: usize) -> PyResult<u32> {
        self.inner.read()?.batch.repeated_draws(index).map_err(to_python)
    }

    /// How many pushes events and the task have applied to the robot of environment `index` in its episode.
    #[pyo3(signature = (index=0))]
    fn push_count(&self, #[pyo3(from_py_with = index)] index: usize) -> PyResult<u32> {
        self.inner.read()?.batch.push_count(index).map_err(to_python)
    }

    /// All options of the motors of environment `index`: from the batch, as changed by events.
    #[pyo3(signature = (index=0))]
    fn actuators<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = index)] index: usize,
    ) -> PyResult<Bound<'py, PyDict>> {
        field_dict(py, self.inner.read()?.batch.actuators(index).map_err(to_python)?)
    }

    /// All options of the sensors of environment `index`: from the batch (exact sensors by default), as changed by
    /// events.
    #[pyo3(signature = (index=0))]
    fn sensors<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = index)] index: usize,
    ) -> PyResult<Bound<'py, PyDict>> {
        field_dict(py, self.inner.read()?.batch.sensors(index).map_err(to_python)?)
    }

    /// Replaces the parameters of the robot of environment `index`; they persist over resets, and events start from
    /// them.
    ///
    /// With the same geometry (radii, wheel angles, position of the center of mass) its motion continues; otherwise the
    /// environment must be reset before its next step. The torque of an action does not change.
    ///
    /// Raises:
    ///     ValueError: the parameters do not describe a robot, or the task or its actions do not fit it; nothing has
    ///         changed then.
    fn set_params(&self, #[pyo3(from_py_with = index)] index: usize, params: Robot) -> PyResult<()> {
        let batch = &mut self.inner.write()?.batch;
        call(|| batch.set_params(index, &params.0))
    }

    /// Applies an impulse (inertial frame, N·s) to the body of one robot at `point` (body frame, m; None is its CoM).
    #[pyo3(signature = (index, impulse, point=None))]
    fn push(
        &self,
        #[pyo3(from_py_with = index)] index: usize,
        impulse: &Bound<'_, PyAny>,
        point: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let impulse = vector("impulse", impulse)?;
        let point = optional_vector("point", point)?;
        let batch = &mut self.inner.write()?.batch;
        call(|| batch.push(index, &impulse, point.as_ref()))
    }

    /// Replaces the external force on the body of one robot: it acts in each time step, until another force or a reset.
    ///
    /// A sine is `force` times sin(2π f t + phase), with t from its start; each time step has its mean over the step. Times are
    /// in whole time steps.
    ///
    /// Args:
    ///     index: the robot.
    ///     force: inertial frame, shape (3,), N; zero ends the former force.
    ///     point: body frame, shape (3,), m; None is its CoM.
    ///     frequency: of a sine, Hz, at most half the rate of the time steps; 0 is a constant force.
    ///     phase: of a sine at its start, rad.
    ///     delay: time from now to its start, s.
    ///     duration: time for which it acts, s; None is without end.
    ///
    /// Raises:
    ///     ValueError: a number out of range, or the model `planar`; the former force then stays.
    #[pyo3(signature = (index, force, point=None, *, frequency=0.0, phase=0.0, delay=0.0, duration=None))]
    #[allow(clippy::too_many_arguments, reason = "keywords of Python")]
    fn apply_force(
        &self,
        #[pyo3(from_py_with = index)] index: usize,
        force: &Bound<'_, PyAny>,
        point: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = real)] frequency: f64,
        #[pyo3(from_py_with = real)] phase: f64,
        #[pyo3(from_py_with = real)] delay: f64,
        #[pyo3(from_py_with = optional_real)] duration: Option<f64>,
    ) -> PyResult<()> {
        let force = outside_force(force, point, frequency, phase, delay, duration)?;
        let batch = &mut self.inner.write()?.batch;
        call(|| batch.apply_force(index, &force))
    }

    /// Estimates of the horizontal external forces on the bodies at the last call of `control`, x and y in the inertial
    /// frame, shape (num_envs, 2), N; None unless it was called with a controller that has `Controller.outside_force`,
    /// without `drawn`. Zero from a reset to the next call.
    fn outside_forces<'py>(&self, py: Python<'py>) -> PyResult<Option<Array2<'py, f64>>> {
        let batch = &self.inner.read()?.batch;
        let Some(forces) = batch.outside_forces() else { return Ok(None) };
        rows(py, batch.len(), 2, |i, row| {
            row.copy_from_slice(&forces[i]);
            Ok(())
        })
        .map(Some)
    }

    /// Moves the rest position of the springs of a robot's payload, as a leaning rider does. Held until another offset
    /// or a reset; in the task `ride` the rider, the first payload, replaces it in the next step.
    ///
    /// Args:
    ///     index: the robot.
    ///     offset: from the payload's place, body axes, shape (3,), m.
    ///     payload: 0, or 1 for the second payload.
    ///
    /// Raises:
    ///     ValueError: a robot without such a payload, or a number beyond ±1000 m; the former offset then stays.
    #[pyo3(signature = (index, offset, *, payload=0))]
    fn move_payload(
        &self,
        #[pyo3(from_py_with = index)] index: usize,
        offset: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = payload_index)] payload: usize,
    ) -> PyResult<()> {
        let offset = vector("offset", offset)?;
        let batch = &mut self.inner.write()?.batch;
        call(|| batch.move_payload(index, payload, offset.into()))
    }

    /// Deflections of each robot's two payloads from their places, m, then their rates, m/s, body axes, shape (num_envs, 2, 6); zeros
    /// for a payload that a robot does not have.
    fn payloads<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let batch = &self.inner.read()?.batch;
        let array = rows(py, batch.len(), NUMBERS, |i, row| {
            row.copy_from_slice(&numbers_of(&batch.payloads(i).map_err(to_python)?));
            Ok(())
        })?;
        array.reshape([batch.len(), PAYLOADS, 6])
    }

    /// Replaces the deflections of the payloads; the reset of a robot puts its payloads at their places.
    ///
    /// Args:
    ///     payloads: as `payloads()`, shape (num_envs, 2, 6); zeros for payloads that a robot does not have.
    ///
    /// Raises:
    ///     ValueError: a wrong shape, a number beyond 1000 m or 1000 m/s, or numbers of a robot without such a payload; the
    ///         payloads then stay as they are.
    fn set_payloads(&self, payloads: &Bound<'_, PyAny>) -> PyResult<()> {
        let batch = &mut self.inner.write()?.batch;
        let n = batch.len();
        let shape = [Some(n), Some(PAYLOADS), Some(6)];
        let numbers = finite_elements("payloads", payloads, &shape, NUMBERS * n)?;
        let rows = deflections_of(&numbers);
        call(|| {
            for (i, deflections) in rows.iter().enumerate() {
                batch.params(i)?.validate_deflections(&format_args!("payloads[{i}]"), deflections)?;
            }
            rows.iter().enumerate().try_for_each(|(i, deflections)| batch.set_payloads(i, deflections))
        })
    }

    /// Actions of a controller on all robots, shape (num_envs, 3), float32; nothing moves.
    ///
    /// They are within ±1: `max_wheel_torque`, the torque of an action, also limits the controller. Its default is less
    /// than a leaning robot can use: with `max_wheel_torque=params.max_wheel_torque` only the controller's own limits
    /// apply. The controller gets what the task observes: with `observation="sensors"` the states of `estimates()`,
    /// else the true states.
    ///
    /// The controller's memory of a robot advances with each call; it is reset with the robot's episode, and when
    /// another controller is used.
    ///
    /// Args:
    ///     controller: sampled at the batch's `control_dt`.
    ///     setpoints: parts by name, each for all robots or with one row per robot; missing parts are zero. None takes
    ///         the task's.
    ///     privileged: whether the controller gets the true states whatever the task observes, as a teacher does.
    ///     drawn: whether each robot has a controller for its parameters as events have sampled them, and for the delay of
    ///         its motors (where the controller has the option `delay` and it is not given), about its equilibrium on
    ///         its floor, and with the friction of its joints fed forward. It is designed again when the robot changes.
    ///
    /// Raises:
    ///     ValueError: the controller has a different sampling rate, or a wrong shape; there is no design for a sampled
    ///         robot.
    ///     TypeError: a part that the controller does not follow.
    #[pyo3(signature = (controller, setpoints=None, *, privileged=false, drawn=false))]
    fn control<'py>(
        &self,
        py: Python<'py>,
        controller: &Bound<'py, PyAny>,
        setpoints: Option<&Bound<'py, PyDict>>,
        privileged: bool,
        drawn: bool,
    ) -> PyResult<Array2<'py, f32>> {
        let controller = controller_of(controller)?.get();
        let mut inner = self.inner.write()?;
        let batch = &mut inner.batch;
        let n = batch.len();
        let law = controller.law.read()?;
        let law = law.as_ref();
        let setpoints = setpoints.map(|parts| self::setpoints(controller, law, n, parts)).transpose()?;
        let under = Under { controller: law, setpoints: setpoints.as_deref(), privileged };
        let actions = PyArray2::zeros(py, [n, ACTION_LEN], false);
        {
            let mut writable = actions.readwrite();
            let out = writable.as_slice_mut()?;
            let design = drawn.then_some(&*controller.design);
            interruptible(py, || match design {
                Some(design) => batch.control_drawn(&under, design, out),
                None => batch.control(&under, out),
            })?;
        }
        Ok(actions)
    }

    /// Runs `steps` control steps under a controller, one policy per robot, or given actions, without Python in the loop.
    ///
    /// Args:
    ///     controller: as in `control`; exactly one of `controller`, `policies` and `actions` is required.
    ///     steps: number of control steps.
    ///     setpoints: as in `control`, the same at all steps; or a `Reference` that all robots follow, or a list with
    ///         one per robot. A reference without `robot` uses the controller's robot; it continues when an episode
    ///         ends and the next begins.
    ///     record: what to return: any of `states`, `observations`, `wheel_normal_forces`, `wheel_tractions`,
    ///         `wheel_slip_speeds`, `floor_force`, `bot_floor_force`, `draws`, each with steps + 1 rows, the first
    ///         before the first step, and `actions`, `torques` (as commanded), `rewards`, `terminated`, `truncated`,
    ///         `success`, `metrics` (of the task, of the episode of the step), `push_counts` (as `push_count`) with one
    ///         row per step.
    ///     privileged: as in `control`.
    ///     impulses: impulses on each body before each of the first k steps, shape (k, num_envs, 3), inertial frame,
    ///         N·s.
    ///     points: point of application on each body, shape (num_envs, 3), body frame, m; None is its CoM.
    ///     start_time: time of the first step, for references, s.
    ///     policies: networks from observations to actions, as in `episodes`; without `setpoints` and `privileged`.
    ///     actions: actions in each step, shape (steps, num_envs, 3), as in `step`; without `setpoints` and `privileged`.
    ///
    /// Returns:
    ///     Arrays by name, shape (rows, num_envs, width), or (rows, num_envs) where there is one number per robot;
    ///     `draws` is a dict of arrays by term. Where an episode ends, the row after it depends on `autoreset`.
    ///
    /// Raises:
    ///     ValueError: an unknown record, a reference for a robot other than the controller's, or as `control`, `step`
    ///         and `episodes`.
    ///     TypeError: as `control`; not exactly one of `controller`, `policies` and `actions`.
    ///     MemoryError: the records need more memory than is available.
    ///     KeyboardInterrupt: Ctrl-C. The robots have then moved for part of the steps; where a single step takes long,
    ///         all must be reset.
    #[pyo3(
        signature = (
            controller=None, steps=None, setpoints=None, record=vec!["states".to_owned()], *, privileged=false,
            impulses=None, points=None, start_time=0.0, policies=None, actions=None
        ),
        text_signature =
            "($self, controller=None, steps=None, setpoints=None, record=['states'], *, privileged=False, impulses=None, points=None, start_time=0.0, policies=None, actions=None)"
    )]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn rollout<'py>(
        &self,
        py: Python<'py>,
        controller: Option<&Bound<'py, PyAny>>,
        #[pyo3(from_py_with = optional_whole)] steps: Option<i64>,
        setpoints: Option<&Bound<'py, PyAny>>,
        #[pyo3(from_py_with = record_names)] record: Vec<String>,
        privileged: bool,
        impulses: Option<&Bound<'py, PyAny>>,
        points: Option<&Bound<'py, PyAny>>,
        #[pyo3(from_py_with = real)] start_time: f64,
        policies: Option<&Bound<'py, PyAny>>,
        actions: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let controller = controller.map(controller_of).transpose()?.map(Bound::get);
        let steps = steps.ok_or_else(|| PyTypeError::new_err("rollout() requires steps"))?;
        let steps = count("steps", steps, 0)?;
        let mut inner = self.inner.write()?;
        let Inner { batch, outcomes, final_observations, .. } = &mut *inner;
        let n = batch.len();
        let law = controller.map(|controller| controller.law.read()).transpose()?;
        let follows_task = setpoints.is_none() && !privileged;
        let driver = match (controller, &law, policies, actions) {
            (Some(controller), Some(law), None, None) => {
                let targets = Targets::extracted(controller, law.as_ref(), n, setpoints)?;
                Driver::Controller { law: law.as_ref(), targets, privileged }
            }
            (None, _, Some(policies), None) if follows_task => Driver::Policies(networks(policies, n)?),
            (None, _, None, Some(actions)) if follows_task => {
                let shape = [Some(steps), Some(n), Some(ACTION_LEN)];
                Driver::Actions(elements("actions", actions, &shape, steps.saturating_mul(n * ACTION_LEN))?)
            }
            _ => {
                let message = "rollout() takes one of controller, with setpoints and privileged, policies and actions";
                return Err(PyTypeError::new_err(message));
            }
        };
        let impulses = impulses
            .map(|value| finite_elements("impulses", value, &[None, Some(n), Some(3)], steps.saturating_mul(3 * n)));
        let points = points.map(|value| finite_elements("points", value, &[Some(n), Some(3)], 3 * n));
        let closed_loop = ClosedLoop {
            driver,
            impulses: impulses.transpose()?.unwrap_or_default(),
            points: points.transpose()?.unwrap_or_default(),
            start_time: ballbot_core::check_finite("start_time", &[start_time])
                .map(|()| start_time)
                .map_err(to_python)?,
        };
        let result = Stepped { batch, outcomes, final_observations }.rollout(py, &closed_loop, steps, &record);
        self.or_raised(result)
    }

    /// Continues the episode of each robot to its end under its own policy, in Rust: what a search over policies needs.
    ///
    /// A policy is a network with tanh between its layers, and actions limited to ±1; with one layer it is linear. All
    /// have the same shape. Robots whose episodes end before others begin further episodes, which do not count: reset
    /// all robots afterwards.
    ///
    /// Args:
    ///     policies: (weights, biases) of each layer: the first layer is on the observation, the last gives the action.
    ///         Weights have the shape (num_envs, outputs, inputs), biases (num_envs, outputs); rounded to float32. One
    ///         policy for all robots has weights of the shape (outputs, inputs) and biases (outputs,), and is faster.
    ///     steps: maximum number of steps of a robot; None is `max_episode_steps`.
    ///
    /// Returns:
    ///     Arrays by name, each of shape (num_envs,): `returns` (sums of the rewards), `lengths` (steps), `terminated`,
    ///     `truncated`, and `success` (whether the episode is a success if it ends there).
    ///
    /// Raises:
    ///     ValueError: a wrong shape, a number that is not within ±1e9, an episode that is over, or a task with a stage
    ///         in Python.
    ///     TypeError: `policies` is not a list of pairs of arrays.
    ///     MemoryError: the weights need more memory than is available.
    ///     KeyboardInterrupt: Ctrl-C; all robots must then be reset.
    #[pyo3(signature = (policies, steps=None))]
    fn episodes<'py>(
        &self,
        py: Python<'py>,
        policies: &Bound<'py, PyAny>,
        #[pyo3(from_py_with = optional_whole)] steps: Option<i64>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let batch = &mut self.inner.write()?.batch;
        let steps = steps.map_or(Ok(batch.max_episode_steps()), |steps| count("steps", steps, 0))?;
        let networks = networks(policies, batch.len())?;
        let mut episodes = vec![Episode::default(); batch.len()];
        interruptible(py, || batch.episodes(&networks, steps, &mut episodes))?;
        let dict = PyDict::new(py);
        dict.set_item("returns", PyArray1::from_iter(py, episodes.iter().map(|episode| episode.total)))?;
        dict.set_item("lengths", PyArray1::from_iter(py, episodes.iter().map(|episode| episode.steps as i64)))?;
        dict.set_item("terminated", PyArray1::from_iter(py, episodes.iter().map(|episode| episode.terminated)))?;
        dict.set_item("truncated", PyArray1::from_iter(py, episodes.iter().map(|episode| episode.truncated)))?;
        dict.set_item("success", PyArray1::from_iter(py, episodes.iter().map(|episode| episode.success)))?;
        Ok(dict)
    }

    /// Derivatives of the next `steps` time steps of the model for each robot under constant motor torques (shape
    /// (num_envs, 3), N·m), without its motors' model; see `Ballbot.jacobian`. Torques of the shape (num_envs, k, 3) are held
    /// for `steps` one after the other, and B has three columns for each. The robots do not move. A robot whose bot touches
    /// the floor, or that diverges, has zeros, and False in `Jacobians.valid`. If one robot has rolling, spinning or roller
    /// friction, the contact forces of the last step are states of all.
    ///
    /// Raises:
    ///     ValueError: a wrong shape; a torque beyond a robot's `max_wheel_torque`; fewer than one step; an unknown parameter,
    ///         or one without derivative; a model or ground without derivatives.
    ///     MemoryError: too many robots.
    ///     KeyboardInterrupt: Ctrl-C during a long call.
    #[pyo3(signature = (wheel_torques, steps=1, parameters=None))]
    fn jacobians(
        &self,
        py: Python<'_>,
        wheel_torques: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = whole)] steps: i64,
        parameters: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<PyJacobians> {
        let steps = count("steps", steps, 1)?;
        let mut inner = self.inner.write()?;
        let n = inner.batch.len();
        let torques = jacobian::torques_of_robots(wheel_torques, n)?;
        let numbers = torques.len() / n * ballbot_core::WHEELS;
        let parameters = jacobian::parameters(parameters)?;
        let batch = &mut inner.batch;
        let jacobians = interruptible(py, || batch.jacobians(&torques, steps, &parameters))?;
        Ok(PyJacobians::new(jacobians, numbers, parameters, batch.derivative_coordinates()))
    }

    /// The complete state of environment `index`, including its robot's parameters, for `restore`; a controller's
    /// memory of the robot is not included, and is reset.
    fn snapshot<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = index)] index: usize,
    ) -> PyResult<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, &self.inner.read()?.batch.save(index).map_err(to_python)?))
    }

    /// Continues, bit for bit, from a snapshot of an environment with the same task, model and options.
    ///
    /// Restore only snapshots from `snapshot`: the checksum detects damage, not forgery.
    ///
    /// Raises:
    ///     ValueError: the bytes are not such a snapshot, or its numbers are not finite; nothing has changed then.
    fn restore(&self, #[pyo3(from_py_with = index)] index: usize, snapshot: &[u8]) -> PyResult<()> {
        let mut inner = self.inner.write()?;
        call(|| inner.batch.load(index, snapshot))?;
        inner.outcomes[index] = Outcome::default();
        Ok(())
    }

    fn __reduce__(&self) -> PyResult<()> {
        not_pickled("Batch", "make another with the same arguments, and restore(i, snapshot(i)) for each robot")
    }

    fn __repr__(&self) -> PyResult<String> {
        let b = &self.inner.read()?.batch;
        let (n, task, model, autoreset) = (b.len(), b.task().name, b.model(), b.autoreset().name());
        Ok(format!("Batch({n}, '{task}', model='{model}', autoreset='{autoreset}')"))
    }
}
