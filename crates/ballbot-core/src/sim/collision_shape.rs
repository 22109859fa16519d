//! Where the wheels are and what stands for the body where it meets the floor: the same in every simulation.

use crate::error::{Result, check};
use crate::kinematics::Omniwheels;
use crate::params::Params;
use crate::state::State;
use nalgebra::{UnitQuaternion, Vector3};

/// How deep in the floor the bot may start, m.
const MAX_FLOOR_OVERLAP: f64 = 1e-3;

/// Wheel centers in the body frame, m.
pub fn wheel_centers(params: &Params, wheels: &Omniwheels) -> [Vector3<f64>; 3] {
    wheels.contact_directions.map(|p| p * (params.ball_radius + params.wheel_radius))
}

/// The cylinder about the mast that stands for the body where it meets the floor.
pub struct BodyShape {
    /// m.
    pub radius: f64,
    /// Lower end in the body frame, m.
    pub bottom: f64,
    /// Upper end in the body frame, m.
    pub top: f64,
}

impl BodyShape {
    /// As wide as the circle of the wheel centers, from just above the ball to the height that the body's radius of
    /// gyration asks of a slender mast: parameters carry inertia, not outlines.
    pub fn new(params: &Params) -> Self {
        let half_height = (3.0 * params.body_inertia[0].max(params.body_inertia[1]) / params.body_mass).sqrt();
        let bottom = 1.05 * params.ball_radius;
        Self {
            radius: (params.ball_radius + params.wheel_radius) * params.wheel_zenith.sin(),
            bottom,
            top: (params.body_com_height + half_height).max(bottom + params.wheel_radius),
        }
    }
}

/// What of the bot can meet the floor.
pub struct CollisionShape {
    pub body: BodyShape,
    wheel_centers: [Vector3<f64>; 3],
    wheel_radius: f64,
}

impl CollisionShape {
    pub fn new(params: &Params, wheels: &Omniwheels) -> Self {
        Self {
            body: BodyShape::new(params),
            wheel_centers: wheel_centers(params, wheels),
            wheel_radius: params.wheel_radius,
        }
    }

    /// The part that is nearest to the floor (or deepest in it), and how high its lowest point is, m.
    pub fn lowest_point(&self, position: &Vector3<f64>, attitude: &UnitQuaternion<f64>) -> (&'static str, f64) {
        let height = |point: Vector3<f64>| (position + attitude * point).z;
        let wheel = self.wheel_centers.map(height).into_iter().fold(f64::INFINITY, f64::min) - self.wheel_radius;
        let mast = attitude * Vector3::z();
        let rim = self.body.radius * mast.xy().norm();
        let body = height(Vector3::z() * self.body.bottom).min(height(Vector3::z() * self.body.top)) - rim;
        if wheel < body { ("wheels", wheel) } else { ("body", body) }
    }

    /// Refuses a state whose bot reaches into the floor.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] naming the part and its height.
    pub fn require_above_floor(&self, state: &State) -> Result<()> {
        let (part, height) = self.lowest_point(&state.body_position, &state.body_quaternion);
        check(
            format_args!("height of the lowest point of the {part}"),
            height,
            "at least 0 m, the floor, within 1 mm",
            |h| h >= -MAX_FLOOR_OVERLAP,
        )?;
        Ok(())
    }
}
