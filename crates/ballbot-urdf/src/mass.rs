//! Mass, center of mass and inertia of rigid parts.

use super::checked::Checked;
use super::numbers::{finite, pose};
use nalgebra::{Isometry3, Matrix3, Point3};
use urdf_rs::Link;

/// A rigid part in the root frame.
#[derive(Clone, Debug)]
pub(super) struct RigidMass {
    /// Mass, kg, > 0.
    pub mass: f64,
    /// Center of mass, m.
    pub center: Point3<f64>,
    /// Inertia about the center of mass, along the root axes, kg·m².
    pub inertia: Matrix3<f64>,
}

impl RigidMass {
    /// The inertial element of a link with the frame `frame`; `None` for a link without mass.
    pub fn of_link(link: &Link, frame: &Isometry3<f64>) -> Checked<Option<Self>> {
        let name = &link.name;
        let mass = link.inertial.mass.value;
        let i = &link.inertial.inertia;
        let tensor = Matrix3::new(i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz);
        let what = format!("the inertial of link '{name}'");
        let origin = pose(&what, &link.inertial.origin)?;
        finite(&what, tensor.as_slice())?;
        if !mass.is_finite() || mass < 0.0 {
            return Err(format!("link '{name}': mass = {mass} kg is out of range: it must be a finite number >= 0"));
        }
        if mass == 0.0 {
            let massless = tensor == Matrix3::zeros();
            return if massless { Ok(None) } else { Err(format!("link '{name}' has an inertia but mass = 0 kg")) };
        }
        let at = frame * origin;
        let axes = at.rotation.to_rotation_matrix().into_inner();
        let inertia = axes * tensor * axes.transpose();
        Ok(Some(Self { mass, center: at.translation.vector.into(), inertia }))
    }

    /// Several parts as one rigid part; `None` without parts.
    pub fn combined(parts: &[Self]) -> Option<Self> {
        let mass: f64 = parts.iter().map(|p| p.mass).sum();
        let first = parts.first()?;
        // Relative to the first part, so that a distant root frame costs no precision.
        let offset = parts.iter().map(|p| (p.center - first.center) * p.mass).sum::<nalgebra::Vector3<f64>>() / mass;
        let center = first.center + offset;
        let inertia = parts
            .iter()
            .map(|p| {
                let d = p.center - center;
                p.inertia + (Matrix3::from_diagonal_element(d.norm_squared()) - d * d.transpose()) * p.mass
            })
            .sum();
        Some(Self { mass, center, inertia })
    }

    /// Rejects an inertia that is not positive definite; `what` names the part.
    pub fn check_inertia(&self, what: &str) -> Checked<()> {
        let j = &self.inertia;
        // Sylvester's criterion terminates for any numbers; an eigenvalue iteration may not.
        let minors = [j[(0, 0)], j.fixed_view::<2, 2>(0, 0).determinant(), j.determinant()];
        if minors.iter().all(|&m| m > 0.0) {
            return Ok(());
        }
        let [x, y, z] = [j[(0, 0)], j[(1, 1)], j[(2, 2)]];
        Err(format!("{what} has moments of inertia ({x}, {y}, {z}) kg m^2: the inertia must be positive definite"))
    }
}
