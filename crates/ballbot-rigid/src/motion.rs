//! The model `rigid` of one robot: a scene with nothing but the robot, its ground and obstacles.

use super::bodies::BodyLink;
use super::bot::Bot;
use super::robot::Robot;
use super::scene::Scene;
use super::world::World;
use ballbot_base::error::Result;
use ballbot_base::force::HeldForce;
use ballbot_base::lane_state::LaneState;
use ballbot_base::model::{Model, same_geometry};
use ballbot_base::params::Params;
use ballbot_base::payload::{Deflection, PAYLOADS, Payload, PayloadMotion};
use ballbot_base::state::{Contacts, State};
use ballbot_base::terrain::Ground;
use ballbot_base::wheels::Wheels;
use nalgebra::Vector3;
use std::any::Any;
use std::sync::Arc;

/// A ballbot of rigid bodies on the ground.
pub struct RigidMotion {
    scene: Scene,
}

impl RigidMotion {
    /// A robot upright at rest.
    ///
    /// # Errors
    /// [`ballbot_base::error::Error::Inconsistent`] if the wheels have more inertia than the bot.
    pub fn new(params: &Params, sim_dt: f64) -> Result<Self> {
        Self::on(params, None, sim_dt)
    }

    fn on(params: &Params, ground: Option<&Arc<Ground>>, sim_dt: f64) -> Result<Self> {
        Ok(Self { scene: Scene::of_one(params, ground, sim_dt)? })
    }

    fn robot(&self) -> &Robot {
        &self.scene.robots[0]
    }

    fn robot_mut(&mut self) -> &mut Robot {
        &mut self.scene.robots[0]
    }

    fn world(&self) -> &World {
        &self.scene.world
    }
}

impl Model for RigidMotion {
    fn as_any(&self) -> &dyn Any {
        self
    }

    fn params(&self) -> &Params {
        &self.robot().params
    }

    fn sim_dt(&self) -> f64 {
        self.robot().dt
    }

    fn set_params(&mut self, params: &Params) -> Result<()> {
        let former = self.robot();
        let [before, after] = [&former.params, params].map(Payload::of);
        let body = LaneState::from(&self.state());
        let payloads = PayloadMotion::all_changed(&former.sim_state.payloads, &before, &after, &body);
        if same_bodies(&former.params, params) {
            let link = BodyLink::new(params, &former.wheels)?;
            let robot = self.robot_mut();
            robot.params = params.clone();
            (robot.gravity, robot.grip) = (params.gravity_vector(), 1.0);
            robot.bot = Bot::new(params, &robot.wheels, &link, &robot.bot.undamped, robot.dt);
            robot.sim_state.payloads = payloads;
        } else {
            let mut scene = Scene::of_one(params, former.ground.as_ref(), former.dt)?;
            if same_geometry(&former.params, params) {
                let state = self.state();
                let robot = &mut scene.robots[0];
                robot.set_motion(&mut scene.world, &state);
                robot.sim_state = former.sim_state;
                robot.sim_state.payloads = payloads;
                // A pending push keeps its point: its angular impulse is about the root, which has moved.
                let [x, y, z, turn @ ..] = &mut robot.sim_state.push;
                let moved = state.body_quaternion * (former.root - robot.root);
                let change = moved.cross(&Vector3::new(*x, *y, *z));
                turn.iter_mut().zip(&change).for_each(|(turn, change)| *turn += change);
            }
            self.scene = scene;
        }
        self.scene.robots[0].apply_joint_friction(&mut self.scene.world);
        Ok(())
    }

    fn set_ground(&mut self, ground: Option<&Arc<Ground>>) -> Result<()> {
        *self = Self::on(self.params(), ground, self.sim_dt())?;
        Ok(())
    }

    fn place(&mut self, state: &State) {
        self.scene.place(std::slice::from_ref(state));
    }

    fn advance(&mut self, wheel_torques: Wheels<f64>, steps: usize) {
        self.scene.advance(&[wheel_torques], steps);
    }

    fn time(&self) -> f64 {
        self.robot().time()
    }

    fn healthy(&self) -> bool {
        self.robot().sim_state.is_finite
    }

    fn accepts(&self, state: &State) -> Result<()> {
        self.robot().accepts(state)
    }

    fn state(&self) -> State {
        self.robot().state(self.world())
    }

    fn contacts(&self) -> Contacts {
        self.robot().contacts(self.world())
    }

    fn bot_on_floor(&self) -> bool {
        self.robot().bot_on_floor(self.world())
    }

    fn on_obstacle(&self) -> bool {
        self.robot().on_obstacle(self.world())
    }

    fn energy(&self) -> f64 {
        self.robot().energy(self.world())
    }

    fn push(&mut self, impulse: &Vector3<f64>, point: &Vector3<f64>) {
        self.scene.robots[0].push(&self.scene.world, impulse, point);
    }

    fn hold_force(&mut self, force: &HeldForce<f64>) -> Result<()> {
        self.robot_mut().sim_state.force = *force;
        Ok(())
    }

    fn held_force(&self) -> HeldForce<f64> {
        self.robot().sim_state.force
    }

    fn pending_push(&self) -> [f64; 6] {
        self.robot().pending_push(self.world())
    }

    fn move_payload(&mut self, index: usize, offset: [f64; 3]) {
        self.scene.move_payload(0, index, offset);
    }

    fn payloads(&self) -> [Deflection<f64>; PAYLOADS] {
        self.scene.payloads(0)
    }

    fn set_payloads(&mut self, deflections: &[Deflection<f64>; PAYLOADS]) {
        self.scene.set_payloads(0, deflections);
    }

    fn save(&self) -> Vec<u8> {
        self.scene.save()
    }

    fn load(&mut self, bytes: &[u8]) -> Result<()> {
        self.scene.load(bytes)
    }
}

/// Whether the rapier bodies of two robots are equal. Parameters that are read at each step or set with the joint
/// friction may differ.
fn same_bodies(a: &Params, b: &Params) -> bool {
    // A payload is not a rapier body.
    let [a, b] = [a, b].map(Params::without_payloads);
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
        second_payload_position: b.second_payload_position,
        second_payload_stiffness: b.second_payload_stiffness,
        second_payload_damping: b.second_payload_damping,
        second_payload_amplitude: b.second_payload_amplitude,
        second_payload_period: b.second_payload_period,
        second_payload_phases: b.second_payload_phases,
        ..a
    };
    read_each_step == b
}
