//! The ball: one massive link with a sphere around its centre of mass.

use super::shape::{Shape, spheres_and_cylinders};
use super::tree::Tree;
use super::{Checked, TOLERANCE};
use nalgebra::Matrix3;

/// What the ball's URDF says.
pub(super) struct Ball {
    /// kg.
    pub mass: f64,
    /// About any diameter, kg·m².
    pub inertia: f64,
    /// m.
    pub radius: f64,
}

impl Ball {
    /// Reads the URDF `text`.
    pub fn read(text: &str) -> Checked<Self> {
        let tree = Tree::read(text)?;
        let masses = tree.masses()?;
        let massive: Vec<usize> = (0..masses.len()).filter(|&i| masses[i].is_some()).collect();
        let [link] = massive[..] else {
            return Err(format!(
                "{} links have a mass, expected exactly one: the ball (is an <inertial> missing?)",
                massive.len()
            ));
        };
        let body = masses[link].clone().ok_or("the ball has no mass")?;
        let name = &tree.links[link].name;
        let shape = spheres_and_cylinders(&tree, &[link], |s| s.cylinder_axis.is_none())?
            .into_iter()
            .next()
            .ok_or_else(|| format!("link '{name}' has no collision or visual sphere: what is the ball's radius?"))?;
        let Shape { radius, centre, .. } = shape;
        let off_centre = (body.centre - centre).norm();
        if !(..=TOLERANCE).contains(&off_centre) {
            return Err(format!(
                "the centre of mass of '{name}' is {off_centre} m off the centre of its sphere: at most {TOLERANCE} m"
            ));
        }
        let inertia = body.inertia.trace() / 3.0;
        let uneven = (body.inertia - Matrix3::from_diagonal_element(inertia)).amax() / inertia;
        if !(..=TOLERANCE).contains(&uneven) {
            return Err(format!(
                "the inertia of '{name}' is not that of a ball: it differs from its mean moment {inertia} kg m^2 by \
                 {uneven} of it, at most {TOLERANCE}"
            ));
        }
        Ok(Self { mass: body.mass, inertia, radius })
    }
}
