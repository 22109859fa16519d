//! Spheres and cylinders of links, which define the radii of ball and wheels.

use super::checked::Checked;
use super::numbers::{finite, pose};
use super::tree::Tree;
use nalgebra::{Point3, Vector3};
use urdf_rs::{Geometry, Link, Pose};

/// A sphere or a cylinder in the root frame.
#[derive(Clone, Debug)]
pub(super) struct Shape {
    /// Radius, m, > 0.
    pub radius: f64,
    /// Center, m.
    pub center: Point3<f64>,
    /// Unit vector along the axis of a cylinder; `None` for a sphere.
    pub cylinder_axis: Option<Vector3<f64>>,
}

/// Spheres and cylinders of `links` that satisfy `accept`: collision shapes if there are any, else visual shapes.
pub(super) fn spheres_and_cylinders(
    tree: &Tree,
    links: &[usize],
    accept: impl Fn(&Shape) -> bool,
) -> Checked<Vec<Shape>> {
    let collisions = |link: &Link| link.collision.iter().map(|c| (c.origin.clone(), c.geometry.clone())).collect();
    let visuals = |link: &Link| link.visual.iter().map(|v| (v.origin.clone(), v.geometry.clone())).collect();
    let collected = collect(tree, links, &accept, collisions)?;
    if collected.is_empty() { collect(tree, links, &accept, visuals) } else { Ok(collected) }
}

fn collect(
    tree: &Tree,
    links: &[usize],
    accept: impl Fn(&Shape) -> bool,
    elements: impl Fn(&Link) -> Vec<(Pose, Geometry)>,
) -> Checked<Vec<Shape>> {
    let mut shapes = Vec::new();
    for &link in links {
        for (origin, geometry) in elements(&tree.links[link]) {
            if let Some(shape) = read(tree, link, &origin, &geometry)?.filter(&accept) {
                shapes.push(shape);
            }
        }
    }
    Ok(shapes)
}

fn read(tree: &Tree, link: usize, origin: &Pose, geometry: &Geometry) -> Checked<Option<Shape>> {
    let (radius, is_cylinder) = match geometry {
        Geometry::Sphere { radius } => (*radius, false),
        Geometry::Cylinder { radius, .. } => (*radius, true),
        _ => return Ok(None),
    };
    let what = format!("a shape of link '{}'", tree.links[link].name);
    finite(&what, &[radius])?;
    if radius <= 0.0 {
        return Err(format!("{what}: radius = {radius} m is out of range: it must be > 0"));
    }
    let at = tree.poses[link] * pose(&what, origin)?;
    let cylinder_axis = is_cylinder.then(|| at.rotation * Vector3::z());
    Ok(Some(Shape { radius, center: at.translation.vector.into(), cylinder_axis }))
}
