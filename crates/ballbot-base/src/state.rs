//! State and contact forces of a ballbot, common to all models.
//!
//! Inertial frame: z up, floor at z = 0. Body frame: origin at the ball center (while the wheels touch the ball), z
//! along the mast. Quaternions are written `[w, x, y, z]` and map body to inertial.

use crate::error::{Result, bounded, check, finite};
use crate::kinematics::Omniwheels;
use crate::lane_state::LaneState;
use crate::params::Params;
use crate::wheels::Wheels;
use nalgebra::{Quaternion, UnitQuaternion, Vector2, Vector3};

/// Position, attitude and velocities of ball, body and wheels.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// Ball center, inertial frame, m.
    pub ball_position: Vector3<f64>,
    /// Attitude of the ball.
    pub ball_quaternion: UnitQuaternion<f64>,
    /// Velocity of the ball center, inertial frame, m/s.
    pub ball_velocity: Vector3<f64>,
    /// Angular velocity of the ball, inertial frame, rad/s.
    pub ball_angular_velocity: Vector3<f64>,
    /// Origin of the body frame, inertial frame, m; the ball center unless a wheel has lifted off.
    pub body_position: Vector3<f64>,
    /// Attitude of the body.
    pub body_quaternion: UnitQuaternion<f64>,
    /// Velocity of the body frame's origin, inertial frame, m/s.
    pub body_velocity: Vector3<f64>,
    /// Angular velocity of the body, **body frame**, rad/s.
    pub body_angular_velocity: Vector3<f64>,
    /// Rotation of each wheel relative to the body about its axle, rad.
    pub wheel_angles: Wheels<f64>,
    /// Rate of each wheel relative to the body about its axle (the encoder rate), rad/s.
    pub wheel_speeds: Wheels<f64>,
}

impl State {
    /// Length of [`State::to_array`].
    pub const LEN: usize = LaneState::<f64>::LEN;

    /// State at rest, upright, with the ball on the floor at the origin.
    pub fn upright(params: &Params) -> Self {
        Self::tilted(params, Vector2::zeros(), 0.0)
    }

    /// State at rest with the ball on the floor at the origin: rotated by `yaw` about the vertical, then tilted by the
    /// rotation vector (`tilt` x, `tilt` y, 0) in the inertial frame, rad.
    pub fn tilted(params: &Params, tilt: Vector2<f64>, yaw: f64) -> Self {
        let ball_position = Vector3::new(0.0, 0.0, params.ball_radius);
        Self {
            ball_position,
            ball_quaternion: UnitQuaternion::identity(),
            ball_velocity: Vector3::zeros(),
            ball_angular_velocity: Vector3::zeros(),
            body_position: ball_position,
            body_quaternion: attitude(tilt, yaw),
            body_velocity: Vector3::zeros(),
            body_angular_velocity: Vector3::zeros(),
            wheel_angles: Wheels::default(),
            wheel_speeds: Wheels::default(),
        }
    }

    /// State of rest in equilibrium, with the ball on the floor at the origin and the heading `yaw`, rad: the body's center
    /// of mass is above the center of the ball. [`State::upright`] for a robot whose center of mass is on the mast.
    pub fn at_equilibrium(params: &Params, yaw: f64) -> Self {
        Self { body_quaternion: params.equilibrium_attitude(yaw), ..Self::upright(params) }
    }

    /// State at rest with the ball on the floor at the origin: in equilibrium, then rotated by `yaw` about the
    /// vertical, then tilted by the rotation vector (`tilt` x, `tilt` y, 0) in the inertial frame, rad.
    /// [`State::tilted`] for a robot whose center of mass is on the mast.
    pub fn tilted_from_equilibrium(params: &Params, tilt: Vector2<f64>, yaw: f64) -> Self {
        Self { body_quaternion: attitude(tilt, yaw) * params.to_balance_frame(), ..Self::upright(params) }
    }

    /// State of rolling without slip. Ball and wheel rates follow from the velocity (x, y) of the ball, its spin about
    /// the vertical, the attitude of the body and its angular velocity in the body frame.
    pub fn rolling(
        params: &Params,
        ball_velocity: Vector2<f64>,
        ball_spin: f64,
        body_quaternion: UnitQuaternion<f64>,
        body_angular_velocity: Vector3<f64>,
    ) -> Self {
        let wheels = Omniwheels::new(params);
        Self::rolling_on(params, &wheels, ball_velocity, ball_spin, body_quaternion, body_angular_velocity)
    }

    /// [`State::rolling`] with given wheels of `params`.
    pub fn rolling_on(
        params: &Params,
        wheels: &Omniwheels,
        ball_velocity: Vector2<f64>,
        ball_spin: f64,
        body_quaternion: UnitQuaternion<f64>,
        body_angular_velocity: Vector3<f64>,
    ) -> Self {
        let ball_velocity = ball_velocity.push(0.0);
        let ball_angular_velocity = rolling_rate(params, &ball_velocity) + Vector3::z() * ball_spin;
        Self {
            ball_velocity,
            ball_angular_velocity,
            body_quaternion,
            body_velocity: ball_velocity,
            body_angular_velocity,
            wheel_speeds: wheels.wheel_speeds(&body_quaternion, &ball_angular_velocity, &body_angular_velocity),
            ..Self::upright(params)
        }
    }

    /// Angle between the mast and the vertical, rad, in [0, π].
    pub fn tilt(&self) -> f64 {
        let mast = self.body_quaternion * Vector3::z();
        mast.xy().norm().atan2(mast.z)
    }

    /// Components of the tilt about the inertial x and y axes, rad: the rotation vector that takes the vertical to the
    /// mast. The mast leans towards −y for positive x, towards +x for positive y.
    pub fn tilt_components(&self) -> Vector2<f64> {
        let mast = self.body_quaternion * Vector3::z();
        let sine = mast.xy().norm();
        if sine == 0.0 {
            // The axis is arbitrary upside down.
            return Vector2::new(self.tilt(), 0.0);
        }
        Vector2::new(-mast.y, mast.x) * (self.tilt() / sine)
    }

    /// Heading: the rotation about the vertical that remains after removing the tilt, rad, in (−π, π].
    pub fn yaw(&self) -> f64 {
        let q = self.body_quaternion.quaternion();
        let yaw = 2.0 * q.k.atan2(q.w);
        if yaw > std::f64::consts::PI {
            yaw - std::f64::consts::TAU
        } else if yaw <= -std::f64::consts::PI {
            yaw + std::f64::consts::TAU
        } else {
            yaw
        }
    }

    /// Components of a horizontal inertial vector in the heading frame, which is rotated by the yaw.
    pub fn to_heading(&self, v: Vector2<f64>) -> Vector2<f64> {
        let (sin, cos) = self.yaw().sin_cos();
        Vector2::new(cos * v.x + sin * v.y, cos * v.y - sin * v.x)
    }

    /// All values in the order of the fields.
    pub fn to_array(&self) -> [f64; Self::LEN] {
        let (mut out, mut at) = ([0.0; Self::LEN], 0);
        LaneState::from(self).map(|number| {
            out[at] = *number;
            at += 1;
        });
        out
    }

    /// The inverse of [`State::to_array`]; the quaternions must have unit length.
    pub fn from_array(a: &[f64; Self::LEN]) -> Self {
        let mut numbers = a.iter().copied();
        LaneState::from_fn(|| numbers.next().unwrap_or_default()).into()
    }

    /// Checks that all numbers are finite and within ±1e9, and that both quaternions have unit length.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] naming the number.
    pub fn validate(&self) -> Result<()> {
        bounded("ball_position", self.ball_position.as_slice())?;
        bounded("ball_velocity", self.ball_velocity.as_slice())?;
        bounded("ball_angular_velocity", self.ball_angular_velocity.as_slice())?;
        bounded("body_position", self.body_position.as_slice())?;
        bounded("body_velocity", self.body_velocity.as_slice())?;
        bounded("body_angular_velocity", self.body_angular_velocity.as_slice())?;
        bounded("wheel_angles", self.wheel_angles.as_slice())?;
        bounded("wheel_speeds", self.wheel_speeds.as_slice())?;
        unit_quaternion("ball_quaternion", wxyz(&self.ball_quaternion))?;
        unit_quaternion("body_quaternion", wxyz(&self.body_quaternion))?;
        Ok(())
    }
}

/// Attitude of a body rotated by `yaw` about the vertical, then tilted by the rotation vector (`tilt` x, `tilt` y, 0).
pub fn attitude(tilt: Vector2<f64>, yaw: f64) -> UnitQuaternion<f64> {
    let swing = UnitQuaternion::from_scaled_axis(tilt.push(0.0));
    swing * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw)
}

/// Angular velocity of a ball that rolls on the floor with `velocity`, without spin about the vertical.
pub fn rolling_rate(params: &Params, velocity: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(-velocity.y, velocity.x, 0.0) / params.ball_radius
}

/// A quaternion as `[w, x, y, z]`.
pub fn wxyz(q: &UnitQuaternion<f64>) -> [f64; 4] {
    [q.w, q.i, q.j, q.k]
}

/// A unit quaternion from `[w, x, y, z]`, unchanged to the last bit if its length is 1 within rounding; an error if the
/// length is off by more than 1e-6.
///
/// # Errors
/// [`crate::Error::OutOfRange`] naming the component or the length.
pub fn unit_quaternion(name: &str, [w, x, y, z]: [f64; 4]) -> Result<UnitQuaternion<f64>> {
    finite(name, &[w, x, y, z])?;
    let q = Quaternion::new(w, x, y, z);
    check(format_args!("the length of {name}"), q.norm(), "1 within 1e-6", |n| (n - 1.0).abs() <= 1e-6)?;
    // A simulated attitude is kept: normalizing it again would change its last bits.
    let rounding = 8.0 * f64::EPSILON;
    if (q.norm_squared() - 1.0).abs() <= rounding {
        return Ok(UnitQuaternion::new_unchecked(q));
    }
    Ok(UnitQuaternion::new_normalize(q))
}

/// Forces at the contacts during the last step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Contacts {
    /// Load of each wheel on the ball, compressive positive, N.
    pub wheel_normal_forces: Wheels<f64>,
    /// Drive friction of each wheel on the ball along its drive direction d_i, N.
    pub wheel_tractions: Wheels<f64>,
    /// Surface speed of each wheel relative to the ball along d_i, m/s; zero without slip.
    pub wheel_slip_speeds: Wheels<f64>,
    /// Force of the floor on the ball, inertial frame, N.
    pub floor_force: Vector3<f64>,
    /// Force of the floor on the bot, that is, on body and wheels, inertial frame, N; zero for models without this
    /// contact.
    pub bot_floor_force: Vector3<f64>,
    /// Velocity of the ball's lowest point along the floor, m/s; zero without slip.
    pub floor_slip_velocity: Vector2<f64>,
    /// Force of obstacles on ball, body and wheels, inertial frame, N.
    pub obstacle_force: Vector3<f64>,
    /// Whether the body or a wheel touches the floor.
    pub bot_on_floor: bool,
    /// Whether the ball, the body or a wheel touches an obstacle.
    pub on_obstacle: bool,
    /// Steps since the reset in which the sticking and slipping contacts were not found at the first attempt; zero for
    /// models without slip.
    pub searched_steps: u64,
    /// Searched steps in which no impulses met the contact conditions, or in which, in the model `rigid`, the impulses
    /// of wheels and bot did not converge.
    pub unsolved_steps: u64,
}

impl Contacts {
    /// Checks that all numbers are finite.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] naming the number.
    pub fn validate(&self) -> Result<()> {
        finite("wheel_normal_forces", self.wheel_normal_forces.as_slice())?;
        finite("wheel_tractions", self.wheel_tractions.as_slice())?;
        finite("wheel_slip_speeds", self.wheel_slip_speeds.as_slice())?;
        finite("floor_force", self.floor_force.as_slice())?;
        finite("bot_floor_force", self.bot_floor_force.as_slice())?;
        finite("obstacle_force", self.obstacle_force.as_slice())?;
        finite("floor_slip_velocity", self.floor_slip_velocity.as_slice())
    }

    /// Fraction of the dynamic friction limit in use, |f| / (μ N), at the three wheels and the floor. The value is
    /// infinite for a contact under tension. Above 1 a model without slip is not valid.
    pub fn friction_utilization(&self, params: &Params) -> [f64; 4] {
        let share = |force: f64, limit: f64| match () {
            () if limit > 0.0 => force / limit,
            () if force == 0.0 && limit == 0.0 => 0.0,
            () => f64::INFINITY,
        };
        let wheel = |i: usize| {
            share(self.wheel_tractions[i].abs(), params.wheel_dynamic_friction * self.wheel_normal_forces[i])
        };
        let floor = share(self.floor_force.xy().norm(), params.floor_dynamic_friction * self.floor_force.z);
        [wheel(0), wheel(1), wheel(2), floor]
    }
}
