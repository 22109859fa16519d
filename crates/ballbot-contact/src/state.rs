//! State and warm-start impulses of one robot or of eight.

use super::constants::Constants;
use super::encoder::encoder_rates;
use super::types::{PerRow, Pose, Velocities};
use ballbot_base::force::HeldForce;
use ballbot_base::lane_state::{LaneRobot, LaneState};
use ballbot_base::lanes::{Cell, Lane, Quat, Value, Vec3, lane_struct};
use ballbot_base::payload::PayloadMotion;
use ballbot_base::wheels::Wheels;
use serde::{Deserialize, Serialize};

/// Largest sum of squared speeds and rates of a robot that has not diverged.
const MAX_SPEED_SQUARED: f64 = 1e30;

lane_struct! {
    /// State and contact impulses of one robot or of eight. Inertial frame and SI units unless stated.
    #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
    pub struct ContactState<T> {
        /// Steps since the reset.
        pub steps: T,
        pub ball_position: [T; 3],
        pub ball_quaternion: [T; 4],
        pub ball_velocity: [T; 3],
        pub ball_rate: [T; 3],
        /// Position of the CoM.
        pub body_position: [T; 3],
        /// Attitude of the principal frame of the body.
        pub body_quaternion: [T; 4],
        /// Velocity of the CoM.
        pub body_velocity: [T; 3],
        /// Angular velocity of the body, principal frame.
        pub body_rate: [T; 3],
        pub wheel_angles: Wheels<T>,
        /// Absolute spins about the axles: encoder rate minus u_i · Ω.
        pub wheel_spins: Wheels<T>,
        /// Impulse of the floor on the ball in the last step: normal, x, y.
        pub floor_impulse: [T; 3],
        /// Normal impulse of the ball on the bot at each wheel in the last step.
        pub normal_impulses: Wheels<T>,
        /// Drive friction impulse of the ball on the bot at each wheel in the last step.
        pub drive_impulses: Wheels<T>,
        /// Angular impulse of joint friction in the last step.
        pub joint_impulses: Wheels<T>,
        /// Impulse on the body and angular impulse about its CoM that act in the next step.
        pub push: [T; 6],
        /// External force on the body.
        pub force: HeldForce<T>,
        /// 1 while the bot touches the floor, else 0.
        pub bot_on_floor: T,
        /// Impulse of the floor on the bot in the last step in which they touched.
        pub bot_floor_impulse: [T; 3],
        /// Lower bound of the distance from obstacles, m.
        pub clearance: T,
        /// 1 while ball or bot touch an obstacle, else 0.
        pub on_obstacle: T,
        /// Impulse of obstacles on ball and bot in the last step in which they touched.
        pub obstacle_impulse: [T; 3],
        /// 1 after a step with non-finite numbers, else 0.
        pub diverged: T,
        /// Steps since the reset in which all modes of the contacts were tried.
        pub searched_steps: T,
        /// Steps since the reset without impulses that meet the contact conditions.
        pub unsolved_steps: T,
        /// Motions of the payloads; of no meaning without them.
        pub payloads: [PayloadMotion<T>; 2],
    }
}

impl<T: Cell> ContactState<T> {
    /// State for tasks and controllers, with the origin of the body frame in place of the CoM and encoder rates in
    /// place of absolute spins.
    #[inline(always)]
    pub fn lane_state<L: Lane<Cell = T>, V: Value<L>>(&self, token: L::Token, c: &Constants<V>) -> LaneState<L> {
        let (pose, v) = (self.pose::<L>(token), self.velocities::<L>(token));
        let rotation = pose.body_quaternion.rotation();
        let mast = Vec3::new(rotation.rows[0].z, rotation.rows[1].z, rotation.rows[2].z);
        // R (Ω × e3)
        let mast_rate = rotation.apply(Vec3::new(v.body_rate.y, -v.body_rate.x, v.body_rate.x.zero()));
        let com = c.com(mast.x);
        let mut state = LaneState {
            ball_position: pose.ball,
            ball_quaternion: pose.ball_quaternion,
            ball_velocity: v.ball,
            ball_angular_velocity: v.ball_rate,
            body_position: pose.body.plus(mast, -com.z),
            body_quaternion: pose.body_quaternion,
            body_velocity: v.body.plus(mast_rate, -com.z),
            body_angular_velocity: v.body_rate,
            wheel_angles: pose.wheel_angles,
            wheel_speeds: encoder_rates(c, &v),
        };
        let general = com.z.zero().lt(c.general.at(com.z));
        // The branch only skips work: lanes of other bodies keep their bits.
        if L::any(general) {
            let axes = c.principal_axes(com.z);
            let select = Vec3::select;
            state.body_position = select(general, pose.body - rotation.apply(com), state.body_position);
            let velocity = v.body - rotation.apply(v.body_rate.cross(com));
            state.body_velocity = select(general, velocity, state.body_velocity);
            let rate = axes.rotation().apply(v.body_rate);
            state.body_angular_velocity = select(general, rate, state.body_angular_velocity);
            let quaternion = pose.body_quaternion.times(axes.conjugated());
            state.body_quaternion = Quat::select(general, quaternion, state.body_quaternion);
        }
        state
    }
}

impl<T: Cell> ContactState<T> {
    /// Replaces pose and velocities: the inverse of [`ContactState::lane_state`].
    #[inline(always)]
    pub fn set_lane_state<L: Lane<Cell = T>, V: Value<L>>(&mut self, c: &Constants<V>, state: &LaneState<L>) {
        let like = state.ball_position.x;
        let (com, axes) = (c.com(like), c.principal_axes(like));
        let attitude = state.body_quaternion.times(axes);
        let rate = axes.rotation().apply_transposed(state.body_angular_velocity);
        let rotation = attitude.rotation();
        let mut spins = state.wheel_speeds;
        for (i, spin) in spins.iter_mut().enumerate() {
            *spin -= c.u(i, like).dot(rate);
        }
        state.ball_position.store(&mut self.ball_position);
        state.ball_quaternion.store(&mut self.ball_quaternion);
        (state.body_position + rotation.apply(com)).store(&mut self.body_position);
        attitude.store(&mut self.body_quaternion);
        state.wheel_angles.store(&mut self.wheel_angles);
        self.set_velocities(&Velocities {
            ball: state.ball_velocity,
            ball_rate: state.ball_angular_velocity,
            body: state.body_velocity + rotation.apply(rate.cross(com)),
            body_rate: rate,
            spins,
        });
    }

    /// Encoder rates of the wheels.
    #[inline(always)]
    pub fn wheel_speeds<L: Lane<Cell = T>, V: Value<L>>(&self, token: L::Token, c: &Constants<V>) -> Wheels<L> {
        encoder_rates(c, &self.velocities::<L>(token))
    }

    /// State, health and contacts for tasks and controllers.
    #[inline(always)]
    pub fn robot<L: Lane<Cell = T>, V: Value<L>>(&self, token: L::Token, c: &Constants<V>) -> LaneRobot<L> {
        let diverged = L::load(token, &self.diverged);
        LaneRobot {
            state: self.lane_state(token, c),
            healthy: diverged.le(diverged.zero()),
            on_floor: diverged.zero().lt(L::load(token, &self.bot_on_floor)),
            on_obstacle: diverged.zero().lt(L::load(token, &self.on_obstacle)),
        }
    }

    #[inline(always)]
    pub fn pose<L: Lane<Cell = T>>(&self, token: L::Token) -> Pose<L> {
        Pose {
            ball: Vec3::load(token, &self.ball_position),
            ball_quaternion: Quat::load(token, &self.ball_quaternion),
            body: Vec3::load(token, &self.body_position),
            body_quaternion: Quat::load(token, &self.body_quaternion),
            wheel_angles: Wheels::load(token, &self.wheel_angles),
        }
    }

    #[inline(always)]
    pub fn velocities<L: Lane<Cell = T>>(&self, token: L::Token) -> Velocities<L> {
        Velocities {
            ball: Vec3::load(token, &self.ball_velocity),
            ball_rate: Vec3::load(token, &self.ball_rate),
            body: Vec3::load(token, &self.body_velocity),
            body_rate: Vec3::load(token, &self.body_rate),
            spins: Wheels::load(token, &self.wheel_spins),
        }
    }

    #[inline(always)]
    pub fn impulses<L: Lane<Cell = T>>(&self, token: L::Token) -> PerRow<L> {
        let [z, x, y] = &self.floor_impulse;
        PerRow {
            floor: [L::load(token, z), L::load(token, x), L::load(token, y)],
            normals: Wheels::load(token, &self.normal_impulses),
            drives: Wheels::load(token, &self.drive_impulses),
            joints: Wheels::load(token, &self.joint_impulses),
        }
    }

    /// Mask of the robots that have not diverged and do not diverge with these velocities.
    #[inline(always)]
    pub fn stays_finite<L: Lane<Cell = T>>(&self, token: L::Token, velocities: &Velocities<L>) -> L::Mask {
        let size = velocities.norm_squared();
        let diverged = L::load(token, &self.diverged);
        size.lt(size.splat(MAX_SPEED_SQUARED)) & diverged.le(diverged.zero())
    }

    /// Replaces the velocities.
    #[inline(always)]
    pub fn set_velocities<L: Lane<Cell = T>>(&mut self, velocities: &Velocities<L>) {
        velocities.ball.store(&mut self.ball_velocity);
        velocities.ball_rate.store(&mut self.ball_rate);
        velocities.body.store(&mut self.body_velocity);
        velocities.body_rate.store(&mut self.body_rate);
        velocities.spins.store(&mut self.wheel_spins);
    }

    /// Replaces the impulses of the contacts.
    #[inline(always)]
    pub fn set_impulses<L: Lane<Cell = T>>(&mut self, impulses: &PerRow<L>) {
        for (cell, impulse) in self.floor_impulse.iter_mut().zip(impulses.floor) {
            impulse.store(cell);
        }
        impulses.normals.store(&mut self.normal_impulses);
        impulses.drives.store(&mut self.drive_impulses);
        impulses.joints.store(&mut self.joint_impulses);
    }

    /// Stores the result of a step. A robot with non-finite or nearly overflowing velocities is marked as diverged and
    /// keeps its state until it restarts.
    #[inline(always)]
    pub fn take<L: Lane<Cell = T>>(
        &mut self,
        token: L::Token,
        pose: &Pose<L>,
        velocities: &Velocities<L>,
        impulses: &PerRow<L>,
        on_floor: L,
    ) {
        let stays_finite = self.stays_finite(token, velocities);
        if !L::any(!stays_finite) {
            self.write(pose, velocities, impulses, on_floor);
            return;
        }
        L::select(stays_finite, L::load(token, &self.diverged), on_floor.splat(1.0)).store(&mut self.diverged);
        let pose = Pose::select(stays_finite, pose, &self.pose(token));
        let velocities = Velocities::select(stays_finite, velocities, &self.velocities(token));
        let impulses = PerRow::select(stays_finite, impulses, &self.impulses(token));
        let on_floor = L::select(stays_finite, on_floor, L::load(token, &self.bot_on_floor));
        self.write(&pose, &velocities, &impulses, on_floor);
    }

    #[inline(always)]
    fn write<L: Lane<Cell = T>>(
        &mut self,
        pose: &Pose<L>,
        velocities: &Velocities<L>,
        impulses: &PerRow<L>,
        on_floor: L,
    ) {
        pose.ball.store(&mut self.ball_position);
        pose.ball_quaternion.store(&mut self.ball_quaternion);
        pose.body.store(&mut self.body_position);
        pose.body_quaternion.store(&mut self.body_quaternion);
        pose.wheel_angles.store(&mut self.wheel_angles);
        self.set_velocities(velocities);
        self.set_impulses(impulses);
        on_floor.store(&mut self.bot_on_floor);
    }
}
