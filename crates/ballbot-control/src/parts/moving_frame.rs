//! The frame of a setpoint in motion, in which a policy that only balances follows the motion.

use super::joint_friction::JointFriction;
use super::limits::dot;
use super::tracking::{LeanReference, Tracking};
use crate::{LaneSetpoint, default_max_torque};
use ballbot_base::kinematics::Omniwheels;
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Heading, Lane, Vec3, wrapped_angle};
use ballbot_base::params::Params;
use ballbot_base::wheels::{WHEELS, Wheels};
use ballbot_models::Scale;
use nalgebra::{UnitQuaternion, Vector3};

/// Rate at which the frame turns per error of the heading, for the robot of the paper, 1/s, and the largest error, rad.
const TURNING: f64 = 2.0;
const LARGEST_TURN: f64 = 0.5;

/// Angular acceleration per error of the heading's rate, for the robot of the paper, 1/s, and the largest torque for it
/// as a fraction of the controllers' default limit. A policy that has only balanced is too weak to turn a robot whose
/// wheels hardly turn the body: its heading oscillates.
const DAMPING: f64 = 8.0;
const LARGEST_TORQUE: f64 = 0.3;

/// Error of the heading, rad, beyond which the robot turns, with smaller errors in proportion: the policy then sees
/// neither the body nor the ball spin about the vertical. A policy that has only balanced has not seen its wheels turn as
/// fast while it does not.
const LEAST_TURN: f64 = 0.02;

/// The frame of a setpoint in motion, for one robot. A robot that follows the setpoint is at rest there, and upright: it
/// leans as the motion requires, and its wheels have the torques of the motion. A PD law turns it; the policy balances it.
#[derive(Clone, Debug)]
pub struct MovingFrame {
    tracking: Tracking,
    friction: JointFriction,
    /// Wheel speeds of the upright robot that rolls along x and y of its body, per speed.
    rolling: [Wheels<f64>; 2],
    /// Wheel speeds of the robot that turns about x, y and z of its body, per rate.
    turning: [Wheels<f64>; 3],
    /// Rate at which the frame turns per error of the heading, 1/s.
    turning_rate: f64,
    /// Angular acceleration about the vertical per error of the heading's rate, 1/s, and the largest, rad/s².
    damping: f64,
    most: f64,
    /// Rate of the body about its z against the ball, per speed of each wheel.
    spin_per_speed: [f64; WHEELS],
}

/// A robot in the frame of its setpoint.
pub struct Followed<L> {
    /// Its state there: position, velocity, attitude, rates of the body, and wheel speeds. Neither body nor ball spin
    /// about the vertical there while it turns.
    pub state: LaneState<L>,
    /// The torques of the setpoint's motion and of the law that turns the robot, N·m, with the friction of the joints in
    /// that motion and on the ball that spins. Zero at rest.
    pub torques: Wheels<L>,
}

impl MovingFrame {
    /// The frame for the robot of `params`.
    pub fn new(params: &Params) -> Self {
        let (friction, without_friction) = JointFriction::of(params);
        let (wheels, upright) = (Omniwheels::new(params), UnitQuaternion::identity());
        let speeds = |ball: Vector3<f64>, body: Vector3<f64>| wheels.wheel_speeds(&upright, &ball, &body);
        let still = Vector3::zeros();
        let turning = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| speeds(still, axis));
        let square: f64 = turning[2].iter().map(|speed| speed * speed).sum();
        let (tracking, time) = (Tracking::new(&without_friction), Scale::of(params).time);
        let largest = tracking.planes.wheel_torques([0.0; 2], 1.0).0.into_iter().map(f64::abs).fold(0.0, f64::max);
        Self {
            tracking,
            friction,
            rolling: [Vector3::y(), -Vector3::x()].map(|axis| speeds(axis / params.ball_radius, still)),
            turning,
            turning_rate: TURNING / time,
            damping: DAMPING / time,
            most: LARGEST_TORQUE * default_max_torque(params) / largest,
            spin_per_speed: std::array::from_fn(|i| turning[2][i] / square),
        }
    }

    /// The robot with this state in the frame of its setpoint.
    #[inline(always)]
    pub fn follow<L: Lane>(&self, state: &LaneState<L>, setpoint: &LaneSetpoint<L>) -> Followed<L> {
        let mut state = *state;
        let ([x, y], [vx, vy]) = (setpoint.position, setpoint.velocity);
        state.ball_position.x -= x;
        state.ball_position.y -= y;
        state.ball_velocity.x -= vx;
        state.ball_velocity.y -= vy;
        let up = state.body_quaternion.rotation().rows[2];
        let heading = Heading::new(self.tracking.frame.attitude(state.body_quaternion));
        let reference = self.tracking.lean(&heading, setpoint);
        let LeanReference { lean: [lean_x, lean_y], rate: [rate_x, rate_y], .. } = reference;
        // Leaning towards y turns about −x.
        let [back_x, back_y] = heading.to_inertial(lean_y * 0.5, lean_x * -0.5);
        state.body_quaternion = state.body_quaternion.turned(Vec3::new(back_x, back_y, x.zero()));
        let most = x.splat(LARGEST_TURN);
        let error = wrapped_angle(setpoint.yaw - state.body_quaternion.yaw()).min(most).max(-most);
        let turn = setpoint.yaw_rate + error * self.turning_rate;
        // A robot that only balances is shown its rate and the ball's spin as in the policy's task.
        let turns = (turn.abs() * (LEAST_TURN * self.turning_rate).recip()).min(x.splat(1.0));
        let rate = up.dot(state.body_angular_velocity);
        let most = x.splat(self.most);
        let acceleration = ((turn - rate) * turns * self.damping).min(most).max(-most);
        let hidden = rate * turns;
        let turning = Vec3::new(up.x * hidden - rate_y, up.y * hidden + rate_x, up.z * hidden);
        state.body_angular_velocity = state.body_angular_velocity - turning;
        let [forward, left] = heading.of(vx, vy);
        let [along, across] = &self.rolling;
        let mut speeds = Wheels::zero(x);
        for i in 0..WHEELS {
            let rolling = forward * along[i] + left * across[i];
            state.wheel_speeds[i] -= rolling + self.turned(i, turning);
            speeds[i] = rolling + setpoint.yaw_rate * self.turning[2][i];
        }
        let spin = dot(&self.spin_per_speed, state.wheel_speeds.0) - state.body_angular_velocity.z;
        let excess = up * (spin * turns);
        for i in 0..WHEELS {
            let spinning = self.turned(i, excess);
            state.wheel_speeds[i] -= spinning;
            speeds[i] += spinning;
        }
        let torques = self.tracking.planes.wheel_torques(self.tracking.forward(&reference), acceleration);
        Followed { state, torques: self.friction.compensated(torques, &speeds, f64::INFINITY) }
    }

    /// Speed of wheel `i` of a body that turns at `rate` in its frame, rad/s.
    #[inline(always)]
    fn turned<L: Lane>(&self, i: usize, rate: Vec3<L>) -> L {
        let [x, y, z] = &self.turning;
        dot(&[x[i], y[i], z[i]], [rate.x, rate.y, rate.z])
    }
}
