//! The floor of a step: planes tangent to the ground under the ball, below each wheel, and below the lowest point of
//! each end of the body.
//!
//! Rapier collides only with planes: a height field would have edges. A plane that is not tangent where it is touched
//! moves along its normal while the robot slides, and its force does work. A fallen robot lies on the ends of its
//! cylinder; between them the ground may rise through it.

use super::convert::{rotation_to_rapier, to_rapier};
use ballbot_base::terrain::Ground;
use nalgebra::{UnitQuaternion, Vector3};
use rapier3d_f64::prelude::Pose;

/// Sine of the angle between ground and disc below which the lowest point moves to the center.
const FLAT: f64 = 0.05;

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

/// Pose of the plane tangent to the ground below a point.
pub fn plane_below(ground: &Ground, point: &Vector3<f64>) -> Pose {
    let terrain = ground.terrain();
    let touched = Vector3::new(point.x, point.y, terrain.height(point.x, point.y));
    plane(&touched, &terrain.normal(point.x, point.y))
}

/// Pose of the plane tangent to the ground below the lowest point of a disc with an axis of length 1. It is the center
/// of a disc that lies flat.
pub fn plane_below_disc(ground: &Ground, center: &Vector3<f64>, axis: &Vector3<f64>, radius: f64) -> Pose {
    let normal = ground.terrain().normal(center.x, center.y);
    let down = axis * axis.dot(&normal) - normal;
    plane_below(ground, &(center + down * (radius / down.norm().max(FLAT))))
}
