//! Robots in one rapier world, and a time step of all of them.

use super::between::Between;
use super::outline::Outline;
use super::robot::{Robot, SimulationState};
use super::solve::Settling;
use super::stepping::Plan;
use super::world::{World, integration_parameters, new_pipeline};
use ballbot_base::error::{Error, Result};
use ballbot_base::force::HeldForce;
use ballbot_base::params::Params;
use ballbot_base::payload::{Deflection, PAYLOADS};
use ballbot_base::snapshot;
use ballbot_base::state::{Contacts, State};
use ballbot_base::terrain::{Ground, upright_on};
use ballbot_base::wheels::Wheels;
use nalgebra::Vector3;
use rapier3d_f64::prelude::*;
use std::sync::Arc;

/// Rapier's sweeps before and after the bodies are moved, for balls on the floor: the first is exact for the normal force,
/// the second for the friction.
const BALL_SWEEPS: [usize; 2] = [2, 0];

/// Rapier's sweeps with the colliders of a bot. Chosen by experiment.
const BOT_SWEEPS: [usize; 2] = [8, 4];

/// Largest number of passes over a step in which a bot touches the floor, a body its ball, or a robot another. Chosen by
/// experiment.
const PASSES: usize = 8;

/// Robots on one ground.
pub struct Scene {
    pub(super) robots: Vec<Robot>,
    pub(super) world: World,
    template: World,
    settings: IntegrationParameters,
    pipeline: PhysicsPipeline,
    between: Between,
    plans: Vec<Plan>,
    outlines: Vec<Outline>,
}

impl Scene {
    /// A robot upright at rest.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] if the wheels have more inertia than the bot.
    pub(super) fn of_one(params: &Params, ground: Option<&Arc<Ground>>, dt: f64) -> Result<Self> {
        let (robot, world) = Robot::new(params, ground, dt)?;
        let mut scene = Self::new(vec![robot], world, Between::default(), dt);
        scene.place(&[upright_on(ground.map(|ground| &**ground), params)]);
        Ok(scene)
    }

    /// Robots that touch each other with the friction and restitution of `between`, all at the origin: [`Scene::place`]
    /// moves them to their states.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] if the wheels of a robot have more inertia than its bot.
    pub fn of_several(robots: &[(&Params, Option<&Arc<Ground>>)], between: Between, dt: f64) -> Result<Self> {
        let mut world = World::default();
        let mut joined = Vec::with_capacity(robots.len());
        for (number, (params, ground)) in robots.iter().enumerate() {
            let (mut robot, _) = Robot::new(params, *ground, dt)?;
            robot.join(&mut world, (robots.len() > 1).then_some(number))?;
            joined.push(robot);
        }
        Ok(Self::new(joined, world, between, dt))
    }

    fn new(mut robots: Vec<Robot>, mut world: World, between: Between, dt: f64) -> Self {
        let terrain = robots.first().and_then(|robot| robot.ground.clone());
        let obstacles: Arc<[ColliderHandle]> = terrain.map_or(Arc::default(), |ground| world.insert_obstacles(&ground));
        robots.iter_mut().for_each(|robot| robot.obstacles = obstacles.clone());
        Self {
            plans: Vec::with_capacity(robots.len()),
            outlines: Vec::with_capacity(robots.len()),
            robots,
            template: world.clone(),
            world,
            settings: integration_parameters(dt),
            pipeline: new_pipeline(),
            between,
        }
    }

    /// Restarts from the state of each robot at time zero.
    pub fn place(&mut self, states: &[State]) {
        self.restore(self.template.clone());
        for (robot, state) in self.robots.iter_mut().zip(states) {
            robot.place(&mut self.world, state);
        }
    }

    /// Continues with another world.
    pub(super) fn restore(&mut self, world: World) {
        self.world = world;
        self.pipeline = new_pipeline();
    }

    /// Advances by `steps` time steps with constant motor torques of each robot, N·m.
    pub fn advance(&mut self, wheel_torques: &[Wheels<f64>], steps: usize) {
        for _ in 0..steps {
            self.step(wheel_torques);
        }
    }

    /// Parameters of a robot.
    pub fn params(&self, robot: usize) -> &Params {
        &self.robots[robot].params
    }

    /// The ground under a robot; `None` for a level floor.
    pub fn ground(&self, robot: usize) -> Option<&Ground> {
        self.robots[robot].ground.as_deref()
    }

    /// Friction and restitution between robots.
    pub fn between(&self) -> Between {
        self.between
    }

    /// Time step, s.
    pub fn dt(&self) -> f64 {
        self.settings.dt
    }

    /// Simulated time since the reset, s.
    pub fn time(&self) -> f64 {
        self.robots[0].time()
    }

    /// False after numbers of a robot that are not finite, which rapier freezes.
    pub fn healthy(&self, robot: usize) -> bool {
        self.robots[robot].sim_state.is_finite
    }

    /// Checks that a robot can be placed in a state, wherever the others are.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for parts within the floor or an obstacle.
    pub fn accepts(&self, robot: usize, state: &State) -> Result<()> {
        self.robots[robot].accepts(state)
    }

    /// The first two robots that overlap by more than `most` m in the given states, and by how much.
    pub fn overlap(&self, states: &[State], most: f64) -> Option<(usize, usize, f64)> {
        let mut world = self.template.clone();
        for (robot, state) in self.robots.iter().zip(states) {
            robot.set_motion(&mut world, state);
        }
        let pairs = (0..states.len()).flat_map(|j| (0..j).map(move |i| (i, j)));
        pairs.filter(|&(i, j)| self.may_overlap([i, j], states)).find_map(|(i, j)| {
            let mut parts = self.robots[i].handles.parts();
            parts.find_map(|mine| {
                let mut overlaps = self.robots[j].handles.parts().map(|theirs| world.overlap(mine, theirs));
                overlaps.find(|overlap| *overlap > most).map(|overlap| (i, j, overlap))
            })
        })
    }

    fn may_overlap(&self, pair: [usize; 2], states: &[State]) -> bool {
        let [a, b] = pair.map(|robot| states[robot].ball_position);
        (a - b).norm() <= pair.iter().map(|&robot| self.robots[robot].reach(&states[robot])).sum()
    }

    /// State of a robot.
    pub fn state(&self, robot: usize) -> State {
        self.robots[robot].state(&self.world)
    }

    /// Contact forces of a robot in the last step, without those between robots.
    pub fn contacts(&self, robot: usize) -> Contacts {
        self.robots[robot].contacts(&self.world)
    }

    /// Impulse of robot `of` on robot `on` in the last step, inertial frame, N·s.
    pub fn impulse_between(&self, of: usize, on: usize) -> Vector3<f64> {
        self.robots[on].impulse_of(&self.world, &self.robots[of])
    }

    /// Kinetic plus potential energy of a robot, J.
    pub fn energy(&self, robot: usize) -> f64 {
        self.robots[robot].energy(&self.world)
    }

    /// Deflection of a robot's payload from its place.
    pub fn payloads(&self, robot: usize) -> [Deflection<f64>; PAYLOADS] {
        self.robots[robot].payloads(&self.world)
    }

    /// Moves the rest of a payload's springs of a robot, body axes, m.
    pub fn move_payload(&mut self, robot: usize, index: usize, offset: [f64; 3]) {
        self.robots[robot].sim_state.payloads[index].offset = offset;
    }

    /// Replaces the deflections of a robot's payloads.
    pub fn set_payloads(&mut self, robot: usize, deflections: &[Deflection<f64>; PAYLOADS]) {
        self.robots[robot].set_payloads(&self.world, deflections);
    }

    /// Applies an impulse (inertial frame, N·s) to a body at `point` (body frame, m) over the next step.
    pub fn push(&mut self, robot: usize, impulse: &Vector3<f64>, point: &Vector3<f64>) {
        self.robots[robot].push(&self.world, impulse, point);
    }

    /// Replaces the external force on a body.
    pub fn hold_force(&mut self, robot: usize, force: &HeldForce<f64>) {
        self.robots[robot].sim_state.force = *force;
    }

    /// Everything that determines the future motion, for [`Scene::load`].
    pub fn save(&self) -> Vec<u8> {
        let states: Vec<_> = self.robots.iter().map(|robot| robot.sim_state).collect();
        snapshot::pack(&(states, &self.world))
    }

    /// Continues from bytes of [`Scene::save`] of a scene with the same robots.
    ///
    /// # Errors
    /// [`Error::Decode`] for any other bytes; the scene is then unchanged.
    pub fn load(&mut self, bytes: &[u8]) -> Result<()> {
        let what = "snapshot of a rigid world";
        let (states, world): (Vec<SimulationState>, World) = snapshot::unpack(what, bytes)?;
        if states.len() != self.robots.len() || !self.robots.iter().all(|robot| world.holds(&robot.handles)) {
            return Err(Error::Decode { what: what.into(), reason: "it lacks a part of a robot".into() });
        }
        self.robots.iter_mut().zip(states).for_each(|(robot, state)| robot.sim_state = state);
        self.restore(world);
        Ok(())
    }

    fn step(&mut self, wheel_torques: &[Wheels<f64>]) {
        let Self { robots, world, plans, .. } = self;
        plans.clear();
        for (robot, torques) in robots.iter_mut().zip(wheel_torques) {
            robot.load_body(world);
            plans.push(robot.plan(world, *torques));
        }
        self.find_neighbors();
        let Self { robots, world, plans, .. } = self;
        for (robot, plan) in robots.iter_mut().zip(&mut *plans) {
            robot.enable_colliders(world, plan);
        }
        let [solving, stabilizing] = if plans.iter().all(|plan| plan.alone) { BALL_SWEEPS } else { BOT_SWEEPS };
        self.settings.num_internal_pgs_iterations = solving;
        self.settings.num_internal_stabilization_iterations = stabilizing;
        if plans.iter().any(Plan::is_coupled) {
            self.pass_until_settled();
        } else {
            self.pass(true);
        }
        for (robot, plan) in self.robots.iter_mut().zip(&self.plans) {
            let state = &mut robot.sim_state;
            state.set_blow(&plan.blow);
            state.steps += 1;
            state.searched_steps += u64::from(plan.settling != Settling::AtOnce);
            state.unsolved_steps += u64::from(plan.settling == Settling::Unsolved);
        }
    }

    /// Finds the robots that may touch another within the step.
    fn find_neighbors(&mut self) {
        if self.robots.len() == 1 {
            return;
        }
        let Self { robots, world, plans, outlines, .. } = self;
        outlines.clear();
        outlines.extend(robots.iter().zip(&*plans).map(|(robot, plan)| {
            let [start, end] = plan.velocities().map(|velocities| robot.largest_motion(velocities));
            robot.outline(world, start.max(end))
        }));
        for (i, outline) in outlines.iter().enumerate() {
            for (j, other) in outlines[..i].iter().enumerate() {
                if !(plans[i].near && plans[j].near) && outline.may_touch(other) {
                    plans[i].near = true;
                    plans[j].near = true;
                }
            }
        }
    }

    /// Gauss-Seidel iteration between rapier's contacts of the bots and the wheel forces: repeats a step until rapier's
    /// contacts change the velocities by the amount assumed for the wheel forces. A step that does not converge is
    /// unsolved.
    fn pass_until_settled(&mut self) {
        let before = self.world.clone();
        for pass in 1.. {
            self.pass(pass == 1);
            if pass == PASSES || self.plans.iter().all(Plan::has_ended) {
                break;
            }
            self.restore(before.clone());
        }
        for plan in &mut self.plans {
            if plan.is_coupled() && !plan.settled {
                plan.settling = Settling::Unsolved;
            }
        }
    }

    /// Solves for the wheel forces while rapier's contacts of the bots change the velocities by the amounts of the plans,
    /// applies them, advances rapier's world, and finds the changes.
    fn pass(&mut self, first: bool) {
        let Self { robots, world, plans, .. } = self;
        for (robot, plan) in robots.iter_mut().zip(&mut *plans) {
            if first || plan.is_coupled() {
                robot.solve(plan);
            }
            robot.apply(world, plan);
        }
        // Gravity is the same for all: they stand on one floor.
        world.step(&mut self.pipeline, &robots[0].gravity, &self.settings, &self.between);
        for (robot, plan) in robots.iter_mut().zip(plans) {
            robot.sim_state.is_finite &= !robot.handles.in_quarantine(self.pipeline.quarantine());
            robot.find_changes(world, plan);
        }
    }
}
