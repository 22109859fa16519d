//! Geometry of three omniwheels on a ball: wheel speeds and the maps between wheel torques and virtual torques.

use crate::error::{Error, Result};
use crate::params::Params;
use crate::wheels::Wheels;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// Map from three virtual torques to three wheel torques.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TorqueMap {
    /// Power-conserving map: Σ τ_i ψ̇_i is the power of the virtual torques at the rates of the virtual wheels.
    #[default]
    Consistent,
    /// Eq. (8) of the paper as printed. It is the inverse of the map of wheel *speeds*. Tilt torques are too large by
    /// the factor (3/2) (r_k/r_w) cos²α, the yaw torque by 3 (r_k/r_w) sin²α (Table II: 1.68 and 3.36).
    AsPrinted,
}

impl TorqueMap {
    /// Checks that the map is defined for the robot of `params`.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] for [`TorqueMap::AsPrinted`] for unevenly placed wheels and for inclined rollers, naming
    /// the parameter.
    pub fn require(self, params: &Params) -> Result<()> {
        match self {
            Self::Consistent => Ok(()),
            Self::AsPrinted => {
                params.require_even_wheels(
                    "eq. (8) as printed is for wheels of one zenith, 120 deg apart; the consistent map takes any",
                )?;
                params.require_omniwheels("eq. (8) as printed is for omniwheels; the consistent map takes any rollers")
            }
        }
    }
}

impl std::str::FromStr for TorqueMap {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        match name {
            "consistent" => Ok(Self::Consistent),
            "as_printed" => Ok(Self::AsPrinted),
            _ => Err(Error::unknown("torque mapping", name, &["consistent", "as_printed"])),
        }
    }
}

/// Unit vectors of the three wheels in the body frame, and the maps between wheels and body.
#[derive(Clone, Debug)]
pub struct Omniwheels {
    /// Directions p_i from the ball center to each contact.
    pub contact_directions: Wheels<Vector3<f64>>,
    /// Directions d_i in which each wheel drives the surface of the ball: [`Params::drive_directions`].
    pub drive_directions: Wheels<Vector3<f64>>,
    /// Directions t_i in which the rim of each wheel moves at its contact; d_i if the rollers are not inclined.
    pub rim_directions: Wheels<Vector3<f64>>,
    /// Matrix of the rows a_i = p_i × t_i; the axle of wheel i is −a_i.
    pub axles: Matrix3<f64>,
    /// Matrix of the rows u_i, which map rates of the ball to rates of the wheels: [`Params::drive_matrix`]; a_i if the
    /// rollers are not inclined.
    pub u: Matrix3<f64>,
    /// Torque on a wheel's joint per traction, m.
    pub traction_radius: f64,
    u_inverse_transposed: Matrix3<f64>,
    gear_ratio: f64,
}

impl Omniwheels {
    /// The wheels of `params`.
    pub fn new(params: &Params) -> Self {
        let u = params.drive_matrix();
        let u_inverse_transposed = u
            .try_inverse()
            .expect("the wheels of validated parameters drive the ball about every axis, so the map has an inverse")
            .transpose();
        Self {
            contact_directions: params.contact_directions(),
            drive_directions: params.drive_directions(),
            rim_directions: params.rim_directions(),
            axles: params.axle_matrix(),
            u,
            traction_radius: params.traction_radius(),
            u_inverse_transposed,
            gear_ratio: params.gear_ratio(),
        }
    }

    /// Encoder rates without slip: ψ̇_i = (r_k/r_w) u_i · (Rᵀ ω_k − Ω), rad/s. `ball` is the angular velocity of the
    /// ball in the inertial frame, `body` the angular velocity of the body in the body frame.
    pub fn wheel_speeds(
        &self,
        body_quaternion: &UnitQuaternion<f64>,
        ball: &Vector3<f64>,
        body: &Vector3<f64>,
    ) -> Wheels<f64> {
        Wheels::of_column(self.u * (body_quaternion.inverse_transform_vector(ball) - body) * self.gear_ratio)
    }

    /// Rates of the three virtual wheels, power conjugate to the virtual torques, from the wheel speeds, rad/s.
    pub fn virtual_rates(&self, wheel_speeds: Wheels<f64>) -> Vector3<f64> {
        on_body(&self.u_inverse_transposed.tr_mul(&wheel_speeds.column()))
    }

    /// Wheel speeds for given virtual rates, the inverse of [`Omniwheels::virtual_rates`], rad/s.
    pub fn wheel_speeds_of_virtual(&self, virtual_rates: &Vector3<f64>) -> Wheels<f64> {
        Wheels::of_column(self.u * on_body(virtual_rates))
    }

    /// Virtual torques for given wheel torques (the inverse of the consistent map), N·m.
    pub fn virtual_torques(&self, wheel_torques: Wheels<f64>) -> Vector3<f64> {
        on_body(&(self.u.transpose() * wheel_torques.column()))
    }

    /// Wheel torques for given virtual torques, N·m.
    ///
    /// Virtual torques are in the body frame, with the sign of eq. (8): positive τ_x and τ_y turn the *body* about +x
    /// and +y, a positive τ_z turns the *ball* about +z (all wheels forward). With even wheels the consistent map is
    /// τ_i = ⅓ (τ_z / sin α + (2 / cos α)(τ_x cos β_i + τ_y sin β_i)). [`TorqueMap::AsPrinted`] is the map of the
    /// paper, only for even wheels ([`TorqueMap::require`]).
    pub fn wheel_torques(&self, virtual_torques: &Vector3<f64>, map: TorqueMap) -> Wheels<f64> {
        Wheels::of_column(match map {
            TorqueMap::Consistent => self.u_inverse_transposed * on_body(virtual_torques),
            // For even wheels the printed matrix is the inverse of the matrix used here: rows (2/3 cos β_i, 2/3 sin β_i)/(k cos α),
            // 1/(3 k sin α).
            TorqueMap::AsPrinted => self.u * on_body(virtual_torques) * self.gear_ratio,
        })
    }

    /// Wheel torques for a torque on the body, body frame, as a torque at the virtual wheels, N·m.
    pub fn torques_on_body(&self, torque: &Vector3<f64>, map: TorqueMap) -> Wheels<f64> {
        self.wheel_torques(&Vector3::new(torque.x, torque.y, -torque.z), map)
    }
}

/// Wheel torques drive the ball; eq. (8) counts tilt torques on the body, so x and y change sign.
fn on_body(v: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(-v.x, -v.y, v.z)
}
