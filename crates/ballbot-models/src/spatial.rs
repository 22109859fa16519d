//! The coupled 3D model without slip, by Kane's method.
//!
//! Generalized velocity ν = (v_x, v_y, Ω_x, Ω_y, Ω_z, s): the ball's velocity on the floor (inertial frame), the body's
//! angular velocity (body frame), the ball's spin about the vertical. The wheel constraints are nonholonomic. Inserting
//! them into a Lagrangian gives wrong equations except in a plane. Kane's method projects the Newton-Euler equations
//! onto the partial velocities (Kane & Levinson, Dynamics: Theory and Applications, 1985, ch. 6). See
//! `docs/derivations.md`.

use super::losses::{Friction, consistent};
use super::{Motion, contact_loads, shaft_torques};
use ballbot_base::error::{Error, Result};
use ballbot_base::kinematics::Omniwheels;
use ballbot_base::params::Params;
use ballbot_base::state::Contacts;
use ballbot_base::wheels::Wheels;
use nalgebra::{Matrix3, Matrix3x6, Matrix6, UnitQuaternion, Vector3, Vector4, Vector6};

/// Wheel spin in the kinetic energy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WheelSpin {
    /// Spin in the inertial frame: exact mechanics.
    Absolute,
    /// Spin relative to the body: the paper's wheel energy ½ J_w ψ̇².
    Relative,
}

impl From<bool> for WheelSpin {
    /// `true` is absolute, the value of `absolute_wheel_spin` in Python.
    fn from(absolute: bool) -> Self {
        if absolute { Self::Absolute } else { Self::Relative }
    }
}

/// Spin of the ball about the vertical.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BallSpin {
    /// A degree of freedom.
    Free,
    /// Constrained to zero.
    Pinned,
}

impl From<bool> for BallSpin {
    /// `true` is free, the value of `ball_spins_about_vertical` in Python.
    fn from(free: bool) -> Self {
        if free { Self::Free } else { Self::Pinned }
    }
}

/// A force on the body at a point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PointForce {
    /// Inertial frame, N.
    pub force: Vector3<f64>,
    /// Body frame, m.
    pub point: Vector3<f64>,
}

impl PointForce {
    /// The force as generalized force.
    fn generalized(&self, body_quaternion: &UnitQuaternion<f64>) -> Vector6<f64> {
        let Self { force, point } = self;
        let moment = point.cross(&body_quaternion.inverse_transform_vector(force));
        Vector6::new(force.x, force.y, moment.x, moment.y, moment.z, 0.0)
    }
}

/// The equations of motion of one robot.
#[derive(Clone, Debug)]
pub struct SpatialModel {
    params: Params,
    wheels: Omniwheels,
    /// CoM and inertia of the body, body frame.
    com: Vector3<f64>,
    inertia: Matrix3<f64>,
    /// 1 for [`WheelSpin::Absolute`], 0 for [`WheelSpin::Relative`].
    kappa: f64,
    ball_spin: BallSpin,
    /// Acceleration of the floor minus gravity, in its frame, m/s².
    weight: Vector3<f64>,
}

/// Matrices of one configuration.
struct Terms {
    body_quaternion: UnitQuaternion<f64>,
    rotation: Matrix3<f64>,
    /// Encoder rates: ψ̇ = B ν.
    b: Matrix3x6<f64>,
    /// Spins in the kinetic energy of the wheels: σ = B_s ν.
    b_s: Matrix3x6<f64>,
    /// Velocity of the CoM: v_CoM = J_c ν.
    j_c: Matrix3x6<f64>,
    mass: Matrix6<f64>,
}

impl SpatialModel {
    /// Equations of the robot of `params`. [`SpatialMotion`](super::SpatialMotion) integrates them with absolute wheel
    /// spin and free ball spin.
    pub fn new(params: &Params, wheel_spin: impl Into<WheelSpin>, ball_spin: impl Into<BallSpin>) -> Self {
        Self {
            wheels: Omniwheels::new(params),
            com: params.body_com(),
            inertia: params.body_inertia_matrix(),
            kappa: match wheel_spin.into() {
                WheelSpin::Absolute => 1.0,
                WheelSpin::Relative => 0.0,
            },
            ball_spin: ball_spin.into(),
            weight: params.up() * params.gravity,
            params: params.clone(),
        }
    }

    /// Replaces the acceleration of the floor minus gravity, in its frame, m/s², of a floor that moves.
    pub(crate) fn set_weight(&mut self, weight: Vector3<f64>) {
        self.weight = weight;
    }

    /// Acceleration of the floor minus gravity, in its frame, m/s².
    pub(crate) fn weight(&self) -> &Vector3<f64> {
        &self.weight
    }

    /// Parameters of the robot.
    pub fn params(&self) -> &Params {
        &self.params
    }

    /// Wheels of the robot.
    pub fn wheels(&self) -> &Omniwheels {
        &self.wheels
    }

    /// Number of generalized velocities: 6 with free ball spin, 5 with pinned ball spin.
    pub fn degrees_of_freedom(&self) -> usize {
        match self.ball_spin {
            BallSpin::Free => 6,
            BallSpin::Pinned => 5,
        }
    }

    /// The generalized velocity from 5 or 6 numbers.
    ///
    /// # Errors
    /// [`Error::Length`] unless there are [`SpatialModel::degrees_of_freedom`] of them.
    pub fn generalized_velocity(&self, values: &[f64]) -> Result<Vector6<f64>> {
        if values.len() != self.degrees_of_freedom() {
            return Err(Error::Length {
                name: "generalized_velocity".into(),
                found: values.len(),
                expected: self.degrees_of_freedom(),
            });
        }
        Ok(Vector6::from_fn(|i, _| values.get(i).copied().unwrap_or(0.0)))
    }

    /// Matrix S of the angular velocity of the ball in the inertial frame, ω_k = S ν.
    fn ball_rate_map(&self) -> Matrix3x6<f64> {
        let mut s = Matrix3x6::zeros();
        s[(0, 1)] = -1.0 / self.params.ball_radius;
        s[(1, 0)] = 1.0 / self.params.ball_radius;
        if self.ball_spin == BallSpin::Free {
            s[(2, 5)] = 1.0;
        }
        s
    }

    fn terms(&self, body_quaternion: &UnitQuaternion<f64>) -> Terms {
        let p = &self.params;
        let rotation = body_quaternion.to_rotation_matrix().into_inner();
        let s = self.ball_rate_map();
        let mut relative_rate = rotation.transpose() * s;
        let mut j_c = Matrix3x6::zeros();
        j_c[(0, 0)] = 1.0;
        j_c[(1, 1)] = 1.0;
        for i in 0..3 {
            relative_rate[(i, 2 + i)] -= 1.0;
            // −R [c]x
            j_c[(i, 2)] = self.com.y * rotation[(i, 2)] - self.com.z * rotation[(i, 1)];
            j_c[(i, 3)] = self.com.z * rotation[(i, 0)] - self.com.x * rotation[(i, 2)];
            j_c[(i, 4)] = self.com.x * rotation[(i, 1)] - self.com.y * rotation[(i, 0)];
        }
        let b = self.wheels.u * relative_rate * p.gear_ratio();
        let mut b_s = b;
        let mut own = b_s.fixed_view_mut::<3, 3>(0, 2);
        own -= self.wheels.axles * self.kappa;

        let mut mass = s.transpose() * s * p.ball_inertia
            + j_c.transpose() * j_c * p.body_mass
            + b_s.transpose() * b_s * p.wheel_inertia;
        mass[(0, 0)] += p.ball_mass;
        mass[(1, 1)] += p.ball_mass;
        let mut own = mass.fixed_view_mut::<3, 3>(2, 2);
        own += self.inertia;
        if self.ball_spin == BallSpin::Pinned {
            mass[(5, 5)] = 1.0;
        }
        Terms { body_quaternion: *body_quaternion, rotation, b, b_s, j_c, mass }
    }

    /// Derivative ν' under motor torques (N·m). The sixth element is zero with [`BallSpin::Pinned`].
    pub fn accelerations(
        &self,
        body_quaternion: &UnitQuaternion<f64>,
        velocity: &Vector6<f64>,
        wheel_torques: Wheels<f64>,
    ) -> Vector6<f64> {
        self.accelerations_under(body_quaternion, velocity, wheel_torques, &[])
    }

    /// [`SpatialModel::accelerations`] with forces on the body.
    pub fn accelerations_under(
        &self,
        body_quaternion: &UnitQuaternion<f64>,
        velocity: &Vector6<f64>,
        wheel_torques: Wheels<f64>,
        loads: &[PointForce],
    ) -> Vector6<f64> {
        self.solve(&self.terms(body_quaternion), velocity, wheel_torques, loads).0
    }

    /// ν' and the friction of the rollers on the bot along p_i × d_i, N.
    fn solve(
        &self,
        terms: &Terms,
        velocity: &Vector6<f64>,
        wheel_torques: Wheels<f64>,
        loads: &[PointForce],
    ) -> (Vector6<f64>, Wheels<f64>) {
        let without = self.solve_lossless(terms, velocity, wheel_torques, loads);
        if !self.params.has_losses() {
            return (without, Wheels::default());
        }
        let mut relative_rate = terms.rotation.transpose() * self.ball_rate_map();
        for i in 0..3 {
            relative_rate[(i, 2 + i)] -= 1.0;
        }
        // Includes the motion of the rim along the free direction of inclined rollers.
        let rims = Matrix3::from_columns(&self.wheels.rim_directions.0);
        let free_speeds = rims.transpose() * relative_rate * (self.params.ball_radius / self.params.roller_angle.cos());
        let friction = Friction::new(&self.params, &self.ball_rate_map(), &free_speeds, velocity);
        let changed = |normal: &Vector4<f64>| without + solve_mass(terms, &(friction.per_load * normal));
        let normal = consistent(|normal| {
            let rollers = friction.rollers(normal);
            let contacts = self.contacts_of(terms, velocity, wheel_torques, loads, &changed(normal), rollers);
            let Wheels([a, b, c]) = contacts.wheel_normal_forces;
            Vector4::new(contacts.floor_force.z, a, b, c)
        });
        (changed(&normal), friction.rollers(&normal))
    }

    fn solve_lossless(
        &self,
        terms: &Terms,
        velocity: &Vector6<f64>,
        wheel_torques: Wheels<f64>,
        loads: &[PointForce],
    ) -> Vector6<f64> {
        let p = &self.params;
        let rate = velocity.fixed_rows::<3>(2).into_owned();
        let shaft = shaft_torques(&self.params, wheel_torques, Wheels::of_column(terms.b * velocity));
        let spin = terms.b_s * velocity;

        let gyroscopic = rate.cross(&(self.inertia * rate))
            - rate.cross(&(self.wheels.axles.transpose() * spin)) * (self.kappa * p.wheel_inertia);
        let weight = self.weight;

        let mut force = terms.b.transpose() * shaft.column()
            - terms.j_c.transpose() * (self.centripetal(terms, &rate) + weight) * p.body_mass
            - terms.b_s.transpose() * self.spin_drift(terms, velocity, &rate) * p.wheel_inertia;
        for i in 0..2 {
            force[i] -= p.ball_viscous_friction * velocity[i];
            force[i] -= p.ball_mass * weight[i];
        }
        for i in 0..3 {
            force[2 + i] -= gyroscopic[i];
        }
        for load in loads.iter().filter(|load| load.force != Vector3::zeros()) {
            force += load.generalized(&terms.body_quaternion);
        }
        if self.ball_spin == BallSpin::Pinned {
            force[5] = 0.0;
        }
        solve_mass(terms, &force)
    }

    /// Acceleration R (Ω × (Ω × c)) of the CoM at ν' = 0.
    fn centripetal(&self, terms: &Terms, rate: &Vector3<f64>) -> Vector3<f64> {
        terms.rotation * rate.cross(&rate.cross(&self.com))
    }

    /// Derivative −k U (Ω × Rᵀ S ν) of σ at ν' = 0.
    fn spin_drift(&self, terms: &Terms, velocity: &Vector6<f64>, rate: &Vector3<f64>) -> Vector3<f64> {
        let ball_rate = terms.rotation.transpose() * (self.ball_rate_map() * velocity);
        self.wheels.u * rate.cross(&ball_rate) * -self.params.gear_ratio()
    }

    /// Encoder rates ψ̇, rad/s.
    pub fn wheel_speeds(&self, body_quaternion: &UnitQuaternion<f64>, velocity: &Vector6<f64>) -> Wheels<f64> {
        let ball_rate = self.ball_rate_map() * velocity;
        self.wheels.wheel_speeds(body_quaternion, &ball_rate, &velocity.fixed_rows::<3>(2).into_owned())
    }

    /// Kinetic energy plus M_b g u·R c, with u upwards ([`Params::up`]), J: with the ball at the origin.
    pub fn energy(&self, body_quaternion: &UnitQuaternion<f64>, velocity: &Vector6<f64>) -> f64 {
        let terms = self.terms(body_quaternion);
        let moment = self.com * (self.params.body_mass * self.params.gravity);
        0.5 * velocity.dot(&(terms.mass * velocity)) + (terms.rotation.transpose() * self.params.up()).dot(&moment)
    }

    /// Momenta M ν conjugate to the generalized velocity.
    pub fn momenta(&self, body_quaternion: &UnitQuaternion<f64>, velocity: &Vector6<f64>) -> Vector6<f64> {
        self.terms(body_quaternion).mass * velocity
    }

    /// Contact forces of floor and wheels for motion without slip. The model is valid only while
    /// [`Contacts::friction_utilization`] is between 0 and 1.
    pub fn contacts(
        &self,
        body_quaternion: &UnitQuaternion<f64>,
        velocity: &Vector6<f64>,
        wheel_torques: Wheels<f64>,
    ) -> Contacts {
        self.contacts_under(body_quaternion, velocity, wheel_torques, &[])
    }

    /// [`SpatialModel::contacts`] with forces on the body.
    pub fn contacts_under(
        &self,
        body_quaternion: &UnitQuaternion<f64>,
        velocity: &Vector6<f64>,
        wheel_torques: Wheels<f64>,
        loads: &[PointForce],
    ) -> Contacts {
        let terms = self.terms(body_quaternion);
        let (acceleration, rollers) = self.solve(&terms, velocity, wheel_torques, loads);
        self.contacts_of(&terms, velocity, wheel_torques, loads, &acceleration, rollers)
    }

    /// Contact forces at ν' = `acceleration`, with the friction `rollers` on the bot along p_i × d_i, N.
    fn contacts_of(
        &self,
        terms: &Terms,
        velocity: &Vector6<f64>,
        wheel_torques: Wheels<f64>,
        loads: &[PointForce],
        acceleration: &Vector6<f64>,
        rollers: Wheels<f64>,
    ) -> Contacts {
        let rate = velocity.fixed_rows::<3>(2).into_owned();
        let spin_acceleration = terms.b_s * acceleration + self.spin_drift(terms, velocity, &rate);
        let mut shaft = shaft_torques(&self.params, wheel_torques, Wheels::of_column(terms.b * velocity));
        if self.params.has_inclined_rollers() {
            // The friction of the rollers turns the wheel.
            shaft = shaft.plus(rollers, -self.params.wheel_radius * self.params.roller_angle.sin());
        }
        let motion = Motion {
            body_quaternion: terms.body_quaternion,
            ball_velocity: Vector3::new(velocity[0], velocity[1], 0.0),
            ball_acceleration: Vector3::new(acceleration[0], acceleration[1], 0.0),
            com_acceleration: terms.j_c * acceleration + self.centripetal(terms, &rate),
            tractions: (shaft - Wheels::of_column(spin_acceleration) * self.params.wheel_inertia)
                / self.wheels.traction_radius,
            rollers,
            load: loads.iter().map(|load| load.force).sum(),
        };
        contact_loads(&self.params, &self.wheels, &self.weight, &motion)
    }

    /// Product of M⁻¹ and a generalized force or impulse: ν' or the change of ν.
    pub fn response(&self, body_quaternion: &UnitQuaternion<f64>, force: &Vector6<f64>) -> Vector6<f64> {
        solve_mass(&self.terms(body_quaternion), force)
    }

    /// Change of ν by an impulse (inertial frame, N·s) on the body at `point` (body frame, m).
    pub fn velocity_jump(
        &self,
        body_quaternion: &UnitQuaternion<f64>,
        impulse: &Vector3<f64>,
        point: &Vector3<f64>,
    ) -> Vector6<f64> {
        let impulse = PointForce { force: *impulse, point: *point };
        self.response(body_quaternion, &impulse.generalized(body_quaternion))
    }
}

/// Solution of M ν' = force; NaN for the mass matrix of a diverged state, which is reported as divergence.
fn solve_mass(terms: &Terms, force: &Vector6<f64>) -> Vector6<f64> {
    terms.mass.cholesky().map_or_else(|| Vector6::repeat(f64::NAN), |mass| mass.solve(force))
}
