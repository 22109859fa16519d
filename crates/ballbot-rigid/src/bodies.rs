//! Mass properties of the body link and the wheel links.

use ballbot_base::collision_shape::wheel_centers;
use ballbot_base::error::{Error, Result};
use ballbot_base::kinematics::Omniwheels;
use ballbot_base::params::Params;
use ballbot_base::wheels::WHEELS;
use nalgebra::{Matrix3, Vector3};

/// The body without its wheels. Body and wheels together have the mass properties of the parameters.
pub struct BodyLink {
    /// Mass, kg.
    pub mass: f64,
    /// Center of mass in the body frame, m.
    pub com: Vector3<f64>,
    /// Inertia about the center of mass, body axes, kg·m².
    pub inertia: Matrix3<f64>,
}

/// Inertia of a wheel across its axle, kg·m², as a thin disc. It only shifts inertia between body and wheel links.
pub fn wheel_transverse_inertia(params: &Params) -> f64 {
    0.5 * params.wheel_inertia
}

impl BodyLink {
    /// Mass properties of the parameters minus the mass properties of the wheels and of a payload that moves.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] if the wheels have more inertia than the bot.
    pub fn new(params: &Params, wheels: &Omniwheels) -> Result<Self> {
        let bot = params.without_payloads();
        let whole_com = bot.body_com();
        let mass = bot.body_mass - WHEELS as f64 * params.wheel_mass;
        let centers = wheel_centers(params, wheels);
        let com = (whole_com * bot.body_mass - centers.iter().sum::<Vector3<f64>>() * params.wheel_mass) / mass;
        let mut inertia = bot.body_inertia_matrix() - steiner(mass, com - whole_com);
        let transverse = wheel_transverse_inertia(params);
        for (center, axle) in centers.iter().zip(wheels.axles.row_iter()) {
            // `body_inertia` excludes the inertia of the wheels about their axles.
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
