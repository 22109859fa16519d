//! A payload that moves on the body: its motion in a step, and its reaction on the body.

use super::robot::Robot;
use super::world::World;
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Vec3, run_one};
use ballbot_base::payload::{Payload, PayloadMotion};
use nalgebra::Vector3;

impl Robot {
    /// Moves the payload over a step, and adds its reaction to the push of the step.
    pub fn carry(&mut self, world: &World) {
        let state = self.state(world);
        let (dt, time) = (self.dt, self.time());
        let gravity = self.params.gravity_at(time + 0.5 * dt);
        let before = self.sim_state.payload;
        let force = run_one(
            #[inline(always)]
            || {
                let payload = Payload::new(&self.params);
                payload.force(&payload.deflection(&LaneState::from(&state), &before), before.offset, time)
            },
        );
        let impulse = state.body_quaternion * vector(force) * dt;
        let velocity = vector(before.velocity) + impulse / self.params.payload_mass + gravity * dt;
        let position = vector(before.position);
        let moved = position + velocity * dt;
        if moved.iter().chain(&velocity).all(|number| number.is_finite()) {
            let [position, velocity] = [moved, velocity].map(|v| Vec3::new(v.x, v.y, v.z));
            self.sim_state.payload = PayloadMotion { position, velocity, ..before };
        }
        let point = state.body_quaternion.inverse_transform_vector(&(position - state.body_position));
        self.push(world, &-impulse, &point);
    }
}

fn vector(v: Vec3<f64>) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}
