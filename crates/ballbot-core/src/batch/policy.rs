//! A policy as a controller: it observes as in its task, and follows setpoints.

use super::config::EnvConfig;
use super::history::History;
use super::networks::{Layer, Networks};
use super::registry::TaskConfig;
use crate::control::{Controller, LaneSetpoint, Law, Sample, Sampled};
use crate::task::{
    ACTION_LEN, Balance, Goal, Push, Row, RowScaling, Rows, Sensed, Task, TaskDescription, Velocity, WriteRows,
};
use ballbot_base::error::{Error, Result};
use ballbot_base::kinematics::Omniwheels;
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Heading, Lane, Memory, Vec3, tanh, wrapped_angle};
use ballbot_base::params::Params;
use ballbot_base::wheels::{WHEELS, Wheels};
use ballbot_models::Scale;
use nalgebra::{UnitQuaternion, Vector3};

/// Most rows of an observation.
const MOST_ROWS: usize = 32;

/// A policy that was trained in a task, as a controller of robots with `params`. Its layers have tanh between them, and
/// its actions are limited to ±1. `options` are options of the environment in which it was trained, by name: its time
/// steps, its torque, the scaling of its observations.
///
/// Policies of the tasks `balance` and `push` follow the motion of a setpoint: they observe the robot in a frame that moves,
/// accelerates and turns with it. Policies of `goal` follow a position, policies of `velocity` a velocity and a rate of the
/// heading.
///
/// # Errors
/// [`Error::UnknownName`] for another task, or for an option that does not exist; errors of [`EnvConfig::validate`] and
/// of [`Networks::new`]; [`Error::Inconsistent`] if the layers do not fit the observation.
pub fn policy_controller(
    task: &str,
    params: &Params,
    options: &[(&str, &[f64])],
    history: &History,
    layers: &[Layer<'_>],
) -> Result<Box<dyn Controller>> {
    match task {
        Balance::NAME => of_task::<Balance>(params, options, history, layers),
        Push::NAME => of_task::<Push>(params, options, history, layers),
        Goal::NAME => of_task::<Goal>(params, options, history, layers),
        Velocity::NAME => of_task::<Velocity>(params, options, history, layers),
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
    // Checks that the layers fit each other and the action.
    let inputs = Networks::new(1, layers)?.inputs();
    if inputs != rows * ages.len() {
        let seen = format!("{rows} rows of the task {} for each of {} ages", T::NAME, ages.len());
        return Err(Error::Inconsistent(format!("inputs of layer 0: {inputs}, expected {seen}")));
    }
    let kept = T::MEMORY + ACTION_LEN + 1;
    let hidden = kept + (oldest + 1) * rows;
    let policy = Policy {
        scaling: config.row_scaling(&description),
        torque,
        frame: Frame::new(params),
        rows,
        oldest,
        // Oldest first.
        inputs: ages.iter().rev().flat_map(|age| (0..rows).map(move |row| kept + age * rows + row)).collect(),
        hidden,
        layers: layers.iter().map(Dense::of).collect(),
        len: hidden + layers.iter().map(|layer| layer.outputs).sum::<usize>(),
        task: config.task.clone(),
    };
    Ok(Box::new(Sampled::uncompensated(policy, params, config.control_dt, largest)?))
}

/// What moves with a setpoint.
struct Frame {
    /// Wheel speeds of the upright robot that rolls along x and y of its body, per speed, and that turns, per rate.
    wheel_speeds: [Wheels<f64>; 3],
    /// Rate at which it turns per error of the heading, 1/s.
    turning: f64,
    /// m/s².
    gravity: f64,
}

/// Rate at which the frame turns per error of the heading, for the robot of the paper, 1/s, and the largest error, rad.
const TURNING: f64 = 3.0;
const LARGEST_TURN: f64 = 0.5;

impl Frame {
    fn new(params: &Params) -> Self {
        let (wheels, upright) = (Omniwheels::new(params), UnitQuaternion::identity());
        let speeds = |ball: Vector3<f64>, body: Vector3<f64>| wheels.wheel_speeds(&upright, &ball, &body);
        let still = Vector3::zeros();
        Self {
            wheel_speeds: [
                speeds(Vector3::y() / params.ball_radius, still),
                speeds(-Vector3::x() / params.ball_radius, still),
                speeds(still, Vector3::z()),
            ],
            turning: TURNING / Scale::of(params).time,
            gravity: params.gravity,
        }
    }

    /// A state in the frame of the setpoint. On level ground the laws of motion are the same in a frame that moves at a
    /// constant velocity, but for friction.
    #[inline(always)]
    fn of<L: Lane>(&self, state: &LaneState<L>, setpoint: &LaneSetpoint<L>) -> LaneState<L> {
        let mut state = *state;
        let ([x, y], [vx, vy]) = (setpoint.position, setpoint.velocity);
        state.ball_position.x -= x;
        state.ball_position.y -= y;
        state.ball_velocity.x -= vx;
        state.ball_velocity.y -= vy;
        let most = x.splat(LARGEST_TURN);
        let error = wrapped_angle(setpoint.yaw - state.body_quaternion.yaw()).min(most).max(-most);
        let turn = setpoint.yaw_rate + error * self.turning;
        state.body_angular_velocity.z -= turn;
        // In a frame that accelerates the vertical is along gravity less the acceleration.
        let ([ax, ay], half) = (setpoint.acceleration, 0.5 / self.gravity);
        let lean = Vec3::new(ay * half, -ax * half, x.zero());
        state.body_quaternion = state.body_quaternion.turned(lean);
        let [forward, left] = Heading::new(state.body_quaternion).of(vx, vy);
        let [rolling, across, turning] = &self.wheel_speeds;
        for i in 0..WHEELS {
            state.wheel_speeds[i] -= forward * rolling[i] + left * across[i] + turn * turning[i];
        }
        state
    }
}

/// A task that takes a setpoint, by the frame of its state unless it has a command.
trait Follow: Task {
    /// The parts of a setpoint that its policies follow.
    const PARTS: &'static [&'static str] = &["position", "velocity", "acceleration", "yaw", "yaw_rate"];

    /// Gives the task a setpoint: by its command, which is first in the memory, or by the frame of the state, which it
    /// returns.
    #[inline(always)]
    fn follow<L: Lane>(
        state: &LaneState<L>,
        setpoint: &LaneSetpoint<L>,
        frame: &Frame,
        _: &mut Memory<'_, L>,
    ) -> LaneState<L> {
        frame.of(state, setpoint)
    }
}

impl Follow for Balance {}

impl Follow for Push {}

impl Follow for Goal {
    const PARTS: &'static [&'static str] = &["position"];

    #[inline(always)]
    fn follow<L: Lane>(
        state: &LaneState<L>,
        setpoint: &LaneSetpoint<L>,
        _: &Frame,
        memory: &mut Memory<'_, L>,
    ) -> LaneState<L> {
        let [x, y] = setpoint.position;
        memory.set(0, x);
        memory.set(1, y);
        *state
    }
}

impl Follow for Velocity {
    const PARTS: &'static [&'static str] = &["velocity", "yaw_rate"];

    #[inline(always)]
    fn follow<L: Lane>(
        state: &LaneState<L>,
        setpoint: &LaneSetpoint<L>,
        _: &Frame,
        memory: &mut Memory<'_, L>,
    ) -> LaneState<L> {
        let [vx, vy] = setpoint.velocity;
        let [forward, left] = Heading::new(state.body_quaternion).of(vx, vy);
        memory.set3(0, [forward, left, setpoint.yaw_rate]);
        *state
    }
}

/// A network of one task's observations. Its memory is the memory of the task, the last action, whether there is an
/// observation, the observations from the newest to the oldest, and the values of the layers.
struct Policy<T> {
    task: T,
    scaling: Option<RowScaling>,
    /// Torque of an action of 1, N·m.
    torque: f64,
    frame: Frame,
    rows: usize,
    /// Largest age of an observation.
    oldest: usize,
    /// Places of the network's inputs in the memory.
    inputs: Vec<usize>,
    /// Place of the values of the first layer.
    hidden: usize,
    layers: Vec<Dense>,
    len: usize,
}

/// Weights and biases, rounded to f32 as in the files of policies.
struct Dense {
    weights: Vec<f64>,
    biases: Vec<f64>,
}

impl Dense {
    fn of(layer: &Layer<'_>) -> Self {
        let rounded = |numbers: &[f64]| numbers.iter().map(|number| f64::from(*number as f32)).collect();
        Self { weights: rounded(layer.weights), biases: rounded(layer.biases) }
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
    const SEEN: usize = T::MEMORY + ACTION_LEN + 1;

    /// Keeps the observation of now; at first it replaces earlier observations.
    #[inline(always)]
    fn observe<L: Lane>(&self, sample: &mut Sample<'_, L>) {
        let state = T::follow(sample.state, sample.setpoint, &self.frame, &mut sample.memory);
        let zero = state.ball_position.x.zero();
        let last_action = sample.memory.wheels(Self::LAST_ACTION);
        let mut seen = Observed { scaling: self.scaling.as_ref(), values: [zero; MOST_ROWS], next: 0 };
        self.task.observe(&Sensed { state: &state, last_action }, &sample.memory, &mut seen);
        let is_first = sample.memory.get(Self::HAS_SEEN).le(zero);
        sample.memory.set(Self::HAS_SEEN, zero.splat(1.0));
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
    }

    /// The values of the last layer.
    #[inline(always)]
    fn act<L: Lane>(&self, memory: &mut Memory<'_, L>) -> Wheels<L> {
        let mut place = self.hidden;
        for (k, layer) in self.layers.iter().enumerate() {
            let inputs = layer.weights.len() / layer.biases.len();
            for (output, bias) in layer.biases.iter().enumerate() {
                let weights = &layer.weights[output * inputs..][..inputs];
                let zero = memory.get(place).zero();
                let mut sum = zero.splat(*bias);
                for (i, weight) in weights.iter().enumerate() {
                    let input = if k == 0 { self.inputs[i] } else { place - inputs + i };
                    // Not fused, which WebAssembly does in software.
                    sum += memory.get(input) * *weight;
                }
                let is_last = k + 1 == self.layers.len();
                memory.set(place + output, if is_last { sum } else { tanh(sum) });
            }
            place += layer.biases.len();
        }
        let one = memory.get(0).splat(1.0);
        let Wheels([a, b, c]) = memory.wheels(place - ACTION_LEN);
        Wheels([a.min(one).max(-one), b.min(one).max(-one), c.min(one).max(-one)])
    }
}

impl<T: Follow> Law for Policy<T> {
    const PARTS: &'static [&'static str] = T::PARTS;

    fn kept(&self) -> usize {
        self.len
    }

    #[inline(always)]
    fn torques<L: Lane>(&self, sample: &mut Sample<'_, L>) -> Wheels<L> {
        self.observe(sample);
        let action = self.act(&mut sample.memory);
        sample.memory.set_wheels(Self::LAST_ACTION, action);
        let Wheels([a, b, c]) = action;
        sample.limited(Wheels([a * self.torque, b * self.torque, c * self.torque])).torques
    }
}
