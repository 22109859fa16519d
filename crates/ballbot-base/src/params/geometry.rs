//! Positions of the wheels and the center of mass of a body, and the resulting equilibrium.

use super::Params;
use crate::error::{Error, Result};
use crate::wheels::Wheels;
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use std::f64::consts::TAU;

/// Largest deviation of the wheel spacing from 120 deg that counts as rounding, rad.
const EVEN: f64 = 1e-6;

impl Params {
    /// Center of mass of the body in the body frame, m.
    pub fn body_com(&self) -> Vector3<f64> {
        let [x, y] = self.body_com_offset;
        Vector3::new(x, y, self.body_com_height)
    }

    /// Half length of a slender mast about the body's center of mass with the body's largest moment of inertia about an axis
    /// across the mast, m. The parameters have no outline; the body is drawn, and touches the floor, as tall as this.
    pub fn slender_half_length(&self) -> f64 {
        let ([x, y, _], [xy, _, _]) = (self.body_inertia, self.body_products_of_inertia);
        // The closed form has rounding errors; without a product of inertia the moments about the axes are exact.
        let largest = if xy == 0.0 { x.max(y) } else { 0.5 * (x + y) + (0.5 * (x - y)).hypot(xy) };
        (3.0 * largest / self.body_mass).sqrt()
    }

    /// Zenith angle of each wheel contact, rad.
    pub fn wheel_zeniths(&self) -> Wheels<f64> {
        Wheels(self.wheel_zenith_offsets).map(|offset| self.wheel_zenith + offset)
    }

    /// Whether the wheels have equal zenith angles and are 120 deg apart, within 1e-6 rad.
    pub fn has_even_wheels(&self) -> bool {
        self.uneven_wheels().is_none()
    }

    /// Whether the center of mass is on the mast, the body axes are principal axes, the wheels have equal zenith angles
    /// and are 120 deg apart, and their rollers are not inclined: the robot of the paper's planar equations.
    pub fn is_symmetric(&self) -> bool {
        self.asymmetry().is_none()
    }

    /// Checks that the robot is symmetric, as `what` requires.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] naming the first parameter that is not.
    pub fn require_symmetric(&self, what: &str) -> Result<()> {
        reject(what, self.asymmetry())
    }

    /// Checks that the wheels have equal zenith angles and are 120 deg apart, as `what` requires.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] naming the parameter that is not even.
    pub fn require_even_wheels(&self, what: &str) -> Result<()> {
        reject(what, self.uneven_wheels())
    }

    fn asymmetry(&self) -> Option<String> {
        let zero = |name: &str, values: &[f64]| {
            values.iter().any(|v| *v != 0.0).then(|| format!("{name} = {values:?}, but it requires zeros"))
        };
        zero("body_com_offset", &self.body_com_offset)
            .or_else(|| zero("body_products_of_inertia", &self.body_products_of_inertia))
            .or_else(|| self.uneven_wheels())
            .or_else(|| self.inclined_rollers())
    }

    fn uneven_wheels(&self) -> Option<String> {
        let even = |i: usize, j: usize| {
            let apart = (self.wheel_azimuths[i] - self.wheel_azimuths[j]).rem_euclid(TAU);
            (apart.min(TAU - apart) - TAU / 3.0).abs() <= EVEN
        };
        if self.wheel_zenith_offsets != [0.0; 3] {
            return Some(format!("wheel_zenith_offsets = {:?}, but it requires zeros", self.wheel_zenith_offsets));
        }
        (!(even(0, 1) && even(0, 2) && even(1, 2))).then(|| {
            format!(
                "wheel_azimuths = {:?}, but it requires 2 pi / 3 rad between them, within {EVEN}",
                self.wheel_azimuths
            )
        })
    }

    /// Attitude in which a robot at the heading `yaw` (rad) is in equilibrium without torque on a level floor: the
    /// body's center of mass is above the center of the ball. The mast then leans by the angle between it and
    /// [`Params::body_com`]. On a slope a robot needs torque to stay at rest: see [`Params::slope_lean`].
    pub fn equilibrium_attitude(&self, yaw: f64) -> UnitQuaternion<f64> {
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw) * self.to_balance_frame()
    }

    /// Rotation from the body frame to the balance frame, whose z axis is along the line from the ball's center to the
    /// body's center of mass: the shortest rotation, the identity for a center of mass on the mast.
    pub fn to_balance_frame(&self) -> UnitQuaternion<f64> {
        let com = self.com_direction();
        // (1 + c·e3, c × e3) is twice the cosine of half the angle times the rotation from c to e3; c is above the ball.
        UnitQuaternion::new_normalize(Quaternion::new(1.0 + com.z, com.y, 0.0 - com.x, 0.0))
    }

    /// Unit vector from the center of the ball to the center of mass of the body, body frame.
    pub fn com_direction(&self) -> Vector3<f64> {
        let com = self.body_com();
        com / com.norm()
    }

    /// Load of each wheel on the ball in equilibrium on a level floor, without motor torques, N: by the weight of the body
    /// and the preload.
    pub fn equilibrium_wheel_loads(&self) -> Wheels<f64> {
        if self.is_symmetric() {
            return Wheels::all(self.static_wheel_load());
        }
        let directions = Matrix3::from_columns(&self.contact_directions().0);
        let mut weight = self.com_direction() * (self.body_mass * self.gravity);
        weight.z += self.wheel_preload;
        // Coplanar directions do not carry load; validation rejects them.
        Wheels::of_column(directions.lu().solve(&weight).unwrap_or_else(Vector3::zeros))
    }

    /// Directions p_i from the ball center to each wheel contact.
    pub fn contact_directions(&self) -> Wheels<Vector3<f64>> {
        let zeniths = self.wheel_zeniths();
        Wheels::from_fn(|i| {
            let (azimuth, (sin, cos)) = (self.wheel_azimuths[i], zeniths[i].sin_cos());
            Vector3::new(sin * azimuth.cos(), sin * azimuth.sin(), cos)
        })
    }

    /// Directions t_i in which the rim of each wheel moves at its contact.
    pub fn rim_directions(&self) -> Wheels<Vector3<f64>> {
        Wheels(self.wheel_azimuths).map(|azimuth| Vector3::new(-azimuth.sin(), azimuth.cos(), 0.0))
    }

    /// Matrix of the rows a_i = p_i × t_i; the axle of wheel i is −a_i.
    pub fn axle_matrix(&self) -> Matrix3<f64> {
        let (p, t) = (self.contact_directions(), self.rim_directions());
        let row = |i: usize| p[i].cross(&t[i]).transpose();
        Matrix3::from_rows(&[row(0), row(1), row(2)])
    }

    /// Directions d_i in which each wheel drives the surface of the ball: t_i cos γ + a_i sin γ along the axis of the
    /// roller that touches the ball.
    pub fn drive_directions(&self) -> Wheels<Vector3<f64>> {
        let rims = self.rim_directions();
        if !self.has_inclined_rollers() {
            return rims;
        }
        let (axles, (sin, cos)) = (self.axle_matrix(), self.roller_angle.sin_cos());
        Wheels::from_fn(|i| rims[i] * cos + axles.row(i).transpose() * sin)
    }

    /// Matrix of the rows u_i = p_i × d_i / cos γ = a_i − t_i tan γ: without slip a wheel turns at the gear ratio times
    /// u_i times the ball's rate relative to the body.
    pub fn drive_matrix(&self) -> Matrix3<f64> {
        let axles = self.axle_matrix();
        if !self.has_inclined_rollers() {
            return axles;
        }
        axles - self.rim_directions().rows() * self.roller_angle.tan()
    }

    /// Torque on a wheel's joint per traction, m: r_w cos γ.
    pub fn traction_radius(&self) -> f64 {
        self.wheel_radius * self.roller_angle.cos()
    }
}

/// The error of `what` for a reason, if there is one.
pub(super) fn reject(what: &str, reason: Option<String>) -> Result<()> {
    reason.map_or(Ok(()), |reason| Err(Error::Inconsistent(format!("{what}: {reason}"))))
}
