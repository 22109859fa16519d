//! [`State`] of one robot or of eight, for computations over lanes.

use crate::lanes::{Lane, Quat, Vec3, lane_struct, run_one};
use crate::state::State;
use crate::wheels::Wheels;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

lane_struct! {
    /// The fields of [`State`], in registers or in memory.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct LaneState<T> {
        /// Ball center, inertial frame, m.
        pub ball_position: Vec3<T>,
        /// Attitude of the ball.
        pub ball_quaternion: Quat<T>,
        /// Velocity of the ball center, inertial frame, m/s.
        pub ball_velocity: Vec3<T>,
        /// Angular velocity of the ball, inertial frame, rad/s.
        pub ball_angular_velocity: Vec3<T>,
        /// Origin of the body frame, inertial frame, m.
        pub body_position: Vec3<T>,
        /// Attitude of the body.
        pub body_quaternion: Quat<T>,
        /// Velocity of the body frame's origin, inertial frame, m/s.
        pub body_velocity: Vec3<T>,
        /// Angular velocity of the body, body frame, rad/s.
        pub body_angular_velocity: Vec3<T>,
        /// Rotation of each wheel relative to the body, rad.
        pub wheel_angles: Wheels<T>,
        /// Encoder rates of the wheels, rad/s.
        pub wheel_speeds: Wheels<T>,
    }
}

/// A robot, or eight, after a step, as input of tasks and controllers.
pub struct LaneRobot<L: Lane> {
    /// The state.
    pub state: LaneState<L>,
    /// False after a step with non-finite numbers.
    pub healthy: L::Mask,
    /// Whether the body or a wheel touches the floor.
    pub on_floor: L::Mask,
    /// Whether the ball, the body or a wheel touches an obstacle.
    pub on_obstacle: L::Mask,
}

lane_struct! {
    /// Fields of [`LaneRobot`] except its state, in memory: 1 for true, 0 for false.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct ConditionCells<T> {
        /// As in [`LaneRobot`].
        pub healthy: T,
        /// As in [`LaneRobot`].
        pub on_floor: T,
        /// As in [`LaneRobot`].
        pub on_obstacle: T,
    }
}

impl<L: Lane> LaneRobot<L> {
    /// Reads the output of [`LaneRobot::store`].
    #[inline(always)]
    pub fn load(token: L::Token, state: &LaneState<L::Cell>, conditions: &ConditionCells<L::Cell>) -> Self {
        let conditions = conditions.load::<L>(token);
        let zero = conditions.healthy.zero();
        Self {
            state: state.load(token),
            healthy: zero.lt(conditions.healthy),
            on_floor: zero.lt(conditions.on_floor),
            on_obstacle: zero.lt(conditions.on_obstacle),
        }
    }

    /// Writes state and conditions.
    #[inline(always)]
    pub fn store(&self, state: &mut LaneState<L::Cell>, conditions: &mut ConditionCells<L::Cell>) {
        state.store(&self.state);
        let zero = self.state.ball_position.x.zero();
        let one = zero.splat(1.0);
        L::select(self.healthy, one, zero).store(&mut conditions.healthy);
        L::select(self.on_floor, one, zero).store(&mut conditions.on_floor);
        L::select(self.on_obstacle, one, zero).store(&mut conditions.on_obstacle);
    }
}

/// A bound of a valid state: quantity, limit, unit.
pub type Bound = (&'static str, f64, &'static str);

/// Largest speed of a valid state, m/s.
const MAX_SPEED: f64 = 100.0;
/// Largest rate of a valid state, rad/s.
pub const MAX_RATE: f64 = 1e4;
/// Largest distance from the origin, m.
const MAX_POSITION: f64 = 1e4;

/// The bounds of a simulated state, in the order of `LaneState::bounded`.
pub const BOUNDS: [Bound; 8] = [
    ("distance of the ball from the origin", MAX_POSITION, "m"),
    ("ball speed", MAX_SPEED, "m/s"),
    ("ball rate", MAX_RATE, "rad/s"),
    ("distance of the body from the origin", MAX_POSITION, "m"),
    ("body speed", MAX_SPEED, "m/s"),
    ("body rate", MAX_RATE, "rad/s"),
    ("wheel speed", MAX_RATE, "rad/s"),
    ("length of the body quaternion", 2.0, ""),
];

impl<L: Lane> LaneState<L> {
    /// Squares of the quantities bounded by [`BOUNDS`].
    #[inline(always)]
    fn bounded(&self) -> [L; 8] {
        let Wheels([a, b, c]) = self.wheel_speeds;
        let q = self.body_quaternion;
        [
            self.ball_position.norm_squared(),
            self.ball_velocity.norm_squared(),
            self.ball_angular_velocity.norm_squared(),
            self.body_position.norm_squared(),
            self.body_velocity.norm_squared(),
            self.body_angular_velocity.norm_squared(),
            // A maximum would let a NaN pass.
            L::select((a.le(a)) & (b.le(b)) & (c.le(c)), a.squared().max(b.squared()).max(c.squared()), a + b + c),
            q.w.mul_add(q.w, q.v.norm_squared()),
        ]
    }

    /// Robots within the bounds; the others have diverged.
    #[inline(always)]
    pub fn within_bounds(&self) -> L::Mask {
        let squares = self.bounded();
        let mut within = squares[0].le(squares[0].splat(BOUNDS[0].1 * BOUNDS[0].1));
        for i in 1..BOUNDS.len() {
            within = within & squares[i].le(squares[i].splat(BOUNDS[i].1 * BOUNDS[i].1));
        }
        within
    }
}

impl LaneState<f64> {
    /// The first bound that the state violates, including by NaN.
    pub fn out_of_bounds(&self) -> Option<String> {
        let within = run_one(
            #[inline(always)]
            || self.within_bounds(),
        );
        if within {
            return None;
        }
        let broken = self
            .bounded()
            .into_iter()
            .zip(BOUNDS)
            .find(|(square, (_, limit, _))| square.is_nan() || *square > limit * limit);
        broken.map(|(square, (name, limit, unit))| format!("{name} = {} {unit}, limit {limit} {unit}", square.sqrt()))
    }
}

impl From<&State> for LaneState<f64> {
    #[inline]
    fn from(state: &State) -> Self {
        Self {
            ball_position: vec3(&state.ball_position),
            ball_quaternion: quat(&state.ball_quaternion),
            ball_velocity: vec3(&state.ball_velocity),
            ball_angular_velocity: vec3(&state.ball_angular_velocity),
            body_position: vec3(&state.body_position),
            body_quaternion: quat(&state.body_quaternion),
            body_velocity: vec3(&state.body_velocity),
            body_angular_velocity: vec3(&state.body_angular_velocity),
            wheel_angles: state.wheel_angles,
            wheel_speeds: state.wheel_speeds,
        }
    }
}

impl From<LaneState<f64>> for State {
    #[inline]
    fn from(state: LaneState<f64>) -> Self {
        Self {
            ball_position: vector(state.ball_position),
            ball_quaternion: quaternion(state.ball_quaternion),
            ball_velocity: vector(state.ball_velocity),
            ball_angular_velocity: vector(state.ball_angular_velocity),
            body_position: vector(state.body_position),
            body_quaternion: quaternion(state.body_quaternion),
            body_velocity: vector(state.body_velocity),
            body_angular_velocity: vector(state.body_angular_velocity),
            wheel_angles: state.wheel_angles,
            wheel_speeds: state.wheel_speeds,
        }
    }
}

fn vec3(v: &Vector3<f64>) -> Vec3<f64> {
    Vec3::new(v.x, v.y, v.z)
}

fn quat(q: &UnitQuaternion<f64>) -> Quat<f64> {
    Quat { w: q.w, v: Vec3::new(q.i, q.j, q.k) }
}

fn vector(v: Vec3<f64>) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

fn quaternion(q: Quat<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::new_unchecked(Quaternion::new(q.w, q.v.x, q.v.y, q.v.z))
}
