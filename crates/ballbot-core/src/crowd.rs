//! Several robots that share a floor and touch each other.

use crate::robot::standing::at_rest_on;
use crate::robot::{
    CHECK_INTERVAL, ModelKind, check_push, check_restored, check_sim_dt, check_state, check_torque, divergence,
};
use ballbot_base::error::{Error, Result, check};
use ballbot_base::fields::{Fields, Limit};
use ballbot_base::force::{Force, HeldForce};
use ballbot_base::interrupt::Watch;
use ballbot_base::params::Params;
use ballbot_base::payload::{Deflection, PAYLOADS};
use ballbot_base::snapshot;
use ballbot_base::state::{Contacts, State};
use ballbot_base::terrain::{Ground, Terrain};
use ballbot_base::wheels::Wheels;
use ballbot_rigid::{Between, Scene};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Largest number of robots: rapier compares every part with every floor.
const MOST_ROBOTS: usize = 64;

/// Largest overlap of robots in an accepted start, m.
const MAX_OVERLAP: f64 = 1e-3;

/// Parameters of the floor, which is the same under all robots; its friction may differ, as balls do.
const OF_FLOOR: [&str; 13] = [
    "gravity",
    "floor_tilt",
    "floor_friction_gradient",
    "floor_patch_size",
    "floor_patch_friction",
    "floor_patch_seed",
    "floor_tilt_amplitude",
    "floor_tilt_period",
    "floor_tilt_phases",
    "floor_acceleration",
    "floor_acceleration_period",
    "floor_acceleration_phase",
    "floor_acceleration_rise",
];

/// Robots of the model `rigid` in one world: ball, body and wheels of each touch the others with friction and restitution.
///
/// A robot that touches none moves as a [`Ballbot`](crate::Ballbot) of the same model, to the last bit while no robot touches
/// anything but its ball and a level floor. Methods that take the number of a robot panic where there is none.
///
/// ```
/// use ballbot_core::{Crowd, Params, control::{Controller, Lqr, Setpoint}, sim::Between};
///
/// let robots = [Params::paper(), Params::paper()];
/// let between = Between { friction: 0.3, restitution: 0.0 };
/// let places = [[0.0, 0.0], [0.5, 0.0]];
/// let mut crowd = Crowd::new(&robots, &places, None, between, 0.001)?;
/// let mut laws = [Lqr::new(&robots[0], 0.01)?, Lqr::new(&robots[1], 0.01)?];
/// for _ in 0..50 {
///     let torques: Vec<_> = laws.iter_mut().zip(crowd.states()).zip(places)
///         .map(|((law, state), place)| {
///             law.wheel_torques(&state, &Setpoint { position: place.into(), ..Setpoint::default() })
///         })
///         .collect();
///     crowd.step(&torques, 10)?;
/// }
/// assert!(crowd.states().iter().all(|state| state.tilt() < 0.1));
/// # Ok::<(), ballbot_core::Error>(())
/// ```
pub struct Crowd {
    scene: Scene,
    /// States to which a reset returns.
    start: Vec<State>,
    /// Time and reason of a divergence; kept until a reset.
    diverged: Option<(f64, String)>,
}

impl Crowd {
    /// Robots at rest with their balls above `positions` (x, y in m), on a terrain or a level floor.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for no robots or more than 64, a time step out of range, `friction` not in 0 to 10 or
    /// `restitution` not in 0 to 0.5; [`Error::Length`] unless there is a position for each robot; [`Error::Inconsistent`]
    /// naming the robot for invalid parameters, for robots that do not have the same gravity and floor, that overlap each
    /// other by more than 1 mm, or that cannot stand at their position.
    pub fn new(
        robots: &[Params],
        positions: &[[f64; 2]],
        terrain: Option<&Arc<Terrain>>,
        between: Between,
        sim_dt: f64,
    ) -> Result<Self> {
        check("number of robots", robots.len() as f64, format_args!("1 to {MOST_ROBOTS}"), |_| {
            (1..=MOST_ROBOTS).contains(&robots.len())
        })?;
        if positions.len() != robots.len() {
            return Err(Error::Length { name: "positions".into(), found: positions.len(), expected: robots.len() });
        }
        check_sim_dt(sim_dt)?;
        let limits = [("friction", between.friction, 10.0), ("restitution", between.restitution, 0.5)];
        for (name, value, most) in limits {
            let limit = Limit::NOT_NEGATIVE.to(most);
            check(name, value, limit, |value| limit.contains(value))?;
        }
        let mut grounds = Vec::with_capacity(robots.len());
        for (i, params) in robots.iter().enumerate() {
            params.validate().and_then(|()| ModelKind::Rigid.require(params, sim_dt)).map_err(|error| of(i, &error))?;
            check_same_floor(i, params, &robots[0])?;
            if terrain.is_some() {
                params.require_level("a robot on a terrain").map_err(|error| of(i, &error))?;
            }
            grounds.push(terrain.map(|terrain| Ground::shared(terrain, params.ball_radius)).transpose()?);
        }
        let mut start = Vec::with_capacity(robots.len());
        for (i, ((params, ground), [x, y])) in robots.iter().zip(&grounds).zip(positions).enumerate() {
            start.push(at_rest_on(params, ground.as_ref(), *x, *y, 0.0, None).map_err(|error| of(i, &error))?);
        }
        let members: Vec<_> = robots.iter().zip(&grounds).map(|(params, ground)| (params, ground.as_ref())).collect();
        let scene = Scene::of_several(&members, between, sim_dt)?;
        let mut crowd = Self { scene, start, diverged: None };
        crowd.reset(&crowd.start.clone())?;
        Ok(crowd)
    }

    /// Number of robots.
    pub fn num_robots(&self) -> usize {
        self.start.len()
    }

    /// The states in which the robots were created.
    pub fn start(&self) -> &[State] {
        &self.start
    }

    /// Restarts from a state of each robot at time zero.
    ///
    /// # Errors
    /// [`Error::Length`] unless there is a state for each; [`Error::Inconsistent`] naming the robot for a state that
    /// [`Ballbot::reset`](crate::Ballbot::reset) rejects, and for robots that overlap by more than 1 mm. All are then unchanged.
    pub fn reset(&mut self, states: &[State]) -> Result<()> {
        self.check_length("states", states.len())?;
        for (i, state) in states.iter().enumerate() {
            check_state(self.params(i), self.scene.ground(i), state)
                .and_then(|()| self.scene.accepts(i, state))
                .map_err(|error| of(i, &error))?;
        }
        if let Some((i, j, overlap)) = self.scene.overlap(states, MAX_OVERLAP) {
            return Err(Error::Inconsistent(format!(
                "robots {i} and {j} overlap by {overlap} m; at most {MAX_OVERLAP} m is accepted"
            )));
        }
        self.scene.place(states);
        self.diverged = None;
        Ok(())
    }

    /// Advances by `steps` time steps under constant motor torques of each robot, N·m.
    ///
    /// # Errors
    /// [`Error::Length`] unless there are torques for each robot, [`Error::OutOfRange`] for torques that are not finite or
    /// beyond a robot's limit, before anything moves; [`Error::Diverged`] naming the robot within 64 steps of when its state
    /// has left its bounds, and then until a reset, as robots may touch; [`Error::Interrupted`] in [`crate::stoppable`].
    pub fn step(&mut self, wheel_torques: &[Wheels<f64>], steps: usize) -> Result<()> {
        self.check_length("wheel_torques", wheel_torques.len())?;
        for (robot, torques) in wheel_torques.iter().enumerate() {
            for (i, &torque) in torques.iter().enumerate() {
                check_torque(format_args!("wheel_torques[{robot}][{i}]"), torque, self.params(robot))?;
            }
        }
        if let Some((time, reason)) = &self.diverged {
            return Err(Error::Diverged { time: *time, reason: reason.clone() });
        }
        let mut left = steps;
        let mut watch = Watch::new();
        while left > 0 {
            watch.check()?;
            let some = left.min((CHECK_INTERVAL / self.num_robots()).max(1));
            self.scene.advance(wheel_torques, some);
            if let Some(reason) = self.divergence() {
                let time = self.time();
                self.diverged = Some((time, reason.clone()));
                return Err(Error::Diverged { time, reason });
            }
            left -= some;
        }
        Ok(())
    }

    fn check_length(&self, name: &str, found: usize) -> Result<()> {
        let expected = self.num_robots();
        if found == expected { Ok(()) } else { Err(Error::Length { name: name.into(), found, expected }) }
    }

    fn divergence(&self) -> Option<String> {
        (0..self.num_robots()).find_map(|robot| {
            let reason = divergence(self.scene.healthy(robot), &self.state(robot), self.scene.ground(robot));
            reason.map(|reason| format!("robot {robot}: {reason}"))
        })
    }

    /// Parameters of a robot.
    pub fn params(&self, robot: usize) -> &Params {
        self.scene.params(robot)
    }

    /// The terrain; `None` for a level floor.
    pub fn terrain(&self) -> Option<&Arc<Terrain>> {
        self.scene.ground(0).map(|ground| ground.terrain())
    }

    /// Friction and restitution between robots.
    pub fn between(&self) -> Between {
        self.scene.between()
    }

    /// Time step, s.
    pub fn sim_dt(&self) -> f64 {
        self.scene.dt()
    }

    /// Simulated time since the reset, s.
    pub fn time(&self) -> f64 {
        self.scene.time()
    }

    /// Present state of a robot.
    pub fn state(&self, robot: usize) -> State {
        self.scene.state(robot)
    }

    /// Present states of all robots.
    pub fn states(&self) -> Vec<State> {
        (0..self.num_robots()).map(|robot| self.state(robot)).collect()
    }

    /// Forces on a robot by floor and obstacles, and between its wheels and its ball, in the last step.
    pub fn contacts(&self, robot: usize) -> Contacts {
        self.scene.contacts(robot)
    }

    /// Mean force of robot `of` on robot `on` in the last step, inertial frame, N.
    pub fn force_between(&self, of: usize, on: usize) -> Vector3<f64> {
        if of == on { Vector3::zeros() } else { self.scene.impulse_between(of, on) / self.sim_dt() }
    }

    /// Kinetic plus potential energy of a robot, J, as [`Ballbot::energy`](crate::Ballbot::energy).
    pub fn energy(&self, robot: usize) -> f64 {
        self.scene.energy(robot)
    }

    /// Deflections of a robot's payloads, as [`Ballbot::payloads`](crate::Ballbot::payloads).
    pub fn payloads(&self, robot: usize) -> [Deflection<f64>; PAYLOADS] {
        self.scene.payloads(robot)
    }

    /// Moves the rest of a payload's springs, as [`Ballbot::move_payload`](crate::Ballbot::move_payload).
    ///
    /// # Errors
    /// As [`Ballbot::move_payload`](crate::Ballbot::move_payload).
    pub fn move_payload(&mut self, robot: usize, index: usize, offset: [f64; 3]) -> Result<()> {
        self.params(robot).validate_offset(index, offset)?;
        self.scene.move_payload(robot, index, offset);
        Ok(())
    }

    /// Replaces the deflections of the payloads of all robots.
    ///
    /// # Errors
    /// [`Error::Length`] unless there are deflections for each robot; as [`Params::validate_deflections`]. All then stay as they are.
    pub fn set_payloads(&mut self, deflections: &[[Deflection<f64>; PAYLOADS]]) -> Result<()> {
        self.check_length("payloads", deflections.len())?;
        for (robot, deflections) in deflections.iter().enumerate() {
            self.params(robot).validate_deflections(&format_args!("payloads[{robot}]"), deflections)?;
        }
        deflections.iter().enumerate().for_each(|(robot, deflections)| self.scene.set_payloads(robot, deflections));
        Ok(())
    }

    /// Applies an impulse to a robot, as [`Ballbot::push`](crate::Ballbot::push).
    ///
    /// # Errors
    /// As [`Ballbot::push`](crate::Ballbot::push).
    pub fn push(&mut self, robot: usize, impulse: &Vector3<f64>, point: Option<&Vector3<f64>>) -> Result<()> {
        check_push(impulse, point)?;
        let com = self.params(robot).body_com();
        self.scene.push(robot, impulse, point.unwrap_or(&com));
        Ok(())
    }

    /// Replaces the external force on a robot, as [`Ballbot::apply_force`](crate::Ballbot::apply_force).
    ///
    /// # Errors
    /// As [`Ballbot::apply_force`](crate::Ballbot::apply_force).
    pub fn apply_force(&mut self, robot: usize, force: &Force) -> Result<()> {
        force.validate(self.sim_dt())?;
        let held = HeldForce::new(force, &self.params(robot).body_com(), self.sim_dt());
        self.scene.hold_force(robot, &held);
        Ok(())
    }

    /// The complete state, as bytes for [`Crowd::load`].
    pub fn save(&self) -> Vec<u8> {
        snapshot::encode(&Snapshot { identity: self.identity(), scene: self.scene.save() })
    }

    /// Continues from bytes of [`Crowd::save`] of a crowd with the same arguments.
    ///
    /// # Errors
    /// [`Error::Decode`] if the bytes are not such a snapshot, or its numbers are not finite. The crowd is then unchanged.
    pub fn load(&mut self, bytes: &[u8]) -> Result<()> {
        let what = "snapshot of a crowd";
        let snapshot: Snapshot = snapshot::decode(what, bytes)?;
        if snapshot.identity != self.identity() {
            let reason = "it is of other robots, another floor or another time step".into();
            return Err(Error::Decode { what: what.into(), reason });
        }
        let before = self.scene.save();
        let restored = self.scene.load(&snapshot.scene).and_then(|()| {
            (0..self.num_robots()).try_for_each(|robot| check_restored(&self.state(robot), &self.contacts(robot)))
        });
        if let Err(error) = restored {
            self.scene.load(&before)?;
            return Err(error);
        }
        self.diverged = None;
        Ok(())
    }

    fn identity(&self) -> Vec<u64> {
        let robots = (0..self.num_robots()).flat_map(|robot| self.params(robot).numbers());
        let between = self.between();
        let numbers = robots.chain([between.friction, between.restitution, self.sim_dt()]).map(f64::to_bits);
        numbers.chain(self.terrain().map(|terrain| terrain.fingerprint())).collect()
    }
}

#[derive(Serialize, Deserialize)]
struct Snapshot {
    identity: Vec<u64>,
    scene: Vec<u8>,
}

/// An error with the number of the robot.
fn of(robot: usize, error: &Error) -> Error {
    Error::Inconsistent(format!("robot {robot}: {error}"))
}

fn check_same_floor(robot: usize, params: &Params, first: &Params) -> Result<()> {
    for name in OF_FLOOR {
        let index = Params::index_of(name).expect("a name of a parameter");
        let [theirs, ours] = [first, params].map(|params| params.values(index));
        if theirs != ours {
            return Err(Error::Inconsistent(format!(
                "robots must share one floor, but robot {robot} has {name} = {ours:?} and robot 0 has {theirs:?}"
            )));
        }
    }
    Ok(())
}
