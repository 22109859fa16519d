//! The part of a control step that follows the simulation: sensor, reward, termination, observation.

use super::ledger::{Ledger, Sizes};
use super::measure::Measured;
use crate::actuator::Actuator;
use crate::batch::config::EnvConfig;
use crate::batch::integral::Integral;
use crate::batch::stage::CustomStage;
use crate::perception::Perception;
use crate::sensor::Sensor;
use crate::task::{DIVERGED, RowScaling, Sensed, Step, Task, TaskDescription, WriteRows, WriteTerms};
use ballbot_base::error::Result;
use ballbot_base::lane_state::{LaneRobot, LaneState};
use ballbot_base::lanes::{Lane, Memory, Scalar, Vec3, atan2_positive, run_one};
use ballbot_base::payload::Deflection;
use ballbot_base::terrain::Terrain;
use ballbot_base::wheels::Wheels;
use std::sync::Arc;

/// A task with its sensor, shared by all chunks of a batch.
pub struct TaskStep<T, S> {
    pub task: T,
    pub sensor: S,
    scales: Vec<f64>,
    scaling: Option<RowScaling>,
    integral: Option<Integral>,
    control_dt: f64,
    terrain: Option<Arc<Terrain>>,
    /// Half lengths of the terrain, or of a terrain tile, along x and y, m.
    half_size: Option<[f64; 2]>,
    pub perception: Option<Arc<Perception>>,
    /// The stage of the caller, if there is one.
    pub stage: Option<CustomStage>,
    /// Rows of one observation.
    rows: usize,
    /// Observations that are given together, and their largest age.
    history: [usize; 2],
    metrics: usize,
    sizes: Sizes,
}

/// A robot at the end of the simulation of a control step.
pub struct Simulated<L: Lane> {
    pub robot: LaneRobot<L>,
    /// As the sensor measures it.
    pub measured: LaneState<L>,
    /// Deflection of the payload; zero unless riders lean in the task.
    pub payload: Deflection<L>,
}

impl<T: Task, S: Sensor> TaskStep<T, S> {
    /// # Errors
    /// The errors of [`EnvConfig::perception`] and [`Integral::of`].
    pub fn new(
        actuator: &impl Actuator,
        sensor: S,
        description: &TaskDescription,
        config: &EnvConfig<T>,
    ) -> Result<Self> {
        let rows = description.rows.len();
        Ok(Self {
            task: config.task.clone(),
            scales: config.reward.values().collect(),
            scaling: config.row_scaling(description),
            integral: Integral::of(config, description)?,
            control_dt: config.control_dt,
            terrain: config.terrain.clone(),
            half_size: config
                .terrain
                .as_ref()
                .map(|terrain| terrain.tiles().map_or_else(|| terrain.half_size(), |tiles| [0.5 * tiles.side; 2])),
            perception: config.perception()?.map(Arc::new),
            stage: config.stage.clone(),
            rows,
            history: [config.history.count(), config.history.ages().last().copied().unwrap_or(0)],
            metrics: description.metrics.len(),
            sizes: Sizes {
                task: T::MEMORY,
                actuator: actuator.memory_len(),
                sensor: sensor.memory_len(),
                observation: rows,
                terms: description.terms.len(),
            },
            sensor,
        })
    }

    pub fn sizes(&self) -> Sizes {
        self.sizes
    }

    /// How many metrics an episode has.
    pub fn metrics(&self) -> usize {
        self.metrics
    }

    /// Name of a reason for termination.
    pub fn termination(&self, index: usize) -> &'static str {
        let reasons = T::TERMINATIONS;
        let added = self.stage.iter().flat_map(|stage| &stage.0.layout().terminations);
        let diverged = (DIVERGED, "");
        let mut all = reasons.iter().chain([&diverged]).chain(added);
        all.nth(index).map_or(DIVERGED, |(name, _)| *name)
    }

    /// Scaling of the rows, if they are scaled.
    pub fn scaling(&self) -> Option<&RowScaling> {
        self.scaling.as_ref()
    }

    /// The integral of the position error, if it is observed.
    pub fn integral(&self) -> Option<&Integral> {
        self.integral.as_ref()
    }

    /// How many rows an observation has.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Length of an observation: its rows at each age of the history, then the readings of the instruments.
    pub fn observation_len(&self) -> usize {
        self.rows * self.history[0] + self.perception.as_ref().map_or(0, |perception| perception.width())
    }

    /// Memory of the observations of a robot: what a step writes, at the end of an episode too, and what is kept.
    pub fn observed_bytes(&self) -> usize {
        (3 * self.observation_len() + self.rows * self.history[1]) * size_of::<f32>()
    }

    /// Replaces true states by states that the sensor reads, before [`TaskStep::run`]: a separate function, so that it
    /// is not compiled for each task. `one` is scratch space for the sensor's numbers of one robot.
    pub fn measure<C: Measured>(&self, states: &mut LaneState<C>, ledger: &mut Ledger<C>, one: &mut [f64]) {
        ledger.last_sensor.copy_from_slice(&ledger.sensor);
        if !self.sensor.is_exact() {
            C::read(&self.sensor, &mut ledger.sensor, one, states);
        }
    }

    /// Counts the step, and computes reward, termination, truncation, success and the observation of the measured state.
    /// `com_direction` is the unit vector from the ball's center to the body's center of mass, body frame.
    #[inline(always)]
    pub fn run<L: Lane>(
        &self,
        token: L::Token,
        simulated: &Simulated<L>,
        actions: &Wheels<L::Cell>,
        com_direction: &[L::Cell; 3],
        ledger: &mut Ledger<L::Cell>,
    ) {
        let Simulated { robot, measured, payload } = simulated;
        let Ledger { episode, task: memory, observation, terms, .. } = ledger;
        let state = &robot.state;
        let zero = state.ball_position.x.zero();
        let one = zero.splat(1.0);
        let action = Wheels::load(token, actions);

        let up = state.body_quaternion.rotation().rows[2];
        let com = Vec3::load(token, com_direction);
        let across = up.cross(com);
        // With the CoM on the mast these are only the terms of `up`, to the last bit.
        let sine = across.z.mul_add(across.z, across.y.mul_add(across.y, across.x.squared())).sqrt();
        let tilt = atan2_positive(sine, up.dot(com));
        let step = Step {
            state,
            up,
            tilt,
            on_floor: robot.on_floor,
            on_obstacle: robot.on_obstacle,
            lean: payload.position,
            action,
            last_action: Wheels::load(token, &episode.last_action),
            terrain: self.terrain.as_deref(),
            control_dt: self.control_dt,
        };

        let mut memory = Memory::new(token, memory);
        self.task.advance(&step, &mut memory);

        let sound = robot.healthy & state.within_bounds();
        let diverged = zero.splat((T::TERMINATIONS.len() + 1) as f64);
        let termination = L::select(sound, self.task.terminate(&step), diverged);
        let terminated = !termination.le(zero);
        let success = self.task.success(&step, terminated, &mut memory);
        let steps = L::load(token, &episode.steps) + 1.0;
        let mut over = L::load(token, &episode.limit).le(steps);
        if let Some([x, y]) = self.half_size {
            let ball = &state.ball_position;
            let [from_x, from_y] = [0, 1].map(|axis| L::load(token, &episode.origin[axis]));
            over = over | zero.splat(x).lt((ball.x - from_x).abs()) | zero.splat(y).lt((ball.y - from_y).abs());
        }
        let truncated = !terminated & over;

        let mut written = WriteTerms { cells: terms, scales: &self.scales, sound, sum: zero, next: 0 };
        self.task.reward(&step, terminated, &memory, &mut written);
        written.sum.store(&mut episode.reward);
        termination.store(&mut episode.termination);
        L::select(truncated, one, zero).store(&mut episode.truncated);
        L::select(success, one, zero).store(&mut episode.success);
        steps.store(&mut episode.steps);
        action.store(&mut episode.last_action);
        let mut rows = WriteRows { cells: observation, scaling: self.scaling.as_ref(), next: 0 };
        self.task.observe(&Sensed { state: measured, last_action: action }, &memory, &mut rows);
        if let Some(integral) = &self.integral {
            integral.apply::<L>(token, observation, &mut episode.integral, true);
        }
    }

    /// [`TaskStep::run`] of one robot. It has no other generic parameters, so that it is compiled once for all models
    /// and actuators, like the other functions of one robot.
    pub fn run_one(
        &self,
        simulated: &Simulated<f64>,
        actions: &Wheels<f64>,
        com_direction: &[f64; 3],
        ledger: &mut Ledger<f64>,
    ) {
        run_one(
            #[inline(always)]
            || self.run::<f64>(Scalar, simulated, actions, com_direction, ledger),
        );
    }

    /// Computes only the observation, at the start of an episode or under a new command.
    pub fn observe(&self, state: &LaneState<f64>, ledger: &mut Ledger<f64>) {
        let mut measured = *state;
        if !self.sensor.is_exact() {
            f64::read(&self.sensor, &mut ledger.sensor, &mut [], &mut measured);
        }
        self.observe_state(&measured, ledger);
    }

    /// The same for a state that is already measured.
    pub fn observe_state(&self, measured: &LaneState<f64>, ledger: &mut Ledger<f64>) {
        run_one(
            #[inline(always)]
            || self.write_rows(measured, ledger),
        );
    }

    #[inline(always)]
    fn write_rows(&self, measured: &LaneState<f64>, ledger: &mut Ledger<f64>) {
        let last_action = ledger.episode.last_action;
        let mut rows = WriteRows { cells: &mut ledger.observation, scaling: self.scaling.as_ref(), next: 0 };
        let memory = Memory::new(Scalar, &mut ledger.task);
        self.task.observe(&Sensed { state: measured, last_action }, &memory, &mut rows);
        if let Some(integral) = &self.integral {
            integral.apply::<f64>(Scalar, &mut ledger.observation, &mut ledger.episode.integral, false);
        }
    }
}
