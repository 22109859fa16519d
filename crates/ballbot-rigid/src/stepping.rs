//! A robot's part in a time step of its scene.

use super::bot::{Coordinates, join, split};
use super::convert::{from_rapier, rotation_from_rapier, to_rapier};
use super::floor::{Floor, plane, plane_below, plane_below_disc};
use super::losses::Losses;
use super::outline::reach_of_step;
use super::robot::Robot;
use super::rows::{Motion, Rows, Velocities, WheelContact, biases};
use super::solve::{Coupling, FLOOR, Impulses, Limits, Problem, Settling};
use super::world::{MAX_RECOVERY_SPEED, World};
use ballbot_base::friction::stribeck;
use ballbot_base::wheels::Wheels;
use nalgebra::{Matrix3, Vector2, Vector3};
use rapier3d_f64::prelude::*;

/// Clearance from floor, obstacles and other robots below which the colliders of the bot are enabled, m.
pub const CLEARANCE: f64 = 0.01;

/// Clearance between body and ball below which their colliders are enabled, and above which a wheel is clear of the
/// ball, as a fraction of the ball's radius.
const BALL_CLEARANCE: f64 = 0.01;

/// Change of the velocities of the rows between passes at which the passes end, as a fraction of the velocity change by
/// gravity in a step.
const SETTLED: f64 = 0.01;

/// A step of a robot before and during the passes over it.
pub struct Plan {
    pub motion: Motion,
    rows: Rows,
    coupling: Coupling,
    biases: Impulses,
    limits: Limits,
    /// Acceleration of the bot without contacts.
    acceleration: Coordinates,
    /// Force, N, and torque, N·m, of drag, losses and preload on the ball, inertial frame.
    drag: [Vector3<f64>; 2],
    /// Velocities at the end of the step without contacts.
    free: Velocities,
    /// Whether an obstacle or another robot may be touched.
    pub near: bool,
    /// Whether only wheels, ball and floor can touch each other: the bot's colliders are then disabled.
    pub alone: bool,
    /// Whether no wheel can touch the ball.
    apart: bool,
    /// Change of the velocities by rapier's contacts of the bot, as the wheel forces assume it.
    pub blow: Velocities,
    /// Whether the last pass changed it as assumed.
    pub settled: bool,
    has_failed: bool,
    /// The worst result of the passes.
    pub settling: Settling,
}

impl Plan {
    /// Whether rapier's contacts of the bot act on the wheel forces.
    pub fn is_coupled(&self) -> bool {
        !(self.alone || self.apart)
    }

    /// Velocities at the start of the step, and at its end without contacts.
    pub fn velocities(&self) -> [&Velocities; 2] {
        [&self.motion.velocities, &self.free]
    }

    /// Whether another pass would change nothing.
    pub fn has_ended(&self) -> bool {
        !self.is_coupled() || self.settled || self.has_failed
    }
}

impl Robot {
    /// Adds the external force and the reaction of the payloads to the push of the step.
    pub fn load_body(&mut self, world: &World) {
        if self.sim_state.force.is_on() {
            let point = self.sim_state.force.point.into();
            let impulse = self.sim_state.force.next_impulse();
            self.push(world, &impulse, &point);
        }
        if self.params.has_payload() {
            self.carry(world);
        }
    }

    /// Plans a step, and moves the floor to where it is.
    pub fn plan(&mut self, world: &mut World, wheel_torques: Wheels<f64>) -> Plan {
        if self.params.has_perturbed_floor() {
            self.perturb_floor(world);
        }
        self.move_floor(world);
        let mut plan = self.without_contacts(world, wheel_torques);
        plan.near = self.comes_near_obstacle(world, &plan.motion);
        self.sim_state.near_obstacle = plan.near;
        plan
    }

    /// Enables the colliders of the bot if it may touch something other than its ball with its wheels.
    pub fn enable_colliders(&self, world: &mut World, plan: &mut Plan) {
        plan.alone = !plan.near && self.only_wheels_and_ball_touch(world, &plan.motion);
        world.set_bot_colliders(&self.handles, !plan.alone);
        if !plan.alone {
            self.move_bot_planes(world);
        }
        if plan.is_coupled() {
            plan.blow = self.sim_state.blow();
        }
    }

    /// Sets gravity and floor friction of a step on a floor that moves, or on which friction differs from place to place.
    fn perturb_floor(&mut self, world: &World) {
        let ball = from_rapier(world.bodies[self.handles.ball].translation());
        let floor = Floor::under(self.ground.as_deref(), &ball, self.params.ball_radius);
        let touched = ball - floor.axes[2] * self.params.ball_radius;
        // In the middle of the step: its error is of second order.
        self.gravity = self.params.gravity_at((self.sim_state.steps as f64 + 0.5) * self.dt);
        self.grip = self.params.floor_friction_factor(touched.x, touched.y);
    }

    /// Moves rapier's plane of the ball to its contact with the ground, unless the ground is level.
    fn move_floor(&self, world: &mut World) {
        let Some(ground) = &self.ground else { return };
        let radius = self.params.ball_radius;
        let ball = from_rapier(world.bodies[self.handles.ball].translation());
        let (gap, normal) = ground.gap(&ball, radius);
        world.colliders[self.handles.floor_collider].set_position(plane(&(ball - normal * (gap + radius)), &normal));
    }

    /// Moves the planes of the bot to the ground below its parts, unless the ground is level.
    fn move_bot_planes(&self, world: &mut World) {
        let (Some(ground), Some(uneven)) = (&self.ground, &self.handles.uneven) else { return };
        let pose = world.bodies[self.handles.body].position();
        let (position, attitude) = (from_rapier(pose.translation), rotation_from_rapier(pose.rotation));
        let place = |point: &Vector3<f64>| position + attitude * (point - self.root);
        let shape = &self.collision_shape;
        let axis = attitude * Vector3::z();
        for (collider, height) in uneven.end_planes.into_iter().zip([shape.body.bottom, shape.body.top]) {
            let pose = plane_below_disc(ground, &place(&(Vector3::z() * height)), &axis, shape.body.radius);
            world.colliders[collider].set_position(pose);
        }
        for (collider, center) in uneven.wheel_planes.into_iter().zip(&shape.wheel_centers) {
            world.colliders[collider].set_position(plane_below(ground, &place(center)));
        }
    }

    /// Solves for the wheel forces while rapier's contacts of the bot change the velocities as planned.
    pub fn solve(&mut self, plan: &mut Plan) {
        let residual = plan.rows.speeds(&plan.free.plus(&plan.blow, 1.0)) + plan.biases;
        let problem = Problem { coupling: &plan.coupling, residual, active: plan.rows.active() };
        let (impulses, settling) = problem.solve(&plan.limits, &Impulses::from(self.sim_state.impulses));
        self.sim_state.impulses = impulses.into();
        plan.settling = plan.settling.max(settling);
    }

    /// Acceleration of the bot with its wheel forces.
    fn driven(&self, plan: &Plan) -> Coordinates {
        let impulses = Impulses::from(self.sim_state.impulses);
        plan.acceleration + self.bot.mass_inverse * plan.rows.on_bot(&impulses) / self.dt
    }

    /// Finds the floor's force, and the change of the velocities by rapier's contacts of the bot.
    pub fn find_changes(&mut self, world: &World, plan: &mut Plan) {
        let dt = self.dt;
        let (plane, ball) = (self.handles.floor_collider, self.handles.ball_collider);
        let floor_force = world.plane_impulse(plane, ball, &plan.motion.floor_normal) / dt;
        self.sim_state.floor_force = floor_force.into();
        if !plan.is_coupled() {
            return;
        }
        let [push, turn] = plan.rows.on_ball(&Impulses::from(self.sim_state.impulses));
        let floor = plan.motion.to_body * floor_force * dt;
        let [_, _, up] = plan.motion.floor_axes;
        let expected = Velocities {
            bot: plan.motion.velocities.bot + self.driven(plan) * dt,
            ball: [
                plan.free.ball[0] + (push + floor) / self.params.ball_mass,
                plan.free.ball[1] + (turn - up.cross(&floor) * self.params.ball_radius) / self.params.ball_inertia,
            ],
        };
        let found = self.velocities(world, &plan.motion.to_body).plus(&expected, -1.0);
        let change = plan.rows.speeds(&found.plus(&plan.blow, -1.0)).fixed_rows::<FLOOR>(0).amax();
        plan.blow = found;
        plan.settled = change <= SETTLED * self.params.gravity * dt;
        plan.has_failed = change.is_nan();
    }

    fn without_contacts(&mut self, world: &mut World, wheel_torques: Wheels<f64>) -> Plan {
        let dt = self.dt;
        let p = &self.params;
        let motion = self.motion(world);
        let contacts = self.wheel_contacts(world, &motion);
        let down = self.gravity_in_body(&motion);
        let velocity = from_rapier(world.bodies[self.handles.ball].linvel());
        let drag = (velocity - motion.floor_normal * motion.floor_normal.dot(&velocity)) * -p.ball_viscous_friction;
        let [fx, fy, fz, tx, ty, tz] = std::mem::take(&mut self.sim_state.push).map(|v| v / dt);
        let [force, torque] = [Vector3::new(fx, fy, fz), Vector3::new(tx, ty, tz)].map(|v| motion.to_body * v);
        let losses = if p.has_losses() { self.losses(&motion, &contacts) } else { Losses::none() };
        let mut applied = self.bot.weight(&down) + join(&[force, torque, wheel_torques.column()]) + losses.on_bot / dt;
        let [push, turn] = losses.on_ball.map(|impulse| impulse / dt);
        let mut drag = drag + motion.to_body.transpose() * push;
        if p.has_preload() {
            let pull = self.preload(&motion);
            applied -= join(&[pull, motion.ball.cross(&pull), Vector3::zeros()]);
            drag += motion.to_body.transpose() * pull;
        }
        let acceleration = self.bot.free_acceleration(&motion.velocities.bot, &applied);
        let of_ball = down + motion.to_body * drag / p.ball_mass;
        let free = Velocities { bot: acceleration, ball: [of_ball, turn / p.ball_inertia] };
        let clearance = self.ball_clearance(&motion);
        let rows = Rows::new(&self.parts, &self.bot, &motion, &contacts, p.wheel_coulomb_friction > 0.0);
        Plan {
            coupling: rows.coupling(&self.parts, &self.bot),
            rows,
            biases: biases(&contacts, motion.floor_gap, self.recovery_rate, MAX_RECOVERY_SPEED, dt),
            free: motion.velocities.plus(&free, dt),
            apart: contacts.iter().all(|contact| contact.gap > clearance),
            limits: self.limits(world, &contacts),
            drag: [drag, motion.to_body.transpose() * turn],
            motion,
            acceleration,
            near: false,
            alone: false,
            blow: Velocities::zeros(),
            settled: false,
            has_failed: false,
            settling: Settling::AtOnce,
        }
    }

    /// Force of the preload on the ball, body axes, N; the opposite force acts on the body at the ball's center.
    fn preload(&self, motion: &Motion) -> Vector3<f64> {
        // Farther away the ball has left whatever pressed it on the wheels.
        let held = (motion.ball + self.root).norm() <= self.params.ball_radius;
        if held { Vector3::z() * self.params.wheel_preload } else { Vector3::zeros() }
    }

    /// Contacts of the wheels and the ball.
    fn wheel_contacts(&self, world: &World, motion: &Motion) -> Wheels<WheelContact> {
        let contacts = Wheels::from_fn(|i| WheelContact::new(&self.parts, &self.bot, motion, i));
        if !self.params.has_ripple() {
            return contacts;
        }
        let ([_, _, rates], angles) = (split(&motion.velocities.bot), self.wheel_angles(world));
        let turning = Wheels::from_fn(|i| (i, angles[i], rates[i]));
        contacts
            .zip(turning)
            .map(|(contact, (i, angle, rate))| contact.with_ripple(&self.params, i, angle, rate, self.dt))
    }

    /// Acceleration of gravity in body axes, m/s².
    fn gravity_in_body(&self, motion: &Motion) -> Vector3<f64> {
        let gravity = &self.gravity;
        let across = motion.to_body.column(2) * gravity.z;
        if gravity.xy() == Vector2::zeros() {
            // Add nothing, to keep a possible negative zero.
            return across;
        }
        across + motion.to_body.column(0) * gravity.x + motion.to_body.column(1) * gravity.y
    }

    /// Positions and velocities in body axes.
    pub fn motion(&self, world: &World) -> Motion {
        let root = world.bodies[self.handles.body].position();
        let to_body = rotation_from_rapier(root.rotation).to_rotation_matrix().into_inner().transpose();
        let ball = &world.bodies[self.handles.ball];
        let floor = Floor::under(self.ground.as_deref(), &from_rapier(ball.translation()), self.params.ball_radius);
        Motion {
            ball: to_body * from_rapier(ball.translation() - root.translation),
            velocities: self.velocities(world, &to_body),
            floor_gap: floor.gap,
            floor_axes: floor.axes.map(|axis| to_body * axis),
            floor_normal: floor.axes[2],
            to_body,
        }
    }

    fn velocities(&self, world: &World, to_body: &Matrix3<f64>) -> Velocities {
        let [velocity, rate, joints] =
            split(&self.multibody(world).generalized_velocity().fixed_rows::<9>(0).into_owned());
        let ball = &world.bodies[self.handles.ball];
        Velocities {
            bot: join(&[to_body * velocity, to_body * rate, joints]),
            ball: [ball.linvel(), ball.angvel()].map(|v| to_body * from_rapier(v)),
        }
    }

    /// Distance from the ball beyond which the bot cannot touch it within the step, m.
    fn ball_clearance(&self, motion: &Motion) -> f64 {
        let [velocity, rate, _] = split(&motion.velocities.bot);
        let shape = &self.collision_shape.body;
        let reach = shape.bottom + shape.radius + self.root.xy().norm();
        let closing = (velocity - motion.velocities.ball[0]).norm() + rate.norm() * reach;
        BALL_CLEARANCE * self.params.ball_radius + 2.0 * closing * self.dt
    }

    /// Whether within the step the bot cannot touch the floor and the body cannot touch the ball.
    fn only_wheels_and_ball_touch(&self, world: &World, motion: &Motion) -> bool {
        let shape = &self.collision_shape;
        let above = shape.body.bottom - (motion.ball.z + self.root.z) - self.params.ball_radius;
        if above <= self.ball_clearance(motion) {
            return false;
        }
        let pose = world.bodies[self.handles.body].position();
        let attitude = rotation_from_rapier(pose.rotation);
        let position = from_rapier(pose.translation) - attitude * self.root;
        let [velocity, rate, _] = split(&motion.velocities.bot);
        let fastest = velocity.norm() + rate.norm() * (shape.body.top + shape.body.radius + self.root.xy().norm());
        shape.lowest(self.ground.as_deref(), &position, &attitude).1 > CLEARANCE + 2.0 * fastest * self.dt
    }

    /// Whether the robot may touch an obstacle within the step. A lower bound of the distance saves most computations of it.
    fn comes_near_obstacle(&mut self, world: &World, motion: &Motion) -> bool {
        let Some(ground) = self.ground.as_deref().filter(|_| !self.obstacles.is_empty()) else { return false };
        let moved = self.largest_motion(&motion.velocities);
        let limit = reach_of_step(moved);
        self.sim_state.clearance -= moved;
        if self.sim_state.clearance > limit {
            return false;
        }
        let outline = self.outline(world, moved);
        let obstacles = ground.terrain().obstacles();
        let of_ball = obstacles.distance(outline.ball.into()) - outline.ball_radius;
        let of_body = obstacles.distance_of_segment(outline.axis.map(Into::into), outline.body_radius);
        self.sim_state.clearance = of_ball.min(of_body);
        self.sim_state.clearance <= limit
    }

    /// Friction limits from the slip at the start of the step. Also sets the friction of rapier's floor.
    fn limits(&self, world: &mut World, contacts: &Wheels<WheelContact>) -> Limits {
        let p = &self.params;
        let ratio = |slip: f64| (slip / p.friction_critical_velocity).powi(2);
        let of_wheel =
            |contact: &WheelContact| stribeck(p.wheel_static_friction, p.wheel_dynamic_friction, ratio(contact.slip));
        let limits = Limits {
            wheels: Wheels::from_fn(|i| of_wheel(&contacts[i])),
            floor: self.grip
                * stribeck(p.floor_static_friction, p.floor_dynamic_friction, ratio(self.floor_slip(world).norm())),
            joint: p.wheel_coulomb_friction * self.dt,
        };
        world.set_floor_friction(&self.handles, limits.floor);
        limits
    }

    /// Sets the forces that accelerate the bot, and the forces on the ball.
    pub fn apply(&self, world: &mut World, plan: &Plan) {
        let wheels_on_ball = plan.rows.on_ball(&Impulses::from(self.sim_state.impulses));
        let down = self.gravity_in_body(&plan.motion);
        let needed = self.bot.force(&plan.motion.velocities.bot, &self.driven(plan), &self.bot.weight(&down));
        let [force, torque, joints] = split(&needed);
        let to_world = plan.motion.to_body.transpose();
        let mut reaction = torque;
        let bodies = &mut world.bodies;
        for i in 0..3 {
            let torque = self.bot.axles[i] * joints[i];
            reaction -= torque;
            set_loads(&mut bodies[self.handles.wheels[i]], &Vector3::zeros(), &(to_world * torque));
        }
        set_loads(&mut bodies[self.handles.body], &(to_world * force), &(to_world * reaction));
        let [push, turn] = wheels_on_ball.map(|impulse| to_world * impulse / self.dt);
        let [drag, braking] = plan.drag;
        set_loads(&mut bodies[self.handles.ball], &(push + drag), &(turn + braking));
    }
}

/// Replaces force and torque on a body for the next step.
fn set_loads(body: &mut RigidBody, force: &Vector3<f64>, torque: &Vector3<f64>) {
    body.reset_forces(false);
    body.reset_torques(false);
    body.add_force(to_rapier(force), false);
    body.add_torque(to_rapier(torque), false);
}
