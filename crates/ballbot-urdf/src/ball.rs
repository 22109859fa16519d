//! The ball of a URDF: one link with mass, with a sphere around its center of mass.

use super::checked::{Checked, TOLERANCE};
use super::shape::{Shape, spheres_and_cylinders};
use super::tree::Tree;
use nalgebra::Matrix3;

/// Parameters of the ball.
pub(super) struct Ball {
    /// Mass, kg.
    pub mass: f64,
    /// Moment of inertia about any diameter, kg·m².
    pub inertia: f64,
    /// Radius, m.
    pub radius: f64,
}

impl Ball {
    /// Reads the URDF `text`.
    pub fn read(text: &str) -> Checked<Self> {
        let tree = Tree::read(text)?;
        let massive: Vec<_> = tree.links.iter().zip(tree.masses()?).filter_map(|(l, m)| Some((l, m?))).collect();
        let [(link, body)] = &massive[..] else {
            return Err(format!(
                "{} links have a mass, expected exactly one: the ball (is an <inertial> missing?)",
                massive.len()
            ));
        };
        let name = &link.name;
        let links: Vec<usize> = (0..tree.links.len()).collect();
        let shape = spheres_and_cylinders(&tree, &links, |s| s.cylinder_axis.is_none())?
            .into_iter()
            .next()
            .ok_or_else(|| format!("'{name}' has no collision or visual sphere, which gives the ball's radius"))?;
        let Shape { radius, center, .. } = shape;
        let off_center = (body.center - center).norm();
        if !(..=TOLERANCE).contains(&off_center) {
            return Err(format!(
                "the center of mass of '{name}' is {off_center:.3e} m off the center of its sphere: \
                 at most {TOLERANCE:e} m"
            ));
        }
        let inertia = body.inertia.trace() / 3.0;
        let uneven = (body.inertia - Matrix3::from_diagonal_element(inertia)).amax() / inertia;
        if !(..=TOLERANCE).contains(&uneven) {
            return Err(format!(
                "the inertia of '{name}' is not the inertia of a ball: it differs from its mean moment {inertia} kg m^2 by \
                 {uneven:.3e} of it, at most {TOLERANCE:e}"
            ));
        }
        Ok(Self { mass: body.mass, inertia, radius })
    }
}
