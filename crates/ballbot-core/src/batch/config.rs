//! Everything that defines an environment.

use super::events::{Event, Plan, Setup, Stages, TASK_ID, Tests, When, check_effects, invalid_event};
use super::history::History;
use super::integral::Integral;
use super::levels::Levels;
use super::observation_source::Observation;
use super::scalars::{Scalar, ScalarOption, env_config};
use super::stage::CustomStage;
use crate::actuator::{Actuator, Drive, Ideal, MotorOptions, Motors};
use crate::control::default_max_torque;
use crate::perception::{Instruments, Perception};
use crate::robot::{Ballbot, ModelKind, SIM_DT, check_sim_dt};
use crate::sensor::{Onboard, SensorOptions};
use crate::task::{Balance, Growth, RewardScales, Row, RowScaling, Task, TaskDescription};
use ballbot_base::error::{Error, Result, check, positive};
use ballbot_base::fields::{Fields, Limit};
use ballbot_base::model::same_geometry;
use ballbot_base::params::Params;
use ballbot_base::terrain::{Ground, Terrain, static_lean};
use ballbot_models::Scale;
use std::sync::Arc;

env_config! {
    /// A robot, its model, the time steps, and a task. SI units and radians.
    pub struct EnvConfig<T> {
        scalars {
            /// Time step of the model.
            pub sim_dt: f64 = 0.002, "s", SIM_DT;
            /// Time between two actions, a whole multiple of `sim_dt`.
            pub control_dt: f64 = 0.01, "s", Limit::POSITIVE;
            /// Steps after which an episode is truncated.
            pub max_episode_steps: usize = T::MAX_EPISODE_STEPS, "", Limit::from(1.0);
            /// Torque of an action of 1, at most `params.max_wheel_torque`; None follows from the traction of the upright
            /// robot: an untrained policy then explores torques that balance a robot, not torques that topple it. With
            /// `scale_by_robot` it is 0.4 N·m on the paper's robot, and on any robot as large in proportion to the torque
            /// that holds its largest lean, within the motors' limit.
            pub max_wheel_torque: Option<f64> = None, "N·m", Limit::from(1e-9);
            /// Whether each row, minus its value at rest, is divided by its typical magnitude, within ±10.
            pub scale_observations: bool = true, "", Limit::FINITE;
            /// Whether typical magnitudes, and the default of `max_wheel_torque`, are scaled from the paper's robot to this
            /// robot by `Params.scale`, by the lean that it can hold (less where the motors limit an action), and lengths,
            /// velocities and wheel speeds by the acceleration that a lean gives: robots of all sizes then look alike to a
            /// policy.
            pub scale_by_robot: bool = false, "", Limit::FINITE;
            /// Integral action of a policy: rate at which the integral of the position error grows. It is added to the observed
            /// error, which grows while the robot rests away from the setpoint. It begins at zero with each episode, turns with
            /// the heading, and hardly changes while the ball moves; the observed error is then at most 4 times the typical. 0
            /// for neither; otherwise `scale_observations` is required, and a task that observes the error: `balance` or
            /// `push`. With `scale_by_robot` it is the rate on the paper's robot.
            pub integral_rate: f64 = 0.0, "1/s", Limit::NOT_NEGATIVE.to(10.0);
        }
        /// The robots, unless [`super::Batch::set_params`] makes them differ.
        pub params: Params = Params::paper();
        /// Their model.
        pub model: ModelKind = ModelKind::default();
        /// The ground; `None` for the ground of the task, which is level for most tasks. Starts are moved to the ground
        /// with the static lean there; an episode that leaves the ground is truncated.
        pub terrain: Option<Arc<Terrain>> = None;
        /// The motors between actions and torques.
        pub actuators: MotorOptions = MotorOptions::default();
        /// The sensors of the robots; `None` for robots without sensors, which have no readings.
        pub sensors: Option<SensorOptions> = None;
        /// The instruments that observe the ground.
        pub instruments: Instruments = Instruments::default();
        /// Levels of the tiles that episodes begin on, if the terrain has tiles.
        pub levels: Levels = Levels::default();
        /// Which of the last observations are given together.
        pub history: History = History::default();
        /// Source of the rows of an observation.
        pub observation: Observation = Observation::default();
        /// Scales of the reward's terms.
        pub reward: RewardScales = RewardScales::of(&TaskDescription::of::<T>().terms);
        /// Options of the task.
        pub task: T = T::unset();
        /// Randomization of the robots and pushes, in addition to random starts.
        pub events: Vec<Event> = Vec::new();
        /// Reward terms, observation rows and terminations that the caller computes.
        pub stage: Option<CustomStage> = None;
    }
}

/// Torque of an action of 1 on the paper's robot, from which it is scaled with [`EnvConfig::scale_by_robot`], N·m.
const PAPER_ACTION: f64 = 0.4;

/// [`EnvConfig`] of the balance task.
pub type BalanceConfig = EnvConfig<Balance>;

impl<T: Task> EnvConfig<T> {
    /// The task with what the stage of the caller adds.
    pub(super) fn description(&self) -> TaskDescription {
        let mut description = TaskDescription::of::<T>();
        if let Some(stage) = &self.stage {
            stage.extend(&mut description);
        }
        description
    }

    /// Torque of an action of 1, N·m.
    pub fn action_torque(&self) -> f64 {
        self.max_wheel_torque.unwrap_or_else(|| self.derived("max_wheel_torque"))
    }

    /// The value of an option that is `None`.
    fn derived(&self, name: &str) -> f64 {
        match name {
            "max_wheel_torque" if self.scale_by_robot => {
                let Scale { torque, lean, .. } = Scale::of(&self.params);
                (PAPER_ACTION * torque * lean).min(self.params.max_wheel_torque)
            }
            "max_wheel_torque" => default_max_torque(&self.params),
            other => unreachable!("{other} has a value"),
        }
    }

    /// The scaling of the rows of an observation, if they are scaled.
    pub(super) fn row_scaling(&self, description: &TaskDescription) -> Option<RowScaling> {
        let TaskDescription { rows, scaling, .. } = description;
        if !self.scale_observations || !self.scale_by_robot {
            return self.scale_observations.then(|| scaling.clone());
        }
        let scale = Scale::of(&self.params);
        // A motion is as large as the lean that starts it, its lengths and velocities as the acceleration that the lean
        // gives. By default an action of 1 holds less of the lean where the motors limit it: the gains of a policy must
        // not depend on that.
        let lean = self.derived("max_wheel_torque") / (PAPER_ACTION * scale.torque);
        let motion = lean * scale.lean_acceleration;
        let factor = |row: &Row| match (row.growth, row.unit) {
            (Growth::WheelSpeed, _) => motion * scale.wheel_speed,
            (Growth::Unit, unit @ ("m" | "m/s" | "m/s²" | "m/s³")) => motion * scale.factor(unit).unwrap_or(1.0),
            (Growth::Lean, _) | (Growth::Unit, "rad") => lean,
            (Growth::Unit, "") => 1.0,
            (Growth::Unit, unit) => lean * scale.factor(unit).unwrap_or(1.0),
        };
        let gain = rows.iter().zip(&scaling.gain).map(|(row, gain)| gain / factor(row)).collect();
        Some(RowScaling { rest: scaling.rest.clone(), gain })
    }

    /// All numbers that the future of an environment depends on, except its robot's parameters. An estimator is
    /// designed for the robot before events and `set_params`, which a snapshot does not store otherwise; observations
    /// may be scaled to it.
    pub(super) fn numbers(&self) -> Vec<f64> {
        let mut numbers = self.scalars().to_vec();
        numbers.extend(self.reward.values());
        numbers.extend(self.history.numbers());
        numbers.extend(self.task.numbers());
        numbers.extend(self.actuators.numbers());
        if let Some(terrain) = &self.terrain {
            let print = terrain.fingerprint();
            numbers.extend([print as u32, (print >> 32) as u32].map(f64::from));
        }
        numbers.extend(self.instruments.numbers());
        numbers.push(self.levels.number());
        let estimated = self.observation == Observation::Sensors;
        numbers.push(f64::from(u8::from(estimated)));
        numbers.extend(self.sensors.iter().flat_map(|sensors| sensors.numbers()));
        if estimated || self.scale_by_robot {
            numbers.extend(self.params.numbers());
        }
        numbers.extend(self.stage.iter().flat_map(|stage| &stage.0.layout().terms).map(|term| term.scale));
        numbers
    }

    /// The stage between actions and torques.
    ///
    /// # Errors
    /// The errors of [`Motors::new`] and [`EnvConfig::validate`].
    pub(super) fn drive(&self) -> Result<Drive> {
        if let Some(plan) = self.plan()?.filter(|plan| plan.individual_motors) {
            let largest = plan.largest_options(&self.setup(&self.params)).actuators;
            let (torque, substeps) = (self.action_torque(), self.substeps()?);
            return Motors::individual(&largest, &self.params, torque, self.sim_dt, substeps).map(Drive::Motors);
        }
        Ok(match self.not_ideal()? {
            None => Drive::Ideal(Ideal { max_torque: self.action_torque() }),
            Some(motors) => Drive::Motors(motors),
        })
    }

    /// The motors, unless they are ideal.
    fn not_ideal(&self) -> Result<Option<Motors>> {
        if self.actuators.is_ideal() { Ok(None) } else { self.motors().map(Some) }
    }

    /// The motors of [`EnvConfig::actuators`] in the time steps of this environment.
    ///
    /// # Errors
    /// The errors of [`Motors::new`] and [`EnvConfig::substeps`].
    pub fn motors(&self) -> Result<Motors> {
        Motors::new(&self.actuators, &self.params, self.action_torque(), self.sim_dt, self.substeps()?)
    }

    /// The sensors of [`EnvConfig::sensors`]; exact sensors if a task observes through sensors that are not given;
    /// `None` if there are none. With events on sensors, each robot has its own.
    ///
    /// # Errors
    /// The errors of [`EnvConfig::substeps`] and [`Onboard::new`]; [`Error::Inconsistent`] for events on sensors that
    /// are not given.
    pub fn onboard(&self) -> Result<Option<Onboard>> {
        let estimated = self.observation == Observation::Sensors;
        let plan = self.plan()?.filter(|plan| plan.individual_sensors);
        if self.sensors.is_none() && !estimated {
            return match plan {
                None => Ok(None),
                Some(_) => Err(Error::Inconsistent(
                    "events change options of the sensors, but the robots have none: give sensors, exact ones for example"
                        .into(),
                )),
            };
        }
        self.substeps()?;
        let options = self.sensors.clone().unwrap_or_default();
        let observer = estimated.then_some(&self.params);
        let turns = self.floors_may_turn();
        let Some(plan) = plan else {
            return Ok(Some(Onboard::new(&options, self.control_dt, observer)?.on_turning_floor(turns)));
        };
        let largest = plan.largest_options(&self.setup(&self.params)).sensors;
        Ok(Some(Onboard::individual(&options, &largest, self.control_dt, observer)?.on_turning_floor(turns)))
    }

    /// Whether the floor of a robot may turn.
    fn floors_may_turn(&self) -> bool {
        self.params.floor_tilt_amplitude != [0.0; 2] || self.changes("floor_tilt_amplitude")
    }

    /// Whether the floor of a robot may move.
    pub(super) fn floors_may_move(&self) -> bool {
        self.params.has_moving_floor() || self.floors_may_turn() || self.changes("floor_acceleration")
    }

    /// Whether an event changes a parameter.
    fn changes(&self, term: &str) -> bool {
        self.events.iter().any(|event| event.term == term)
    }

    /// Checks that the sensors, if there are any, measure how the floor of a robot turns.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] naming the motion.
    pub(super) fn check_floor(&self, params: &Params) -> Result<()> {
        let senses = self.sensors.is_some() || self.observation == Observation::Sensors;
        if senses && !self.floors_may_turn() && params.floor_tilt_amplitude != [0.0; 2] {
            return Err(Error::Inconsistent(format!(
                "floor_tilt_amplitude = {:?}: the sensors were made for floors that do not turn; give the amplitude to the robot \
                 of the environment, or to an event",
                params.floor_tilt_amplitude
            )));
        }
        Ok(())
    }

    /// The instruments that observe the ground, if there are any.
    ///
    /// # Errors
    /// The errors of [`Perception::new`].
    pub fn perception(&self) -> Result<Option<Perception>> {
        Perception::new(&self.instruments, &self.params, self.control_dt, self.scale_observations)
    }

    /// The options of the stages before events.
    pub(super) fn stages(&self) -> Stages {
        Stages { actuators: self.actuators.clone(), sensors: self.sensors.clone().unwrap_or_default() }
    }

    fn setup(&self, params: &Params) -> Setup {
        Setup { params: params.clone(), stages: self.stages() }
    }

    fn check_sensors(&self, options: &SensorOptions) -> Result<()> {
        options.check(self.control_dt, self.observation == Observation::Sensors)
    }

    /// Model steps in one control step.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] if `control_dt` is not a whole multiple of `sim_dt`.
    pub fn substeps(&self) -> Result<usize> {
        check_sim_dt(self.sim_dt)?;
        positive("control_dt", self.control_dt)?;
        let ratio = self.control_dt / self.sim_dt;
        check(
            "control_dt / sim_dt",
            ratio,
            format_args!("a whole number from 1 to 10000 (control_dt = {}, sim_dt = {})", self.control_dt, self.sim_dt),
            |r| (r - r.round()).abs() <= 1e-6 * r && (0.5..10000.5).contains(&r),
        )?;
        Ok(ratio.round() as usize)
    }

    /// Checks that the environment can be run.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] or [`Error::Inconsistent`] naming the value and the limit.
    pub fn validate(&self) -> Result<()> {
        self.resolved()?.validate_resolved()
    }

    /// [`EnvConfig::validate`] of a configuration of [`EnvConfig::resolved`].
    pub(super) fn validate_resolved(&self) -> Result<()> {
        self.params.validate()?;
        self.substeps()?;
        SCALAR_OPTIONS.iter().zip(self.scalars()).try_for_each(|(option, value)| option.check(value))?;
        self.history.check()?;
        self.task.check_limits()?;
        self.task.validate(&self.params)?;
        self.onboard()?;
        self.validate_robot(&self.params)?;
        self.reward.validate()?;
        self.stage.as_ref().map_or(Ok(()), |stage| stage.check(&TaskDescription::of::<T>()))?;
        self.check_terrain()?;
        self.perception()?;
        Integral::of(self, &TaskDescription::of::<T>())?;
        let Some(plan) = self.plan()? else { return Ok(()) };
        check_effects(&self.events, self.model, &self.params)?;
        self.check_torque_limits(&plan)?;
        self.check_events(&plan, &self.params)
    }

    /// Checks that events on the torque of the motors limit a torque that actions can command.
    fn check_torque_limits(&self, plan: &Plan) -> Result<()> {
        const TERM: &str = "max_wheel_torque";
        let limits = |event: &Event| event.term == TERM && !event.optional;
        let Some(place) = self.events.iter().position(limits) else { return Ok(()) };
        let motors = plan.largest_options(&self.setup(&self.params)).actuators;
        let peak = motors.peak_torque;
        if peak > 0.0 {
            return Err(invalid_event(
                place,
                TERM,
                &format!("it changes nothing: the motors have peak_torque = {peak} N·m"),
            ));
        }
        let commanded = self.action_torque() * motors.strength.into_iter().fold(0.0, f64::max);
        let least = plan.least_torque(self.params.max_wheel_torque);
        // The back-EMF of a motor with a torque-speed curve exceeds the command.
        if motors.stall_torque > 0.0 || least < commanded {
            return Ok(());
        }
        let reason = format!(
            "it changes nothing: motors of at least {least} N·m give all of the largest torque that actions ask for, \
             {commanded} N·m, the option max_wheel_torque times actuators.strength"
        );
        Err(invalid_event(place, TERM, &reason))
    }

    /// Checks that the robots can start on the terrain, and that no event changes something incompatible with it.
    fn check_terrain(&self) -> Result<()> {
        let tiles = self.terrain.as_ref().and_then(|terrain| terrain.tiles());
        self.levels.check(tiles)?;
        let Some(terrain) = &self.terrain else { return Ok(()) };
        if tiles.is_some() && !T::ANYWHERE {
            return Err(Error::Inconsistent(format!(
                "the terrain has tiles, on which robots start in many places, but the task '{}' has its place at the origin",
                T::NAME
            )));
        }
        self.params.require_level("a robot on a terrain")?;
        if self.events.iter().any(|event| event.term == "floor_tilt") {
            return Err(Error::Inconsistent(
                "an event changes floor_tilt, which robots on a terrain do not have: give the terrain the slope".into(),
            ));
        }
        let lean = static_lean(&self.params, &terrain.normal(0.0, 0.0), [0.0; 2])?.norm();
        let option = |name: &str| {
            let index = T::FIELDS.iter().position(|field| field.name == name)?;
            self.task.values(index).first().copied()
        };
        if let (Some(reset), Some(fall)) = (option("reset_tilt"), option("fall_tilt"))
            && lean + reset >= fall
        {
            return Err(Error::Inconsistent(format!(
                "the terrain is steep where robots start: the lean at rest there is {lean:.3} rad, which with \
                 reset_tilt = {reset} is not below fall_tilt = {fall}"
            )));
        }
        Ok(())
    }

    /// The task with the options that follow from the robot where they are unset.
    pub(super) fn fitted_task(&self) -> T {
        Scale::of(&self.params).fit(&self.task)
    }

    /// The same configuration with all options of the task, and with its ground where none is chosen.
    ///
    /// # Errors
    /// The errors of [`Params::validate`], [`Fields::check_limits`] and [`Task::terrain`].
    pub(super) fn resolved(&self) -> Result<Self> {
        self.params.validate()?;
        let mut config = Self { task: self.fitted_task(), ..self.clone() };
        config.task.check_limits()?;
        config.params = config.task.robot(&config.params);
        if config.terrain.is_none() {
            config.terrain = config.task.terrain(&config.params)?;
        }
        Ok(config)
    }

    /// The ground of the robots.
    ///
    /// # Errors
    /// The errors of [`Ground::new`].
    pub(super) fn ground(&self) -> Result<Option<Arc<Ground>>> {
        self.terrain.as_ref().map(|terrain| Ground::shared(terrain, self.params.ball_radius)).transpose()
    }

    /// The plan of the events, if there are any.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] for an event that is invalid for any robot.
    pub(super) fn plan(&self) -> Result<Option<Arc<Plan>>> {
        let pushes = self.task.pushes(&self.params).map(|pushes| Event {
            when: When::Every(pushes.every),
            id: Some(TASK_ID),
            duration: pushes.duration,
            ..Event::new("push", pushes.impulse)
        });
        let senses = self.sensors.is_some() || self.observation == Observation::Sensors;
        let slips = matches!(self.model, ModelKind::Contact | ModelKind::Rigid);
        let events: Vec<_> = self.events.iter().cloned().chain(pushes).collect();
        let plan = Plan::new(&events, &self.params, [senses, slips], self.sim_dt, self.control_dt)?;
        Ok((!plan.events.is_empty()).then(|| Arc::new(plan)))
    }

    /// Checks that every robot that the events may produce from a valid robot can be run.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] with the term of an event that may produce an invalid robot.
    pub(super) fn check_events(&self, plan: &Plan, nominal: &Params) -> Result<()> {
        self.validate_robot(nominal)?;
        // Computed once: it takes longer than everything else.
        let (torque, motors, substeps) = (self.action_torque(), self.not_ideal()?, self.substeps()?);
        let robot = |robot: &Setup| {
            let params = &robot.params;
            params.validate()?;
            params.validate_payload_step(self.sim_dt)?;
            if plan.individual_motors {
                Motors::new(&robot.stages.actuators, params, torque, self.sim_dt, substeps)?;
            } else {
                check_drive(torque, motors.as_ref(), params, self.sim_dt)?;
            }
            if plan.individual_sensors {
                self.check_sensors(&robot.stages.sensors)?;
            }
            self.task.validate(params)
        };
        let nominal = self.setup(nominal);
        robot(&nominal)?;
        if self.model != ModelKind::Contact {
            Ballbot::new(&nominal.params, self.model, self.sim_dt)?;
        }
        let starts = |robot: &Setup| {
            let params = &robot.params;
            // `contact` accepts every robot, and rejects starts only because of the robot's shape.
            if *params == nominal.params || self.model == ModelKind::Contact && same_geometry(params, &nominal.params) {
                return Ok(());
            }
            let robot = Ballbot::new(params, self.model, self.sim_dt)?;
            self.task.extreme_starts(params).iter().try_for_each(|start| robot.accepts(start))
        };
        plan.check(&nominal, &Tests { robot: &robot, starts: &starts })
    }

    /// Whether a robot changed by events is valid, in addition to the checks of its model.
    pub(super) fn check_changed_robot<A: Actuator>(&self, actuator: &A) -> impl Fn(&Setup) -> Result<()> {
        // The sensors of the configuration have passed.
        let passed = self.sensors.clone().unwrap_or_default();
        move |robot| {
            actuator.fits(&robot.stages.actuators, &robot.params)?;
            if robot.stages.sensors != passed {
                self.check_sensors(&robot.stages.sensors)?;
            }
            if let Some(terrain) = &self.terrain {
                Ground::check_radius(terrain, robot.params.ball_radius)?;
            }
            self.task.validate(&robot.params)
        }
    }

    /// Checks that a valid robot can be driven by the actions of this environment.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] if an action exceeds the motors' limit.
    pub(super) fn validate_robot(&self, params: &Params) -> Result<()> {
        let motors = self.not_ideal()?;
        check_drive(self.action_torque(), motors.as_ref(), params, self.sim_dt)
    }
}

/// Checks that the torque of an action, and of motors that are not ideal, is within the limit of a robot, and that time
/// steps are short enough for its payload.
fn check_drive(torque: f64, motors: Option<&Motors>, params: &Params, sim_dt: f64) -> Result<()> {
    params.check_torque("max_wheel_torque", torque)?;
    params.validate_payload_step(sim_dt)?;
    motors.map_or(Ok(()), |motors| motors.check_robot(params, sim_dt))
}
