//! One time step of the rigid-body robot.

use super::convert::{from_rapier, rotation_from_rapier, to_rapier};
use super::motion::RigidMotion;
use super::rows::{self, WarmStart};
use super::wheel_contact::Contact;
use crate::sim::friction::stribeck;
use nalgebra::Vector3;
use rapier3d_f64::prelude::*;

/// Clearance below which the bot might meet the floor within a step whatever happens to it, m.
const FLOOR_CLEARANCE: f64 = 0.01;

/// Sweeps of the solver over all rows, and sweeps after it has moved the bodies, where the forces of the last
/// step are a good start.
const STEADY_SWEEPS: [usize; 2] = [3, 0];

/// The same where they are not: at first, after a push, and when the robot lands.
const TRANSIENT_SWEEPS: [usize; 2] = [8, 1];

impl RigidMotion {
    pub(super) fn step(&mut self, wheel_torques: &[f64; 3]) {
        let contacts = [0, 1, 2].map(|i| self.contact(i));
        let starts = [0, 1, 2].map(|i| self.anchor(i, &contacts[i]));
        self.world.set_bot_colliders(&self.handles, !self.far_from_floor());
        self.set_sweeps();
        self.set_floor_friction();
        self.apply_forces(wheel_torques, &contacts, &starts);
        self.sim_state.healthy &= self.world.step(&mut self.pipeline, self.params.gravity, &self.settings);
        let dt = self.settings.dt;
        let usual = self.params.static_wheel_load();
        for (i, start) in starts.iter().enumerate() {
            let last = self.sim_state.wheel_forces[i];
            self.sim_state.wheel_forces[i] =
                rows::wheel_force(self.world.drive(&self.handles, i), start, &last, usual, dt);
        }
        self.sim_state.floor_force = self.world.floor_force(&self.handles, dt).into();
        self.sim_state.steps += 1;
    }

    fn anchor(&mut self, i: usize, contact: &Contact) -> WarmStart {
        let p = &self.params;
        let slip = self.slip_speed(i, contact);
        let slip = (slip / p.friction_critical_velocity).powi(2);
        let friction = stribeck(p.wheel_static_friction, p.wheel_dynamic_friction, slip);
        let last = self.sim_state.wheel_forces[i];
        let (joint, poses) = self.world.drive_mut(&self.handles, i);
        rows::anchor(joint, contact, poses, &last, friction * last.normal_estimate, self.settings.dt)
    }

    fn set_sweeps(&mut self) {
        let steady = self.sim_state.steps > 0 && self.all_steady();
        let [solving, stabilizing] = if steady { STEADY_SWEEPS } else { TRANSIENT_SWEEPS };
        self.settings.num_internal_pgs_iterations = solving;
        self.settings.num_internal_stabilization_iterations = stabilizing;
    }

    fn all_steady(&self) -> bool {
        self.sim_state.wheel_forces.iter().all(|force| force.steady)
    }

    /// Whether nothing of the bot can touch the floor within the step, nor its body the ball: then its colliders need
    /// not be looked at.
    fn far_from_floor(&self) -> bool {
        if !self.all_steady() {
            return false;
        }
        let pose = self.world.bodies[self.handles.body].position();
        let attitude = rotation_from_rapier(pose.rotation);
        let position = from_rapier(pose.translation) - attitude * self.root;
        let (velocity, rate) = self.root_velocity();
        let reach = self.collision_shape.body.top + self.collision_shape.body.radius;
        let fastest = velocity.norm() + rate.norm() * reach;
        self.collision_shape.lowest_point(&position, &attitude).1 > FLOOR_CLEARANCE + 2.0 * fastest * self.settings.dt
    }

    fn set_floor_friction(&mut self) {
        let p = &self.params;
        if p.floor_static_friction > p.floor_dynamic_friction {
            let slip = (self.floor_slip() / p.friction_critical_velocity).norm_squared();
            let friction = stribeck(p.floor_static_friction, p.floor_dynamic_friction, slip);
            self.world.set_floor_friction(&self.handles, friction);
        }
    }

    /// Torques, pushes, drag, and the contact forces that the step starts from.
    fn apply_forces(&mut self, wheel_torques: &[f64; 3], contacts: &[Contact; 3], starts: &[WarmStart; 3]) {
        let axles = [0, 1, 2].map(|i| self.axle(i));
        let bodies = &mut self.world.bodies;
        let [fx, fy, fz, tx, ty, tz] = std::mem::take(&mut self.sim_state.push).map(|v| v / self.settings.dt);
        let mut torque_on_body = Vector3::new(tx, ty, tz);
        let velocity = from_rapier(bodies[self.handles.ball].linvel());
        let mut force_on_ball = Vector3::new(velocity.x, velocity.y, 0.0) * -self.params.ball_viscous_friction;
        let mut torque_on_ball = Vector3::zeros();
        for i in 0..3 {
            let (contact, start) = (&contacts[i], &starts[i]);
            let traction = contact.drive * start.traction;
            let force = contact.normal * start.load - traction;
            let arm = contact.normal.cross(&traction);
            let torque = axles[i] * wheel_torques[i];
            set_loads(&mut bodies[self.handles.wheels[i]], &force, &(torque + arm * self.params.wheel_radius));
            force_on_ball -= force;
            torque_on_ball += arm * self.params.ball_radius;
            torque_on_body -= torque;
        }
        set_loads(&mut bodies[self.handles.body], &Vector3::new(fx, fy, fz), &torque_on_body);
        set_loads(&mut bodies[self.handles.ball], &force_on_ball, &torque_on_ball);
    }
}

/// Sets the force and the torque of the next step.
fn set_loads(body: &mut RigidBody, force: &Vector3<f64>, torque: &Vector3<f64>) {
    body.reset_forces(false);
    body.reset_torques(false);
    body.add_force(to_rapier(force), false);
    body.add_torque(to_rapier(torque), false);
}
