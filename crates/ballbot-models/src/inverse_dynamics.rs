//! Wheel torques for a desired angular acceleration of the body: the equations of [`SpatialModel`](super::SpatialModel)
//! solved for the torques, over lanes.

use ballbot_base::kinematics::Omniwheels;
use ballbot_base::lanes::{Lane, Mat3, Rotation, Vec3};
use ballbot_base::params::Params;
use ballbot_base::wheels::Wheels;
use nalgebra::Matrix3;

/// Motion of a robot, as input of the inverse dynamics.
#[derive(Clone, Copy, Debug)]
pub struct BodyMotion<L> {
    /// Attitude of the balance frame ([`Params::to_balance_frame`]).
    pub rotation: Rotation<L>,
    /// Angular velocity of the body, balance frame, rad/s.
    pub body_rate: Vec3<L>,
    /// Angular velocity of the ball, inertial frame, rad/s.
    pub ball_rate: Vec3<L>,
    /// Encoder rates, rad/s.
    pub wheel_speeds: Wheels<L>,
}

/// Inverse dynamics of the motion without slip: from the angular acceleration of the body to the wheel torques.
///
/// Exact mechanics with free ball spin and viscous friction of ball and wheels. Dry friction and the losses at the ball
/// ([`Params::has_losses`]) are neglected. Derived in `docs/laws.md`.
#[derive(Clone, Debug)]
pub struct InverseDynamics {
    ball_radius: f64,
    ball_inertia: f64,
    /// M = M_k + M_b.
    mass: f64,
    body_mass: f64,
    gravity: f64,
    /// Unit vector opposite to gravity, inertial frame.
    up: [f64; 3],
    /// Distance of the CoM from the ball's center, along the z axis of the balance frame.
    com: f64,
    ball_viscous_friction: f64,
    wheel_viscous_friction: f64,
    /// k.
    gear_ratio: f64,
    /// W = J_w AᵀU, with the rows a_i of A: J_w UᵀU for omniwheels.
    spin: [[f64; 3]; 3],
    /// V = J_w CᵀU / (k + 1) with C = k U + A: W for omniwheels.
    drive: [[f64; 3]; 3],
    /// H = I_O + J_w AᵀC, with the inertia I_O about the ball's center: I_O + (k + 1) W for omniwheels.
    momentum: [[f64; 3]; 3],
    /// D = I_O + J_w CᵀC: I_O + (k + 1)² W for omniwheels.
    inertia: [[f64; 3]; 3],
    /// U⁻ᵀ / k: from the torque on the ball to the wheel torques.
    torques: Wheels<[f64; 3]>,
}

impl InverseDynamics {
    /// Inverse dynamics of the robot of `params`.
    pub fn new(params: &Params) -> Self {
        let p = params;
        let to_balance = p.to_balance_frame().to_rotation_matrix().into_inner();
        let wheels = Omniwheels::new(p);
        let [u, axles] = [wheels.u, wheels.axles].map(|rows| rows * to_balance.transpose());
        // U = A − L: the part of the rims' directions, zero for omniwheels.
        let inclined = axles - u;
        let inverse = u.transpose().try_inverse().expect("the wheels drive the ball about every axis");
        let (k, com) = (p.gear_ratio(), p.body_com().norm());
        let of_axles = axles.transpose() * axles * p.wheel_inertia;
        let mixed = axles.transpose() * inclined * p.wheel_inertia;
        let spin = of_axles - mixed;
        let own = inclined.transpose() * u * p.wheel_inertia;
        let both = mixed + mixed.transpose();
        let arm = Matrix3::from_diagonal(&[com * com, com * com, 0.0].into()) * p.body_mass;
        let about_ball = to_balance * p.body_inertia_matrix() * to_balance.transpose() + arm;
        Self {
            ball_radius: p.ball_radius,
            ball_inertia: p.ball_inertia,
            mass: p.ball_mass + p.body_mass,
            body_mass: p.body_mass,
            gravity: p.gravity,
            up: p.up().into(),
            com,
            ball_viscous_friction: p.ball_viscous_friction,
            wheel_viscous_friction: p.wheel_viscous_friction,
            gear_ratio: k,
            spin: rows(&spin),
            drive: rows(&(spin - own * (k / (k + 1.0)))),
            momentum: rows(&(about_ball + of_axles * (k + 1.0) - mixed * k)),
            inertia: rows(
                &(about_ball + of_axles * (k + 1.0).powi(2) - both * (k * (k + 1.0))
                    + inclined.transpose() * inclined * (p.wheel_inertia * k * k)),
            ),
            torques: Wheels(rows(&(inverse / k))),
        }
    }

    /// Motor torques, N·m, that give the body the angular acceleration `acceleration`, the derivative of
    /// [`BodyMotion::body_rate`] (balance frame, rad/s²). Not finite at attitudes, far from upright, at which the
    /// wheels cannot turn the body about every axis.
    #[inline(always)]
    pub fn torques<L: Lane>(&self, motion: &BodyMotion<L>, acceleration: Vec3<L>) -> Wheels<L> {
        let like = acceleration.x;
        let BodyMotion { rotation, body_rate: rate, ball_rate, wheel_speeds } = *motion;
        // In the balance frame: the vertical n, the direction opposite to gravity, the ball's rate, the CoM.
        let vertical = rotation.rows[2];
        let [x, y, z] = self.up;
        let up = rotation.apply_transposed(Vec3::new(like.splat(x), like.splat(y), like.splat(z)));
        let ball = rotation.apply_transposed(ball_rate);
        let com = Vec3::new(like.zero(), like.zero(), like.splat(self.com));
        let drift = rate.cross(ball);
        let radius = like.splat(self.ball_radius);

        // Contribution of the body's motion, without the wheels' inertia as seen by the ball.
        let angular_momentum = times(&self.momentum, rate) - times(&self.spin, ball) * like.splat(self.gear_ratio);
        let moment = rate.cross(angular_momentum) + com.cross(up) * like.splat(self.body_mass * self.gravity);
        let com_acceleration = acceleration.cross(com) + rate.cross(rate.cross(com));
        let velocity = ball.cross(vertical) * radius;
        let force = (com_acceleration * like.splat(self.body_mass))
            .plus(up, like.splat(self.mass * self.gravity))
            .plus(velocity, like.splat(self.ball_viscous_friction));
        // About the floor contact the wheel torques cancel: the remaining terms determine the ball's acceleration.
        let contact = times(&self.momentum, acceleration)
            + moment
            + times(&self.spin, drift) * like.splat(self.gear_ratio)
            + vertical.cross(force) * radius;
        let ball_acceleration = self.ball_matrix(vertical).inverse().times(-contact);

        let lean = self.body_mass * self.ball_radius * self.com;
        let relative = ball_acceleration - drift;
        let coupling = ball_acceleration * (vertical.z * lean) - vertical * (ball_acceleration.z * lean);
        let k = self.gear_ratio;
        let torque = coupling + times(&self.inertia, acceleration) + moment
            - times(&self.drive, relative) * like.splat(k * (k + 1.0));
        let Vec3 { x, y, z } = times(&self.torques.0, -torque);
        let friction = self.wheel_viscous_friction;
        let Wheels([a, b, c]) = wheel_speeds;
        Wheels([a.mul_add_all(friction, x), b.mul_add_all(friction, y), c.mul_add_all(friction, z)])
    }

    /// K of the ball's acceleration K x = −(contribution of the body's motion about the floor contact).
    #[inline(always)]
    fn ball_matrix<L: Lane>(&self, vertical: Vec3<L>) -> Mat3<L> {
        let (translation, lean) =
            (self.mass * self.ball_radius * self.ball_radius, self.body_mass * self.ball_radius * self.com);
        let like = vertical.x;
        let diagonal = vertical.z.mul_add_all(lean, like.splat(self.ball_inertia + translation));
        let row = Vec3::new(
            vertical.x * translation,
            vertical.y * translation,
            vertical.z.mul_add_all(translation, like.splat(lean)),
        );
        let [a, b, c] = &self.spin;
        let k = -self.gear_ratio;
        let own = Mat3::new(
            Vec3::new(diagonal + a[0] * k, like.splat(a[1] * k), like.splat(a[2] * k)),
            Vec3::new(like.splat(b[0] * k), diagonal + b[1] * k, like.splat(b[2] * k)),
            Vec3::new(like.splat(c[0] * k), like.splat(c[1] * k), diagonal + c[2] * k),
        );
        own.minus_outer(vertical, row)
    }
}

fn rows(matrix: &Matrix3<f64>) -> [[f64; 3]; 3] {
    std::array::from_fn(|i| std::array::from_fn(|j| matrix[(i, j)]))
}

/// Product of a constant matrix and a vector.
#[inline(always)]
fn times<L: Lane>([a, b, c]: &[[f64; 3]; 3], v: Vec3<L>) -> Vec3<L> {
    Vec3::new(product(a, v), product(b, v), product(c, v))
}

#[inline(always)]
fn product<L: Lane>(row: &[f64; 3], v: Vec3<L>) -> L {
    v.z.mul_add_all(row[2], v.y.mul_add_all(row[1], v.x * row[0]))
}
