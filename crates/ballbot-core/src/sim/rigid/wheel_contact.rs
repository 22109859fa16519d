//! Where a wheel meets the ball.

use super::convert::from_rapier;
use nalgebra::Vector3;
use rapier3d_f64::prelude::*;

/// Where and along what a wheel drives the ball.
pub struct Contact {
    /// Contact point, inertial frame, m.
    pub point: Vector3<f64>,
    /// From the ball center to the wheel center.
    pub normal: Vector3<f64>,
    /// Drive direction in the plane of contact.
    pub drive: Vector3<f64>,
    /// From the ball's surface to the wheel's, m.
    pub gap: f64,
}

impl Contact {
    /// Of a ball and a wheel whose axle is `axle` (inertial frame).
    pub fn new(
        ball: Vector3<f64>,
        ball_radius: f64,
        wheel: Vector3<f64>,
        wheel_radius: f64,
        axle: &Vector3<f64>,
    ) -> Self {
        let apart = wheel - ball;
        let distance = apart.norm();
        let normal = apart / distance;
        // u × p = d with the axle along −u.
        let drive = normal.cross(axle).normalize();
        Self { point: ball + normal * ball_radius, normal, drive, gap: distance - ball_radius - wheel_radius }
    }
}

/// Velocity of a body's material point, inertial frame, m/s.
pub fn point_velocity(body: &RigidBody, point: &Vector3<f64>) -> Vector3<f64> {
    let arm = point - from_rapier(body.center_of_mass());
    from_rapier(body.linvel()) + from_rapier(body.angvel()).cross(&arm)
}
