//! Tasks by name: tasks of this crate, and tasks that other crates register.

use super::autoreset::Autoreset;
use super::batch::Batch;
use super::config::EnvConfig;
use super::events::Event;
use super::levels::Levels;
use super::observation_source::Observation;
use super::stage::CustomStage;
use crate::actuator::MotorOptions;
use crate::perception::{DepthOptions, ScanOptions};
use crate::robot::ModelKind;
use crate::sensor::SensorOptions;
use crate::task::{Balance, Bare, Goal, OpenBallBot, Path, Push, Task, TaskDescription, Traverse, Velocity};
use ballbot_base::error::{Error, Result};
use ballbot_base::params::Params;
use ballbot_base::terrain::Terrain;
use std::marker::PhantomData;
use std::sync::{Arc, PoisonError, RwLock};

/// A configuration of a task that is known only by name.
pub trait TaskConfig: Send {
    /// Replaces the robots' parameters.
    fn set_params(&mut self, params: Params);
    /// Replaces the model.
    fn set_model(&mut self, model: ModelKind);
    /// Replaces the ground.
    fn set_terrain(&mut self, terrain: Option<Arc<Terrain>>);
    /// The ground.
    fn terrain(&self) -> Option<&Arc<Terrain>>;
    /// Replaces the motors.
    fn set_actuators(&mut self, actuators: MotorOptions);
    /// The motors.
    fn actuators(&self) -> &MotorOptions;
    /// Replaces the sensors.
    fn set_sensors(&mut self, sensors: Option<SensorOptions>);
    /// The sensors.
    fn sensors(&self) -> Option<&SensorOptions>;
    /// Replaces the height scan.
    fn set_scan(&mut self, scan: Option<ScanOptions>);
    /// The height scan.
    fn scan(&self) -> Option<&ScanOptions>;
    /// Replaces the depth camera.
    fn set_depth(&mut self, depth: Option<DepthOptions>);
    /// The depth camera.
    fn depth(&self) -> Option<&DepthOptions>;
    /// Replaces the levels of the tiles that episodes begin on.
    fn set_levels(&mut self, levels: Levels);
    /// The levels of the tiles that episodes begin on.
    fn levels(&self) -> Levels;
    /// Replaces the observation source.
    fn set_observation(&mut self, observation: Observation);
    /// The observation source.
    fn observation(&self) -> Observation;
    /// Sets an option by its name: a time step, a torque, a switch (0 or 1), or an option of the task.
    ///
    /// # Errors
    /// [`Error::UnknownName`], [`Error::Length`] or [`Error::OutOfRange`].
    fn set(&mut self, name: &str, values: &[f64]) -> Result<()>;
    /// Value of an option by its name; `None` if there is no such option.
    fn get(&self, name: &str) -> Option<Vec<f64>>;
    /// Changes the scale of a reward term.
    ///
    /// # Errors
    /// [`Error::UnknownName`] if there is no such term.
    fn set_reward(&mut self, name: &str, scale: f64) -> Result<()>;
    /// The scales of all reward terms.
    fn reward(&self) -> Vec<(&'static str, f64)>;
    /// Replaces the events.
    fn set_events(&mut self, events: Vec<Event>);
    /// The events.
    fn events(&self) -> &[Event];
    /// Replaces the stage of the caller.
    fn set_stage(&mut self, stage: Option<CustomStage>);
    /// The environments.
    ///
    /// # Errors
    /// As [`Batch::new`].
    fn batch(&self, num_envs: usize, autoreset: Autoreset, num_threads: Option<usize>, seed: u64) -> Result<Batch>;
}

/// A task that is known by its name.
pub trait TaskKind: Sync {
    /// Its description.
    fn description(&self) -> TaskDescription;
    /// Its default configuration.
    fn config(&self) -> Box<dyn TaskConfig>;
}

struct Kind<T>(PhantomData<fn() -> T>);

impl<T: Task> TaskKind for Kind<T> {
    fn description(&self) -> TaskDescription {
        TaskDescription::of::<T>()
    }

    fn config(&self) -> Box<dyn TaskConfig> {
        Box::new(EnvConfig::<T>::default())
    }
}

/// The tasks of this crate.
static TASKS: [&dyn TaskKind; 7] = [
    &Kind::<Balance>(PhantomData),
    &Kind::<Velocity>(PhantomData),
    &Kind::<Goal>(PhantomData),
    &Kind::<Path>(PhantomData),
    &Kind::<Push>(PhantomData),
    &Kind::<Traverse>(PhantomData),
    &Kind::<OpenBallBot>(PhantomData),
];

/// Robots for tasks that are defined outside the core: not a task by itself, so it is not listed.
static BARE: &dyn TaskKind = &Kind::<Bare>(PhantomData);

/// The tasks of other crates.
static REGISTERED: RwLock<Vec<&'static dyn TaskKind>> = RwLock::new(Vec::new());

/// Registers a task by its name, like the tasks of this crate; see the example of [`Task`].
///
/// # Errors
/// [`Error::Inconsistent`] if its name is taken.
pub fn register_task<T: Task>() -> Result<()> {
    if task_kinds().iter().any(|kind| kind.description().name == T::NAME) {
        return Err(Error::Inconsistent(format!("there is a task '{}' already", T::NAME)));
    }
    let kind: &'static dyn TaskKind = Box::leak(Box::new(Kind::<T>(PhantomData)));
    REGISTERED.write().unwrap_or_else(PoisonError::into_inner).push(kind);
    Ok(())
}

/// All tasks.
pub fn task_kinds() -> Vec<&'static dyn TaskKind> {
    let registered = REGISTERED.read().unwrap_or_else(PoisonError::into_inner);
    TASKS.into_iter().chain(registered.iter().copied()).collect()
}

/// A task by its name; `bare` is [`Bare`].
///
/// # Errors
/// [`Error::UnknownName`] if there is no such task.
pub fn task_kind(name: &str) -> Result<&'static dyn TaskKind> {
    if name == Bare::NAME {
        return Ok(BARE);
    }
    let kinds = task_kinds();
    let names: Vec<_> = kinds.iter().map(|kind| kind.description().name).collect();
    let found = names.iter().position(|known| *known == name);
    found.map(|i| kinds[i]).ok_or_else(|| Error::unknown("task", name, &names))
}

impl<T: Task> TaskConfig for EnvConfig<T> {
    fn set_params(&mut self, params: Params) {
        self.params = params;
    }

    fn set_model(&mut self, model: ModelKind) {
        self.model = model;
    }

    fn set_terrain(&mut self, terrain: Option<Arc<Terrain>>) {
        self.terrain = terrain;
    }

    fn terrain(&self) -> Option<&Arc<Terrain>> {
        self.terrain.as_ref()
    }

    fn set_actuators(&mut self, actuators: MotorOptions) {
        self.actuators = actuators;
    }

    fn actuators(&self) -> &MotorOptions {
        &self.actuators
    }

    fn set_sensors(&mut self, sensors: Option<SensorOptions>) {
        self.sensors = sensors;
    }

    fn sensors(&self) -> Option<&SensorOptions> {
        self.sensors.as_ref()
    }

    fn set_scan(&mut self, scan: Option<ScanOptions>) {
        self.scan = scan;
    }

    fn scan(&self) -> Option<&ScanOptions> {
        self.scan.as_ref()
    }

    fn set_depth(&mut self, depth: Option<DepthOptions>) {
        self.depth = depth;
    }

    fn depth(&self) -> Option<&DepthOptions> {
        self.depth.as_ref()
    }

    fn set_levels(&mut self, levels: Levels) {
        self.levels = levels;
    }

    fn levels(&self) -> Levels {
        self.levels
    }

    fn set_observation(&mut self, observation: Observation) {
        self.observation = observation;
    }

    fn observation(&self) -> Observation {
        self.observation
    }

    fn set(&mut self, name: &str, values: &[f64]) -> Result<()> {
        let one = || match values {
            [value] => Ok(*value),
            _ => Err(Error::Length { name: name.into(), found: values.len(), expected: 1 }),
        };
        match name {
            "sim_dt" => self.sim_dt = one()?,
            "control_dt" => self.control_dt = one()?,
            "max_wheel_torque" => self.max_wheel_torque = Some(one()?),
            "scale_observations" => {
                let flag =
                    ballbot_base::error::check(name, one()?, "0 or 1 (False or True)", |f| f == 0.0 || f == 1.0)?;
                self.scale_observations = flag != 0.0;
            }
            "history" => {
                let length = one()?;
                ballbot_base::error::check(name, length, "a whole number from 1 on", |n| {
                    (1.0..=f64::from(u32::MAX)).contains(&n) && n.fract() == 0.0
                })?;
                self.history = length as usize;
            }
            "max_episode_steps" => {
                let steps = one()?;
                ballbot_base::error::check(name, steps, "a whole number from 1 to 2^53", |s| {
                    (1.0..=9_007_199_254_740_992.0).contains(&s) && s.fract() == 0.0
                })?;
                self.max_episode_steps = steps as usize;
            }
            _ => self.task.set(name, values)?,
        }
        Ok(())
    }

    fn get(&self, name: &str) -> Option<Vec<f64>> {
        Some(match name {
            "sim_dt" => vec![self.sim_dt],
            "control_dt" => vec![self.control_dt],
            "max_wheel_torque" => vec![self.action_torque()],
            "scale_observations" => vec![f64::from(u8::from(self.scale_observations))],
            "history" => vec![self.history as f64],
            "max_episode_steps" => vec![self.max_episode_steps as f64],
            _ => {
                let index = T::FIELDS.iter().position(|field| field.name == name)?;
                self.task.values(index).to_vec()
            }
        })
    }

    fn set_reward(&mut self, name: &str, scale: f64) -> Result<()> {
        self.reward.set(name, scale)
    }

    fn reward(&self) -> Vec<(&'static str, f64)> {
        self.reward.names().zip(self.reward.values()).collect()
    }

    fn set_events(&mut self, events: Vec<Event>) {
        self.events = events;
    }

    fn events(&self) -> &[Event] {
        &self.events
    }

    fn set_stage(&mut self, stage: Option<CustomStage>) {
        self.stage = stage;
    }

    fn batch(&self, num_envs: usize, autoreset: Autoreset, num_threads: Option<usize>, seed: u64) -> Result<Batch> {
        Batch::new(self, num_envs, autoreset, num_threads, seed)
    }
}
