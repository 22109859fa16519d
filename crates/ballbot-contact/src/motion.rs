//! Simulation of one robot of the contact model in `f64`.

use super::constants::Constants;
use super::footing::Footing;
use super::perturbed::PerturbedFloor;
use super::state::ContactState;
use super::step::advance;
use ballbot_base::collision_shape::CollisionShape;
use ballbot_base::energy::energy_with_payloads;
use ballbot_base::error::Result;
use ballbot_base::force::HeldForce;
use ballbot_base::kinematics::Omniwheels;
use ballbot_base::model::{Model, same_geometry};
use ballbot_base::params::Params;
use ballbot_base::payload::{Deflection, PAYLOADS};
use ballbot_base::snapshot;
use ballbot_base::state::{Contacts, State};
use ballbot_base::terrain::{Ground, upright_on};
use ballbot_base::wheels::Wheels;
use nalgebra::Vector3;
use std::any::Any;
use std::sync::Arc;

/// A ballbot on the ground, with unilateral contacts and friction.
pub struct ContactMotion {
    params: Params,
    wheels: Omniwheels,
    constants: Constants<f64>,
    memory: ContactState<f64>,
    footing: Option<Footing<f64>>,
    perturbed: Option<Box<PerturbedFloor<f64>>>,
}

impl ContactMotion {
    /// A robot upright at rest.
    pub fn new(params: &Params, sim_dt: f64) -> Self {
        let constants = Constants::new(params, sim_dt);
        let mut motion = Self {
            wheels: Omniwheels::new(params),
            perturbed: PerturbedFloor::new(params, &constants),
            constants,
            memory: ContactState::default(),
            footing: None,
            params: params.clone(),
        };
        motion.place(&State::upright(params));
        motion
    }

    /// Constants of the robot and the time step.
    pub fn constants(&self) -> &Constants<f64> {
        &self.constants
    }

    /// State of the simulation, with warm-start impulses.
    pub fn memory(&self) -> &ContactState<f64> {
        &self.memory
    }

    fn ground(&self) -> Option<&Ground> {
        self.footing.as_ref().map(|footing| &*footing.ground)
    }
}

impl Model for ContactMotion {
    fn as_any(&self) -> &dyn Any {
        self
    }

    fn params(&self) -> &Params {
        &self.params
    }

    fn sim_dt(&self) -> f64 {
        self.constants.sim_dt
    }

    fn set_params(&mut self, params: &Params) -> Result<()> {
        let keeps_moving = same_geometry(&self.params, params);
        let sim_dt = self.constants.sim_dt;
        let constants = Constants::new(params, sim_dt);
        self.wheels = Omniwheels::new(params);
        self.params = params.clone();
        self.memory.change_body(&self.constants, &constants);
        self.perturbed = PerturbedFloor::new(params, &constants);
        self.constants = constants;
        if keeps_moving {
            // Reset impulses of joint friction: without friction no row would remove them.
            self.memory.joint_impulses = Wheels::default();
        } else {
            self.place(&upright_on(self.ground(), params));
        }
        Ok(())
    }

    fn set_ground(&mut self, ground: Option<&Arc<Ground>>) -> Result<()> {
        self.footing = ground.map(Footing::new);
        self.place(&upright_on(self.ground(), &self.params));
        Ok(())
    }

    fn place(&mut self, state: &State) {
        self.memory = ContactState::at(&self.constants, &self.wheels, self.ground(), state);
    }

    fn advance(&mut self, wheel_torques: Wheels<f64>, steps: usize) {
        if let Some(perturbed) = &mut self.perturbed {
            for _ in 0..steps {
                let ground = self.footing.as_ref().map(|footing| &*footing.ground);
                let constants = perturbed.next(&self.memory, ground);
                advance(constants, &mut self.memory, self.footing.as_mut(), wheel_torques, 1);
            }
            return;
        }
        advance(&self.constants, &mut self.memory, self.footing.as_mut(), wheel_torques, steps);
    }

    fn time(&self) -> f64 {
        self.memory.steps * self.constants.sim_dt
    }

    fn state(&self) -> State {
        self.memory.read(&self.constants).into()
    }

    fn contacts(&self) -> Contacts {
        self.memory.contacts(&self.constants, self.ground())
    }

    fn bot_on_floor(&self) -> bool {
        self.memory.bot_on_floor > 0.0
    }

    fn on_obstacle(&self) -> bool {
        self.memory.on_obstacle > 0.0
    }

    fn energy(&self) -> f64 {
        energy_with_payloads(&self.params, &self.wheels, &self.state(), &self.memory.payloads, self.time())
    }

    fn healthy(&self) -> bool {
        self.memory.diverged == 0.0
    }

    fn accepts(&self, state: &State) -> Result<()> {
        state.validate()?;
        CollisionShape::new(&self.params, &self.wheels).require_above(self.ground(), state)
    }

    /// Acts during the next time step, so that the contact forces of the step include the reaction.
    fn push(&mut self, impulse: &Vector3<f64>, point: &Vector3<f64>) {
        self.memory.push(&self.constants, impulse, point);
    }

    fn pending_push(&self) -> [f64; 6] {
        self.memory.push
    }

    fn hold_force(&mut self, force: &HeldForce<f64>) -> Result<()> {
        self.memory.force = *force;
        Ok(())
    }

    fn held_force(&self) -> HeldForce<f64> {
        self.memory.force
    }

    fn move_payload(&mut self, index: usize, offset: [f64; 3]) {
        self.memory.payloads[index].offset = offset;
    }

    fn payloads(&self) -> [Deflection<f64>; PAYLOADS] {
        self.memory.payload_deflections(&self.constants)
    }

    fn set_payloads(&mut self, deflections: &[Deflection<f64>; PAYLOADS]) {
        self.memory.set_payloads(&self.constants, deflections);
    }

    fn save(&self) -> Vec<u8> {
        snapshot::pack(&self.memory)
    }

    fn load(&mut self, bytes: &[u8]) -> Result<()> {
        self.memory = snapshot::unpack("snapshot of a contact model", bytes)?;
        Ok(())
    }
}
