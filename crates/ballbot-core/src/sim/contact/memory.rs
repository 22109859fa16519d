//! What a robot carries from one step to the next.

use super::constants::Constants;
use super::rows::encoder_rate;
use crate::lane_state::LaneState;
use crate::lanes::{Lane, Vec3, cells};
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
    /// The state: the body at its frame's origin instead of its CoM, the wheels' rates against the body.
    #[inline(always)]
    pub fn state<L: Lane<Cell = T>>(&self, token: L::Token, c: &Constants) -> LaneState<L> {
        let (pose, v) = (self.pose::<L>(token), self.velocities::<L>(token));
        let rotation = pose.body_quaternion.rotation();
        let mast = Vec3::new(rotation.rows[0].z, rotation.rows[1].z, rotation.rows[2].z);
        // Ω × e3
        let turning = rotation.apply(Vec3::new(v.body_rate.y, -v.body_rate.x, v.body_rate.x.zero()));
        LaneState {
            ball_position: pose.ball,
            ball_quaternion: pose.ball_quaternion,
            ball_velocity: v.ball,
            ball_angular_velocity: v.ball_rate,
            body_position: pose.body.plus_all(mast, -c.com_height),
            body_quaternion: pose.body_quaternion,
            body_velocity: v.body.plus_all(turning, -c.com_height),
            body_angular_velocity: v.body_rate,
            wheel_angles: pose.wheel_angles,
            wheel_speeds: [encoder_rate(c, &v, 0), encoder_rate(c, &v, 1), encoder_rate(c, &v, 2)],
        }
    }
}
