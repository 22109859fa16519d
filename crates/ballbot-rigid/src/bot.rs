//! Free motion of the bot: mass matrix, gyroscopic terms, and the forces that make rapier reproduce it.
//!
//! Generalized velocities are the velocities of the multibody, with vectors in body axes: velocity of the root, angular
//! velocity, joint rates. In body axes the mass matrix is constant, because the wheels are axisymmetric. Rapier
//! computes it.
//!
//! Rapier evaluates the gyroscopic torque at the start of a step, which adds energy. Here it is evaluated at the
//! middle, which conserves energy and the magnitude of the angular momentum (implicit midpoint rule). [`Bot::force`]
//! makes rapier follow.

use super::bodies::{BodyLink, wheel_transverse_inertia};
use ballbot_base::collision_shape::wheel_centers;
use ballbot_base::kinematics::Omniwheels;
use ballbot_base::params::Params;
use ballbot_base::wheels::{WHEELS, Wheels};
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

/// Degrees of freedom of the bot.
pub const DOFS: usize = 9;

/// Generalized velocities, accelerations or forces of the bot.
pub type Coordinates = SVector<f64, DOFS>;

/// Matrix on [`Coordinates`].
pub type Mass = SMatrix<f64, DOFS, DOFS>;

/// Largest number of iterations of the midpoint rule, and the change of a rate, rad/s, at which it ends.
const MIDPOINT: (usize, f64) = (20, 1e-12);

/// Constants of the bot's motion.
pub struct Bot {
    /// Mass matrix of the multibody in body axes.
    pub undamped: Mass,
    /// Mass matrix, including the damping of a step.
    mass: Mass,
    /// Inverse of `mass`.
    pub mass_inverse: Mass,
    /// Wheel centers from the root, body frame, m.
    pub centers: Wheels<Vector3<f64>>,
    /// Axles, body frame.
    pub axles: Wheels<Vector3<f64>>,
    body_inertia: Matrix3<f64>,
    total_mass: f64,
    wheel_mass: f64,
    wheel_inertia: f64,
    wheel_transverse: f64,
    viscous_friction: f64,
    dt: f64,
}

/// Velocity of the root, angular velocity and joint rates.
pub fn split(x: &Coordinates) -> [Vector3<f64>; 3] {
    [0, 3, 6].map(|at| x.fixed_rows::<3>(at).into_owned())
}

/// Inverse of [`split`].
pub fn join(parts: &[Vector3<f64>; 3]) -> Coordinates {
    let mut x = Coordinates::zeros();
    for (i, part) in parts.iter().enumerate() {
        x.fixed_rows_mut::<3>(3 * i).copy_from(part);
    }
    x
}

impl Bot {
    /// Constants of a bot with the mass matrix `undamped`, for steps of `dt`.
    pub fn new(params: &Params, wheels: &Omniwheels, link: &BodyLink, undamped: &Mass, dt: f64) -> Self {
        let mut mass = *undamped;
        for i in 6..DOFS {
            mass[(i, i)] += params.wheel_viscous_friction * dt;
        }
        Self {
            mass_inverse: mass.try_inverse().expect("a mass matrix has an inverse"),
            mass,
            undamped: *undamped,
            centers: wheel_centers(params, wheels).map(|center| center - link.com),
            axles: Wheels::from_fn(|i| -wheels.axles.row(i).transpose()),
            body_inertia: link.inertia,
            total_mass: params.without_payloads().body_mass,
            wheel_mass: params.wheel_mass,
            wheel_inertia: params.wheel_inertia,
            wheel_transverse: wheel_transverse_inertia(params),
            viscous_friction: params.wheel_viscous_friction,
            dt,
        }
    }

    /// Inertia of wheel `i` times a vector.
    fn wheel_moment(&self, i: usize, rate: &Vector3<f64>) -> Vector3<f64> {
        let axle = &self.axles[i];
        rate * self.wheel_transverse + axle * ((self.wheel_inertia - self.wheel_transverse) * axle.dot(rate))
    }

    /// Generalized force of the gravity `gravity` (body frame, m/s²).
    pub fn weight(&self, gravity: &Vector3<f64>) -> Coordinates {
        let arm: Vector3<f64> = self.centers.iter().sum();
        join(&[gravity * self.total_mass, arm.cross(gravity) * self.wheel_mass, Vector3::zeros()])
    }

    /// Generalized centrifugal, Coriolis and gyroscopic forces at an angular velocity and joint rates.
    fn gyroscopic(&self, rate: &Vector3<f64>, joints: &Vector3<f64>) -> Coordinates {
        let mut force = Vector3::zeros();
        let mut torque = -rate.cross(&(self.body_inertia * rate));
        for (i, (center, axle)) in self.centers.iter().zip(&self.axles).enumerate() {
            let spin = axle * joints[i];
            let absolute = rate + spin;
            let pull = rate.cross(&rate.cross(center)) * -self.wheel_mass;
            let twist = absolute.cross(&self.wheel_moment(i, &absolute)) + self.wheel_moment(i, &rate.cross(&spin));
            force += pull;
            torque += center.cross(&pull) - twist;
        }
        // A wheel is axisymmetric: no gyroscopic torque about its axle.
        join(&[force, torque, Vector3::zeros()])
    }

    /// Acceleration from `velocity` over a step under the generalized force `applied`, without contacts.
    pub fn free_acceleration(&self, velocity: &Coordinates, applied: &Coordinates) -> Coordinates {
        let [_, rate, joints] = split(velocity);
        // Only the bot without applied forces: applied forces change the midpoint rates by a fraction of a step.
        let mut turning = Coordinates::zeros();
        for _ in 0..MIDPOINT.0 {
            let [_, turn, spin] = split(&turning).map(|part| part * (0.5 * self.dt));
            let next = self.mass_inverse * self.gyroscopic(&(rate + turn), &(joints + spin));
            let change = (next - turning).fixed_rows::<6>(3).amax() * self.dt;
            turning = next;
            if change <= MIDPOINT.1 {
                break;
            }
        }
        let mut applied = *applied;
        for i in 0..WHEELS {
            applied[6 + i] -= self.viscous_friction * joints[i];
        }
        turning + self.mass_inverse * applied
    }

    /// Force on root and torque on root and joints that make rapier accelerate the bot by `acceleration` from
    /// `velocity`, without its weight `weight`. This inverts rapier's step, which multiplies the acceleration by the
    /// mass matrix plus Coriolis terms linear in it.
    pub fn force(&self, velocity: &Coordinates, acceleration: &Coordinates, weight: &Coordinates) -> Coordinates {
        let [_, rate, joints] = split(velocity);
        let [_, turn, spin_up] = split(acceleration);
        let mut needed = self.mass * acceleration - self.gyroscopic(&rate, &joints) - weight;
        // Change of a gyroscopic torque with the angular velocity.
        let change = |rate: &Vector3<f64>, moment: Vector3<f64>, turn: &Vector3<f64>, turned: Vector3<f64>| {
            (rate.cross(&turned) - moment.cross(turn)) * self.dt
        };
        let mut force = Vector3::zeros();
        let mut torque = change(&rate, self.body_inertia * rate, &turn, self.body_inertia * turn);
        for (i, (center, axle)) in self.centers.iter().zip(&self.axles).enumerate() {
            let spin = axle * joints[i];
            let (absolute, turning) = (rate + spin, turn + axle * spin_up[i]);
            torque += change(&absolute, self.wheel_moment(i, &absolute), &turning, self.wheel_moment(i, &turning));
            let pull = turn.cross(&absolute.cross(center)) + rate.cross(&turn.cross(center));
            let pull = pull * (self.wheel_mass * self.dt);
            let twist = turn.cross(&spin) + rate.cross(&(axle * spin_up[i]));
            force += pull;
            torque += center.cross(&pull) + self.wheel_moment(i, &twist) * self.dt;
            needed[6 + i] += self.viscous_friction * joints[i];
        }
        needed += join(&[force, torque, Vector3::zeros()]);
        needed
    }
}
