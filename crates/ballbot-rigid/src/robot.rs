//! A robot in a rapier world: its constants, its parts, and its state in addition to the world.

use super::bodies::BodyLink;
use super::bot::{Bot, Coordinates};
use super::convert::{from_rapier, rotation_from_rapier, rotation_to_rapier, to_rapier};
use super::floor::Floor;
use super::rows::{Parts, Velocities, WheelContact};
use super::solve::{ROWS, TRACTION};
use super::world::{Handles, World, recovery_rate};
use ballbot_base::collision_shape::CollisionShape;
use ballbot_base::energy::energy_with_payloads;
use ballbot_base::error::Result;
use ballbot_base::force::HeldForce;
use ballbot_base::kinematics::Omniwheels;
use ballbot_base::lane_state::LaneState;
use ballbot_base::params::Params;
use ballbot_base::payload::{Deflection, PAYLOADS, Payload, PayloadMotion};
use ballbot_base::state::{Contacts, State};
use ballbot_base::terrain::Ground;
use ballbot_base::wheels::{WHEELS, Wheels};
use nalgebra::Vector3;
use rapier3d_f64::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// A robot in a [`World`].
pub struct Robot {
    pub params: Params,
    pub wheels: Omniwheels,
    /// CoM of the body without its wheels, body frame, m: the root of the multibody.
    pub root: Vector3<f64>,
    pub collision_shape: CollisionShape,
    pub ground: Option<Arc<Ground>>,
    pub bot: Bot,
    pub parts: Parts,
    pub handles: Handles,
    /// Colliders of the obstacles.
    pub obstacles: Arc<[ColliderHandle]>,
    /// Time step, s.
    pub dt: f64,
    /// Rate of recovery from overlaps, 1/s.
    pub recovery_rate: f64,
    pub sim_state: SimulationState,
    /// Acceleration of gravity in the present step, in the frame of the floor, m/s².
    pub gravity: Vector3<f64>,
    /// Factor of floor friction at the ball in the present step.
    pub grip: f64,
}

/// State of the simulation in addition to the rapier world.
#[derive(Clone, Copy, Serialize, Deserialize)]
pub struct SimulationState {
    /// Steps since the reset.
    pub steps: u64,
    /// Impulses of the rows in the last step.
    pub impulses: [f64; ROWS],
    /// Change of the velocities by rapier's contacts of the bot in the last step: bot, then ball.
    pub blow: [f64; 15],
    /// Force of the floor on the ball in the last step, inertial frame, N.
    pub floor_force: [f64; 3],
    /// Pending impulse on the body at its root and angular impulse about the root, N·s and N·m·s.
    pub push: [f64; 6],
    /// External force on the body.
    pub force: HeldForce<f64>,
    /// Motions of the payloads; of no meaning without them.
    pub payloads: [PayloadMotion<f64>; PAYLOADS],
    /// Lower bound of the distance from obstacles at the start of the last step, m.
    pub clearance: f64,
    /// Whether the robot was near an obstacle in the last step.
    pub near_obstacle: bool,
    /// False after a non-finite state, which rapier freezes.
    pub is_finite: bool,
    /// Steps since the reset in which the modes of the contacts did not settle at the first attempt.
    pub searched_steps: u64,
    /// Searched steps in which the modes did not settle at all.
    pub unsolved_steps: u64,
}

impl SimulationState {
    fn new() -> Self {
        Self {
            steps: 0,
            impulses: [0.0; ROWS],
            blow: [0.0; 15],
            floor_force: [0.0; 3],
            push: [0.0; 6],
            force: HeldForce::default(),
            payloads: Default::default(),
            clearance: 0.0,
            near_obstacle: false,
            is_finite: true,
            searched_steps: 0,
            unsolved_steps: 0,
        }
    }

    pub fn blow(&self) -> Velocities {
        let vector = |i: usize| Vector3::from_column_slice(&self.blow[i..i + 3]);
        Velocities { bot: Coordinates::from_column_slice(&self.blow[..9]), ball: [vector(9), vector(12)] }
    }

    pub fn set_blow(&mut self, blow: &Velocities) {
        self.blow[..9].copy_from_slice(blow.bot.as_slice());
        self.blow[9..12].copy_from_slice(blow.ball[0].as_slice());
        self.blow[12..].copy_from_slice(blow.ball[1].as_slice());
    }
}

impl Robot {
    /// A robot, and a world in which it is upright at rest, without obstacles.
    ///
    /// # Errors
    /// [`ballbot_base::error::Error::Inconsistent`] if the wheels have more inertia than the bot.
    pub fn new(params: &Params, ground: Option<&Arc<Ground>>, dt: f64) -> Result<(Self, World)> {
        let wheels = Omniwheels::new(params);
        let link = BodyLink::new(params, &wheels)?;
        let mut world = World::default();
        let handles = world.insert_robot(params, &wheels, &link, ground.is_none());
        let robot = Self {
            root: link.com,
            collision_shape: CollisionShape::new(params, &wheels),
            ground: ground.cloned(),
            bot: Bot::new(params, &wheels, &link, &world.upright_mass(&handles), dt),
            parts: Parts {
                ball_radius: params.ball_radius,
                wheel_radius: params.wheel_radius,
                roller_angle: params.roller_angle,
                ball_mass: params.ball_mass,
                ball_inertia: params.ball_inertia,
            },
            wheels,
            handles,
            obstacles: Arc::default(),
            dt,
            recovery_rate: recovery_rate(dt),
            sim_state: SimulationState::new(),
            gravity: params.gravity_vector(),
            grip: 1.0,
            params: params.clone(),
        };
        Ok((robot, world))
    }

    /// Inserts the robot into another world, with a number if there are others.
    ///
    /// # Errors
    /// As [`Robot::new`].
    pub fn join(&mut self, world: &mut World, number: Option<usize>) -> Result<()> {
        let link = BodyLink::new(&self.params, &self.wheels)?;
        self.handles = world.insert_robot(&self.params, &self.wheels, &link, self.ground.is_none());
        if let Some(number) = number {
            world.share(&self.handles, number);
        }
        Ok(())
    }

    pub fn multibody<'a>(&self, world: &'a World) -> &'a Multibody {
        world.multibody_joints.get_multibody(self.handles.bot).expect("the bot is never removed")
    }

    /// Encoder angles.
    pub fn wheel_angles(&self, world: &World) -> Wheels<f64> {
        let bot = self.multibody(world);
        Wheels::from_fn(|i| bot.link(1 + i).map_or(0.0, |link| link.joint().coords()[3]))
    }

    /// Linear velocity of the root and angular velocity of the body, inertial frame. After a step the multibody has the
    /// new velocities; its rigid bodies are updated only at the start of the next step.
    fn root_velocity(&self, world: &World) -> (Vector3<f64>, Vector3<f64>) {
        let velocities = self.multibody(world).generalized_velocity();
        (velocities.fixed_rows::<3>(0).into_owned(), velocities.fixed_rows::<3>(3).into_owned())
    }

    /// Velocity of the ball's surface where it touches the floor, inertial frame, m/s.
    pub fn floor_slip(&self, world: &World) -> Vector3<f64> {
        let ball = &world.bodies[self.handles.ball];
        let radius = self.params.ball_radius;
        let [_, _, normal] = Floor::under(self.ground.as_deref(), &from_rapier(ball.translation()), radius).axes;
        let slip = from_rapier(ball.linvel()) - from_rapier(ball.angvel()).cross(&normal) * radius;
        slip - normal * normal.dot(&slip)
    }

    /// Rapier's part of the joint friction: viscous friction acts within its step; dry friction is a row of `rows`.
    pub fn apply_joint_friction(&self, world: &mut World) {
        let bot = world.multibody_joints.get_multibody_mut(self.handles.bot).expect("the bot is never removed");
        for i in 0..WHEELS {
            bot.damping_mut()[6 + i] = self.params.wheel_viscous_friction;
        }
    }

    /// Impulse of all obstacles on the robot in the last step, inertial frame, N·s.
    fn obstacle_impulse(&self, world: &World) -> Vector3<f64> {
        let obstacles = if self.sim_state.near_obstacle { &*self.obstacles } else { &[] };
        let of_parts = |obstacle: &ColliderHandle| -> Vector3<f64> {
            self.handles.parts().map(|part| world.impulse(*obstacle, part)).sum()
        };
        obstacles.iter().map(of_parts).sum()
    }

    /// Impulse of another robot on this robot in the last step, inertial frame, N·s.
    pub fn impulse_of(&self, world: &World, other: &Self) -> Vector3<f64> {
        let of_part = |theirs: ColliderHandle| -> Vector3<f64> {
            self.handles.parts().map(|part| world.impulse(theirs, part)).sum()
        };
        other.handles.parts().map(of_part).sum()
    }

    /// Moves the robot to `state` at time zero, in a world that is as built.
    pub fn place(&mut self, world: &mut World, state: &State) {
        self.set_motion(world, state);
        self.sim_state = SimulationState::new();
        self.sim_state.payloads = PayloadMotion::at_places(&Payload::of(&self.params), &LaneState::from(state));
        self.apply_joint_friction(world);
    }

    /// Moves the robot to `state` in a world that is as built.
    pub fn set_motion(&self, world: &mut World, state: &State) {
        let ball = &mut world.bodies[self.handles.ball];
        ball.set_position(
            Pose::from_parts(to_rapier(&state.ball_position), rotation_to_rapier(&state.ball_quaternion)),
            true,
        );
        ball.set_linvel(to_rapier(&state.ball_velocity), true);
        ball.set_angvel(to_rapier(&state.ball_angular_velocity), true);

        let root = state.body_position + state.body_quaternion * self.root;
        let pose = Pose::from_parts(to_rapier(&root), rotation_to_rapier(&state.body_quaternion));
        world.bodies[self.handles.body].set_position(pose, true);
        let rate = state.body_quaternion * state.body_angular_velocity;
        let velocity = state.body_velocity + state.body_quaternion * state.body_angular_velocity.cross(&self.root);

        let bot = world.multibody_joints.get_multibody_mut(self.handles.bot).expect("the bot is never removed");
        let mut displacements = [0.0; 9];
        displacements[6..].copy_from_slice(state.wheel_angles.as_slice());
        bot.apply_displacements(&displacements);
        let mut velocities = bot.generalized_velocity_mut();
        velocities.fixed_rows_mut::<3>(0).copy_from_slice(velocity.as_slice());
        velocities.fixed_rows_mut::<3>(3).copy_from_slice(rate.as_slice());
        velocities.fixed_rows_mut::<3>(6).copy_from_slice(state.wheel_speeds.as_slice());
        bot.forward_kinematics(&world.bodies, true);
        bot.update_rigid_bodies(&mut world.bodies, true);
    }

    /// Checks that the robot can be placed in a state.
    ///
    /// # Errors
    /// [`ballbot_base::error::Error::OutOfRange`] for parts within the floor or an obstacle.
    pub fn accepts(&self, state: &State) -> Result<()> {
        state.validate()?;
        self.collision_shape.require_above(self.ground.as_deref(), state)
    }

    pub fn state(&self, world: &World) -> State {
        let ball = &world.bodies[self.handles.ball];
        let body = &world.bodies[self.handles.body];
        let velocities = self.multibody(world).generalized_velocity();
        let body_quaternion = rotation_from_rapier(*body.rotation());
        let (velocity, rate) = self.root_velocity(world);
        let rate = body_quaternion.inverse_transform_vector(&rate);
        State {
            ball_position: from_rapier(ball.translation()),
            ball_quaternion: rotation_from_rapier(*ball.rotation()),
            ball_velocity: from_rapier(ball.linvel()),
            ball_angular_velocity: from_rapier(ball.angvel()),
            body_position: from_rapier(body.translation()) - body_quaternion * self.root,
            body_quaternion,
            body_velocity: velocity - body_quaternion * rate.cross(&self.root),
            body_angular_velocity: rate,
            wheel_angles: self.wheel_angles(world),
            wheel_speeds: Wheels([velocities[6], velocities[7], velocities[8]]),
        }
    }

    pub fn contacts(&self, world: &World) -> Contacts {
        let motion = self.motion(world);
        let force = |row: usize| self.sim_state.impulses[row] / self.dt;
        Contacts {
            wheel_normal_forces: Wheels::from_fn(force),
            // The rows act on the wheels; the force on the ball is the opposite.
            wheel_tractions: Wheels::from_fn(|i| -force(TRACTION + i)),
            wheel_slip_speeds: Wheels::from_fn(|i| WheelContact::new(&self.parts, &self.bot, &motion, i).slip),
            floor_force: self.sim_state.floor_force.into(),
            bot_floor_force: world.bot_floor_impulse(&self.handles) / self.dt,
            floor_slip_velocity: self.floor_slip(world).xy(),
            obstacle_force: self.obstacle_impulse(world) / self.dt,
            bot_on_floor: self.bot_on_floor(world),
            on_obstacle: self.on_obstacle(world),
            searched_steps: self.sim_state.searched_steps,
            unsolved_steps: self.sim_state.unsolved_steps,
        }
    }

    pub fn bot_on_floor(&self, world: &World) -> bool {
        self.handles.bot_on_planes().any(|(part, plane)| world.touch(plane, part))
    }

    pub fn on_obstacle(&self, world: &World) -> bool {
        self.sim_state.near_obstacle
            && self.obstacles.iter().any(|obstacle| self.handles.parts().any(|part| world.touch(*obstacle, part)))
    }

    pub fn energy(&self, world: &World) -> f64 {
        energy_with_payloads(&self.params, &self.wheels, &self.state(world), &self.sim_state.payloads, self.time())
    }

    /// Simulated time since the reset, s.
    pub fn time(&self) -> f64 {
        self.sim_state.steps as f64 * self.dt
    }

    pub fn payloads(&self, world: &World) -> [Deflection<f64>; PAYLOADS] {
        let body = LaneState::from(&self.state(world));
        Deflection::of_all(&Payload::of(&self.params), &body, &self.sim_state.payloads)
    }

    pub fn set_payloads(&mut self, world: &World, deflections: &[Deflection<f64>; PAYLOADS]) {
        let body = LaneState::from(&self.state(world));
        let payloads = Payload::of(&self.params);
        self.sim_state.payloads = PayloadMotion::all_deflected(&self.sim_state.payloads, &payloads, &body, deflections);
    }

    /// Acts as a force during the next time step, so that the contact forces of the step include the reaction.
    pub fn push(&mut self, world: &World, impulse: &Vector3<f64>, point: &Vector3<f64>) {
        let body = rotation_from_rapier(*world.bodies[self.handles.body].rotation());
        let angular_impulse = (body * (point - self.root)).cross(impulse);
        for i in 0..3 {
            self.sim_state.push[i] += impulse[i];
            self.sim_state.push[3 + i] += angular_impulse[i];
        }
    }

    pub fn pending_push(&self, world: &World) -> [f64; 6] {
        let [x, y, z, turn @ ..] = self.sim_state.push;
        let body = rotation_from_rapier(*world.bodies[self.handles.body].rotation());
        let about_com = Vector3::from(turn)
            - (body * (self.params.without_payloads().body_com() - self.root)).cross(&Vector3::new(x, y, z));
        [x, y, z, about_com.x, about_com.y, about_com.z]
    }
}
