//! The rigid-body robot in motion.

use super::bodies::BodyLink;
use super::convert::{from_rapier, rotation_from_rapier, rotation_to_rapier, to_rapier};
use super::rows::WheelForce;
use super::wheel_contact::{self, Contact};
use super::world::{Handles, World, integration_parameters, new_pipeline};
use crate::energy::mechanical_energy;
use crate::error::{Error, Result};
use crate::kinematics::Omniwheels;
use crate::model::{Model, same_geometry};
use crate::params::Params;
use crate::sim::collision_shape::CollisionShape;
use crate::snapshot;
use crate::state::{Contacts, State};
use nalgebra::Vector3;
use rapier3d_f64::prelude::*;
use serde::{Deserialize, Serialize};

/// How far the wheel may hover over the ball for its first friction limit to count on the robot's weight, m.
const CONTACT_TOLERANCE: f64 = 1e-4;

/// A ballbot of rigid bodies on a flat floor.
pub struct RigidMotion {
    pub(super) params: Params,
    pub(super) wheels: Omniwheels,
    /// CoM of the body without its wheels, in the body frame: the multibody's root.
    pub(super) root: Vector3<f64>,
    pub(super) collision_shape: CollisionShape,
    pub(super) template: World,
    pub(super) handles: Handles,
    pub(super) settings: IntegrationParameters,
    pub(super) pipeline: PhysicsPipeline,
    pub(super) world: World,
    pub(super) sim_state: SimulationState,
}

/// What the next step needs besides the world.
#[derive(Clone, Copy, Serialize, Deserialize)]
pub(super) struct SimulationState {
    pub(super) steps: u64,
    /// Between wheels and ball; the loads bound the drive friction of the next step.
    pub(super) wheel_forces: [WheelForce; 3],
    pub(super) floor_force: [f64; 3],
    /// Impulse on the body at its root and angular impulse about it, still to act, N·s and N·m·s.
    pub(super) push: [f64; 6],
    /// False once rapier has frozen a state that was not finite.
    pub(super) healthy: bool,
}

impl SimulationState {
    fn at_rest(wheel_forces: [WheelForce; 3]) -> Self {
        Self { steps: 0, wheel_forces, floor_force: [0.0; 3], push: [0.0; 6], healthy: true }
    }
}

impl RigidMotion {
    /// At rest upright.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] if the wheels have more inertia than the whole bot.
    pub fn new(params: &Params, sim_dt: f64) -> Result<Self> {
        let wheels = Omniwheels::new(params);
        let (template, handles) = World::new(params, &wheels)?;
        let sim_state = SimulationState::at_rest([WheelForce::default(); 3]);
        let mut motion = Self {
            root: BodyLink::new(params, &wheels)?.com,
            collision_shape: CollisionShape::new(params, &wheels),
            wheels,
            world: template.clone(),
            template,
            handles,
            settings: integration_parameters(sim_dt),
            pipeline: new_pipeline(),
            sim_state,
            params: params.clone(),
        };
        motion.place(&State::upright(params));
        Ok(motion)
    }

    pub(super) fn axle(&self, i: usize) -> Vector3<f64> {
        let body = rotation_from_rapier(*self.world.bodies[self.handles.body].rotation());
        -(body * self.wheels.u.row(i).transpose())
    }

    pub(super) fn contact(&self, i: usize) -> Contact {
        let ball = from_rapier(self.world.bodies[self.handles.ball].translation());
        let wheel = from_rapier(self.world.bodies[self.handles.wheels[i]].translation());
        Contact::new(ball, self.params.ball_radius, wheel, self.params.wheel_radius, &self.axle(i))
    }

    fn bot(&self) -> &Multibody {
        self.world.multibody_joints.get_multibody(self.handles.bot).expect("the bot is never removed")
    }

    /// Linear velocity of the root and angular velocity of the body, inertial frame. The multibody knows them at the
    /// end of a step, its rigid bodies only at the start of the next.
    pub(super) fn root_velocity(&self) -> (Vector3<f64>, Vector3<f64>) {
        let velocities = self.bot().generalized_velocity();
        (velocities.fixed_rows::<3>(0).into_owned(), velocities.fixed_rows::<3>(3).into_owned())
    }

    /// Wheel surface less ball surface along the drive direction, m/s.
    pub(super) fn slip_speed(&self, i: usize, contact: &Contact) -> f64 {
        let (velocity, rate) = self.root_velocity();
        let root = from_rapier(self.world.bodies[self.handles.body].translation());
        let of_body = velocity + rate.cross(&(contact.point - root));
        // Relative to the body, the rim moves along the drive direction.
        let rim = self.params.wheel_radius * self.bot().generalized_velocity()[6 + i];
        let ball = wheel_contact::point_velocity(&self.world.bodies[self.handles.ball], &contact.point);
        (of_body - ball).dot(&contact.drive) + rim
    }

    pub(super) fn floor_slip(&self) -> Vector3<f64> {
        let ball = &self.world.bodies[self.handles.ball];
        let lowest = from_rapier(ball.translation()) - Vector3::z() * self.params.ball_radius;
        let velocity = wheel_contact::point_velocity(ball, &lowest);
        Vector3::new(velocity.x, velocity.y, 0.0)
    }

    fn apply_joint_friction(&mut self) {
        let bot = self.world.multibody_joints.get_multibody_mut(self.handles.bot).expect("the bot is never removed");
        for (i, _) in self.handles.wheels.iter().enumerate() {
            bot.damping_mut()[6 + i] = self.params.wheel_viscous_friction;
            bot.frictions_mut()[6 + i] = self.params.wheel_coulomb_friction;
        }
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
        displacements[6..].copy_from_slice(&state.wheel_angles);
        bot.apply_displacements(&displacements);
        let mut velocities = bot.generalized_velocity_mut();
        velocities.fixed_rows_mut::<3>(0).copy_from_slice(velocity.as_slice());
        velocities.fixed_rows_mut::<3>(3).copy_from_slice(rate.as_slice());
        velocities.fixed_rows_mut::<3>(6).copy_from_slice(&state.wheel_speeds);
        bot.forward_kinematics(&world.bodies, true);
        bot.update_rigid_bodies(&mut world.bodies, true);
    }

    /// Before the first step no contact has carried a load yet: count on the weight where a wheel touches.
    fn first_forces(&self) -> [WheelForce; 3] {
        let usual = self.params.static_wheel_load();
        let ball = self.world.bodies[self.handles.ball].translation();
        let on_floor = ball.z - self.params.ball_radius <= CONTACT_TOLERANCE;
        [0, 1, 2].map(|i| {
            let load = if self.contact(i).gap <= CONTACT_TOLERANCE { usual } else { 0.0 };
            WheelForce { load, normal_estimate: load, traction: 0.0, steady: load > 0.0 && on_floor }
        })
    }
}

impl Model for RigidMotion {
    fn params(&self) -> &Params {
        &self.params
    }

    fn sim_dt(&self) -> f64 {
        self.settings.dt
    }

    fn set_params(&mut self, params: &Params) -> Result<()> {
        if same_bodies(&self.params, params) {
            self.params = params.clone();
        } else {
            let mut robot = Self::new(params, self.settings.dt)?;
            if same_geometry(&self.params, params) {
                robot.set_motion(&self.state());
                robot.sim_state = self.sim_state;
            }
            *self = robot;
        }
        self.apply_joint_friction();
        Ok(())
    }

    fn place(&mut self, state: &State) {
        self.world = self.template.clone();
        self.pipeline = new_pipeline();
        self.set_motion(state);
        self.sim_state = SimulationState::at_rest(self.first_forces());
        self.apply_joint_friction();
    }

    fn advance(&mut self, wheel_torques: &[f64; 3], steps: usize) {
        for _ in 0..steps {
            self.step(wheel_torques);
        }
    }

    fn time(&self) -> f64 {
        self.sim_state.steps as f64 * self.settings.dt
    }

    fn healthy(&self) -> bool {
        self.sim_state.healthy
    }

    fn accepts(&self, state: &State) -> Result<()> {
        state.validate()?;
        self.collision_shape.require_above_floor(state)
    }

    fn state(&self) -> State {
        let ball = &self.world.bodies[self.handles.ball];
        let body = &self.world.bodies[self.handles.body];
        let bot = self.bot();
        let velocities = bot.generalized_velocity();
        let body_quaternion = rotation_from_rapier(*body.rotation());
        let (velocity, rate) = self.root_velocity();
        let rate = body_quaternion.inverse_transform_vector(&rate);
        let angle = |i: usize| bot.link(1 + i).map_or(0.0, |link| link.joint().coords()[3]);
        State {
            ball_position: from_rapier(ball.translation()),
            ball_quaternion: rotation_from_rapier(*ball.rotation()),
            ball_velocity: from_rapier(ball.linvel()),
            ball_angular_velocity: from_rapier(ball.angvel()),
            body_position: from_rapier(body.translation()) - body_quaternion * self.root,
            body_quaternion,
            body_velocity: velocity - body_quaternion * rate.cross(&self.root),
            body_angular_velocity: rate,
            wheel_angles: [angle(0), angle(1), angle(2)],
            wheel_speeds: [velocities[6], velocities[7], velocities[8]],
        }
    }

    fn contacts(&self) -> Contacts {
        let forces = &self.sim_state.wheel_forces;
        Contacts {
            // Before the first step the loads are only what its friction counts on.
            wheel_normal_forces: if self.sim_state.steps > 0 { forces.map(|f| f.load) } else { [0.0; 3] },
            wheel_tractions: forces.map(|f| f.traction),
            wheel_slip_speeds: [0, 1, 2].map(|i| self.slip_speed(i, &self.contact(i))),
            floor_force: self.sim_state.floor_force.into(),
            floor_slip_velocity: self.floor_slip().xy(),
            bot_on_floor: self.bot_on_floor(),
        }
    }

    fn bot_on_floor(&self) -> bool {
        let h = &self.handles;
        let on_floor = |collider| self.world.touch(h.floor_collider, collider);
        on_floor(h.body_collider) || h.wheel_colliders.iter().any(|&wheel| on_floor(wheel))
    }

    fn energy(&self) -> f64 {
        mechanical_energy(&self.params, &self.wheels, &self.state())
    }

    /// Acts as a force over the next time step, so that the contacts answer within that step.
    fn push(&mut self, impulse: &Vector3<f64>, point: &Vector3<f64>) {
        let body = rotation_from_rapier(*self.world.bodies[self.handles.body].rotation());
        let angular_impulse = (body * (point - self.root)).cross(impulse);
        for i in 0..3 {
            self.sim_state.push[i] += impulse[i];
            self.sim_state.push[3 + i] += angular_impulse[i];
        }
        if *impulse == Vector3::zeros() {
            return;
        }
        // Loads under a push are not those of the step before it.
        self.sim_state.wheel_forces.iter_mut().for_each(|force| force.steady = false);
    }

    fn save(&self) -> Vec<u8> {
        snapshot::pack(&(&self.sim_state, &self.world))
    }

    fn load(&mut self, bytes: &[u8]) -> Result<()> {
        let refused = |reason: String| Error::Decode { what: "snapshot of a rigid world".into(), reason };
        let (sim_state, world): (SimulationState, World) = snapshot::unpack("snapshot of a rigid world", bytes)?;
        if !world.holds(&self.handles) {
            return Err(refused("it lacks a part of the robot".into()));
        }
        self.sim_state = sim_state;
        self.world = world;
        self.pipeline = new_pipeline();
        Ok(())
    }
}

/// Whether two robots are the same to rapier: only values that are read at every step, or set with the joint friction,
/// differ.
fn same_bodies(a: &Params, b: &Params) -> bool {
    let read_each_step = Params {
        gravity: b.gravity,
        ball_viscous_friction: b.ball_viscous_friction,
        max_wheel_torque: b.max_wheel_torque,
        wheel_viscous_friction: b.wheel_viscous_friction,
        wheel_coulomb_friction: b.wheel_coulomb_friction,
        wheel_static_friction: b.wheel_static_friction,
        wheel_dynamic_friction: b.wheel_dynamic_friction,
        ..a.clone()
    };
    read_each_step == *b
}
