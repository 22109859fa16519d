//! Tasks by name: tasks of this crate, and tasks that other crates register.

use super::autoreset::Autoreset;
use super::batch::Batch;
use super::config::{EnvConfig, SCALAR_OPTIONS};
use super::events::Event;
use super::history::History;
use super::levels::Levels;
use super::observation_source::Observation;
use super::stage::CustomStage;
use crate::actuator::MotorOptions;
use crate::perception::Instruments;
use crate::robot::ModelKind;
use crate::sensor::SensorOptions;
use crate::task::{
    Balance, Bare, Carry, Goal, Navigate, OpenBallBot, Path, Push, Ride, Task, TaskDescription, Traverse, Velocity,
};
use ballbot_base::error::{Error, Result};
use ballbot_base::params::Params;
use ballbot_base::registry::{Named, Registry};
use ballbot_base::terrain::Terrain;
use std::marker::PhantomData;
use std::slice;
use std::sync::Arc;

/// The options of [`EnvConfig`] that are not single numbers: getter, setter and type.
macro_rules! structured {
    ($expand:ident) => {
        $expand! {
            /// The robots' parameters.
            params, set_params: Params;
            /// The model.
            model, set_model: ModelKind;
            /// The ground.
            terrain, set_terrain: Option<Arc<Terrain>>;
            /// The motors.
            actuators, set_actuators: MotorOptions;
            /// The sensors.
            sensors, set_sensors: Option<SensorOptions>;
            /// The levels of the tiles that episodes begin on.
            levels, set_levels: Levels;
            /// Which of the last observations are given together.
            history, set_history: History;
            /// The observation source.
            observation, set_observation: Observation;
            /// The events.
            events, set_events: Vec<Event>;
            /// The stage of the caller.
            stage, set_stage: Option<CustomStage>;
        }
    };
}

macro_rules! declared {
    ($($(#[$doc:meta])* $name:ident, $set:ident: $type:ty;)*) => {$(
        $(#[$doc])*
        fn $name(&self) -> &$type;
        #[doc = concat!("Replaces [`TaskConfig::", stringify!($name), "`].")]
        fn $set(&mut self, value: $type);
    )*};
}

macro_rules! defined {
    ($($(#[$doc:meta])* $name:ident, $set:ident: $type:ty;)*) => {$(
        fn $name(&self) -> &$type {
            &self.$name
        }

        fn $set(&mut self, value: $type) {
            self.$name = value;
        }
    )*};
}

/// A configuration of a task that is known only by name.
pub trait TaskConfig: Send {
    structured!(declared);

    /// The instruments.
    fn instruments(&self) -> &Instruments;
    /// The same, to be changed.
    fn instruments_mut(&mut self) -> &mut Instruments;

    /// Sets an option by its name: a time step, a torque, a switch (0 or 1), or an option of the task.
    ///
    /// # Errors
    /// [`Error::UnknownName`], [`Error::Length`] or [`Error::OutOfRange`].
    fn set(&mut self, name: &str, values: &[f64]) -> Result<()>;
    /// Value of an option by its name; `None` if there is no such option.
    fn get(&self, name: &str) -> Option<Vec<f64>>;
    /// Whether the default of an option follows from the robot.
    fn is_scaled(&self, name: &str) -> bool;
    /// Changes the scale of a reward term.
    ///
    /// # Errors
    /// [`Error::UnknownName`] if there is no such term.
    fn set_reward(&mut self, name: &str, scale: f64) -> Result<()>;
    /// The scales of all reward terms.
    fn reward(&self) -> Vec<(&'static str, f64)>;
    /// The environments.
    ///
    /// # Errors
    /// As [`Batch::new`].
    fn batch(&self, num_envs: usize, autoreset: Autoreset, num_threads: Option<usize>, seed: u64) -> Result<Batch> {
        self.batch_of(slice::from_ref(self.params()), num_envs, autoreset, num_threads, seed)
    }

    /// The environments of several robots, in place of [`TaskConfig::params`].
    ///
    /// # Errors
    /// As [`Batch::of_robots`].
    fn batch_of(
        &self,
        robots: &[Params],
        num_envs: usize,
        autoreset: Autoreset,
        num_threads: Option<usize>,
        seed: u64,
    ) -> Result<Batch>;
}

/// A task that is known by its name.
pub trait TaskKind: Sync {
    /// Its description.
    fn description(&self) -> TaskDescription;
    /// Its default configuration.
    fn config(&self) -> Box<dyn TaskConfig>;
}

impl Named for &'static dyn TaskKind {
    fn name(&self) -> &'static str {
        self.description().name
    }
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
static TASKS: [&dyn TaskKind; 10] = [
    &Kind::<Balance>(PhantomData),
    &Kind::<Velocity>(PhantomData),
    &Kind::<Goal>(PhantomData),
    &Kind::<Path>(PhantomData),
    &Kind::<Push>(PhantomData),
    &Kind::<Carry>(PhantomData),
    &Kind::<Navigate>(PhantomData),
    &Kind::<Ride>(PhantomData),
    &Kind::<Traverse>(PhantomData),
    &Kind::<OpenBallBot>(PhantomData),
];

/// Robots for tasks that are defined outside the core: not a task by itself, so it is not listed.
static BARE: &dyn TaskKind = &Kind::<Bare>(PhantomData);

static REGISTRY: Registry<&dyn TaskKind> = Registry::new("task", &TASKS);

/// Registers a task by its name, like the tasks of this crate; see the example of [`Task`].
///
/// # Errors
/// [`Error::Inconsistent`] if its name is taken.
pub fn register_task<T: Task>() -> Result<()> {
    REGISTRY.register(Box::leak(Box::new(Kind::<T>(PhantomData))))
}

/// All tasks.
pub fn task_kinds() -> Vec<&'static dyn TaskKind> {
    REGISTRY.all()
}

/// A task by its name; `bare` is [`Bare`].
///
/// # Errors
/// [`Error::UnknownName`] if there is no such task.
pub fn task_kind(name: &str) -> Result<&'static dyn TaskKind> {
    if name == Bare::NAME { Ok(BARE) } else { REGISTRY.find(name) }
}

impl<T: Task> TaskConfig for EnvConfig<T> {
    structured!(defined);

    fn instruments(&self) -> &Instruments {
        &self.instruments
    }

    fn instruments_mut(&mut self) -> &mut Instruments {
        &mut self.instruments
    }

    fn set(&mut self, name: &str, values: &[f64]) -> Result<()> {
        if !SCALAR_OPTIONS.iter().any(|option| option.name == name) {
            return self.task.set(name, values);
        }
        match values {
            [value] => self.set_scalar(name, *value).expect("a scalar option"),
            _ => Err(Error::Length { name: name.into(), found: values.len(), expected: 1 }),
        }
    }

    fn get(&self, name: &str) -> Option<Vec<f64>> {
        let scalar = SCALAR_OPTIONS.iter().zip(self.scalars()).find(|(option, _)| option.name == name);
        match scalar {
            Some((_, value)) => Some(vec![value]),
            None => T::index_of(name).map(|index| self.fitted_task().values(index).to_vec()),
        }
    }

    fn is_scaled(&self, name: &str) -> bool {
        T::FIELDS.iter().any(|field| field.name == name && field.scaled)
    }

    fn set_reward(&mut self, name: &str, scale: f64) -> Result<()> {
        self.reward.set(name, scale)
    }

    fn reward(&self) -> Vec<(&'static str, f64)> {
        self.reward.names().zip(self.reward.values()).collect()
    }

    fn batch_of(
        &self,
        robots: &[Params],
        num_envs: usize,
        autoreset: Autoreset,
        num_threads: Option<usize>,
        seed: u64,
    ) -> Result<Batch> {
        Batch::of_robots(self, robots, num_envs, autoreset, num_threads, seed)
    }
}
