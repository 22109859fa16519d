//! `Batch`: the environments behind every Python front end.

use crate::convert::{elements, read_elements, vector};
use crate::errors::{call, to_python};
use crate::infos::EmptyInfos;
use crate::params::{PyParams, or_paper};
use crate::robot::changed;
use crate::state::PyState;
use ballbot_core::State;
use ballbot_core::env::{
    ACTION_LEN, BalanceConfig, Batch, OBSERVATION, OBSERVATION_LEN, Outcome, ResetRequest, RewardScales, RewardTerms,
    StepBuffers, Termination,
};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::PyTypeError;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList};
use pyo3::{PyTraverseError, PyVisit};

/// Name, unit and bound of every row of an observation.
pub(crate) fn observation_rows() -> Vec<(&'static str, &'static str, f32)> {
    OBSERVATION.iter().map(|row| (row.name, row.unit, row.bound)).collect()
}

/// Why episodes are terminated, with none for those that were not.
pub(crate) fn terminations() -> Vec<Option<&'static str>> {
    std::iter::once(None).chain(Termination::ALL.map(|t| Some(t.name()))).collect()
}

/// Environments of the balance task that are stepped together; what the front ends are made of.
#[pyclass(name = "Batch", module = "ballbot_rs._core")]
pub(crate) struct PyBatch {
    batch: Batch,
    actions: Vec<f32>,
    outcomes: Vec<Outcome>,
    final_observations: Vec<f32>,
    infos: EmptyInfos,
}

type Observations<'py> = Bound<'py, PyArray2<f32>>;

/// What a step gives: observations, rewards, terminated, truncated.
type Step<'py> = (Observations<'py>, Bound<'py, PyArray1<f32>>, Bound<'py, PyArray1<bool>>, Bound<'py, PyArray1<bool>>);

/// How episodes ended: success, and the number of the reason for termination.
type Endings<'py> = (Bound<'py, PyArray1<bool>>, Bound<'py, PyArray1<u8>>);

/// Sets the field of `config` that a keyword argument names.
fn configure(config: &mut BalanceConfig, name: &str, value: &Bound<'_, PyAny>) -> PyResult<()> {
    let number: &mut f64 = match name {
        "params" => {
            // None is no robot here: the option is there to be given.
            config.params = or_paper(Some(value))?;
            return Ok(());
        }
        "model" => {
            config.model = value.extract::<String>()?.parse().map_err(to_python)?;
            return Ok(());
        }
        "reward" => return configure_reward(&mut config.reward, &value.extract::<Bound<'_, PyDict>>()?),
        "max_episode_steps" => {
            config.max_episode_steps = value.extract()?;
            return Ok(());
        }
        "setpoint" => {
            config.setpoint = crate::convert::numbers::<2>("setpoint", value)?;
            return Ok(());
        }
        "sim_dt" => &mut config.sim_dt,
        "control_dt" => &mut config.control_dt,
        "max_wheel_torque" => &mut config.max_wheel_torque,
        "reset_tilt" => &mut config.reset_tilt,
        "reset_yaw" => &mut config.reset_yaw,
        "reset_ball_speed" => &mut config.reset_ball_speed,
        "reset_tilt_rate" => &mut config.reset_tilt_rate,
        "fall_tilt" => &mut config.fall_tilt,
        "success_window" => &mut config.success_window,
        "success_tilt" => &mut config.success_tilt,
        "success_radius" => &mut config.success_radius,
        _ => return Err(PyTypeError::new_err(format!("the balance task has no option '{name}'"))),
    };
    *number = value.extract()?;
    Ok(())
}

fn configure_reward(scales: &mut RewardScales, values: &Bound<'_, PyDict>) -> PyResult<()> {
    for (name, value) in values {
        let name: String = name.extract()?;
        let scale = match name.as_str() {
            "alive" => &mut scales.alive,
            "tilt" => &mut scales.tilt,
            "position" => &mut scales.position,
            "velocity" => &mut scales.velocity,
            "rate" => &mut scales.rate,
            "action" => &mut scales.action,
            "action_change" => &mut scales.action_change,
            _ => {
                return Err(PyTypeError::new_err(format!(
                    "unknown reward term '{name}': expected one of {}",
                    RewardTerms::NAMES.join(", ")
                )));
            }
        };
        *scale = value.extract().map_err(|_| PyTypeError::new_err(format!("reward.{name} must be a number")))?;
    }
    Ok(())
}

#[pymethods]
impl PyBatch {
    #[new]
    #[pyo3(signature = (num_envs, autoreset, num_threads=None, seed=0, **options))]
    fn new(
        num_envs: usize,
        autoreset: &str,
        num_threads: Option<usize>,
        seed: u64,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let mut config = BalanceConfig::default();
        for (name, value) in options.into_iter().flatten() {
            let name = name.extract::<String>()?;
            configure(&mut config, &name, &value).map_err(|error| {
                // A conversion does not know what it converts.
                if error.is_instance_of::<PyTypeError>(value.py()) && !error.to_string().contains(&name) {
                    PyTypeError::new_err(format!("{name}: {}", error.value(value.py())))
                } else {
                    error
                }
            })?;
        }
        let autoreset = autoreset.parse().map_err(to_python)?;
        let batch = call(|| Batch::new(&config, num_envs, autoreset, num_threads, seed))?;
        Ok(Self {
            actions: Vec::with_capacity(num_envs * ACTION_LEN),
            outcomes: vec![Outcome::default(); num_envs],
            final_observations: vec![0.0; num_envs * OBSERVATION_LEN],
            infos: EmptyInfos::default(),
            batch,
        })
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        self.infos.traverse(&visit)
    }

    fn __clear__(&mut self) {
        self.infos.clear();
    }

    #[getter]
    fn num_envs(&self) -> usize {
        self.batch.len()
    }

    #[getter]
    fn num_threads(&self) -> usize {
        self.batch.num_threads()
    }

    #[getter]
    fn params(&self) -> PyParams {
        PyParams(self.batch.config().params.clone())
    }

    #[getter]
    fn model(&self) -> &'static str {
        self.batch.config().model.name()
    }

    #[getter]
    fn sim_dt(&self) -> f64 {
        self.batch.config().sim_dt
    }

    #[getter]
    fn control_dt(&self) -> f64 {
        self.batch.config().control_dt
    }

    #[getter]
    fn max_wheel_torque(&self) -> f64 {
        self.batch.config().max_wheel_torque
    }

    #[getter]
    fn setpoint(&self) -> [f64; 2] {
        self.batch.config().setpoint
    }

    #[getter]
    fn max_episode_steps(&self) -> usize {
        self.batch.config().max_episode_steps
    }

    /// Observations of all environments; checks everything before it changes anything.
    #[pyo3(signature = (mask=None, seeds=None, starts=None))]
    #[expect(clippy::needless_pass_by_value, reason = "extracted from Python lists")]
    fn reset<'py>(
        &mut self,
        py: Python<'py>,
        mask: Option<&Bound<'py, PyAny>>,
        seeds: Option<Vec<Option<u64>>>,
        starts: Option<Vec<Option<PyRef<'py, PyState>>>>,
    ) -> PyResult<Observations<'py>> {
        let mask = mask.map(|m| elements::<bool>("reset_mask", m, &[Some(self.batch.len())])).transpose()?;
        let starts: Option<Vec<_>> =
            starts.map(|starts| starts.iter().map(|start| start.as_ref().map(|s| s.0.clone())).collect());
        let request = ResetRequest { mask: mask.as_deref(), seeds: seeds.as_deref(), starts: starts.as_deref() };
        let observations = PyArray2::zeros(py, [self.batch.len(), OBSERVATION_LEN], false);
        let mut writable = observations.readwrite();
        let rows = writable.as_slice_mut()?;
        let batch = &mut self.batch;
        py.detach(|| call(|| batch.reset_with(&request, rows)))?;
        drop(writable);
        Ok(observations)
    }

    fn stagger(&mut self) {
        self.batch.stagger();
    }

    /// Observations, rewards, terminated and truncated; all fresh.
    fn step<'py>(&mut self, py: Python<'py>, actions: &Bound<'py, PyAny>) -> PyResult<Step<'py>> {
        let n = self.batch.len();
        read_elements("actions", actions, &[Some(n), Some(ACTION_LEN)], &mut self.actions)?;
        let observations = PyArray2::zeros(py, [n, OBSERVATION_LEN], false);
        let rewards = PyArray1::zeros(py, n, false);
        let terminated = PyArray1::from_vec(py, vec![false; n]);
        let truncated = PyArray1::from_vec(py, vec![false; n]);
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

    /// Last observations of the episodes that the last step ended and reset; other rows mean nothing.
    fn last_observations<'py>(&self, py: Python<'py>) -> PyResult<Observations<'py>> {
        PyArray1::from_slice(py, &self.final_observations).reshape([self.batch.len(), OBSERVATION_LEN])
    }

    /// Infos of the last step as Stable-Baselines3 wants them, one for each environment.
    ///
    /// An info is empty unless its episode ended. No dict is one that a caller still holds or wrote into.
    fn infos<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let infos = self.infos.list(py, self.batch.len())?;
        for (i, outcome) in self.outcomes.iter().enumerate().filter(|(_, outcome)| outcome.done()) {
            let last = &self.final_observations[i * OBSERVATION_LEN..(i + 1) * OBSERVATION_LEN];
            let info = PyDict::new(py);
            info.set_item(intern!(py, "terminal_observation"), PyArray1::from_slice(py, last))?;
            info.set_item(intern!(py, "TimeLimit.truncated"), outcome.truncated)?;
            info.set_item(intern!(py, "is_success"), outcome.success)?;
            if let Some(termination) = outcome.terminated {
                info.set_item(intern!(py, "termination"), termination.name())?;
            }
            infos.set_item(i, info)?;
        }
        Ok(infos)
    }

    /// Whether the last step of each environment is a success if it ends there, and why it was terminated.
    ///
    /// The reasons are indices into `TERMINATIONS`.
    fn endings<'py>(&self, py: Python<'py>) -> Endings<'py> {
        let success = PyArray1::from_iter(py, self.outcomes.iter().map(|o| o.success));
        let reasons = PyArray1::from_iter(py, self.outcomes.iter().map(|o| o.terminated.map_or(0, |t| t as u8)));
        (success, reasons)
    }

    /// Whether the last step of environment `index` is a success if it ends there, and why it was terminated.
    fn ending(&self, index: usize) -> PyResult<(bool, Option<&'static str>)> {
        let outcome = self.outcomes.get(index).ok_or_else(|| self.no_such(index))?;
        Ok((outcome.success, outcome.terminated.map(Termination::name)))
    }

    fn reward_terms<'py>(&mut self, py: Python<'py>, index: usize) -> PyResult<Bound<'py, PyDict>> {
        let terms = call(|| self.batch.view(index))?.reward_terms();
        let dict = PyDict::new(py);
        for (name, value) in RewardTerms::NAMES.iter().zip(terms.values()) {
            dict.set_item(name, value)?;
        }
        Ok(dict)
    }

    fn state(&mut self, index: usize) -> PyResult<PyState> {
        Ok(PyState(call(|| self.batch.view(index))?.robot().state()))
    }

    fn states<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let states = PyArray2::zeros(py, [self.batch.len(), State::LEN], false);
        let mut writable = states.readwrite();
        let rows = writable.as_slice_mut()?.chunks_exact_mut(State::LEN);
        for (index, row) in rows.enumerate() {
            row.copy_from_slice(&call(|| self.batch.view(index))?.robot().state().to_array());
        }
        drop(writable);
        Ok(states)
    }

    #[pyo3(signature = (index, impulse, point=None))]
    fn push(&mut self, index: usize, impulse: &Bound<'_, PyAny>, point: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        let impulse = vector("impulse", impulse)?;
        let point = point.map(|p| vector("point", p)).transpose()?;
        call(|| self.batch.edit(index, |environment| environment.robot_mut().push(&impulse, point.as_ref())))
    }

    #[pyo3(signature = (index, viscous_friction=None, coulomb_friction=None))]
    fn set_joint_dynamics(
        &mut self,
        index: usize,
        viscous_friction: Option<f64>,
        coulomb_friction: Option<f64>,
    ) -> PyResult<()> {
        call(|| {
            self.batch.edit(index, |environment| {
                let robot = environment.robot_mut();
                robot.set_joint_dynamics(changed(robot.joint_dynamics(), viscous_friction, coulomb_friction))
            })
        })
    }

    fn snapshot<'py>(&mut self, py: Python<'py>, index: usize) -> PyResult<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, &call(|| self.batch.view(index))?.save()))
    }

    fn restore(&mut self, index: usize, snapshot: &[u8]) -> PyResult<()> {
        call(|| self.batch.edit(index, |environment| environment.load(snapshot)))
    }
}

impl PyBatch {
    fn no_such(&self, index: usize) -> PyErr {
        to_python(ballbot_core::Error::OutOfRange {
            name: "environment index".into(),
            value: index as f64,
            limit: format!("below num_envs = {}", self.batch.len()),
        })
    }
}
