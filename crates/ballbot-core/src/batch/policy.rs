//! A policy as a controller: it observes as in its task, and follows setpoints.

use super::config::EnvConfig;
use super::history::History;
use super::integral::Integral;
use super::networks::{Layer, Networks};
use super::registry::TaskConfig;
use crate::control::{Controller, Followed, LaneSetpoint, Law, MOTION_PARTS, MovingFrame, Sample, Sampled};
use crate::task::{
    ACTION_LEN, Balance, Goal, Push, Row, RowScaling, Rows, Sensed, Task, TaskDescription, Velocity, WriteRows,
};
use ballbot_base::error::{Error, Result, bounded};
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Heading, Lane, Memory, tanh};
use ballbot_base::params::Params;
use ballbot_base::wheels::{WHEELS, Wheels};

/// Most rows of an observation.
const MOST_ROWS: usize = 32;

/// Gates of a unit of an LSTM cell.
const GATES: usize = 4;

/// A policy that was trained in a task, as a controller of robots with `params`. Its layers have tanh between them, and
/// its actions are limited to ±1. `options` are options of the environment in which it was trained, by name: its time
/// steps, its torque, the scaling of its observations.
///
/// A recurrent policy has `cells` before its layers: LSTM cells (Hochreiter and Schmidhuber 1997, with a forget gate). A
/// cell of u units has u outputs; as a [`Layer`] it has 4u outputs, which are the input, forget, cell and output gates of
/// all units in this order, and its own inputs and then its u outputs of the last step as inputs. Its state is zero at
/// first. Other policies have no cell.
///
/// Policies of the tasks `balance` and `push` follow the motion of a setpoint: they observe the robot in the frame of the
/// motion ([`MovingFrame`]), and their torques are added to its torques. Policies of `goal` follow a position, policies of
/// `velocity` a velocity and a rate of the heading.
///
/// # Errors
/// [`Error::UnknownName`] for another task, or for an option that does not exist; errors of [`EnvConfig::validate`] and
/// of [`Networks::new`]; [`Error::Inconsistent`] if the cells and layers do not fit the observation or each other.
pub fn policy_controller(
    task: &str,
    params: &Params,
    options: &[(&str, &[f64])],
    history: &History,
    cells: &[Layer<'_>],
    layers: &[Layer<'_>],
) -> Result<Box<dyn Controller>> {
    match task {
        Balance::NAME => of_task::<Balance>(params, options, history, cells, layers),
        Push::NAME => of_task::<Push>(params, options, history, cells, layers),
        Goal::NAME => of_task::<Goal>(params, options, history, cells, layers),
        Velocity::NAME => of_task::<Velocity>(params, options, history, cells, layers),
        other => {
            let known = [Balance::NAME, Push::NAME, Goal::NAME, Velocity::NAME];
            Err(Error::unknown("task of a policy that follows setpoints", other, &known))
        }
    }
}

fn of_task<T: Follow>(
    params: &Params,
    options: &[(&str, &[f64])],
    history: &History,
    cells: &[Layer<'_>],
    layers: &[Layer<'_>],
) -> Result<Box<dyn Controller>> {
    let mut config = EnvConfig::<T> { params: params.clone(), history: history.clone(), ..EnvConfig::default() };
    options.iter().try_for_each(|(name, values)| TaskConfig::set(&mut config, name, values))?;
    let torque = config.resolved()?.action_torque();
    // Weaker motors give their most.
    let largest = torque.min(params.max_wheel_torque);
    config.max_wheel_torque = Some(largest);
    let config = config.resolved()?;
    config.validate_resolved()?;
    let description = TaskDescription::of::<T>();
    let ages = history.ages();
    let (rows, oldest) = (description.rows.len(), ages.last().copied().unwrap_or(0));
    let seen = format!("{rows} rows of the task {} for each of {} ages", T::NAME, ages.len());
    let width = width_of_cells(cells, rows * ages.len(), &seen)?;
    // Checks that the layers fit each other and the action.
    let inputs = Networks::new(1, layers)?.inputs();
    if inputs != width {
        let expected = if cells.is_empty() { seen } else { format!("{width} units of the last cell") };
        return Err(Error::Inconsistent(format!("inputs of layer 0: {inputs}, expected {expected}")));
    }
    let kept = Policy::<T>::SEEN;
    let hidden = kept + (oldest + 1) * rows;
    let policy = Policy {
        scaling: config.row_scaling(&description),
        integral: Integral::of(&config, &description)?,
        torque,
        frame: MovingFrame::new(params),
        rows,
        oldest,
        // Oldest first.
        inputs: ages.iter().rev().flat_map(|age| (0..rows).map(move |row| kept + age * rows + row)).collect(),
        hidden,
        cells: cells.iter().map(Dense::cell).collect(),
        layers: layers.iter().map(Dense::layer).collect(),
        len: hidden
            + cells.iter().map(|cell| cell.outputs + 2 * units_of(cell)).sum::<usize>()
            + layers.iter().map(|layer| layer.outputs).sum::<usize>(),
        task: config.task.clone(),
    };
    Ok(Box::new(Sampled::uncompensated(policy, params, config.control_dt, largest)?))
}

fn units_of(cell: &Layer<'_>) -> usize {
    cell.outputs / GATES
}

/// The number of outputs of the last cell, or `width` inputs without a cell; `seen` describes the inputs in messages.
fn width_of_cells(cells: &[Layer<'_>], width: usize, seen: &str) -> Result<usize> {
    let mut given = (width, seen.to_owned());
    for (k, cell) in cells.iter().enumerate() {
        let units = units_of(cell);
        if units == 0 || cell.outputs != GATES * units {
            let found = cell.outputs;
            return Err(Error::Inconsistent(format!("outputs of cell {k}: {found}, expected {GATES} for each unit")));
        }
        if cell.inputs != given.0 + units {
            let (found, (_, seen)) = (cell.inputs, &given);
            return Err(Error::Inconsistent(format!("inputs of cell {k}: {found}, expected {seen} and {units} units")));
        }
        for (what, found, expected) in
            [("weights", cell.weights, cell.outputs * cell.inputs), ("biases", cell.biases, cell.outputs)]
        {
            let name = format!("{what} of cell {k}");
            if found.len() != expected {
                return Err(Error::Length { name, found: found.len(), expected });
            }
            bounded(&name, found)?;
        }
        given = (units, format!("{units} units of cell {k}"));
    }
    Ok(given.0)
}

/// A task that takes a setpoint, by the frame of its state unless it has a command.
trait Follow: Task {
    /// The parts of a setpoint that its policies follow.
    const PARTS: &'static [&'static str] = MOTION_PARTS;

    /// Gives the task a setpoint: by its command, which is first in the memory, or by the frame of the state, which it
    /// returns.
    #[inline(always)]
    fn follow<L: Lane>(
        state: &LaneState<L>,
        setpoint: &LaneSetpoint<L>,
        frame: &MovingFrame,
        _: &mut Memory<'_, L>,
    ) -> Followed<L> {
        frame.follow(state, setpoint)
    }
}

/// A robot whose task has a command.
#[inline(always)]
fn still<L: Lane>(state: &LaneState<L>) -> Followed<L> {
    Followed { state: *state, torques: Wheels::zero(state.ball_position.x) }
}

impl Follow for Balance {}

impl Follow for Push {}

impl Follow for Goal {
    const PARTS: &'static [&'static str] = &["position"];

    #[inline(always)]
    fn follow<L: Lane>(
        state: &LaneState<L>,
        setpoint: &LaneSetpoint<L>,
        _: &MovingFrame,
        memory: &mut Memory<'_, L>,
    ) -> Followed<L> {
        let [x, y] = setpoint.position;
        memory.set(0, x);
        memory.set(1, y);
        still(state)
    }
}

impl Follow for Velocity {
    const PARTS: &'static [&'static str] = &["velocity", "yaw_rate"];

    #[inline(always)]
    fn follow<L: Lane>(
        state: &LaneState<L>,
        setpoint: &LaneSetpoint<L>,
        _: &MovingFrame,
        memory: &mut Memory<'_, L>,
    ) -> Followed<L> {
        let [vx, vy] = setpoint.velocity;
        let [forward, left] = Heading::new(state.body_quaternion).of(vx, vy);
        memory.set3(0, [forward, left, setpoint.yaw_rate]);
        still(state)
    }
}

/// A network of one task's observations. Its memory is the memory of the task, the last action, whether there is an
/// observation, the integral of the position error, the observations from the newest to the oldest, of each cell its gates, outputs and state, and the values
/// of the layers.
struct Policy<T> {
    task: T,
    scaling: Option<RowScaling>,
    integral: Option<Integral>,
    /// Torque of an action of 1, N·m.
    torque: f64,
    frame: MovingFrame,
    rows: usize,
    /// Largest age of an observation.
    oldest: usize,
    /// Places of the network's inputs in the memory.
    inputs: Vec<usize>,
    /// Place of the gates of the first cell, or of the values of the first layer.
    hidden: usize,
    cells: Vec<Dense>,
    layers: Vec<Dense>,
    len: usize,
}

/// Weights and biases, rounded to f32 as in the files of policies.
struct Dense {
    weights: Vec<f64>,
    biases: Vec<f64>,
    /// How many of the inputs, the last ones, are own outputs of the last step.
    own: usize,
}

impl Dense {
    fn layer(layer: &Layer<'_>) -> Self {
        let rounded = |numbers: &[f64]| numbers.iter().map(|number| f64::from(*number as f32)).collect();
        Self { weights: rounded(layer.weights), biases: rounded(layer.biases), own: 0 }
    }

    fn cell(cell: &Layer<'_>) -> Self {
        Self { own: units_of(cell), ..Self::layer(cell) }
    }
}

/// Rows of one observation.
struct Observed<'a, L> {
    scaling: Option<&'a RowScaling>,
    values: [L; MOST_ROWS],
    next: usize,
}

impl<L: Lane> Rows<L> for Observed<'_, L> {
    #[inline(always)]
    fn row(&mut self, row: Row, value: L) {
        let scaling = match self.scaling {
            Some(scaling) => Some((scaling.rest[self.next], scaling.gain[self.next])),
            None => None,
        };
        self.values[self.next] = WriteRows::scaled(row, value, scaling);
        self.next += 1;
    }
}

impl<T: Follow> Policy<T> {
    const LAST_ACTION: usize = T::MEMORY;
    const HAS_SEEN: usize = T::MEMORY + ACTION_LEN;
    const INTEGRAL: usize = T::MEMORY + ACTION_LEN + 1;
    const SEEN: usize = T::MEMORY + ACTION_LEN + 3;

    /// Keeps the observation of now; at first it replaces earlier observations. Returns the torques of the setpoint's
    /// motion.
    #[inline(always)]
    fn observe<L: Lane>(&self, sample: &mut Sample<'_, L>) -> Wheels<L> {
        let Followed { state, torques } = T::follow(sample.state, sample.setpoint, &self.frame, &mut sample.memory);
        let zero = state.ball_position.x.zero();
        let last_action = sample.memory.wheels(Self::LAST_ACTION);
        let mut seen = Observed { scaling: self.scaling.as_ref(), values: [zero; MOST_ROWS], next: 0 };
        self.task.observe(&Sensed { state: &state, last_action }, &sample.memory, &mut seen);
        let is_first = sample.memory.get(Self::HAS_SEEN).le(zero);
        sample.memory.set(Self::HAS_SEEN, zero.splat(1.0));
        if let Some(integral) = &self.integral {
            let last = [sample.memory.get(Self::INTEGRAL), sample.memory.get(Self::INTEGRAL + 1)];
            let next = integral.next(
                last,
                #[inline(always)]
                |row| seen.values[row],
            );
            let now = next.map(
                #[inline(always)]
                |value| L::select(is_first, zero, value),
            );
            let [x, y] = integral.places();
            [seen.values[x], seen.values[y]] = Integral::shown([seen.values[x], seen.values[y]], now);
            sample.memory.set(Self::INTEGRAL, now[0]);
            sample.memory.set(Self::INTEGRAL + 1, now[1]);
        }
        for age in (1..=self.oldest).rev() {
            for row in 0..self.rows {
                let place = Self::SEEN + age * self.rows + row;
                let earlier = sample.memory.get(place - self.rows);
                sample.memory.set(place, L::select(is_first, seen.values[row], earlier));
            }
        }
        for row in 0..self.rows {
            sample.memory.set(Self::SEEN + row, seen.values[row]);
        }
        torques
    }

    /// The actions; cells keep their outputs and states.
    #[inline(always)]
    fn act<L: Lane>(&self, memory: &mut Memory<'_, L>) -> Wheels<L> {
        let one = memory.get(0).splat(1.0);
        let half = one.splat(0.5);
        let mut place = self.hidden;
        // The place of the inputs of the next layer, unless they are the observations.
        let mut from = None;
        for cell in &self.cells {
            let gates = cell.biases.len();
            let units = gates / GATES;
            let (outputs, states) = (place + gates, place + gates + units);
            for gate in 0..gates {
                let sum = self.sum(cell, gate, from, outputs, memory);
                let is_cell_gate = gate / units == 2;
                let squashed = if is_cell_gate { tanh(sum) } else { half * tanh(half * sum) + half };
                memory.set(place + gate, squashed);
            }
            for unit in 0..units {
                let [input, forget, new, output] = [0, 1, 2, 3].map(
                    #[inline(always)]
                    |gate| memory.get(place + gate * units + unit),
                );
                let state = forget * memory.get(states + unit) + input * new;
                memory.set(states + unit, state);
                memory.set(outputs + unit, output * tanh(state));
            }
            from = Some(outputs);
            place = states + units;
        }
        for (k, layer) in self.layers.iter().enumerate() {
            let is_last = k + 1 == self.layers.len();
            for output in 0..layer.biases.len() {
                let sum = self.sum(layer, output, from, place, memory);
                memory.set(place + output, if is_last { sum } else { tanh(sum) });
            }
            from = Some(place);
            place += layer.biases.len();
        }
        let Wheels([a, b, c]) = memory.wheels(place - ACTION_LEN);
        Wheels([a.min(one).max(-one), b.min(one).max(-one), c.min(one).max(-one)])
    }

    /// An output before its nonlinearity. The inputs of the layer are from the place `from`, or the observations; further
    /// inputs of a cell are its own `outputs`.
    #[inline(always)]
    fn sum<L: Lane>(
        &self,
        layer: &Dense,
        output: usize,
        from: Option<usize>,
        outputs: usize,
        memory: &Memory<'_, L>,
    ) -> L {
        let inputs = layer.weights.len() / layer.biases.len();
        let weights = &layer.weights[output * inputs..][..inputs];
        let given = inputs - layer.own;
        let mut sum = memory.get(outputs).splat(layer.biases[output]);
        for (i, weight) in weights[..given].iter().enumerate() {
            let place = match from {
                Some(place) => place + i,
                None => self.inputs[i],
            };
            // Not fused, which WebAssembly does in software.
            sum += memory.get(place) * *weight;
        }
        for (i, weight) in weights[given..].iter().enumerate() {
            sum += memory.get(outputs + i) * *weight;
        }
        sum
    }
}

impl<T: Follow> Law for Policy<T> {
    const PARTS: &'static [&'static str] = T::PARTS;

    fn kept(&self) -> usize {
        self.len
    }

    #[inline(always)]
    fn torques<L: Lane>(&self, sample: &mut Sample<'_, L>) -> Wheels<L> {
        let mut torques = self.observe(sample);
        let action = self.act(&mut sample.memory);
        sample.memory.set_wheels(Self::LAST_ACTION, action);
        for i in 0..WHEELS {
            torques[i] += action[i] * self.torque;
        }
        sample.limited(torques).torques
    }
}
