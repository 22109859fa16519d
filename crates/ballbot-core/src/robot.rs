//! A simulated robot with any model of the ladder; its input is checked and divergence is reported.

mod derivatives;
pub(crate) mod standing;

use crate::models::{PlanarMotion, SpatialMotion};
use ballbot_base::error::{Error, Result, check};
use ballbot_base::fields::{Fields, Limit};
use ballbot_base::force::{Force, HeldForce};
use ballbot_base::interrupt::Watch;
use ballbot_base::lane_state::LaneState;
use ballbot_base::model::{Model, same_geometry};
use ballbot_base::names;
use ballbot_base::params::Params;
use ballbot_base::payload::{Deflection, PAYLOADS};
use ballbot_base::snapshot;
use ballbot_base::state::{Contacts, State};
use ballbot_base::terrain::Ground;
use ballbot_base::wheels::Wheels;
use ballbot_contact::ContactMotion;
#[cfg(feature = "rigid")]
use ballbot_rigid::RigidMotion;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

/// Rungs of the ladder of models, from the simplest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ModelKind {
    /// Three decoupled planes, eqs. (1)-(7) of the paper, for robots that are symmetric about their mast.
    Planar,
    /// Coupled 3D motion without slip.
    Spatial,
    /// Ball, body and wheels with unilateral contacts and Coulomb friction on the ground, with a dedicated solver.
    #[default]
    Contact,
    /// Rigid bodies with contacts and Coulomb friction, with rapier3d; needs the cargo feature `rigid`.
    Rigid,
}

impl ModelKind {
    /// All kinds.
    pub const ALL: [Self; 4] = [Self::Planar, Self::Spatial, Self::Contact, Self::Rigid];

    /// Name in options.
    pub fn name(self) -> &'static str {
        match self {
            Self::Planar => "planar",
            Self::Spatial => "spatial",
            Self::Contact => "contact",
            Self::Rigid => "rigid",
        }
    }

    /// Approximate duration of a time step on a core of 2025, s; in lanes where there are lanes.
    pub(crate) fn step_seconds(self) -> f64 {
        match self {
            Self::Planar => 0.6e-6,
            Self::Spatial => 1.2e-6,
            Self::Contact => 0.04e-6,
            Self::Rigid => 9e-6,
        }
    }

    /// Approximate memory of a robot, including its part of an environment.
    pub(crate) fn bytes(self) -> usize {
        match self {
            Self::Planar | Self::Spatial | Self::Contact => 2000,
            Self::Rigid => 95_000,
        }
    }

    /// Checks that the model simulates the wheels of a robot.
    pub(crate) fn require(self, params: &Params, sim_dt: f64) -> Result<()> {
        params.validate_payload_step(sim_dt)?;
        if matches!(self, Self::Contact | Self::Rigid) {
            return Ok(());
        }
        if self == Self::Planar {
            params
                .require_no_payload("the model 'planar' has a rigid body; 'spatial', 'contact' and 'rigid' take any")?;
            params.require_still_floor(
                "the model 'planar' is of a level floor; 'spatial', 'contact' and 'rigid' take any",
            )?;
        }
        params.require_even_friction(
            "the models 'planar' and 'spatial' roll without slip, whatever the friction; 'contact' and 'rigid' slip",
        )?;
        params.require_round_wheels(
            "the models 'planar' and 'spatial' roll on round wheels; 'contact' and 'rigid' have the ripple of rollers",
        )
    }

    /// A robot of this kind, upright at rest.
    fn build(self, params: &Params, sim_dt: f64) -> Result<Box<dyn Model>> {
        self.require(params, sim_dt)?;
        Ok(match self {
            Self::Planar => Box::new(PlanarMotion::new(params, sim_dt)?),
            Self::Spatial => Box::new(SpatialMotion::new(params, sim_dt)),
            Self::Contact => Box::new(ContactMotion::new(params, sim_dt)),
            #[cfg(feature = "rigid")]
            Self::Rigid => Box::new(RigidMotion::new(params, sim_dt)?),
            #[cfg(not(feature = "rigid"))]
            Self::Rigid => return Err(Error::MissingFeature { what: "the model 'rigid'".into(), feature: "rigid" }),
        })
    }
}

impl fmt::Display for ModelKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for ModelKind {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        names::find("model", name, Self::ALL, Self::name)
    }
}

/// Time steps that the models support, s.
pub(crate) const SIM_DT: Limit = Limit::from(1e-6).to(0.02);

/// Limits of a push, N·s and m: far beyond what a robot survives, far below what overflows.
const MAX_IMPULSE: f64 = 1e4;
const MAX_ARM: f64 = 100.0;

/// Steps after which a long run checks for divergence.
pub(crate) const CHECK_INTERVAL: usize = 64;

/// A robot that can be reset, driven by wheel torques, pushed and observed.
pub struct Ballbot {
    kind: ModelKind,
    model: Box<dyn Model>,
    ground: Option<Arc<Ground>>,
    /// Time and reason of a divergence; kept until a reset.
    diverged: Option<(f64, String)>,
}

impl Ballbot {
    /// A robot upright at rest, its model advanced in steps of `sim_dt` seconds.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] or [`Error::Inconsistent`] for invalid parameters or time step; [`Error::Inconsistent`]
    /// also for a robot that the model does not simulate: [`ModelKind::Planar`] takes only symmetric robots
    /// ([`Params::is_symmetric`]), and it and [`ModelKind::Spatial`] only round wheels ([`Params::has_ripple`]);
    /// [`Error::MissingFeature`] for a model that was not compiled.
    pub fn new(params: &Params, kind: ModelKind, sim_dt: f64) -> Result<Self> {
        params.validate()?;
        check_sim_dt(sim_dt)?;
        Ok(Self { kind, model: kind.build(params, sim_dt)?, ground: None, diverged: None })
    }

    /// The kind of its model.
    pub fn kind(&self) -> ModelKind {
        self.kind
    }

    /// The robot's parameters.
    pub fn params(&self) -> &Params {
        self.model.params()
    }

    /// Time step, s.
    pub fn sim_dt(&self) -> f64 {
        self.model.sim_dt()
    }

    /// Restarts from `state` at time zero. A reset robot equals a new robot to the last bit.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a state beyond the simulation's bounds, [`Error::Inconsistent`] for a state that the
    /// model cannot represent (slip in a model without slip, a ball below the floor). The robot is then unchanged.
    pub fn reset(&mut self, state: &State) -> Result<()> {
        self.accepts(state)?;
        self.place(state);
        Ok(())
    }

    /// [`Ballbot::reset`] to a state that has been accepted.
    pub(crate) fn place(&mut self, state: &State) {
        self.model.place(state);
        self.diverged = None;
    }

    /// Checks that [`Ballbot::reset`] would accept a state.
    ///
    /// # Errors
    /// As [`Ballbot::reset`].
    pub fn accepts(&self, state: &State) -> Result<()> {
        check_state(self.params(), self.ground.as_deref(), state)?;
        self.model.accepts(state)
    }

    /// Replaces the robot's parameters. If the geometry (radii, wheel angles, CoM position) is unchanged, the motion
    /// continues, with the new parameters from the next step on; otherwise the robot restarts upright at rest. The
    /// change persists over resets. Returns whether the motion continues.
    ///
    /// # Errors
    /// The errors of [`Params::validate`], and [`Error::Inconsistent`] if the model cannot simulate such a robot; the
    /// robot is then unchanged.
    pub fn set_params(&mut self, params: &Params) -> Result<bool> {
        params.validate()?;
        if params == self.params() {
            return Ok(true);
        }
        let ground = match &self.ground {
            Some(ground) if ground.ball_radius() != params.ball_radius => {
                Some(Ground::shared(ground.terrain(), params.ball_radius)?)
            }
            _ => None,
        };
        let before = (self.params().clone(), self.ground.clone(), self.model.save(), self.diverged.clone());
        let continues = self.change_params(params)?;
        if ground.is_some() {
            self.set_ground(ground.as_ref())?;
        }
        // A larger robot may be in an obstacle.
        if !continues && let Err(error) = self.model.accepts(&self.model.state()) {
            let (params, ground, motion, diverged) = before;
            self.model.set_params(&params)?;
            self.set_ground(ground.as_ref())?;
            self.model.load(&motion)?;
            self.diverged = diverged;
            return Err(error);
        }
        Ok(continues)
    }

    /// [`Ballbot::set_params`] with valid parameters, on the ground that it shares with other robots.
    pub(crate) fn change_params(&mut self, params: &Params) -> Result<bool> {
        if self.ground.is_some() {
            params.require_level("a robot on a terrain")?;
        }
        self.kind.require(params, self.sim_dt())?;
        let continues = same_geometry(self.params(), params);
        self.model.set_params(params)?;
        if !continues {
            self.diverged = None;
        }
        Ok(continues)
    }

    /// Advances by `steps` time steps under constant motor torques, N·m.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a torque that is not finite or beyond the motors' limit, before anything moves;
    /// [`Error::Diverged`] within 64 steps of when the state has left its bounds, and then until a reset;
    /// [`Error::Interrupted`] in [`crate::stoppable`]; the robot stays at the time it has reached.
    pub fn step(&mut self, wheel_torques: impl Into<Wheels<f64>>, steps: usize) -> Result<()> {
        let wheel_torques = self.checked(wheel_torques.into())?;
        let mut left = steps;
        let mut watch = Watch::new();
        loop {
            watch.check()?;
            // Not after every step: checking the state costs about as much as a step of the simpler models.
            let some = left.min(CHECK_INTERVAL);
            self.advance(wheel_torques, some);
            if let Some(reason) = self.diverged() {
                let time = self.time();
                self.diverged = Some((time, reason.clone()));
                return Err(Error::Diverged { time, reason });
            }
            left -= some;
            if left == 0 {
                return Ok(());
            }
        }
    }

    /// Torques that the robot can have next.
    fn checked(&self, wheel_torques: Wheels<f64>) -> Result<Wheels<f64>> {
        for (i, &torque) in wheel_torques.iter().enumerate() {
            check_torque(format_args!("wheel_torques[{i}]"), torque, self.params())?;
        }
        match &self.diverged {
            Some((time, reason)) => Err(Error::Diverged { time: *time, reason: reason.clone() }),
            None => Ok(wheel_torques),
        }
    }

    /// [`Ballbot::step`] for callers that have checked the torques and check divergence themselves.
    pub(crate) fn advance(&mut self, wheel_torques: Wheels<f64>, steps: usize) {
        self.model.advance(wheel_torques, steps);
    }

    /// Which bound the current state violates, or a state violated when a step failed, if any.
    pub fn diverged(&self) -> Option<String> {
        self.diverged.as_ref().map(|(_, reason)| reason.clone()).or_else(|| self.diverged_at(&self.state()))
    }

    /// [`Ballbot::diverged`] for callers that already have the current state.
    fn diverged_at(&self, state: &State) -> Option<String> {
        divergence(self.model.healthy(), state, self.ground.as_deref())
    }

    /// As [`Model::pending_push`](ballbot_base::model::Model::pending_push).
    pub(crate) fn pending_push(&self) -> [f64; 6] {
        self.model.pending_push()
    }

    /// False once a step has met numbers that are not finite.
    pub(crate) fn healthy(&self) -> bool {
        self.model.healthy()
    }

    /// Simulated time since the reset, s.
    pub fn time(&self) -> f64 {
        self.model.time()
    }

    /// The current state.
    pub fn state(&self) -> State {
        self.model.state()
    }

    /// Contact forces of the last step; `contact` and `rigid` return zeros until the first step.
    pub fn contacts(&self) -> Contacts {
        self.model.contacts()
    }

    /// Kinetic plus potential energy, J; see [`crate::mechanical_energy`] for its zero.
    pub fn energy(&self) -> f64 {
        self.model.energy()
    }

    /// Whether the body or a wheel touches the floor. Always false for `planar` and `spatial`, which have no such
    /// contact.
    pub fn bot_on_floor(&self) -> bool {
        self.model.bot_on_floor()
    }

    /// Whether the ball, the body or a wheel touches an obstacle.
    pub fn on_obstacle(&self) -> bool {
        self.model.on_obstacle()
    }

    /// Applies an impulse (inertial frame, N·s) to the body at `point` (body frame, m; its CoM if `None`). Models with
    /// contacts spread it over their next time step.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for an impulse above 1e4 N·s or a point farther than 100 m.
    pub fn push(&mut self, impulse: &Vector3<f64>, point: Option<&Vector3<f64>>) -> Result<()> {
        check_push(impulse, point)?;
        let com = self.params().body_com();
        self.model.push(impulse, point.unwrap_or(&com));
        Ok(())
    }

    /// Replaces the external force on the body: it acts in every time step, until another force or a reset. A force of
    /// zero ends it.
    ///
    /// # Errors
    /// As [`Force::validate`]; [`Error::Inconsistent`] for the model `planar`. The former force then stays.
    pub fn apply_force(&mut self, force: &Force) -> Result<()> {
        force.validate(self.sim_dt())?;
        let held = HeldForce::new(force, &self.params().body_com(), self.sim_dt());
        self.model.hold_force(&held)
    }

    /// Moves the rest of the springs of payload `index`, as a rider who leans does: to an offset from the payload's place, body axes,
    /// m. It is held until another offset or a reset.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] for a robot without such a payload; [`Error::OutOfRange`] for a number beyond ±1000 m. The former
    /// offset then stays.
    pub fn move_payload(&mut self, index: usize, offset: [f64; 3]) -> Result<()> {
        self.params().validate_offset(index, offset)?;
        self.model.move_payload(index, offset);
        Ok(())
    }

    /// [`Ballbot::move_payload`] of the first payload by a task, whose numbers are within bounds.
    pub(crate) fn move_rider(&mut self, offset: [f64; 3]) {
        self.model.move_payload(0, offset);
    }

    /// Deflections of the payloads from their places; zeros for payloads that the robot does not have.
    pub fn payloads(&self) -> [Deflection<f64>; PAYLOADS] {
        self.model.payloads()
    }

    /// Replaces the deflections of the payloads; a reset puts them at their places.
    ///
    /// # Errors
    /// As [`Params::validate_deflections`]; the payloads then stay as they are.
    pub fn set_payloads(&mut self, deflections: &[Deflection<f64>; PAYLOADS]) -> Result<()> {
        self.params().validate_deflections(&"payloads", deflections)?;
        self.model.set_payloads(deflections);
        Ok(())
    }

    /// Whether an external force acts, now or later.
    pub fn has_force(&self) -> bool {
        self.model.held_force().is_on()
    }

    /// The complete state, as bytes for [`Ballbot::load`].
    pub fn save(&self) -> Vec<u8> {
        let snapshot = Snapshot { identity: self.identity(), model: self.model.save() };
        snapshot::encode(&snapshot)
    }

    /// The model's part of [`Ballbot::save`].
    pub(crate) fn save_model(&self) -> Vec<u8> {
        self.model.save()
    }

    /// The model's part of [`Ballbot::load`].
    pub(crate) fn load_model(&mut self, bytes: &[u8]) -> Result<()> {
        self.model.load(bytes)
    }

    /// What must match for a snapshot to fit: model, time step and parameters.
    fn identity(&self) -> Identity {
        Identity {
            model: self.kind.name().to_owned(),
            sim_dt: self.sim_dt(),
            parameters: self.params().numbers(),
            terrain: self.ground.as_ref().map(|ground| (ground.terrain().fingerprint(), ground.ball_radius())),
        }
    }

    /// Continues from bytes of [`Ballbot::save`] of a robot with the same model, parameters and time step.
    ///
    /// # Errors
    /// [`Error::Decode`] if the bytes are not such a snapshot, or its numbers are not finite. The robot is then
    /// unchanged.
    pub fn load(&mut self, bytes: &[u8]) -> Result<()> {
        let snapshot: Snapshot = snapshot::decode("snapshot of a robot", bytes)?;
        let (theirs, ours) = (snapshot.identity, self.identity());
        if theirs != ours {
            return Err(Error::Decode {
                what: "snapshot of a robot".into(),
                reason: format!(
                    "it is of a '{}' robot at sim_dt = {} s, this is a '{}' robot at {} s, or their parameters differ, or their terrains differ",
                    theirs.model, theirs.sim_dt, ours.model, ours.sim_dt
                ),
            });
        }
        let before = self.model.save();
        let loaded = self.model.load(&snapshot.model);
        if let Err(error) = loaded.and_then(|()| check_restored(&self.state(), &self.contacts())) {
            self.model.load(&before)?;
            return Err(error);
        }
        self.diverged = None;
        Ok(())
    }
}

/// Checks that a snapshot has put a robot into a valid state.
///
/// # Errors
/// [`Error::Decode`] naming the invalid number.
pub(crate) fn check_restored(state: &State, contacts: &Contacts) -> Result<()> {
    let sound = state.validate().and_then(|()| contacts.validate());
    sound.map_err(|error| Error::Decode { what: "snapshot of a robot".into(), reason: error.to_string() })
}

#[derive(PartialEq, Serialize, Deserialize)]
struct Identity {
    model: String,
    sim_dt: f64,
    parameters: Vec<f64>,
    terrain: Option<(u64, f64)>,
}

#[derive(Serialize, Deserialize)]
struct Snapshot {
    identity: Identity,
    model: Vec<u8>,
}

/// Checks the time step of a model.
pub(crate) fn check_sim_dt(sim_dt: f64) -> Result<f64> {
    check("sim_dt", sim_dt, format_args!("{SIM_DT} s"), |dt| SIM_DT.contains(dt))
}

/// Checks the bounds of a state that all models share: finite, within the limits of a valid state, ball above the
/// floor.
pub(crate) fn check_state(params: &Params, ground: Option<&Ground>, state: &State) -> Result<()> {
    state.validate()?;
    if let Some(reason) = LaneState::from(state).out_of_bounds() {
        return Err(Error::Inconsistent(reason));
    }
    let radius = params.ball_radius;
    if let Some(ground) = ground {
        for (axis, half) in ground.terrain().half_size().into_iter().enumerate() {
            let edge = format_args!("within ±{half} m, the edges of the terrain");
            check(format_args!("ball_position[{axis}]"), state.ball_position[axis], edge, |place| place.abs() <= half)?;
        }
        let (gap, _) = ground.gap(&state.ball_position, radius);
        check("gap of ball_position above the ground", gap, "at least 0 m within ball_radius / 1000", |gap| {
            gap >= -1e-3 * radius
        })?;
        return Ok(());
    }
    let lowest = radius * (1.0 - 1e-3);
    check(
        "ball_position[2]",
        state.ball_position.z,
        format_args!("at least ball_radius = {radius} (the floor)"),
        |z| z >= lowest,
    )?;
    Ok(())
}

/// Checks a motor torque.
pub(crate) fn check_torque(name: fmt::Arguments<'_>, torque: f64, params: &Params) -> Result<f64> {
    let limit = params.max_wheel_torque;
    check(name, torque, format_args!("within ±max_wheel_torque = {limit} N·m"), |torque| torque.abs() <= limit)
}

/// Which bound a state violates, if any; `healthy` is false after a step with numbers that are not finite.
pub(crate) fn divergence(healthy: bool, state: &State, ground: Option<&Ground>) -> Option<String> {
    if !healthy {
        return Some("the next state is not finite".into());
    }
    if let Some(reason) = LaneState::from(state).out_of_bounds() {
        return Some(reason);
    }
    let [x, y, _] = state.ball_position.into();
    let left = ground.is_some_and(|ground| !ground.terrain().contains(x, y));
    left.then(|| format!("the ball left the terrain at x = {x} m, y = {y} m"))
}

/// Checks the size of a push.
pub(crate) fn check_push(impulse: &Vector3<f64>, point: Option<&Vector3<f64>>) -> Result<()> {
    for (name, vector, limit) in [("impulse", Some(impulse), MAX_IMPULSE), ("point", point, MAX_ARM)] {
        for (i, &value) in vector.into_iter().flatten().enumerate() {
            check(format_args!("{name}[{i}]"), value, format_args!("within ±{limit}"), |v| v.abs() <= limit)?;
        }
    }
    Ok(())
}
