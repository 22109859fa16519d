//! What a robot carries from one step to the next.

use crate::lane_state::LaneState;
use crate::lanes::{Lane, Quat, Vec3, cells};
use serde::{Deserialize, Serialize};

/// Torques of the three motors, N·m.
pub type Torques<T> = [T; 3];

cells! {
    /// State and contact impulses of one robot or of eight. Inertial frame and SI units unless said.
    #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
    pub struct Memory {
        /// Since the reset.
        pub steps: T,
        pub ball_position: [T; 3],
        pub ball_quaternion: [T; 4],
        pub ball_velocity: [T; 3],
        pub ball_rate: [T; 3],
        /// Of the CoM.
        pub body_position: [T; 3],
        pub body_quaternion: [T; 4],
        /// Of the CoM.
        pub body_velocity: [T; 3],
        /// Body frame.
        pub body_rate: [T; 3],
        pub wheel_angles: [T; 3],
        /// Absolute spins about the axles: encoder rate less u_i · Ω.
        pub wheel_spins: [T; 3],
        /// Of the last step, on the ball: normal, x, y.
        pub floor_impulse: [T; 3],
        /// Of the last step, on the bot.
        pub normal_impulses: [T; 3],
        /// Of the last step, on the bot.
        pub drive_impulses: [T; 3],
        /// Of the last step.
        pub joint_impulses: [T; 3],
        /// Impulse on the body and angular impulse about its CoM that act in the next step.
        pub push: [T; 6],
        pub joint_viscous_friction: T,
        pub joint_coulomb_friction: T,
        /// 1 while the bot touches the floor, else 0.
        pub bot_on_floor: T,
        /// 1 once a step met numbers that are not finite, else 0.
        pub diverged: T,
    }
}

impl<T> Memory<T> {
    /// The state, with the body at its frame's origin instead of its CoM, which is `com_height` above it, and the rates
    /// of the wheels against the body. `u` are the rows u_i.
    #[inline(always)]
    pub fn state<L: Lane<Cell = T>>(&self, token: L::Token, com_height: f64, u: &[[f64; 3]; 3]) -> LaneState<L> {
        let body_quaternion = Quat::<L>::load(token, &self.body_quaternion);
        let rotation = body_quaternion.rotation();
        let rate = Vec3::load(token, &self.body_rate);
        let like = rate.x;
        let position = Vec3::load(token, &self.body_position);
        let velocity = Vec3::load(token, &self.body_velocity);
        let mast = Vec3::new(rotation.rows[0].z, rotation.rows[1].z, rotation.rows[2].z);
        // Ω × e3
        let turning = rotation.apply(Vec3::new(rate.y, -rate.x, like.zero()));
        let spins = Vec3::<L>::load(token, &self.wheel_spins);
        let angles = Vec3::<L>::load(token, &self.wheel_angles);
        LaneState {
            ball_position: Vec3::load(token, &self.ball_position),
            ball_quaternion: Quat::load(token, &self.ball_quaternion),
            ball_velocity: Vec3::load(token, &self.ball_velocity),
            ball_angular_velocity: Vec3::load(token, &self.ball_rate),
            body_position: position.plus_all(mast, -com_height),
            body_quaternion,
            body_velocity: velocity.plus_all(turning, -com_height),
            body_angular_velocity: rate,
            wheel_angles: [angles.x, angles.y, angles.z],
            wheel_speeds: [
                Vec3::splat(like, &u[0]).dot(rate) + spins.x,
                Vec3::splat(like, &u[1]).dot(rate) + spins.y,
                Vec3::splat(like, &u[2]).dot(rate) + spins.z,
            ],
        }
    }
}
