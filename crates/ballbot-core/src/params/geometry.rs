//! Where the wheels and the CoM of a body are.

use super::Params;
use nalgebra::{Matrix3, Vector3};
use std::f64::consts::TAU;

impl Params {
    /// CoM of the body in the body frame, m.
    pub fn body_com(&self) -> Vector3<f64> {
        let [x, y] = self.body_com_offset;
        Vector3::new(x, y, self.body_com_height)
    }

    /// Zenith angle of each wheel contact, rad.
    pub fn wheel_zeniths(&self) -> [f64; 3] {
        self.wheel_zenith_offsets.map(|offset| self.wheel_zenith + offset)
    }

    /// Whether the CoM is on the mast, the body axes are principal axes, and the wheels
    /// are alike and 120 deg apart: the robot of the paper's planar equations.
    pub fn is_symmetric(&self) -> bool {
        let even = |i: usize, j: usize| {
            let apart = (self.wheel_azimuths[i] - self.wheel_azimuths[j]).rem_euclid(TAU);
            (apart.min(TAU - apart) - TAU / 3.0).abs() <= 1e-6
        };
        self.body_com_offset == [0.0; 2]
            && self.body_products_of_inertia == [0.0; 3]
            && self.wheel_zenith_offsets == [0.0; 3]
            && even(0, 1)
            && even(0, 2)
            && even(1, 2)
    }

    /// Load of each wheel on the ball in equilibrium, where the CoM is above the ball's center and no motor drives, N.
    pub fn equilibrium_wheel_loads(&self) -> [f64; 3] {
        if self.is_symmetric() {
            return [self.static_wheel_load(); 3];
        }
        let directions = Matrix3::from_columns(&self.contact_directions());
        let weight = self.body_com().normalize() * self.body_mass * self.gravity;
        directions.lu().solve(&weight).unwrap_or_else(Vector3::zeros).into()
    }

    /// Directions p_i from the ball center to each wheel contact.
    pub(crate) fn contact_directions(&self) -> [Vector3<f64>; 3] {
        let zeniths = self.wheel_zeniths();
        [0, 1, 2].map(|i| {
            let (azimuth, (sin, cos)) = (self.wheel_azimuths[i], zeniths[i].sin_cos());
            Vector3::new(sin * azimuth.cos(), sin * azimuth.sin(), cos)
        })
    }

    /// Directions d_i in which each wheel drives the surface of the ball.
    pub(crate) fn drive_directions(&self) -> [Vector3<f64>; 3] {
        self.wheel_azimuths.map(|azimuth| Vector3::new(-azimuth.sin(), azimuth.cos(), 0.0))
    }

    /// Matrix of the rows u_i = p_i × d_i.
    pub(crate) fn drive_matrix(&self) -> Matrix3<f64> {
        let (p, d) = (self.contact_directions(), self.drive_directions());
        let row = |i: usize| p[i].cross(&d[i]).transpose();
        Matrix3::from_rows(&[row(0), row(1), row(2)])
    }
}
