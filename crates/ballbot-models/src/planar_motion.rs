//! Simulation of the planar model: two decoupled vertical planes and the yaw equation, integrated by RK4.

use super::planar::Plane;
use super::rk4::rk4;
use super::{
    Motion, PlanarModel, Saved, WheelInertia, are_bounded, contact_loads, require_rolling, require_rolling_with,
    shaft_torques,
};
use ballbot_base::error::{Error, Result};
use ballbot_base::force::HeldForce;
use ballbot_base::kinematics::Omniwheels;
use ballbot_base::model::{Model, same_geometry};
use ballbot_base::params::Params;
use ballbot_base::snapshot;
use ballbot_base::state::{Contacts, State, attitude, rolling_rate};
use ballbot_base::terrain::Ground;
use ballbot_base::wheels::Wheels;
use nalgebra::{Quaternion, SVector, UnitQuaternion, Vector2, Vector3, Vector6};
use std::any::Any;
use std::sync::Arc;

/// Coordinates (x, θ_y), (y, θ_x), yaw and ball spin angle; their rates; wheel angles; ball quaternion.
type Coordinates = SVector<f64, 19>;

/// Index of the first rate in [`Coordinates`].
const RATES: usize = 6;
/// Index of the first wheel angle.
const WHEEL_ANGLES: usize = 12;
/// Index of the scalar part of the ball quaternion.
const BALL_QUATERNION: usize = 15;

/// A robot with decoupled xz, yz and yaw motion (assumption 2 of the paper).
///
/// The wheel inertia is [`WheelInertia::ThreeWheels`], so motion in one plane equals the motion of the spatial model
/// with relative wheel spin. Tilts in both planes are the components of one rotation vector.
#[derive(Clone, Debug)]
pub struct PlanarMotion {
    params: Params,
    wheels: Omniwheels,
    xz: PlanarModel,
    yz: PlanarModel,
    sim_dt: f64,
    steps: u64,
    is_finite: bool,
    coordinates: Coordinates,
    wheel_torques: Wheels<f64>,
}

impl PlanarMotion {
    /// A robot upright at rest.
    ///
    /// # Errors
    /// [`ballbot_base::Error::Inconsistent`] unless the robot is symmetric about its mast and has no rolling, spinning or
    /// roller friction.
    pub fn new(params: &Params, sim_dt: f64) -> Result<Self> {
        Ok(Self {
            wheels: Omniwheels::new(params),
            xz: PlanarModel::in_plane(params, WheelInertia::ThreeWheels, Plane::Xz)?,
            yz: PlanarModel::in_plane(params, WheelInertia::ThreeWheels, Plane::Yz)?,
            sim_dt,
            steps: 0,
            is_finite: true,
            coordinates: coordinates_of(&State::upright(params)),
            wheel_torques: Wheels::default(),
            params: params.clone(),
        })
    }

    /// Virtual wheel rates of the three planes, along inertial axes, or their derivatives for derivatives of the rates. They
    /// are conjugate to the virtual torques; see `virtual_torques`.
    fn virtual_rates(&self, rates: &Vector6<f64>) -> Vector3<f64> {
        let planar = self.xz.input_map();
        Vector3::new(
            planar[0] * rates[2] + planar[1] * rates[3],
            -(planar[0] * rates[0] + planar[1] * rates[1]),
            self.params.gear_ratio() * (rates[5] - rates[4]),
        )
    }

    /// Encoder rates: virtual wheel rates, rotated into the heading frame.
    fn wheel_speeds(&self, y: &Coordinates) -> Wheels<f64> {
        let rates = self.virtual_rates(&y.fixed_rows::<RATES>(RATES).into_owned());
        self.wheels.wheel_speeds_of_virtual(&rotate(rates.xy(), -y[4]).push(rates.z))
    }

    /// Derivatives of the encoder rates, for derivatives of the rates.
    fn wheel_accelerations(&self, y: &Coordinates, accelerations: &Vector6<f64>) -> Wheels<f64> {
        let (rates, yaw_rate) = (self.virtual_rates(&y.fixed_rows::<RATES>(RATES).into_owned()), y[RATES + 4]);
        let changes = self.virtual_rates(accelerations);
        // The heading frame turns with the yaw.
        let inertial = changes.xy() + Vector2::new(rates.y, -rates.x) * yaw_rate;
        self.wheels.wheel_speeds_of_virtual(&rotate(inertial, -y[4]).push(changes.z))
    }

    /// Virtual torques of the xz-plane, the yz-plane and the yaw equation from the motor torques minus joint friction.
    fn virtual_torques(&self, y: &Coordinates) -> Vector3<f64> {
        let shaft = shaft_torques(&self.params, self.wheel_torques, self.wheel_speeds(y));
        let in_heading = self.wheels.virtual_torques(shaft);
        let inertial = rotate(in_heading.xy(), y[4]);
        // Eq. (8) counts torques about x and y on the body; a positive planar torque in the xz-plane turns the body
        // about −y, in the yz-plane (left-handed) about +x. Eq. (7) counts τ_z on the body.
        Vector3::new(-inertial.y, inertial.x, -in_heading.z)
    }

    fn rate_derivatives(&self, y: &Coordinates) -> Vector6<f64> {
        let rates = y.fixed_rows::<RATES>(RATES);
        let torques = self.virtual_torques(y);
        let plane = |model: &PlanarModel, at: usize, torque: f64| {
            model.accelerations(&Vector2::new(y[at], y[at + 1]), &Vector2::new(rates[at], rates[at + 1]), torque)
        };
        let in_xz = plane(&self.xz, 0, torques.x);
        let in_yz = plane(&self.yz, 2, torques.y);
        let yaw = self.xz.yaw_acceleration(torques.z);
        // The angular momentum of ball and body about the vertical is constant.
        let ball_spin = -yaw * self.params.body_inertia[2] / self.params.ball_inertia;
        Vector6::new(in_xz[0], in_xz[1], in_yz[0], in_yz[1], yaw, ball_spin)
    }

    fn derivative(&self, y: &Coordinates) -> Coordinates {
        let rates = y.fixed_rows::<RATES>(RATES);
        let mut out = Coordinates::zeros();
        out.fixed_rows_mut::<RATES>(0).copy_from(&rates);
        out.fixed_rows_mut::<RATES>(RATES).copy_from(&self.rate_derivatives(y));
        out.fixed_rows_mut::<3>(WHEEL_ANGLES).copy_from_slice(self.wheel_speeds(y).as_slice());
        let spin = rolling_rate(&self.params, &Vector3::new(rates[0], rates[2], 0.0)) + Vector3::z() * rates[5];
        let quaternion_rate = Quaternion::from_imag(spin) * ball_quaternion(y).into_inner() * 0.5;
        out.fixed_rows_mut::<4>(BALL_QUATERNION).copy_from_slice(&[
            quaternion_rate.w,
            quaternion_rate.i,
            quaternion_rate.j,
            quaternion_rate.k,
        ]);
        out
    }

    /// Acceleration of the CoM of the body: sum of the motions in both planes.
    fn com_acceleration(&self, y: &Coordinates, rates: &Vector6<f64>) -> Vector3<f64> {
        let l = self.params.body_com_height;
        let mut acceleration = Vector3::zeros();
        for (axis, at) in [(0, 0), (1, 2)] {
            let (sin, cos) = y[at + 1].sin_cos();
            let tilt_rate = y[RATES + at + 1];
            acceleration[axis] = rates[at] + l * (rates[at + 1] * cos - tilt_rate.powi(2) * sin);
            acceleration.z -= l * (rates[at + 1] * sin + tilt_rate.powi(2) * cos);
        }
        acceleration
    }
}

impl Model for PlanarMotion {
    fn as_any(&self) -> &dyn Any {
        self
    }

    fn params(&self) -> &Params {
        &self.params
    }

    fn sim_dt(&self) -> f64 {
        self.sim_dt
    }

    fn set_params(&mut self, params: &Params) -> Result<()> {
        let mut robot = Self::new(params, self.sim_dt)?;
        if same_geometry(&self.params, params) {
            robot.coordinates = self.coordinates;
            robot.steps = self.steps;
            robot.is_finite = self.is_finite;
            robot.wheel_torques = self.wheel_torques;
        }
        *self = robot;
        Ok(())
    }

    fn set_ground(&mut self, ground: Option<&Arc<Ground>>) -> Result<()> {
        if ground.is_some() {
            return Err(Error::Inconsistent("the model 'planar' simulates only level ground, not a terrain".into()));
        }
        self.place(&State::upright(&self.params.clone()));
        Ok(())
    }

    fn place(&mut self, state: &State) {
        self.coordinates = coordinates_of(state);
        self.steps = 0;
        self.is_finite = true;
        self.wheel_torques = Wheels::default();
    }

    fn advance(&mut self, wheel_torques: Wheels<f64>, steps: usize) {
        self.wheel_torques = wheel_torques;
        for _ in 0..steps {
            let next = rk4(&self.coordinates, self.sim_dt, |y| self.derivative(y));
            self.is_finite &= are_bounded(next.as_slice());
            if self.is_finite {
                self.coordinates = next;
            }
            self.steps += 1;
        }
    }

    fn time(&self) -> f64 {
        self.steps as f64 * self.sim_dt
    }

    fn healthy(&self) -> bool {
        self.is_finite
    }

    /// A state that rolls in space, or in the planes like the states of this model. At a tilt the two differ in the
    /// wheel speeds, which motion in the planes does not need.
    fn accepts(&self, state: &State) -> Result<()> {
        let in_planes = self.wheel_speeds(&coordinates_of(state));
        require_rolling_with(&self.params, state, in_planes)
            .or_else(|_| require_rolling(&self.params, &self.wheels, state))
    }

    fn state(&self) -> State {
        let y = &self.coordinates;
        let rates = y.fixed_rows::<RATES>(RATES);
        let position = Vector3::new(y[0], y[2], self.params.ball_radius);
        let velocity = Vector3::new(rates[0], rates[2], 0.0);
        let tilt_rate = rotate(Vector2::new(-rates[3], rates[1]), -y[4]);
        State {
            ball_position: position,
            ball_quaternion: ball_quaternion(y),
            ball_velocity: velocity,
            ball_angular_velocity: rolling_rate(&self.params, &velocity) + Vector3::z() * rates[5],
            body_position: position,
            body_quaternion: attitude(Vector2::new(-y[3], y[1]), y[4]),
            body_velocity: velocity,
            body_angular_velocity: tilt_rate.push(rates[4]),
            wheel_angles: Wheels([y[WHEEL_ANGLES], y[WHEEL_ANGLES + 1], y[WHEEL_ANGLES + 2]]),
            wheel_speeds: self.wheel_speeds(y),
        }
    }

    fn contacts(&self) -> Contacts {
        let y = &self.coordinates;
        let rates = self.rate_derivatives(y);
        let wheel_acceleration = self.wheel_accelerations(y, &rates);
        let shaft = shaft_torques(&self.params, self.wheel_torques, self.wheel_speeds(y));
        let motion = Motion {
            body_quaternion: attitude(Vector2::new(-y[3], y[1]), y[4]),
            ball_velocity: Vector3::new(y[RATES], y[RATES + 2], 0.0),
            ball_acceleration: Vector3::new(rates[0], rates[2], 0.0),
            com_acceleration: self.com_acceleration(y, &rates),
            tractions: (shaft - wheel_acceleration * self.params.wheel_inertia) / self.params.wheel_radius,
            rollers: Wheels::default(),
            load: Vector3::zeros(),
        };
        contact_loads(&self.params, &self.wheels, &(self.params.up() * self.params.gravity), &motion)
    }

    fn energy(&self) -> f64 {
        let y = &self.coordinates;
        let rates = y.fixed_rows::<RATES>(RATES);
        let plane = |model: &PlanarModel, at: usize| {
            model.energy(&Vector2::new(y[at], y[at + 1]), &Vector2::new(rates[at], rates[at + 1]))
        };
        let p = &self.params;
        let (yaw_rate, spin) = (rates[4], rates[5]);
        let wheels = 3.0 * p.wheel_inertia * (p.gear_ratio() * p.wheel_zenith.sin() * (spin - yaw_rate)).powi(2);
        let twice_yaw_energy = p.body_inertia[2] * yaw_rate.powi(2) + p.ball_inertia * spin.powi(2) + wheels;
        // Each plane includes the whole potential energy.
        let counted_twice = p.body_mass * p.gravity * p.body_com_height;
        plane(&self.xz, 0) + plane(&self.yz, 2) + 0.5 * twice_yaw_energy - counted_twice
    }

    fn push(&mut self, impulse: &Vector3<f64>, point: &Vector3<f64>) {
        let y = self.coordinates;
        for (model, at, horizontal) in [(&self.xz, 0, impulse.x), (&self.yz, 2, impulse.y)] {
            let (sin, cos) = y[at + 1].sin_cos();
            let generalized_impulse = Vector2::new(horizontal, point.z * (horizontal * cos - impulse.z * sin));
            let jump = model
                .mass_matrix(y[at + 1])
                .try_inverse()
                .map_or_else(|| Vector2::repeat(f64::NAN), |inverse| inverse * generalized_impulse);
            self.coordinates[RATES + at] += jump[0];
            self.coordinates[RATES + at + 1] += jump[1];
        }
        let angular_impulse = rotate(point.xy(), y[4]).perp(&impulse.xy());
        let p = &self.params;
        let wheels = 3.0 * p.wheel_inertia * (p.gear_ratio() * p.wheel_zenith.sin()).powi(2);
        // (J_z + w) Ω − w s = impulse, (J_k + w) s − w Ω = 0, with w the wheels' inertia about the vertical.
        let determinant = (p.body_inertia[2] + wheels) * (p.ball_inertia + wheels) - wheels * wheels;
        self.coordinates[RATES + 4] += angular_impulse * (p.ball_inertia + wheels) / determinant;
        self.coordinates[RATES + 5] += angular_impulse * wheels / determinant;
    }

    fn save(&self) -> Vec<u8> {
        snapshot::pack(&Saved {
            steps: self.steps,
            is_finite: self.is_finite,
            coordinates: self.coordinates.into(),
            wheel_torques: self.wheel_torques,
            force: HeldForce::default(),
            load: [0.0; 6],
            payloads: Default::default(),
        })
    }

    fn load(&mut self, bytes: &[u8]) -> Result<()> {
        let saved: Saved = snapshot::unpack("snapshot of a planar model", bytes)?;
        self.steps = saved.steps;
        self.is_finite = saved.is_finite;
        self.coordinates = saved.coordinates.into();
        self.wheel_torques = saved.wheel_torques;
        Ok(())
    }
}

fn rotate(v: Vector2<f64>, angle: f64) -> Vector2<f64> {
    let (sin, cos) = angle.sin_cos();
    Vector2::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y)
}

fn ball_quaternion(y: &Coordinates) -> UnitQuaternion<f64> {
    let q = y.fixed_rows::<4>(BALL_QUATERNION);
    UnitQuaternion::new_normalize(Quaternion::new(q[0], q[1], q[2], q[3]))
}

fn coordinates_of(state: &State) -> Coordinates {
    let tilt = state.tilt_components();
    let yaw = state.yaw();
    let rate = state.body_angular_velocity;
    let tilt_rate = rotate(rate.xy(), yaw);
    let (position, velocity) = (state.ball_position, state.ball_velocity);
    let q = state.ball_quaternion;
    let w = state.wheel_angles;
    Coordinates::from_column_slice(&[
        position.x,
        tilt.y,
        position.y,
        -tilt.x,
        yaw,
        0.0,
        velocity.x,
        tilt_rate.y,
        velocity.y,
        -tilt_rate.x,
        rate.z,
        state.ball_angular_velocity.z,
        w[0],
        w[1],
        w[2],
        q.w,
        q.i,
        q.j,
        q.k,
    ])
}
