//! The floor of a step: a plane tangent to the ground under the ball, a plane below each wheel, and a plane below the
//! body.
//!
//! Rapier collides only with planes: a height field would have edges. The planes of ball and wheels are tangent to the
//! ground. The plane of the body passes through the ground below both ends of its cylinder, on which a fallen robot
//! lies; between the ends the ground may rise through it.

use super::convert::{rotation_to_rapier, to_rapier};
use ballbot_base::terrain::Ground;
use nalgebra::{UnitQuaternion, Vector2, Vector3};
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

/// Pose of the plane tangent to the ground below a point.
pub fn plane_below(ground: &Ground, point: &Vector3<f64>) -> Pose {
    let terrain = ground.terrain();
    let touched = Vector3::new(point.x, point.y, terrain.height(point.x, point.y));
    plane(&touched, &terrain.normal(point.x, point.y))
}

/// Pose of the plane through the ground below two points. Across the line that joins the points, its slope is the slope
/// of the ground below their middle. If one point is above the other, it is the tangent plane below the lower point.
pub fn plane_below_ends(ground: &Ground, ends: &[Vector3<f64>; 2]) -> Pose {
    let terrain = ground.terrain();
    let [low, high] = if ends[0].z < ends[1].z { [&ends[0], &ends[1]] } else { [&ends[1], &ends[0]] };
    let heights = [low, high].map(|end| terrain.height(end.x, end.y));
    let (along, distance) = ((high - low).xy(), (high - low).norm());
    // For an upright body the ends do not matter, and the line that joins them has no horizontal direction.
    let share = (2.0 * along.norm() / distance - 1.0).clamp(0.0, 1.0);
    let Some(direction) = along.try_normalize(0.0).filter(|_| share > 0.0) else { return plane_below(ground, low) };
    let at = low.xy() + along * (0.5 * share);
    let mut gradient = Vector2::from(terrain.gradient(at.x, at.y));
    let secant = (heights[1] - heights[0]) / along.norm();
    gradient += direction * (share * (secant - gradient.dot(&direction)));
    let touched = Vector3::new(low.x, low.y, heights[0]);
    plane(&touched, &Vector3::new(-gradient.x, -gradient.y, 1.0).normalize())
}
