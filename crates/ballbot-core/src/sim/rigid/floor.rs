//! The floor of a step: a plane that touches the ground under the ball, and another below the body.
//!
//! Rapier collides with planes alone: a height field would have edges. The plane of the bot touches the ground below the
//! middle of the body, so the ends of a fallen robot may be off uneven ground by half its curvature times the square of half
//! their distance.

use super::convert::{rotation_to_rapier, to_rapier};
use crate::terrain::Ground;
use nalgebra::{UnitQuaternion, Vector3};
use rapier3d_f64::prelude::Pose;

/// The floor under the ball.
pub struct Floor {
    /// Gap between ball and floor, m.
    pub gap: f64,
    /// Two tangents and the normal, inertial frame.
    pub axes: [Vector3<f64>; 3],
}

impl Floor {
    pub fn under(ground: Option<&Ground>, ball: &Vector3<f64>, radius: f64) -> Self {
        let Some(ground) = ground else {
            return Self { gap: ball.z - radius, axes: [Vector3::x(), Vector3::y(), Vector3::z()] };
        };
        let (gap, normal) = ground.gap(ball, radius);
        let upright = upright_to(&normal);
        Self { gap, axes: [upright * Vector3::x(), upright * Vector3::y(), normal] }
    }
}

/// The smallest rotation from z to a normal that points upwards.
fn upright_to(normal: &Vector3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::rotation_between(&Vector3::z(), normal).expect("a normal points upwards")
}

/// Pose of the plane through a point with an upward normal.
pub fn plane(point: &Vector3<f64>, normal: &Vector3<f64>) -> Pose {
    Pose::from_parts(to_rapier(point), rotation_to_rapier(&upright_to(normal)))
}

/// Pose of the plane that touches the ground below a point.
pub fn plane_below(ground: &Ground, point: &Vector3<f64>) -> Pose {
    let terrain = ground.terrain();
    let touched = Vector3::new(point.x, point.y, terrain.height(point.x, point.y));
    plane(&touched, &terrain.normal(point.x, point.y))
}
