//! A closed loop on a batch, recorded without Python in the loop.

use crate::batch::events::draw_records;
use crate::control::controllers::{PyController, setpoints};
use crate::control::reference::References;
use crate::errors::to_python;
use crate::signals::interruptible;
use crate::values::convert::names;
use ballbot_core::batch::{Batch, Networks, Outcome, StepBuffers, Under};
use ballbot_core::control::{Controller, Setpoint};
use ballbot_core::task::ACTION_LEN;
use ballbot_core::{Contacts, Error, State, try_zeros};
use nalgebra::Vector3;
use numpy::{PyArray1, PyArray3, PyArrayMethods};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Three numbers of a robot's contacts, by their name.
pub(crate) struct ContactPart {
    pub(crate) name: &'static str,
    pub(crate) of: fn(&Contacts) -> [f64; 3],
}

/// The parts of [`Contacts`] that have three numbers.
pub(crate) static CONTACT_PARTS: [ContactPart; 6] = [
    ContactPart { name: "wheel_normal_forces", of: |c| c.wheel_normal_forces.0 },
    ContactPart { name: "wheel_tractions", of: |c| c.wheel_tractions.0 },
    ContactPart { name: "wheel_slip_speeds", of: |c| c.wheel_slip_speeds.0 },
    ContactPart { name: "floor_force", of: |c| [c.floor_force.x, c.floor_force.y, c.floor_force.z] },
    ContactPart { name: "bot_floor_force", of: |c| [c.bot_floor_force.x, c.bot_floor_force.y, c.bot_floor_force.z] },
    ContactPart { name: "obstacle_force", of: |c| [c.obstacle_force.x, c.obstacle_force.y, c.obstacle_force.z] },
];

/// Where the numbers of a [`Record`] come from.
enum Source {
    /// A function that writes the row of a robot.
    Row(fn(&Batch, &Last<'_>, usize, &mut [f64])),
    /// A flag of the last outcome, as 0 or 1.
    Flag(fn(&Outcome) -> bool),
    /// The contacts.
    Contact(fn(&Contacts) -> [f64; 3]),
    /// Draws of the events.
    Draws,
}

/// A quantity that a rollout can record.
struct Record {
    name: &'static str,
    width: fn(&Batch) -> usize,
    /// Whether there is a row before the first step.
    at_start: bool,
    source: Source,
}

/// Results of the last step of a rollout.
struct Last<'a> {
    actions: &'a [f32],
    observations: &'a [f32],
    outcomes: &'a [Outcome],
}

const fn flag(name: &'static str, of: fn(&Outcome) -> bool) -> Record {
    Record { name, width: |_| 1, at_start: false, source: Source::Flag(of) }
}

const fn contact(part: &ContactPart) -> Record {
    Record { name: part.name, width: |_| 3, at_start: true, source: Source::Contact(part.of) }
}

/// All quantities that can be recorded.
static RECORDS: [Record; 15] = [
    Record {
        name: "states",
        width: |_| State::LEN,
        at_start: true,
        source: Source::Row(|batch, _, i, out| {
            if let Ok(state) = batch.state(i) {
                out.copy_from_slice(&state.to_array());
            }
        }),
    },
    Record {
        name: "observations",
        width: Batch::observation_len,
        at_start: true,
        source: Source::Row(|_, last, i, out| {
            let row = &last.observations[i * out.len()..];
            out.iter_mut().zip(row).for_each(|(out, value)| *out = f64::from(*value));
        }),
    },
    Record {
        name: "actions",
        width: |_| ACTION_LEN,
        at_start: false,
        source: Source::Row(|_, last, i, out| {
            let row = &last.actions[i * ACTION_LEN..];
            out.iter_mut().zip(row).for_each(|(out, value)| *out = f64::from(*value));
        }),
    },
    Record {
        name: "torques",
        width: |_| ACTION_LEN,
        at_start: false,
        source: Source::Row(|batch, last, i, out| {
            let row = &last.actions[i * ACTION_LEN..];
            let scale = batch.max_wheel_torque(i).unwrap_or(f64::NAN);
            out.iter_mut().zip(row).for_each(|(out, value)| *out = f64::from(*value).clamp(-1.0, 1.0) * scale);
        }),
    },
    Record {
        name: "rewards",
        width: |_| 1,
        at_start: false,
        source: Source::Row(|_, last, i, out| out[0] = last.outcomes[i].reward),
    },
    flag("terminated", |outcome| outcome.terminated.is_some()),
    flag("truncated", |outcome| outcome.truncated),
    flag("success", |outcome| outcome.success),
    Record {
        name: "metrics",
        width: |batch| batch.task().metrics.len(),
        at_start: false,
        source: Source::Row(|batch, _, i, out| {
            if batch.metrics(i, out).is_err() {
                out.fill(f64::NAN);
            }
        }),
    },
    Record {
        name: "push_counts",
        width: |_| 1,
        at_start: false,
        source: Source::Row(|batch, _, i, out| out[0] = f64::from(batch.push_count(i).unwrap_or(0))),
    },
    contact(&CONTACT_PARTS[0]),
    contact(&CONTACT_PARTS[1]),
    contact(&CONTACT_PARTS[2]),
    contact(&CONTACT_PARTS[3]),
    Record {
        name: "draws",
        width: |batch| batch.draw_columns().map(|(_, width)| width).sum(),
        at_start: true,
        source: Source::Draws,
    },
];

/// The names of a sequence of records.
pub(crate) fn record_names(value: &Bound<'_, PyAny>) -> PyResult<Vec<String>> {
    names("record", value, RECORDS.len())
}

impl Record {
    fn named(name: &String) -> PyResult<&'static Self> {
        RECORDS.iter().find(|record| record.name == name).ok_or_else(|| {
            let known: Vec<_> = RECORDS.iter().map(|record| record.name).collect();
            to_python(Error::unknown("record", name, &known))
        })
    }

    fn rows(&self, steps: usize) -> usize {
        steps + usize::from(self.at_start)
    }

    /// Writes the numbers of robot `i`.
    fn write(&self, batch: &Batch, last: &Last<'_>, i: usize, out: &mut [f64]) {
        match self.source {
            Source::Row(write) => write(batch, last, i, out),
            Source::Flag(of) => out[0] = f64::from(u8::from(of(&last.outcomes[i]))),
            Source::Contact(of) => {
                if let Ok(contacts) = batch.contacts(i) {
                    out.copy_from_slice(&of(&contacts));
                }
            }
            Source::Draws => {
                if let Ok(draws) = batch.draws(i) {
                    out.copy_from_slice(draws);
                }
            }
        }
    }

    /// The recorded numbers as an array, with an axis for the width where it is not 1.
    fn array<'py>(&self, py: Python<'py>, values: Vec<f64>, shape: [usize; 3]) -> PyResult<Bound<'py, PyAny>> {
        let [rows, n, width] = shape;
        let array = PyArray1::from_vec(py, values);
        Ok(match (&self.source, width) {
            (Source::Flag(_), _) => {
                array.reshape([rows, n])?.into_any().call_method1(intern!(py, "astype"), ("bool",))?
            }
            (_, 1) => array.reshape([rows, n])?.into_any(),
            _ => {
                let array: Bound<'py, PyArray3<f64>> = array.reshape(shape)?;
                array.into_any()
            }
        })
    }
}

/// Setpoints of the robots of a rollout.
pub(crate) enum Targets {
    /// The setpoints of their tasks.
    Task,
    /// The same setpoints at all steps.
    Same(Vec<Setpoint>),
    References(References),
}

impl Targets {
    /// Targets from None, parts by name, or references.
    pub(crate) fn extracted(
        controller: &PyController,
        law: &dyn Controller,
        n: usize,
        value: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let Some(value) = value else { return Ok(Self::Task) };
        if let Some(references) = References::extracted(controller, law, n, value)? {
            return Ok(Self::References(references));
        }
        Ok(Self::Same(setpoints(controller, law, n, value.cast::<PyDict>()?)?))
    }
}

/// What gives the actions of all robots of a batch.
pub(crate) enum Driver<'a> {
    Controller {
        law: &'a dyn Controller,
        targets: Targets,
        privileged: bool,
    },
    Policies(Networks),
    /// The actions of all robots in each step.
    Actions(Vec<f32>),
}

/// A driver on all robots of a batch, and the impulses on the robots.
pub(crate) struct ClosedLoop<'a> {
    pub(crate) driver: Driver<'a>,
    /// Impulses on each robot before each of the first steps, N·s.
    pub(crate) impulses: Vec<f64>,
    /// Points of application on each body, body frame, m; if empty, its CoM.
    pub(crate) points: Vec<f64>,
    pub(crate) start_time: f64,
}

impl ClosedLoop<'_> {
    /// Checks in advance what would fail after some of the steps.
    fn check(&self, batch: &Batch, steps: usize) -> ballbot_core::Result<()> {
        let pushes = self.impulses.len() / (3 * batch.len());
        if pushes > steps {
            return Err(Error::Length { name: "impulses".into(), found: pushes, expected: steps });
        }
        match &self.driver {
            Driver::Controller { targets: Targets::References(references), .. } => {
                let last = steps.saturating_sub(1) as f64 * batch.control_dt();
                references.check([self.start_time, self.start_time + last])
            }
            Driver::Controller { .. } => Ok(()),
            Driver::Actions(actions) => match actions.iter().position(|action| !action.is_finite()) {
                Some(at) => {
                    let (row, i) = (at / ACTION_LEN, at % ACTION_LEN);
                    let name = format!("actions[{}, {}, {i}]", row / batch.len(), row % batch.len());
                    Err(Error::OutOfRange { name, value: actions[at].into(), limit: "finite".into() })
                }
                None => Ok(()),
            },
            Driver::Policies(networks) => batch.check_networks(networks),
        }
    }

    /// Applies the impulses of a step to the robots.
    fn push(&self, batch: &mut Batch, step: usize) -> ballbot_core::Result<()> {
        let width = 3 * batch.len();
        let impulses = self.impulses.get(step * width..(step + 1) * width).unwrap_or_default();
        for (i, impulse) in impulses.chunks_exact(3).enumerate() {
            if impulse.iter().any(|component| *component != 0.0) {
                let point = self.points.get(3 * i..3 * i + 3).map(Vector3::from_column_slice);
                batch.push(i, &Vector3::from_column_slice(impulse), point.as_ref())?;
            }
        }
        Ok(())
    }
}

/// A batch, and the buffers of the Python object that its steps write into.
pub(crate) struct Stepped<'a> {
    pub(crate) batch: &'a mut Batch,
    pub(crate) outcomes: &'a mut [Outcome],
    pub(crate) final_observations: &'a mut [f32],
}

impl Stepped<'_> {
    /// Runs `steps` control steps and returns the records by name.
    pub(crate) fn rollout<'py>(
        mut self,
        py: Python<'py>,
        closed_loop: &ClosedLoop<'_>,
        steps: usize,
        names: &[String],
    ) -> PyResult<Bound<'py, PyDict>> {
        let records = names.iter().map(Record::named).collect::<PyResult<Vec<_>>>()?;
        let n = self.batch.len();
        closed_loop.check(self.batch, steps).map_err(to_python)?;
        let shape = |record: &Record, batch: &Batch| [record.rows(steps), n, (record.width)(batch)];
        let mut recorded = Vec::with_capacity(records.len());
        for record in &records {
            let shape = shape(record, self.batch);
            let what = format!("the record '{}' of shape {shape:?}", record.name);
            recorded.push(try_zeros(what, &shape).map_err(to_python)?);
        }
        self.run(py, closed_loop, steps, &records, &mut recorded)?;
        let dict = PyDict::new(py);
        for (record, values) in records.iter().zip(recorded) {
            if matches!(record.source, Source::Draws) {
                dict.set_item(record.name, draw_records(py, self.batch, &values, record.rows(steps))?)?;
                continue;
            }
            dict.set_item(record.name, record.array(py, values, shape(record, self.batch))?)?;
        }
        Ok(dict)
    }

    /// Runs the closed loop; Python can interrupt it.
    fn run(
        &mut self,
        py: Python<'_>,
        closed_loop: &ClosedLoop<'_>,
        steps: usize,
        records: &[&Record],
        recorded: &mut [Vec<f64>],
    ) -> PyResult<()> {
        let n = self.batch.len();
        let width = self.batch.observation_len();
        let mut actions = vec![0.0; n * ACTION_LEN];
        let mut observations = vec![0.0; n * width];
        let (mut rewards, mut terminated, mut truncated) = (vec![0.0; n], vec![false; n], vec![false; n]);
        for i in 0..n {
            self.batch.observation(i, &mut observations[i * width..][..width]).map_err(to_python)?;
        }
        let mut moving = match closed_loop.driver {
            Driver::Controller { targets: Targets::References(_), .. } => vec![Setpoint::default(); n],
            _ => Vec::new(),
        };
        interruptible(py, || {
            for step in 0..=steps {
                if step > 0 {
                    closed_loop.push(self.batch, step - 1)?;
                    match &closed_loop.driver {
                        Driver::Controller { .. } => {}
                        Driver::Policies(networks) => networks.act(&observations, &mut actions)?,
                        Driver::Actions(all) => {
                            actions.copy_from_slice(&all[(step - 1) * n * ACTION_LEN..][..n * ACTION_LEN]);
                        }
                    }
                    let mut buffers = StepBuffers {
                        observations: &mut observations,
                        rewards: &mut rewards,
                        terminated: &mut terminated,
                        truncated: &mut truncated,
                        final_observations: self.final_observations,
                        outcomes: self.outcomes,
                    };
                    match &closed_loop.driver {
                        Driver::Policies(_) | Driver::Actions(_) => self.batch.step(&actions, &mut buffers)?,
                        Driver::Controller { law, targets, privileged } => {
                            let setpoints = match targets {
                                Targets::Task => None,
                                Targets::Same(setpoints) => Some(setpoints.as_slice()),
                                Targets::References(references) => {
                                    let time = closed_loop.start_time + (step - 1) as f64 * self.batch.control_dt();
                                    references.write(time, &mut moving);
                                    Some(moving.as_slice())
                                }
                            };
                            let under = Under { controller: *law, setpoints, privileged: *privileged };
                            self.batch.step_under(&under, &mut actions, &mut buffers)?;
                        }
                    }
                }
                let last = Last { actions: &actions, observations: &observations, outcomes: self.outcomes };
                write_records(self.batch, &last, step, records, recorded);
            }
            Ok(())
        })
    }
}

/// Writes the records after `step` steps.
fn write_records(batch: &Batch, last: &Last<'_>, step: usize, records: &[&Record], recorded: &mut [Vec<f64>]) {
    let n = batch.len();
    for (record, out) in records.iter().zip(recorded) {
        if step == 0 && !record.at_start {
            continue;
        }
        let width = (record.width)(batch);
        if width == 0 {
            continue;
        }
        let row = if record.at_start { step } else { step - 1 };
        for (i, out) in out[row * n * width..(row + 1) * n * width].chunks_exact_mut(width).enumerate() {
            record.write(batch, last, i, out);
        }
    }
}
