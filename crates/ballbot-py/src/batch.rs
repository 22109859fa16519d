//! `Batch`: the environments behind every Python front end.

use crate::control::{PyController, setpoints};
use crate::convert::{elements, read_elements, vector};
use crate::errors::{InvalidInputError, call, to_python};
use crate::infos::EmptyInfos;
use crate::params::{PyParams, or_paper};
use crate::rollout::{CONTACT_PARTS, Stepped};
use crate::state::{PyContacts, PyState};
use ballbot_core::batch::{Autoreset, Batch, Outcome, ResetRequest, StepBuffers, TaskConfig, task_kind};
use ballbot_core::task::ACTION_LEN;
use ballbot_core::{Contacts, State};
use numpy::{Element, PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::PyTypeError;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList};
use pyo3::{PyTraverseError, PyVisit};

/// Environments of one task that are stepped together in Rust; the front ends are made of it.
///
/// Environment i, seeded with `seed + i`, does what it would do alone, to the last bit, for any `num_threads`.
///
/// Args:
///     num_envs: number of robots.
///     task: name of the task, one of `TASKS`.
///     autoreset: "same_step", "next_step" or "disabled": when an environment whose episode has ended is reset.
///     num_threads: threads that step the robots; None takes all cores.
///     seed: of the first environment.
///     options: `params` (`Params` or the name of a preset), `model`, `sim_dt`, `control_dt` (s), `max_episode_steps`,
///         `max_wheel_torque` (N·m; None follows from traction), `scale_observations`, `reward` (scales by term), and the
///         options of the task.
///
/// Raises:
///     ValueError: an unknown name, or a number out of range; the message has the value and the limit.
///     TypeError: an unknown option.
#[pyclass(name = "Batch", module = "ballbot_rs")]
pub(crate) struct PyBatch {
    batch: Batch,
    options: Py<PyDict>,
    actions: Vec<f32>,
    outcomes: Vec<Outcome>,
    final_observations: Vec<f32>,
    infos: EmptyInfos,
}

type Array1<'py, T> = Bound<'py, PyArray1<T>>;
type Array2<'py, T> = Bound<'py, PyArray2<T>>;

/// What a step gives: observations, rewards, terminated, truncated.
type Step<'py> = (Array2<'py, f32>, Array1<'py, f64>, Array1<'py, bool>, Array1<'py, bool>);

/// Sets the option of `config` that a keyword argument names.
fn configure(config: &mut dyn TaskConfig, name: &str, value: &Bound<'_, PyAny>) -> PyResult<()> {
    let wrong = |what: &str| {
        let found = value.get_type().name().map_or_else(|_| "this".to_owned(), |n| n.to_string());
        PyTypeError::new_err(format!("{name} must be {what}, not {found}"))
    };
    match name {
        // `params=None` is rejected: omit the option to get the default robot.
        "params" => config.set_params(or_paper(Some(value))?),
        "model" => {
            let model: String = value.extract().map_err(|_| wrong("the name of a model"))?;
            config.set_model(model.parse().map_err(to_python)?);
        }
        "reward" => {
            let scales = value.cast::<PyDict>().map_err(|_| wrong("a dict of scales by reward term"))?;
            for (term, scale) in scales {
                let term: String = term.extract()?;
                let scale =
                    scale.extract().map_err(|_| PyTypeError::new_err(format!("reward.{term} must be a number")))?;
                config.set_reward(&term, scale).map_err(to_python)?;
            }
        }
        "max_wheel_torque" if value.is_none() => (),
        _ if config.get(name).is_none() => {
            return Err(PyTypeError::new_err(format!("Batch got an unexpected keyword argument '{name}'")));
        }
        _ => {
            let values = match value.extract::<f64>() {
                Ok(number) => vec![number],
                Err(_) => elements(name, value, &[None]).map_err(|_| wrong("a number, or an array of numbers"))?,
            };
            config.set(name, &values).map_err(to_python)?;
        }
    }
    Ok(())
}

/// A count that Python gave.
fn count(name: &str, value: i64, least: i64) -> PyResult<usize> {
    usize::try_from(value)
        .ok()
        .filter(|_| value >= least)
        .ok_or_else(|| InvalidInputError::new_err(format!("{name} = {value}, it must be at least {least}")))
}

/// A fresh array that `fill` writes into, row by row.
fn rows<'py, T: Element + Copy + Default>(
    py: Python<'py>,
    n: usize,
    width: usize,
    mut fill: impl FnMut(usize, &mut [T]) -> PyResult<()>,
) -> PyResult<Array2<'py, T>> {
    let array = PyArray2::<T>::zeros(py, [n, width], false);
    {
        let mut writable = array.readwrite();
        for (i, row) in writable.as_slice_mut()?.chunks_exact_mut(width).enumerate() {
            fill(i, row)?;
        }
    }
    Ok(array)
}

#[pymethods]
impl PyBatch {
    #[new]
    #[pyo3(signature = (num_envs, task="balance", *, autoreset="same_step", num_threads=None, seed=0, **options))]
    fn new(
        py: Python<'_>,
        num_envs: i64,
        task: &str,
        autoreset: &str,
        num_threads: Option<usize>,
        seed: u64,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let num_envs = count("num_envs", num_envs, 1)?;
        let mut config = task_kind(task).map_err(to_python)?.config();
        for (name, value) in options.into_iter().flatten() {
            configure(config.as_mut(), &name.extract::<String>()?, &value)?;
        }
        let autoreset: Autoreset = autoreset.parse().map_err(to_python)?;
        let batch = call(|| config.batch(num_envs, autoreset, num_threads, seed))?;
        let resolved = PyDict::new(py);
        let own = batch.task().options.iter().map(|option| option.name);
        let common = ["sim_dt", "control_dt", "max_episode_steps", "max_wheel_torque", "scale_observations"];
        for name in common.into_iter().chain(own) {
            match config.get(name).unwrap_or_default().as_slice() {
                [flag] if name == "scale_observations" => resolved.set_item(name, *flag != 0.0)?,
                [steps] if name == "max_episode_steps" => resolved.set_item(name, *steps as u64)?,
                [number] => resolved.set_item(name, number)?,
                numbers => resolved.set_item(name, numbers)?,
            }
        }
        let reward = PyDict::new(py);
        for (name, scale) in config.reward() {
            reward.set_item(name, scale)?;
        }
        resolved.set_item("reward", reward)?;
        Ok(Self {
            actions: Vec::with_capacity(num_envs * ACTION_LEN),
            outcomes: vec![Outcome::default(); num_envs],
            final_observations: vec![0.0; num_envs * batch.observation_len()],
            infos: EmptyInfos::default(),
            options: resolved.unbind(),
            batch,
        })
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        visit.call(&self.options)?;
        self.infos.traverse(&visit)
    }

    fn __clear__(&mut self) {
        self.infos.clear();
    }

    /// Number of environments.
    #[getter]
    fn num_envs(&self) -> usize {
        self.batch.len()
    }

    /// Number of threads that step them.
    #[getter]
    fn num_threads(&self) -> usize {
        self.batch.num_threads()
    }

    /// Name of the task.
    #[getter]
    fn task(&self) -> &'static str {
        self.batch.task().name
    }

    /// When an environment whose episode has ended is reset.
    #[getter]
    fn autoreset(&self) -> &'static str {
        self.batch.autoreset().name()
    }

    /// All options of the task and of its environment, as they are used, but for `params` and `model`.
    #[getter]
    fn options<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let options = self.options.bind(py).copy()?;
        if let Some(reward) = options.get_item("reward")? {
            options.set_item("reward", reward.cast::<PyDict>()?.copy()?)?;
        }
        Ok(options)
    }

    /// Model of the robots.
    #[getter]
    fn model(&self) -> &'static str {
        self.batch.model().name()
    }

    /// Time step of the model, s.
    #[getter]
    fn sim_dt(&self) -> f64 {
        self.batch.sim_dt()
    }

    /// Time between two actions, s.
    #[getter]
    fn control_dt(&self) -> f64 {
        self.batch.control_dt()
    }

    /// Model steps in one control step.
    #[getter]
    fn substeps(&self) -> usize {
        self.batch.substeps()
    }

    /// Torque of an action of 1, N·m.
    #[getter]
    fn max_wheel_torque(&self) -> f64 {
        self.batch.max_wheel_torque()
    }

    /// Steps after which an episode is truncated.
    #[getter]
    fn max_episode_steps(&self) -> usize {
        self.batch.max_episode_steps()
    }

    /// How many numbers an observation has.
    #[getter]
    fn observation_len(&self) -> usize {
        self.batch.observation_len()
    }

    /// Whether observations are scaled.
    #[getter]
    fn scale_observations(&self) -> bool {
        self.batch.scale_observations()
    }

    /// Begins episodes and returns the observations of all environments, shape (num_envs, observation_len), float32.
    ///
    /// Everything is checked before anything changes.
    ///
    /// Args:
    ///     mask: which environments to reset, shape (num_envs,), bool; None resets all.
    ///     seeds: one an environment to start its random numbers from; None leaves them as they are.
    ///     starts: one `State` an environment; None draws one.
    ///
    /// Raises:
    ///     ValueError: a wrong shape, or a state that the model cannot represent.
    #[pyo3(signature = (mask=None, seeds=None, starts=None))]
    #[expect(clippy::needless_pass_by_value, reason = "extracted from Python lists")]
    fn reset<'py>(
        &mut self,
        py: Python<'py>,
        mask: Option<&Bound<'py, PyAny>>,
        seeds: Option<Vec<Option<u64>>>,
        starts: Option<Vec<Option<PyRef<'py, PyState>>>>,
    ) -> PyResult<Array2<'py, f32>> {
        let mask = mask.map(|m| elements::<bool>("reset_mask", m, &[Some(self.batch.len())])).transpose()?;
        let starts: Option<Vec<_>> =
            starts.map(|starts| starts.iter().map(|start| start.as_ref().map(|s| s.0.clone())).collect());
        let request = ResetRequest { mask: mask.as_deref(), seeds: seeds.as_deref(), starts: starts.as_deref() };
        let observations = PyArray2::zeros(py, [self.batch.len(), self.batch.observation_len()], false);
        let mut writable = observations.readwrite();
        let rows = writable.as_slice_mut()?;
        let batch = &mut self.batch;
        py.detach(|| call(|| batch.reset_with(&request, rows)))?;
        drop(writable);
        for (i, outcome) in self.outcomes.iter_mut().enumerate() {
            if request.mask.is_none_or(|mask| mask[i]) {
                *outcome = Outcome::default();
            }
        }
        Ok(observations)
    }

    /// Spreads the ends of the present episodes evenly, so that environments reset together are not truncated together.
    fn stagger(&mut self) {
        self.batch.stagger();
    }

    /// Applies actions, shape (num_envs, 3) in [-1, 1], for one control step.
    ///
    /// Returns:
    ///     Observations (num_envs, observation_len) float32, rewards (num_envs,) float64, terminated and truncated
    ///     (num_envs,) bool; all fresh.
    ///
    /// Raises:
    ///     ValueError: a wrong shape, an action that is not finite, or an episode that is over; nothing has moved then.
    fn step<'py>(&mut self, py: Python<'py>, actions: &Bound<'py, PyAny>) -> PyResult<Step<'py>> {
        let n = self.batch.len();
        read_elements("actions", actions, &[Some(n), Some(ACTION_LEN)], &mut self.actions)?;
        let observations = PyArray2::zeros(py, [n, self.batch.observation_len()], false);
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
                final_observations: &mut self.final_observations,
                outcomes: &mut self.outcomes,
            };
            let (batch, actions) = (&mut self.batch, &self.actions);
            py.detach(|| call(|| batch.step(actions, &mut buffers)))?;
        }
        Ok((observations, rewards, terminated, truncated))
    }

    /// Last observations of the episodes that the last step ended and reset, shape (num_envs, observation_len); other
    /// rows have no meaning.
    fn final_observations<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py, f32>> {
        PyArray1::from_slice(py, &self.final_observations).reshape([self.batch.len(), self.batch.observation_len()])
    }

    /// Infos of the last step for Stable-Baselines3, one dict an environment, empty unless its episode ended.
    ///
    /// No dict is one that a caller still holds or wrote into.
    fn infos<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let width = self.batch.observation_len();
        let infos = self.infos.list(py, self.batch.len())?;
        for (i, outcome) in self.outcomes.iter().enumerate().filter(|(_, outcome)| outcome.done()) {
            let last = &self.final_observations[i * width..(i + 1) * width];
            let info = PyDict::new(py);
            info.set_item(intern!(py, "terminal_observation"), PyArray1::from_slice(py, last))?;
            info.set_item(intern!(py, "TimeLimit.truncated"), outcome.truncated)?;
            info.set_item(intern!(py, "is_success"), outcome.success)?;
            if let Some(termination) = outcome.terminated {
                info.set_item(intern!(py, "termination"), termination)?;
            }
            infos.set_item(i, info)?;
        }
        Ok(infos)
    }

    /// Whether each environment is a success if its episode ends with the last step, shape (num_envs,), bool, and the
    /// reasons for termination as indices into `TASKS[task]["terminations"]` plus one, 0 where there is none.
    fn endings<'py>(&self, py: Python<'py>) -> (Array1<'py, bool>, Array1<'py, u8>) {
        let reasons = &self.batch.task().terminations;
        let number = |outcome: &Outcome| {
            let found = outcome.terminated.and_then(|name| reasons.iter().position(|(known, _)| *known == name));
            found.map_or(0, |index| index as u8 + 1)
        };
        let success = PyArray1::from_iter(py, self.outcomes.iter().map(|o| o.success));
        (success, PyArray1::from_iter(py, self.outcomes.iter().map(number)))
    }

    /// The same of environment `index`: whether it is a success, and the name of the reason or None.
    fn ending(&self, index: usize) -> PyResult<(bool, Option<&'static str>)> {
        self.batch.check_index(index).map_err(to_python)?;
        let outcome = self.outcomes[index];
        Ok((outcome.success, outcome.terminated))
    }

    /// Terms of the last reward: of environment `index` as a dict, or of all, shape (num_envs, terms), in the order of
    /// `TASKS[task]["rewards"]`. Zeros right after a reset.
    #[pyo3(signature = (index=None))]
    fn reward_terms<'py>(&self, py: Python<'py>, index: Option<usize>) -> PyResult<Bound<'py, PyAny>> {
        let terms = &self.batch.task().terms;
        let Some(index) = index else {
            let read = |i, row: &mut [f64]| self.batch.reward_terms(i, row).map_err(to_python);
            return Ok(rows(py, self.batch.len(), terms.len(), read)?.into_any());
        };
        let mut values = vec![0.0; terms.len()];
        self.batch.reward_terms(index, &mut values).map_err(to_python)?;
        let dict = PyDict::new(py);
        for (term, value) in terms.iter().zip(values) {
            dict.set_item(term.name, value)?;
        }
        Ok(dict.into_any())
    }

    /// State of the robot of environment `index`.
    fn state(&self, index: usize) -> PyResult<PyState> {
        self.batch.state(index).map(PyState).map_err(to_python)
    }

    /// States of all robots, shape (num_envs, 32), float64, rows as `State.to_array` lays them out.
    fn states<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py, f64>> {
        let mut states = self.batch.states();
        rows(py, self.batch.len(), State::LEN, |_, row| {
            row.copy_from_slice(&states.next().unwrap_or_else(|| unreachable!("one state a row")).to_array());
            Ok(())
        })
    }

    /// Last observations of all environments, shape (num_envs, observation_len), float32.
    fn observations<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py, f32>> {
        let read = |i, row: &mut [f32]| self.batch.observation(i, row).map_err(to_python);
        rows(py, self.batch.len(), self.batch.observation_len(), read)
    }

    /// Contact forces of the last model step: of environment `index` as `Contacts`, or of all as a dict of arrays.
    ///
    /// `wheel_normal_forces`, `wheel_tractions` (N), `wheel_slip_speeds` (m/s) and `floor_force` (N) have the shape
    /// (num_envs, 3), `floor_slip_velocity` (m/s) (num_envs, 2), `bot_on_floor` (num_envs,).
    #[pyo3(signature = (index=None))]
    fn contacts<'py>(&self, py: Python<'py>, index: Option<usize>) -> PyResult<Bound<'py, PyAny>> {
        let n = self.batch.len();
        if let Some(index) = index {
            let contacts = self.batch.contacts(index).map_err(to_python)?;
            let params = self.batch.params(index).map_err(to_python)?.clone();
            return Ok(PyContacts { contacts, params }.into_pyobject(py)?.into_any());
        }
        let all: Vec<Contacts> = (0..n).map(|i| self.batch.contacts(i)).collect::<Result<_, _>>().map_err(to_python)?;
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
        Ok(dict.into_any())
    }

    /// Parameters of the robot of environment `index`.
    #[pyo3(signature = (index=0))]
    fn params(&self, index: usize) -> PyResult<PyParams> {
        Ok(PyParams(self.batch.params(index).map_err(to_python)?.clone()))
    }

    /// Replaces the parameters of the robot of environment `index`; they outlive resets.
    ///
    /// With the same geometry (radii, wheel angles, height of the center of mass) its motion goes on; otherwise the
    /// environment must be reset before its next step. The torque of an action stays that of the batch.
    ///
    /// Raises:
    ///     ValueError: the parameters do not describe a robot, or the task or its actions do not fit it; nothing has
    ///         changed then.
    fn set_params(&mut self, index: usize, params: &Bound<'_, PyAny>) -> PyResult<()> {
        let params = or_paper(Some(params))?;
        call(|| self.batch.set_params(index, &params))
    }

    /// Gives the body of one robot an impulse (inertial frame, N·s) at `point` (body frame, m; None is its CoM).
    #[pyo3(signature = (index, impulse, point=None))]
    fn push(&mut self, index: usize, impulse: &Bound<'_, PyAny>, point: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        let impulse = vector("impulse", impulse)?;
        let point = point.map(|p| vector("point", p)).transpose()?;
        call(|| self.batch.push(index, &impulse, point.as_ref()))
    }

    /// Actions of a controller on all robots, shape (num_envs, 3), float32; nothing moves.
    ///
    /// What the controller keeps of a robot advances with each call; it starts anew with the robot's episode, and when
    /// another controller is used.
    ///
    /// Args:
    ///     controller: sampled at the batch's `control_dt`.
    ///     setpoints: parts by name, each of all robots or with one row a robot; parts that are not named are zero. None
    ///         takes the task's.
    ///
    /// Raises:
    ///     ValueError: the controller is sampled at another rate, or a wrong shape.
    ///     TypeError: a part that the controller does not follow.
    #[pyo3(signature = (controller, setpoints=None))]
    fn control<'py>(
        &mut self,
        py: Python<'py>,
        controller: &PyController,
        setpoints: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Array2<'py, f32>> {
        let n = self.batch.len();
        let setpoints = setpoints.map(|parts| self::setpoints(controller, n, parts)).transpose()?;
        let actions = PyArray2::zeros(py, [n, ACTION_LEN], false);
        {
            let mut writable = actions.readwrite();
            let (out, batch, law) = (writable.as_slice_mut()?, &mut self.batch, controller.law.as_ref());
            py.detach(|| call(|| batch.control(law, setpoints.as_deref(), out)))?;
        }
        Ok(actions)
    }

    /// Runs `steps` control steps under a controller, without Python in the loop.
    ///
    /// Args:
    ///     controller: as in `control`.
    ///     steps: how many.
    ///     setpoints: as in `control`, the same at all steps.
    ///     record: what to return, of `states`, `observations`, `wheel_normal_forces`, `wheel_tractions`,
    ///         `wheel_slip_speeds`, `floor_force`, each with steps + 1 rows of which the first is before the first step,
    ///         and `actions`, `torques`, `rewards`, `terminated`, `truncated`, `success` with one row a step.
    ///
    /// Returns:
    ///     Arrays by name, shape (rows, num_envs, width), or (rows, num_envs) where there is one number a robot. Where an
    ///     episode ends, the row after it depends on `autoreset`.
    ///
    /// Raises:
    ///     ValueError: an unknown record, or as `control` and `step`.
    ///     TypeError: as `control`.
    #[pyo3(signature = (controller, steps, setpoints=None, record=vec!["states".to_owned()]))]
    #[expect(clippy::needless_pass_by_value, reason = "extracted from a Python sequence")]
    fn rollout<'py>(
        &mut self,
        py: Python<'py>,
        controller: &PyController,
        steps: i64,
        setpoints: Option<&Bound<'py, PyDict>>,
        record: Vec<String>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let n = self.batch.len();
        let setpoints = setpoints.map(|parts| self::setpoints(controller, n, parts)).transpose()?;
        let steps = count("steps", steps, 0)?;
        let (batch, outcomes) = (&mut self.batch, &mut self.outcomes);
        let stepped = Stepped { batch, outcomes, final_observations: &mut self.final_observations };
        stepped.rollout(py, controller.law.as_ref(), setpoints.as_deref(), steps, &record)
    }

    /// Everything that the future of environment `index` depends on, its robot's parameters included, for `restore`.
    fn snapshot<'py>(&self, py: Python<'py>, index: usize) -> PyResult<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, &self.batch.save(index).map_err(to_python)?))
    }

    /// Continues, to the last bit, from a snapshot of an environment with the same task, model and options.
    fn restore(&mut self, index: usize, snapshot: &[u8]) -> PyResult<()> {
        call(|| self.batch.load(index, snapshot))?;
        self.outcomes[index] = Outcome::default();
        Ok(())
    }

    fn __repr__(&self) -> String {
        let b = &self.batch;
        format!("Batch({}, '{}', model='{}', autoreset='{}')", b.len(), b.task().name, b.model(), b.autoreset().name())
    }
}
