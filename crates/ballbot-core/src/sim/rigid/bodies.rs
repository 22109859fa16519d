//! How the robot's mass is split between body and wheels, and the shape of its body.

use crate::error::{Error, Result};
use crate::kinematics::Omniwheels;
use crate::params::Params;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// The body without its wheels, such that body and wheels together have the mass properties of the parameters.
pub struct BodyLink {
    /// kg.
    pub mass: f64,
    /// Centre of mass in the body frame, m.
    pub com: Vector3<f64>,
    /// About the centre of mass, body axes, kg·m².
    pub inertia: Matrix3<f64>,
}

/// Wheel centres in the body frame, m.
pub fn wheel_centers(params: &Params, wheels: &Omniwheels) -> [Vector3<f64>; 3] {
    wheels.contact_directions.map(|p| p * (params.ball_radius + params.wheel_radius))
}

/// Inertia of a wheel across its axle, of a thin disc, kg·m². It only moves inertia between body and wheel links.
pub fn wheel_transverse_inertia(params: &Params) -> f64 {
    0.5 * params.wheel_inertia
}

impl BodyLink {
    /// What the parameters leave once the wheels are taken away.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] if the wheels have more inertia than the whole.
    pub fn new(params: &Params, wheels: &Omniwheels) -> Result<Self> {
        let whole_com = Vector3::z() * params.body_com_height;
        let mass = params.body_mass - 3.0 * params.wheel_mass;
        let centers = wheel_centers(params, wheels);
        let com = (whole_com * params.body_mass - centers.iter().sum::<Vector3<f64>>() * params.wheel_mass) / mass;
        let mut inertia = params.body_inertia_matrix() - steiner(mass, com - whole_com);
        let transverse = wheel_transverse_inertia(params);
        for (center, axle) in centers.iter().zip(wheels.u.row_iter()) {
            // The wheel's inertia about its own axle is not part of the parameters' body inertia.
            inertia -= (Matrix3::identity() - axle.transpose() * axle) * transverse;
            inertia -= steiner(params.wheel_mass, center - whole_com);
        }
        let smallest = inertia.symmetric_eigenvalues().min();
        if smallest <= 0.0 {
            return Err(Error::Inconsistent(format!(
                "three wheels of wheel_mass = {} kg leave the body a moment of inertia of {smallest} kg·m²; it must be > 0",
                params.wheel_mass
            )));
        }
        Ok(Self { mass, com, inertia })
    }
}

/// Inertia of a point mass at an offset.
fn steiner(mass: f64, offset: Vector3<f64>) -> Matrix3<f64> {
    (Matrix3::identity() * offset.norm_squared() - offset * offset.transpose()) * mass
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
    /// As wide as the circle of the wheel centres, from just above the ball to the height that the body's radius of
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
pub struct Outline {
    pub body: BodyShape,
    wheel_centers: [Vector3<f64>; 3],
    wheel_radius: f64,
}

impl Outline {
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
}
