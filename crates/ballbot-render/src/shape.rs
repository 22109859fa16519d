//! Shapes and their intersections with rays.

use super::mesh;
use ballbot_base::error::{Error, Result};
use nalgebra::Vector3;
use parry3d_f64::math::Vector;
use parry3d_f64::shape::TriMesh;
use std::sync::Arc;

/// A shape about the origin of its frame. Axes of cylinders and cones are along z.
#[derive(Clone, Debug)]
pub enum Shape {
    /// A ball.
    Sphere {
        /// Radius, m.
        radius: f64,
    },
    /// A solid cylinder.
    Cylinder {
        /// Radius, m.
        radius: f64,
        /// Half of the length, m.
        half_length: f64,
    },
    /// A box.
    Cuboid {
        /// Half of each edge, m.
        half_extents: Vector3<f64>,
    },
    /// A cone, its tip at +`half_length`.
    Cone {
        /// Radius of the base, m.
        radius: f64,
        /// Half of the length, m.
        half_length: f64,
    },
    /// Triangles in a bounding-volume hierarchy.
    Mesh(Arc<TriMesh>),
}

/// Intersection of a ray and a shape, in the frame of the shape.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hit {
    /// Distance along the ray in lengths of its direction.
    pub distance: f64,
    /// Outward normal, unit length.
    pub normal: Vector3<f64>,
}

impl Shape {
    /// A mesh from its corners (m) and triangles of indices into them.
    ///
    /// # Errors
    /// [`Error::Decode`] for a mesh without triangles, an index out of range or a corner that is not finite.
    pub fn mesh(points: &[Vector3<f64>], triangles: &[[u32; 3]]) -> Result<Self> {
        let invalid = |reason: String| Error::Decode { what: "mesh".into(), reason };
        if let Some(point) = points.iter().find(|p| !p.iter().all(|x| x.is_finite())) {
            return Err(invalid(format!("a corner is {point:?}, must be finite")));
        }
        if let Some(index) = triangles.iter().flatten().find(|&&i| i as usize >= points.len()) {
            return Err(invalid(format!("index {index} is beyond the {} corners", points.len())));
        }
        let points = points.iter().map(|p| Vector::new(p.x, p.y, p.z)).collect();
        let mesh = TriMesh::new(points, triangles.to_vec()).map_err(|e| invalid(e.to_string()))?;
        Ok(Self::Mesh(Arc::new(mesh)))
    }

    /// Center and radius of a bounding sphere, m.
    pub(super) fn bounding_sphere(&self) -> (Vector3<f64>, f64) {
        match self {
            Self::Sphere { radius } => (Vector3::zeros(), *radius),
            Self::Cylinder { radius, half_length } | Self::Cone { radius, half_length } => {
                (Vector3::zeros(), radius.hypot(*half_length))
            }
            Self::Cuboid { half_extents } => (Vector3::zeros(), half_extents.norm()),
            Self::Mesh(mesh) => {
                let sphere = mesh.local_bounding_sphere();
                (Vector3::new(sphere.center.x, sphere.center.y, sphere.center.z), sphere.radius)
            }
        }
    }

    /// Center and half extents of a bounding box along the axes, m.
    pub(super) fn bounding_box(&self) -> (Vector3<f64>, Vector3<f64>) {
        match self {
            Self::Sphere { radius } => (Vector3::zeros(), Vector3::repeat(*radius)),
            Self::Cylinder { radius, half_length } | Self::Cone { radius, half_length } => {
                (Vector3::zeros(), Vector3::new(*radius, *radius, *half_length))
            }
            Self::Cuboid { half_extents } => (Vector3::zeros(), *half_extents),
            Self::Mesh(mesh) => {
                let (center, half) = (mesh.local_aabb().center(), mesh.local_aabb().half_extents());
                (Vector3::new(center.x, center.y, center.z), Vector3::new(half.x, half.y, half.z))
            }
        }
    }

    /// Radius of the largest inscribed sphere, m; for a mesh, of its bounding box.
    pub(super) fn inner_radius(&self) -> f64 {
        match self {
            Self::Sphere { radius } => *radius,
            Self::Cylinder { radius, half_length } => radius.min(*half_length),
            Self::Cuboid { half_extents } => half_extents.min(),
            Self::Cone { .. } => 0.0,
            Self::Mesh(mesh) => mesh.local_aabb().half_extents().min_element(),
        }
    }

    /// First hit within `limit` from an origin outside the shape.
    pub(super) fn cast(&self, origin: &Vector3<f64>, direction: &Vector3<f64>, limit: f64) -> Option<Hit> {
        let hit = match self {
            Self::Sphere { radius } => sphere(origin, direction, *radius),
            Self::Cylinder { radius, half_length } => cylinder(origin, direction, *radius, *half_length),
            Self::Cuboid { half_extents } => cuboid(origin, direction, half_extents),
            Self::Cone { radius, half_length } => cone(origin, direction, *radius, *half_length),
            Self::Mesh(mesh) => {
                mesh::first(mesh, origin, direction, limit).map(|(distance, normal)| Hit { distance, normal })
            }
        };
        hit.filter(|hit| hit.distance > 0.0 && hit.distance < limit)
    }

    /// Whether a ray from an origin outside the shape hits it.
    pub(super) fn hides(&self, origin: &Vector3<f64>, direction: &Vector3<f64>) -> bool {
        match self {
            Self::Mesh(mesh) => mesh::any(mesh, origin, direction),
            _ => self.cast(origin, direction, f64::INFINITY).is_some(),
        }
    }
}

/// Smaller root of a t² + 2 b t + c.
fn first_root(a: f64, b: f64, c: f64) -> Option<f64> {
    let discriminant = b * b - a * c;
    (discriminant >= 0.0).then(|| (-b - discriminant.sqrt()) / a)
}

fn sphere(origin: &Vector3<f64>, direction: &Vector3<f64>, radius: f64) -> Option<Hit> {
    let b = origin.dot(direction);
    let distance = first_root(direction.norm_squared(), b, origin.norm_squared() - radius * radius)?;
    Some(Hit { distance, normal: (origin + direction * distance) / radius })
}

fn cylinder(origin: &Vector3<f64>, direction: &Vector3<f64>, radius: f64, half_length: f64) -> Option<Hit> {
    let (o, d) = (origin.xy(), direction.xy());
    let side = first_root(d.norm_squared(), o.dot(&d), o.norm_squared() - radius * radius);
    if let Some(distance) = side.filter(|t| t.is_finite()) {
        let at = origin + direction * distance;
        if at.z.abs() <= half_length {
            return Some(Hit { distance, normal: Vector3::new(at.x, at.y, 0.0) / radius });
        }
    }
    cap(origin, direction, radius, -direction.z.signum() * half_length)
}

/// Hit of the disc of `radius` at height `z`, with the normal towards the origin of the ray.
fn cap(origin: &Vector3<f64>, direction: &Vector3<f64>, radius: f64, z: f64) -> Option<Hit> {
    let distance = (z - origin.z) / direction.z;
    let at = origin + direction * distance;
    (distance.is_finite() && at.xy().norm_squared() <= radius * radius)
        .then(|| Hit { distance, normal: Vector3::new(0.0, 0.0, -direction.z.signum()) })
}

fn cone(origin: &Vector3<f64>, direction: &Vector3<f64>, radius: f64, half_length: f64) -> Option<Hit> {
    let slope = radius / (2.0 * half_length);
    // x² + y² = slope² (half_length − z)²
    let height = half_length - origin.z;
    let (o, d) = (origin.xy(), direction.xy());
    let a = d.norm_squared() - (slope * direction.z).powi(2);
    let b = o.dot(&d) + slope * slope * height * direction.z;
    let c = o.norm_squared() - (slope * height).powi(2);
    let discriminant = b * b - a * c;
    let roots = if discriminant >= 0.0 {
        let root = discriminant.sqrt();
        [(-b - root) / a, (-b + root) / a]
    } else {
        [f64::NAN; 2]
    };
    let side = roots
        .into_iter()
        .filter(|t| t.is_finite() && *t > 0.0 && (origin.z + t * direction.z).abs() <= half_length)
        .fold(f64::INFINITY, f64::min);
    let side = side.is_finite().then(|| {
        let at = origin + direction * side;
        let normal = Vector3::new(at.x, at.y, slope * slope * (half_length - at.z)).normalize();
        Hit { distance: side, normal }
    });
    let base = (direction.z > 0.0).then(|| cap(origin, direction, radius, -half_length)).flatten();
    [side, base].into_iter().flatten().min_by(|a, b| a.distance.total_cmp(&b.distance))
}

fn cuboid(origin: &Vector3<f64>, direction: &Vector3<f64>, half: &Vector3<f64>) -> Option<Hit> {
    let (mut enter, mut leave, mut axis) = (f64::NEG_INFINITY, f64::INFINITY, 0);
    for i in 0..3 {
        if direction[i] == 0.0 {
            if origin[i].abs() > half[i] {
                return None;
            }
            continue;
        }
        let near = (-half[i] * direction[i].signum() - origin[i]) / direction[i];
        let far = (half[i] * direction[i].signum() - origin[i]) / direction[i];
        if near > enter {
            (enter, axis) = (near, i);
        }
        leave = leave.min(far);
    }
    (enter <= leave).then(|| {
        let mut normal = Vector3::zeros();
        normal[axis] = -direction[axis].signum();
        Hit { distance: enter, normal }
    })
}
