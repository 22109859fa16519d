//! Simulation of the robot as rigid bodies.

use super::bodies::BodyLink;
use super::bot::{Bot, Coordinates};
use super::convert::{from_rapier, rotation_from_rapier, rotation_to_rapier, to_rapier};
use super::floor::Floor;
use super::rows::{Parts, Velocities, WheelContact};
use super::solve::{ROWS, TRACTION};
use super::world::{Handles, World, integration_parameters, new_pipeline};
use ballbot_base::collision_shape::CollisionShape;
use ballbot_base::energy::energy_with_payload;
use ballbot_base::error::{Error, Result};
use ballbot_base::force::HeldForce;
use ballbot_base::kinematics::Omniwheels;
use ballbot_base::lane_state::LaneState;
use ballbot_base::model::{Model, same_geometry};
use ballbot_base::params::Params;
use ballbot_base::payload::{Deflection, Payload, PayloadMotion};
use ballbot_base::snapshot;
use ballbot_base::state::{Contacts, State};
use ballbot_base::terrain::{Ground, upright_on};
use ballbot_base::wheels::{WHEELS, Wheels};
use nalgebra::Vector3;
use rapier3d_f64::prelude::*;
use serde::{Deserialize, Serialize};
use std::any::Any;
use std::sync::Arc;

/// A ballbot of rigid bodies on the ground.
pub struct RigidMotion {
    pub(super) params: Params,
    pub(super) wheels: Omniwheels,
    /// CoM of the body without its wheels, body frame, m: the root of the multibody.
    pub(super) root: Vector3<f64>,
    pub(super) collision_shape: CollisionShape,
    pub(super) ground: Option<Arc<Ground>>,
    pub(super) bot: Bot,
    pub(super) parts: Parts,
    pub(super) template: World,
    pub(super) handles: Handles,
    /// Colliders of the obstacles.
    pub(super) obstacles: Vec<ColliderHandle>,
    pub(super) settings: IntegrationParameters,
    pub(super) pipeline: PhysicsPipeline,
    pub(super) world: World,
    pub(super) sim_state: SimulationState,
    /// Acceleration of gravity in the present step, in the frame of the floor, m/s².
    pub(super) gravity: Vector3<f64>,
    /// Factor of floor friction at the ball in the present step.
    pub(super) grip: f64,
}

/// State of the simulation in addition to the rapier world.
#[derive(Clone, Copy, Serialize, Deserialize)]
pub(super) struct SimulationState {
    /// Steps since the reset.
    pub(super) steps: u64,
    /// Impulses of the rows in the last step.
    pub(super) impulses: [f64; ROWS],
    /// Change of the velocities by rapier's contacts of the bot in the last step: bot, then ball.
    pub(super) blow: [f64; 15],
    /// Force of the floor on the ball in the last step, inertial frame, N.
    pub(super) floor_force: [f64; 3],
    /// Pending impulse on the body at its root and angular impulse about the root, N·s and N·m·s.
    pub(super) push: [f64; 6],
    /// Force from outside on the body.
    pub(super) force: HeldForce<f64>,
    /// Motion of the payload; of no meaning without one.
    pub(super) payload: PayloadMotion<f64>,
    /// Lower bound of the distance from obstacles at the start of the last step, m.
    pub(super) clearance: f64,
    /// Whether the robot was near an obstacle in the last step.
    pub(super) near_obstacle: bool,
    /// False after a non-finite state, which rapier freezes.
    pub(super) is_finite: bool,
    /// Steps since the reset in which the modes of the contacts did not settle at the first attempt.
    pub(super) searched_steps: u64,
    /// Searched steps in which the modes did not settle at all.
    pub(super) unsolved_steps: u64,
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
            payload: PayloadMotion::default(),
            clearance: 0.0,
            near_obstacle: false,
            is_finite: true,
            searched_steps: 0,
            unsolved_steps: 0,
        }
    }
}

impl SimulationState {
    pub(super) fn blow(&self) -> Velocities {
        let vector = |i: usize| Vector3::from_column_slice(&self.blow[i..i + 3]);
        Velocities { bot: Coordinates::from_column_slice(&self.blow[..9]), ball: [vector(9), vector(12)] }
    }

    pub(super) fn set_blow(&mut self, blow: &Velocities) {
        self.blow[..9].copy_from_slice(blow.bot.as_slice());
        self.blow[9..12].copy_from_slice(blow.ball[0].as_slice());
        self.blow[12..].copy_from_slice(blow.ball[1].as_slice());
    }
}

impl RigidMotion {
    /// A robot upright at rest.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] if the wheels have more inertia than the bot.
    pub fn new(params: &Params, sim_dt: f64) -> Result<Self> {
        Self::on(params, None, sim_dt)
    }

    fn on(params: &Params, ground: Option<&Arc<Ground>>, sim_dt: f64) -> Result<Self> {
        let wheels = Omniwheels::new(params);
        let (template, handles, obstacles) = World::new(params, &wheels, ground.map(|ground| &**ground))?;
        let link = BodyLink::new(params, &wheels)?;
        let mass = template.upright_mass(&handles);
        let mut motion = Self {
            root: link.com,
            collision_shape: CollisionShape::new(params, &wheels),
            ground: ground.cloned(),
            bot: Bot::new(params, &wheels, &link, &mass, sim_dt),
            parts: Parts {
                ball_radius: params.ball_radius,
                wheel_radius: params.wheel_radius,
                roller_angle: params.roller_angle,
                ball_mass: params.ball_mass,
                ball_inertia: params.ball_inertia,
            },
            wheels,
            world: template.clone(),
            template,
            handles,
            obstacles,
            settings: integration_parameters(sim_dt),
            pipeline: new_pipeline(),
            sim_state: SimulationState::new(),
            gravity: params.gravity_vector(),
            grip: 1.0,
            params: params.clone(),
        };
        motion.place(&upright_on(ground.map(|ground| &**ground), params));
        Ok(motion)
    }

    pub(super) fn multibody(&self) -> &Multibody {
        self.world.multibody_joints.get_multibody(self.handles.bot).expect("the bot is never removed")
    }

    /// Encoder angles.
    pub(super) fn wheel_angles(&self) -> Wheels<f64> {
        let bot = self.multibody();
        Wheels::from_fn(|i| bot.link(1 + i).map_or(0.0, |link| link.joint().coords()[3]))
    }

    /// Linear velocity of the root and angular velocity of the body, inertial frame. After a step the multibody has the
    /// new velocities; its rigid bodies are updated only at the start of the next step.
    pub(super) fn root_velocity(&self) -> (Vector3<f64>, Vector3<f64>) {
        let velocities = self.multibody().generalized_velocity();
        (velocities.fixed_rows::<3>(0).into_owned(), velocities.fixed_rows::<3>(3).into_owned())
    }

    /// Velocity of the ball's surface where it touches the floor, inertial frame, m/s.
    pub(super) fn floor_slip(&self) -> Vector3<f64> {
        let ball = &self.world.bodies[self.handles.ball];
        let radius = self.params.ball_radius;
        let [_, _, normal] = Floor::under(self.ground.as_deref(), &from_rapier(ball.translation()), radius).axes;
        let slip = from_rapier(ball.linvel()) - from_rapier(ball.angvel()).cross(&normal) * radius;
        slip - normal * normal.dot(&slip)
    }

    /// Rapier's part of the joint friction: viscous friction acts within its step; dry friction is a row of `rows`.
    fn apply_joint_friction(&mut self) {
        let bot = self.world.multibody_joints.get_multibody_mut(self.handles.bot).expect("the bot is never removed");
        for i in 0..WHEELS {
            bot.damping_mut()[6 + i] = self.params.wheel_viscous_friction;
        }
    }

    /// Impulse of all obstacles on the robot in the last step, inertial frame, N·s.
    fn obstacle_impulse(&self) -> Vector3<f64> {
        let obstacles = if self.sim_state.near_obstacle { &*self.obstacles } else { &[] };
        let of_parts = |obstacle: &ColliderHandle| -> Vector3<f64> {
            self.handles.parts().map(|part| self.world.obstacle_impulse(*obstacle, part)).sum()
        };
        obstacles.iter().map(of_parts).sum()
    }

    fn set_motion(&mut self, state: &State) {
        let world = &mut self.world;
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
}

impl Model for RigidMotion {
    fn as_any(&self) -> &dyn Any {
        self
    }

    fn params(&self) -> &Params {
        &self.params
    }

    fn sim_dt(&self) -> f64 {
        self.settings.dt
    }

    fn set_params(&mut self, params: &Params) -> Result<()> {
        let [before, after] = [&self.params, params].map(Payload::new);
        let payload = self.sim_state.payload.changed(&before, &after, &LaneState::from(&self.state()));
        if same_bodies(&self.params, params) {
            let link = BodyLink::new(params, &self.wheels)?;
            self.params = params.clone();
            (self.gravity, self.grip) = (params.gravity_vector(), 1.0);
            self.bot = Bot::new(params, &self.wheels, &link, &self.bot.undamped, self.settings.dt);
            self.sim_state.payload = payload;
        } else {
            let mut robot = Self::on(params, self.ground.as_ref(), self.settings.dt)?;
            if same_geometry(&self.params, params) {
                let state = self.state();
                robot.set_motion(&state);
                robot.sim_state = self.sim_state;
                robot.sim_state.payload = payload;
                // A pending push keeps its point: its angular impulse is about the root, which has moved.
                let [x, y, z, turn @ ..] = &mut robot.sim_state.push;
                let moved = state.body_quaternion * (self.root - robot.root);
                let change = moved.cross(&Vector3::new(*x, *y, *z));
                turn.iter_mut().zip(&change).for_each(|(turn, change)| *turn += change);
            }
            *self = robot;
        }
        self.apply_joint_friction();
        Ok(())
    }

    fn set_ground(&mut self, ground: Option<&Arc<Ground>>) -> Result<()> {
        *self = Self::on(&self.params, ground, self.settings.dt)?;
        Ok(())
    }

    fn place(&mut self, state: &State) {
        self.world = self.template.clone();
        self.pipeline = new_pipeline();
        self.set_motion(state);
        self.sim_state = SimulationState::new();
        self.sim_state.payload = PayloadMotion::at_place(&Payload::new(&self.params), &LaneState::from(state));
        self.apply_joint_friction();
    }

    fn advance(&mut self, wheel_torques: Wheels<f64>, steps: usize) {
        for _ in 0..steps {
            if self.sim_state.force.is_on() {
                let point = self.sim_state.force.point.into();
                let impulse = self.sim_state.force.next_impulse();
                self.push(&impulse, &point);
            }
            if self.params.has_payload() {
                self.carry();
            }
            self.step(wheel_torques);
        }
    }

    fn time(&self) -> f64 {
        self.sim_state.steps as f64 * self.settings.dt
    }

    fn healthy(&self) -> bool {
        self.sim_state.is_finite
    }

    fn accepts(&self, state: &State) -> Result<()> {
        state.validate()?;
        self.collision_shape.require_above(self.ground.as_deref(), state)
    }

    fn state(&self) -> State {
        let ball = &self.world.bodies[self.handles.ball];
        let body = &self.world.bodies[self.handles.body];
        let bot = self.multibody();
        let velocities = bot.generalized_velocity();
        let body_quaternion = rotation_from_rapier(*body.rotation());
        let (velocity, rate) = self.root_velocity();
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
            wheel_angles: self.wheel_angles(),
            wheel_speeds: Wheels([velocities[6], velocities[7], velocities[8]]),
        }
    }

    fn contacts(&self) -> Contacts {
        let motion = self.motion();
        let force = |row: usize| self.sim_state.impulses[row] / self.settings.dt;
        Contacts {
            wheel_normal_forces: Wheels::from_fn(force),
            // The rows act on the wheels; the force on the ball is the opposite.
            wheel_tractions: Wheels::from_fn(|i| -force(TRACTION + i)),
            wheel_slip_speeds: Wheels::from_fn(|i| WheelContact::new(&self.parts, &self.bot, &motion, i).slip),
            floor_force: self.sim_state.floor_force.into(),
            bot_floor_force: self.world.bot_floor_impulse(&self.handles) / self.settings.dt,
            floor_slip_velocity: self.floor_slip().xy(),
            obstacle_force: self.obstacle_impulse() / self.settings.dt,
            bot_on_floor: self.bot_on_floor(),
            on_obstacle: self.on_obstacle(),
            searched_steps: self.sim_state.searched_steps,
            unsolved_steps: self.sim_state.unsolved_steps,
        }
    }

    fn bot_on_floor(&self) -> bool {
        self.handles.bot_on_planes().any(|(part, plane)| self.world.touch(plane, part))
    }

    fn on_obstacle(&self) -> bool {
        self.sim_state.near_obstacle
            && self.obstacles.iter().any(|obstacle| self.handles.parts().any(|part| self.world.touch(*obstacle, part)))
    }

    fn energy(&self) -> f64 {
        energy_with_payload(&self.params, &self.wheels, &self.state(), &self.sim_state.payload, self.time())
    }

    /// Acts as a force during the next time step, so that the contact forces of the step include the reaction.
    fn push(&mut self, impulse: &Vector3<f64>, point: &Vector3<f64>) {
        let body = rotation_from_rapier(*self.world.bodies[self.handles.body].rotation());
        let angular_impulse = (body * (point - self.root)).cross(impulse);
        for i in 0..3 {
            self.sim_state.push[i] += impulse[i];
            self.sim_state.push[3 + i] += angular_impulse[i];
        }
    }

    fn hold_force(&mut self, force: &HeldForce<f64>) -> Result<()> {
        self.sim_state.force = *force;
        Ok(())
    }

    fn held_force(&self) -> HeldForce<f64> {
        self.sim_state.force
    }

    fn pending_push(&self) -> [f64; 6] {
        let [x, y, z, turn @ ..] = self.sim_state.push;
        let body = rotation_from_rapier(*self.world.bodies[self.handles.body].rotation());
        let about_com = Vector3::from(turn)
            - (body * (self.params.without_payload().body_com() - self.root)).cross(&Vector3::new(x, y, z));
        [x, y, z, about_com.x, about_com.y, about_com.z]
    }

    fn move_payload(&mut self, offset: [f64; 3]) {
        self.sim_state.payload.offset = offset;
    }

    fn payload(&self) -> Deflection<f64> {
        Deflection::of(&Payload::new(&self.params), &LaneState::from(&self.state()), &self.sim_state.payload)
    }

    fn save(&self) -> Vec<u8> {
        snapshot::pack(&(&self.sim_state, &self.world))
    }

    fn load(&mut self, bytes: &[u8]) -> Result<()> {
        let invalid = |reason: String| Error::Decode { what: "snapshot of a rigid world".into(), reason };
        let (sim_state, world): (SimulationState, World) = snapshot::unpack("snapshot of a rigid world", bytes)?;
        if !world.holds(&self.handles) {
            return Err(invalid("it lacks a part of the robot".into()));
        }
        self.sim_state = sim_state;
        self.world = world;
        self.pipeline = new_pipeline();
        Ok(())
    }
}

/// Whether the rapier bodies of two robots are equal. Parameters that are read at each step or set with the joint
/// friction may differ.
fn same_bodies(a: &Params, b: &Params) -> bool {
    // A payload is not a rapier body.
    let [a, b] = [a, b].map(Params::without_payload);
    let read_each_step = Params {
        gravity: b.gravity,
        floor_tilt: b.floor_tilt,
        floor_friction_gradient: b.floor_friction_gradient,
        floor_patch_size: b.floor_patch_size,
        floor_patch_friction: b.floor_patch_friction,
        floor_patch_seed: b.floor_patch_seed,
        floor_tilt_amplitude: b.floor_tilt_amplitude,
        floor_tilt_period: b.floor_tilt_period,
        floor_tilt_phases: b.floor_tilt_phases,
        floor_acceleration: b.floor_acceleration,
        floor_acceleration_period: b.floor_acceleration_period,
        floor_acceleration_phase: b.floor_acceleration_phase,
        floor_acceleration_rise: b.floor_acceleration_rise,
        ball_viscous_friction: b.ball_viscous_friction,
        max_wheel_torque: b.max_wheel_torque,
        wheel_viscous_friction: b.wheel_viscous_friction,
        wheel_coulomb_friction: b.wheel_coulomb_friction,
        wheel_static_friction: b.wheel_static_friction,
        wheel_dynamic_friction: b.wheel_dynamic_friction,
        wheel_preload: b.wheel_preload,
        roller_ripple: b.roller_ripple,
        roller_count: b.roller_count,
        roller_phases: b.roller_phases,
        payload_position: b.payload_position,
        payload_stiffness: b.payload_stiffness,
        payload_damping: b.payload_damping,
        payload_amplitude: b.payload_amplitude,
        payload_period: b.payload_period,
        payload_phases: b.payload_phases,
        ..a
    };
    read_each_step == b
}
