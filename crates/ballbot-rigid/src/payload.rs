//! The payloads that move on the body: their motion in a step, and their reaction on the body.

use super::robot::Robot;
use super::world::World;
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Vec3, run_one};
use ballbot_base::payload::{Payload, PayloadMotion};
use ballbot_base::state::State;
use nalgebra::Vector3;

impl Robot {
    /// Moves the payloads over a step, and adds their reaction to the push of the step.
    pub fn carry(&mut self, world: &World) {
        let state = self.state(world);
        for (index, payload) in Payload::of(&self.params).iter().enumerate() {
            if payload.mass > 0.0 {
                self.carry_one(world, &state, payload, index);
            }
        }
    }

    fn carry_one(&mut self, world: &World, state: &State, payload: &Payload<f64>, index: usize) {
        let (dt, time) = (self.dt, self.time());
        let gravity = self.params.gravity_at(time + 0.5 * dt);
        let before = self.sim_state.payloads[index];
        let force = run_one(
            #[inline(always)]
            || payload.force(&payload.deflection(&LaneState::from(state), &before), before.offset, time),
        );
        let impulse = state.body_quaternion * vector(force) * dt;
        let velocity = vector(before.velocity) + impulse / payload.mass + gravity * dt;
        let position = vector(before.position);
        let moved = position + velocity * dt;
        if moved.iter().chain(&velocity).all(|number| number.is_finite()) {
            let [position, velocity] = [moved, velocity].map(|v| Vec3::new(v.x, v.y, v.z));
            self.sim_state.payloads[index] = PayloadMotion { position, velocity, ..before };
        }
        let point = state.body_quaternion.inverse_transform_vector(&(position - state.body_position));
        self.push(world, &-impulse, &point);
    }
}

fn vector(v: Vec3<f64>) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}
