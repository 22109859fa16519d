//! Environments that are stepped together: a single environment of any model, or eight of the contact model in lanes.

mod begin;
pub mod chunk;
mod command;
pub mod ledger;
pub mod measure;
mod observe;
mod past;
mod perceive;
mod randomize;
pub mod robots;
mod snapshot;
mod staged;
pub mod task_step;

use self::chunk::Chunk;
use self::ledger::Ledger;
use self::past::Past;
use self::perceive::Sight;
use self::robots::Robots;
use self::task_step::TaskStep;
use crate::actuator::Actuator;
use crate::batch::autoreset::Autoreset;
use crate::batch::buffers::{Outcome, StepBuffers};
use crate::batch::config::EnvConfig;
use crate::batch::drawn_law::{Design, Drawn, DrawnLaws};
use crate::batch::events::{Plan, Randomized, Setup, Source, Stages, key_of};
use crate::batch::integral::Integral;
use crate::batch::stage::ChunkResults;
use crate::control::{Controller, LaneWidth};
use crate::sensor::{Readings, Sensor};
use crate::task::{ACTION_LEN, RowScaling, Task};
use ballbot_base::error::{Error, Result};
use ballbot_base::force::Force;
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::Cell;
use ballbot_base::params::Params;
use ballbot_base::payload::{Deflection, PAYLOADS};
use ballbot_base::setpoint::{LaneSetpoint, Setpoint};
use ballbot_base::state::{Contacts, State};
use ballbot_base::terrain::Ground;
use ballbot_base::wheels::Wheels;
use ballbot_gradients::{Coordinates, Differentiable, Parameter};
use nalgebra::Vector3;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use std::sync::Arc;

/// Numbers that a controller keeps for each robot.
pub struct ControlMemory<C> {
    /// [`Controller::id`] of the controller that the numbers belong to.
    owner: u64,
    pub cells: Vec<C>,
    /// [`Controller::force_index`] of the controller.
    force: Option<usize>,
}

/// Environments whose robots are `R`, with task `T`, actuator `A` and sensor `S`.
pub struct Environments<R: Robots, T, A, S> {
    pub config: Arc<EnvConfig<T>>,
    pub step: Arc<TaskStep<T, S>>,
    pub actuator: A,
    substeps: usize,
    action_torque: f64,
    /// Whether any robot may be on a floor that moves.
    floors_move: bool,
    /// How many robots belong to environments; the others do not move.
    pub used: usize,
    pub robots: R,
    /// As in [`TaskStep::run`].
    com_directions: [R::Cell; 3],
    pub ledger: Ledger<R::Cell>,
    past: Past,
    /// Scratch space for the ledger of one robot.
    pub one: Ledger<f64>,
    pub control: ControlMemory<R::Cell>,
    drawn_laws: DrawnLaws,
    /// Whether any reset has happened.
    pub begun: bool,
    pub over: Vec<bool>,
    pub rngs: Vec<ChaCha8Rng>,
    /// Seeds that the next episodes begin with; the current episodes keep their random numbers.
    pub next_seeds: Vec<Option<u64>>,
    /// Episodes begun since the last seed.
    pub episodes: Vec<u32>,
    /// Metrics of the last episode that ended, environment by environment.
    metrics: Vec<f64>,
    /// Scratch space for the metrics of one environment.
    measured: Vec<f64>,
    /// The randomization of the robots, if there is any.
    pub events: Option<Box<Randomized>>,
    /// Instruments that observe the ground, if there are any.
    pub sight: Option<Box<Sight>>,
    /// Levels of a curriculum that the environments have reached.
    pub levels: Vec<u32>,
}

impl<R: Robots, T: Task, A: Actuator, S: Sensor> Environments<R, T, A, S> {
    /// Environments with seeds `seed`, `seed + 1`, ...; each must be reset before its first step.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] if the model does not accept every start that the task may sample, and for events on
    /// motors that the actuator does not support.
    pub fn new(
        config: &Arc<EnvConfig<T>>,
        step: &Arc<TaskStep<T, S>>,
        actuator: A,
        robots: R,
        plan: Option<&Arc<Plan>>,
        used: usize,
        seed: u64,
    ) -> Result<Self> {
        let nominal = Arc::new(Setup { params: robots.params(0).clone(), stages: config.stages() });
        if !actuator.is_individual() && plan.is_some_and(|plan| plan.individual_motors) {
            return Err(Error::Inconsistent(
                "events change options of the actuators or max_wheel_torque, but the motors are a stage of the caller's \
                 own, alike on all robots"
                    .into(),
            ));
        }
        if !step.sensor.is_individual() && plan.is_some_and(|plan| plan.individual_sensors) {
            return Err(Error::Inconsistent(
                "events change options of the sensors, but these are a stage of the caller's own, alike on all robots"
                    .into(),
            ));
        }
        let metrics = step.metrics();
        let mut environments = Self {
            step: Arc::clone(step),
            com_directions: [R::Cell::default(); 3],
            actuator,
            substeps: config.substeps()?,
            action_torque: config.action_torque(),
            floors_move: config.floors_may_move(),
            used,
            ledger: Ledger::new(step.sizes()),
            past: Past::new(&config.history, step.rows(), used),
            one: Ledger::new(step.sizes()),
            control: ControlMemory { owner: 0, cells: Vec::new(), force: None },
            drawn_laws: DrawnLaws::default(),
            begun: false,
            over: vec![true; used],
            rngs: (0..used).map(|i| ChaCha8Rng::seed_from_u64(seed.wrapping_add(i as u64))).collect(),
            next_seeds: vec![None; used],
            episodes: vec![0; used],
            metrics: vec![f64::NAN; used * metrics],
            measured: Vec::with_capacity(metrics),
            events: plan.map(|plan| Box::new(Randomized::new(plan, &nominal, used))),
            sight: step.perception.as_ref().map(|perception| Box::new(Sight::new(perception, used))),
            levels: vec![0; used],
            robots,
            config: Arc::clone(config),
        };
        environments.check_starts(0)?;
        if let Some(events) = &mut environments.events {
            let check = config.check_changed_robot(&environments.actuator);
            for (i, rng) in environments.rngs.iter().enumerate() {
                let source = Source { key: key_of(rng.get_seed()), episode: 0 };
                events.start(&mut environments.robots, i, source, &check);
            }
        }
        (0..R::Cell::WIDTH).for_each(|i| environments.note_com(i));
        Ok(environments)
    }

    /// Takes the direction of the center of mass from the parameters of robot `i`.
    pub fn note_com(&mut self, i: usize) {
        let direction = self.robots.params(i).com_direction();
        for (cells, component) in self.com_directions.iter_mut().zip(direction.iter()) {
            cells.set(i, *component);
        }
    }

    fn check_starts(&self, i: usize) -> Result<()> {
        for start in self.step.task.extreme_starts(self.robots.params(i)) {
            self.robots.accepts(i, &self.on_ground(i, start)).map_err(|error| {
                Error::Inconsistent(format!("the robot cannot start where the task may place it: {error}"))
            })?;
        }
        Ok(())
    }

    /// Replaces the parameters of robot `i` without applying events.
    pub fn replace_robot(&mut self, i: usize, params: &Params) -> Result<()> {
        params.validate()?;
        // A robot changed by events may have weaker motors than an action commands.
        if !self.has_own_motors() {
            self.config.validate_robot(params)?;
        }
        self.config.task.validate(params)?;
        self.config.check_floor(params)?;
        let (old, motion) = (self.robots.params(i).clone(), self.robots.save(i));
        let continues = self.robots.set_params(i, params)?;
        if let Err(error) = self.check_starts(i) {
            self.robots.set_params(i, &old)?;
            self.robots.load(i, &motion)?;
            return Err(error);
        }
        self.note_com(i);
        self.floors_move |= params.has_moving_floor();
        self.over[i] |= !continues;
        Ok(())
    }

    /// Measures the current episode of robot `i`.
    fn measure(&mut self, i: usize) {
        self.read_memory(i);
        self.measured.clear();
        self.step.task.measure(&self.one.task, self.config.control_dt, &mut self.measured);
    }

    /// Copies the task's memory of robot `i` to the ledger of one robot.
    fn read_memory(&mut self, i: usize) {
        self.one.task.iter_mut().zip(&self.ledger.task).for_each(|(number, cell)| *number = cell.get(i));
    }

    /// Keeps the metrics of the episode of robot `i` as it ends.
    fn keep_metrics(&mut self, i: usize) {
        let len = self.step.metrics();
        if len > 0 {
            self.measure(i);
            self.metrics[i * len..][..len].copy_from_slice(&self.measured);
        }
    }

    /// Forgets the metrics of the last episode of robot `i`.
    pub fn forget_metrics(&mut self, i: usize) {
        let len = self.step.metrics();
        self.metrics[i * len..][..len].fill(f64::NAN);
    }

    /// Whether an episode begins in place of the step of robot `i`.
    pub fn is_reset_instead(&self, autoreset: Autoreset, i: usize) -> bool {
        autoreset == Autoreset::NextStep && self.over[i]
    }

    /// Writes the results of a step, and begins a new episode where it ended one.
    fn write_step(&mut self, autoreset: Autoreset, mut buffers: StepBuffers<'_>) {
        let width = self.step.observation_len();
        for i in 0..self.used {
            let row = i * width..(i + 1) * width;
            if self.is_reset_instead(autoreset, i) {
                self.begin_at_random(i, &mut buffers.observations[row]);
                buffers.write(i, Outcome::default());
                continue;
            }
            let observation = &mut buffers.observations[row.clone()];
            self.perceive(i);
            self.write_observation(i, observation);
            let outcome = self.outcome(i);
            self.over[i] = outcome.done();
            if outcome.done() {
                self.keep_metrics(i);
                self.note_level(i);
                buffers.final_observations[row].copy_from_slice(observation);
                if autoreset == Autoreset::SameStep {
                    self.begin_at_random(i, observation);
                }
            } else {
                self.renew_commands(i, observation);
            }
            buffers.write(i, outcome);
        }
    }

    /// States and setpoints of all robots for a controller.
    fn controlled(&mut self, setpoints: &[Setpoint], privileged: bool) -> (LaneState<R::Cell>, LaneSetpoint<R::Cell>) {
        let mut states = LaneState::<R::Cell>::default();
        if privileged {
            self.robots.read(&mut states);
        } else {
            self.read_measured(&mut states);
        }
        let mut targets = LaneSetpoint::<R::Cell>::default();
        for i in 0..self.used {
            let setpoint = match setpoints.get(i) {
                Some(setpoint) => *setpoint,
                None => {
                    self.read_memory(i);
                    self.step.task.setpoint(&self.one.task)
                }
            };
            targets.set_lane(i, &(&setpoint).into());
        }
        (states, targets)
    }

    /// Clears what controllers have stored about robot `i`.
    fn reset_controllers(&mut self, i: usize) {
        self.control.cells.iter_mut().for_each(|cell| cell.set(i, 0.0));
        self.drawn_laws.reset(i);
    }

    fn outcome(&self, i: usize) -> Outcome {
        let episode = &self.ledger.episode;
        let terminated = match episode.termination.get(i) as usize {
            0 => None,
            reason => Some(self.step.termination(reason - 1)),
        };
        Outcome {
            reward: episode.reward.get(i),
            terminated,
            truncated: episode.truncated.get(i) > 0.0,
            success: episode.success.get(i) > 0.0,
        }
    }
}

/// Actions of the robots of a chunk, n × 3, within their bounds.
fn commands<C: Cell>(actions: &[f32]) -> Wheels<C> {
    let mut commands = Wheels::<C>::default();
    for (i, action) in actions.chunks_exact(ACTION_LEN).enumerate() {
        for (cell, value) in commands.iter_mut().zip(action) {
            cell.set(i, f64::from(*value).clamp(-1.0, 1.0));
        }
    }
    commands
}

impl<R: Robots, T: Task, A: Actuator, S: Sensor> Chunk for Environments<R, T, A, S> {
    fn len(&self) -> usize {
        self.used
    }

    fn action_torque(&self) -> f64 {
        self.action_torque
    }

    fn scaling(&self) -> Option<&RowScaling> {
        self.step.scaling()
    }

    fn integral(&self) -> Option<&Integral> {
        self.step.integral()
    }

    fn ground(&self) -> Option<&Ground> {
        self.robots.ground()
    }

    fn advance(&mut self, autoreset: Autoreset, actions: &[f32]) {
        self.fire_events(autoreset);
        // A single robot whose episode is over is not simulated; in lanes its neighbors are.
        if R::Cell::WIDTH > 1 || !self.is_reset_instead(autoreset, 0) {
            self.keep_observations();
            self.robots.park(self.used);
            if let Some([x, y]) = T::LEAN {
                let memory = &self.ledger.task;
                self.robots.move_payloads(&[memory[x], memory[y], R::Cell::default()]);
            }
            let commands = commands(actions);
            let (memory, one) = (&mut self.ledger.actuator, &mut self.one.actuator);
            self.robots.drive(&self.actuator, &commands, memory, one, self.substeps);
            self.feel_floors();
            self.robots.conclude(&self.step, &commands, &self.com_directions, &mut self.ledger, &mut self.one);
        }
    }

    fn begin_step(&mut self, autoreset: Autoreset) {
        self.fire_events(autoreset);
    }

    fn advance_to(&mut self, autoreset: Autoreset, actions: &[f32], states: &[State]) {
        for (i, state) in states.iter().enumerate() {
            if !self.is_reset_instead(autoreset, i) {
                self.robots.place(i, state);
            }
        }
        self.keep_observations();
        let commands = commands(actions);
        self.feel_floors();
        self.robots.conclude(&self.step, &commands, &self.com_directions, &mut self.ledger, &mut self.one);
    }

    fn finish(&mut self, autoreset: Autoreset, results: Option<ChunkResults<'_>>, buffers: StepBuffers<'_>) {
        if let Some(results) = results {
            self.apply(autoreset, &results);
        }
        self.write_step(autoreset, buffers);
    }

    fn robot_rows(&mut self, observed: bool, out: &mut [f32]) {
        self.write_robot_rows(observed, out);
    }

    fn put_rows(&mut self, i: usize, values: &[f64]) {
        self.put_newest_rows(i, values);
    }

    fn steps(&self, i: usize) -> i64 {
        self.ledger.episode.steps.get(i) as i64
    }

    fn key(&self, i: usize) -> [u32; 3] {
        let [a, b] = key_of(self.rngs[i].get_seed());
        [a, b, self.episodes[i]]
    }

    fn control(&mut self, controller: &dyn Controller, setpoints: &[Setpoint], privileged: bool, actions: &mut [f32]) {
        let len = controller.memory_len();
        if self.control.owner != controller.id() || self.control.cells.len() != len {
            self.control.owner = controller.id();
            self.control.cells.clear();
            self.control.cells.resize(len, R::Cell::default());
        }
        self.control.force = controller.force_index();
        let (states, targets) = self.controlled(setpoints, privileged);
        let torques = (R::Cell::TORQUES)(controller, &states, &targets, self.action_torque, &mut self.control.cells);
        for (i, action) in actions.chunks_exact_mut(ACTION_LEN).enumerate() {
            for (value, torque) in action.iter_mut().zip(&torques) {
                *value = (torque.get(i) / self.action_torque) as f32;
            }
        }
    }

    fn outside_force(&self, i: usize) -> Option<[f64; 2]> {
        let ControlMemory { cells, force, .. } = &self.control;
        force.map(|index| [cells[index].get(i), cells[index + 1].get(i)])
    }

    fn control_drawn(
        &mut self,
        owner: u64,
        design: &Design,
        setpoints: &[Setpoint],
        privileged: bool,
        actions: &mut [f32],
    ) -> Result<()> {
        self.drawn_laws.own(owner, self.used);
        self.control.force = None;
        let (states, targets) = self.controlled(setpoints, privileged);
        let (control_dt, largest) = (self.config.control_dt, self.action_torque);
        for (i, action) in actions.chunks_exact_mut(ACTION_LEN).enumerate() {
            let motors = self.events.as_ref().map_or(&self.config.actuators, |events| &events.stages(i).actuators);
            let robot = Drawn { params: self.robots.params(i), motors, control_dt };
            let torques = self.drawn_laws.torques(i, design, &robot, &states.lane(i), &targets.lane(i), largest)?;
            for (value, torque) in action.iter_mut().zip(torques) {
                *value = (torque / largest) as f32;
            }
        }
        Ok(())
    }

    fn reset(&mut self, i: usize, start: Option<&State>, observation: &mut [f32]) -> Result<()> {
        match start {
            Some(start) => {
                self.accepts(i, start, None)?;
                self.renew(i);
                self.begin(i, start, observation);
            }
            None => self.begin_at_random(i, observation),
        }
        Ok(())
    }

    fn accepts(&self, i: usize, start: &State, seed: Option<u64>) -> Result<()> {
        let Some(events) = &self.events else { return self.robots.accepts(i, start) };
        let seed = seed.or(self.next_seeds[i]);
        let source = match seed {
            Some(seed) => Source { key: key_of(ChaCha8Rng::seed_from_u64(seed).get_seed()), episode: 1 },
            None => Source { key: key_of(self.rngs[i].get_seed()), episode: self.episodes[i].wrapping_add(1) },
        };
        let check = self.config.check_changed_robot(&self.actuator);
        let params = events.of_next_episode(&self.robots, i, source, seed.is_some(), &check);
        if params == *self.robots.params(i) {
            return self.robots.accepts(i, start);
        }
        self.robots.accepts_as(&params, start)
    }

    fn observation(&self, i: usize, out: &mut [f32]) {
        self.write_observation(i, out);
    }

    fn reward_terms(&self, i: usize, out: &mut [f64]) {
        for (out, cell) in out.iter_mut().zip(&self.ledger.terms) {
            *out = cell.get(i);
        }
    }

    fn metrics(&self, i: usize, out: &mut [f64]) {
        if self.ledger.episode.steps.get(i) == 0.0 {
            out.copy_from_slice(&self.metrics[i * out.len()..][..out.len()]);
            return;
        }
        let memory: Vec<_> = self.ledger.task.iter().map(|cell| cell.get(i)).collect();
        let mut measured = Vec::with_capacity(out.len());
        self.step.task.measure(&memory, self.config.control_dt, &mut measured);
        out.copy_from_slice(&measured);
    }

    fn running_metrics(&mut self, out: &mut [f64]) {
        for (i, row) in out.chunks_exact_mut(self.step.metrics()).enumerate() {
            if self.ledger.episode.steps.get(i) == 0.0 {
                row.fill(0.0);
                continue;
            }
            self.measure(i);
            for (out, value) in row.iter_mut().zip(&self.measured) {
                *out = if value.is_finite() { *value } else { 0.0 };
            }
        }
    }

    fn command(&self, i: usize, out: &mut [f64]) {
        out.iter_mut().zip(&self.ledger.task).for_each(|(out, cell)| *out = cell.get(i));
    }

    fn set_command(&mut self, i: usize, command: &[f64]) -> Result<()> {
        self.hold_command(i, command)
    }

    fn setpoint(&mut self, i: usize) -> Setpoint {
        self.read_memory(i);
        self.step.task.setpoint(&self.one.task)
    }

    fn state(&self, i: usize) -> State {
        self.robots.state(i)
    }

    fn contacts(&self, i: usize) -> Contacts {
        self.robots.contacts(i)
    }

    fn differentiated(
        &self,
        i: usize,
        parameters: &[Parameter],
        coordinates: Coordinates,
    ) -> Result<Box<dyn Differentiable>> {
        self.robots.differentiated(i, parameters, coordinates)
    }

    fn readings(&self, i: usize) -> Option<Readings<f64>> {
        self.step.sensor.readings(self.sensor_numbers(i))
    }

    fn estimate(&self, i: usize) -> Option<State> {
        self.step.sensor.estimate(self.sensor_numbers(i))
    }

    fn privileged_observation(&mut self, i: usize, out: &mut [f32]) {
        self.observe_truth(i, out);
    }

    fn params(&self, i: usize) -> &Params {
        self.robots.params(i)
    }

    fn nominal_params(&self, i: usize) -> &Params {
        self.events.as_ref().map_or_else(|| self.robots.params(i), |events| events.nominal(i))
    }

    fn draws(&self, i: usize) -> &[f64] {
        self.events.as_ref().map_or(&[], |events| events.draws(i))
    }

    fn drawn_stages(&self, i: usize) -> Option<&Stages> {
        self.events.as_ref().map(|events| events.stages(i))
    }

    fn repeated_draws(&self, i: usize) -> u32 {
        self.events.as_ref().map_or(0, |events| events.repeated(i))
    }

    fn push_count(&self, i: usize) -> u32 {
        self.events.as_ref().map_or(0, |events| events.push_count(i))
    }

    fn set_params(&mut self, i: usize, params: &Params) -> Result<()> {
        let Some(events) = &self.events else {
            self.replace_robot(i, params)?;
            self.inform(i);
            return Ok(());
        };
        params.validate()?;
        self.config.check_events(&events.plan, params)?;
        let robot = events.made_of(i, params);
        self.config.check_changed_robot(&self.actuator)(&robot)?;
        self.replace_robot(i, &robot.params)?;
        if let Some(events) = &mut self.events {
            events.set_nominal(i, params);
        }
        self.inform(i);
        Ok(())
    }

    fn push(&mut self, i: usize, impulse: &Vector3<f64>, point: Option<&Vector3<f64>>) -> Result<()> {
        self.robots.push(i, impulse, point)
    }

    fn apply_force(&mut self, i: usize, force: &Force) -> Result<()> {
        self.robots.apply_force(i, force)
    }

    fn has_riders(&self) -> bool {
        T::LEAN.is_some()
    }

    fn move_payload(&mut self, i: usize, payload: usize, offset: [f64; 3]) -> Result<()> {
        self.robots.move_payload(i, payload, offset)
    }

    fn payloads(&self, i: usize) -> [Deflection<f64>; PAYLOADS] {
        self.robots.payloads(i)
    }

    fn set_payloads(&mut self, i: usize, deflections: &[Deflection<f64>; PAYLOADS]) -> Result<()> {
        self.robots.set_payloads(i, deflections)
    }

    fn has_force(&self, i: usize) -> bool {
        self.robots.has_force(i)
    }

    fn pending_push(&self, i: usize) -> [f64; 6] {
        self.robots.pending_push(i)
    }

    fn seed(&mut self, i: usize, seed: u64) {
        self.next_seeds[i] = Some(seed);
    }

    fn shorten(&mut self, i: usize, steps: usize) {
        self.ledger.episode.limit.set(i, steps.clamp(1, self.config.max_episode_steps) as f64);
    }

    fn perceived(&self, i: usize, place: usize) -> &[f32] {
        self.sight.as_ref().map_or(&[], |sight| &sight.seen[i].readings[place].values)
    }

    fn level(&self, i: usize) -> usize {
        self.ledger.episode.level.get(i) as usize
    }

    fn first_over(&self) -> Option<usize> {
        self.over.iter().position(|&over| over)
    }

    fn begun(&self) -> bool {
        self.begun
    }

    fn save(&self, i: usize) -> Vec<u8> {
        self.save_one(i)
    }

    fn load(&mut self, i: usize, bytes: &[u8]) -> Result<()> {
        self.load_one(i, bytes)
    }
}
