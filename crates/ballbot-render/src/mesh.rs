//! Rays and triangle meshes. parry finds the same hits, but its box test divides for each ray, which took most of the
//! rendering time.

use nalgebra::Vector3;
use parry3d_f64::math::Vector;
use parry3d_f64::partitioning::{BvhNode, TraversalAction};
use parry3d_f64::query::details::local_ray_intersection_with_triangle;
use parry3d_f64::query::{Ray, RayIntersection};
use parry3d_f64::shape::TriMesh;

/// A ray, prepared for box tests.
struct MeshRay {
    ray: Ray,
    inverse: [f64; 3],
}

impl MeshRay {
    fn new(origin: &Vector3<f64>, direction: &Vector3<f64>) -> Self {
        let vector = |v: &Vector3<f64>| Vector::new(v.x, v.y, v.z);
        let inverse = [1.0 / direction.x, 1.0 / direction.y, 1.0 / direction.z];
        Self { ray: Ray::new(vector(origin), vector(direction)), inverse }
    }

    /// Distance to a box, zero inside; infinite for a ray that misses it.
    #[inline(always)]
    fn enters(&self, node: &BvhNode) -> f64 {
        let (low, high, origin) = (node.mins(), node.maxs(), self.ray.origin);
        let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
        for i in 0..3 {
            // For a ray within a face, 0 · ∞ is NaN, which these comparisons skip; `f64::min` and `max` take longer.
            // The sign of the direction, including -0, gives the near face: NaN has no order.
            let (a, b) = ((low[i] - origin[i]) * self.inverse[i], (high[i] - origin[i]) * self.inverse[i]);
            let (near, far) = if self.inverse[i] > 0.0 { (a, b) } else { (b, a) };
            enter = if near > enter { near } else { enter };
            leave = if far < leave { far } else { leave };
        }
        if enter <= leave { enter } else { f64::INFINITY }
    }

    #[inline]
    fn triangle(&self, mesh: &TriMesh, index: u32) -> Option<RayIntersection> {
        let triangle = mesh.triangle(index);
        local_ray_intersection_with_triangle(triangle.a, triangle.b, triangle.c, &self.ray).map(|(hit, _)| hit)
    }
}

/// Distance and normal of the first hit within `limit`; the normal is towards the origin of the ray.
pub fn first(
    mesh: &TriMesh,
    origin: &Vector3<f64>,
    direction: &Vector3<f64>,
    limit: f64,
) -> Option<(f64, Vector3<f64>)> {
    let ray = MeshRay::new(origin, direction);
    let enters = |node: &BvhNode, best: f64| {
        let distance = ray.enters(node);
        if distance < best { distance } else { f64::MAX }
    };
    let (_, hit) = mesh.bvh().find_best(limit, enters, |index, _| ray.triangle(mesh, index))?;
    Some((hit.time_of_impact, Vector3::new(hit.normal.x, hit.normal.y, hit.normal.z)))
}

/// Whether anything is hit at all, for shadows.
pub fn any(mesh: &TriMesh, origin: &Vector3<f64>, direction: &Vector3<f64>) -> bool {
    let ray = MeshRay::new(origin, direction);
    let mut found = false;
    mesh.bvh().traverse(|node| {
        if ray.enters(node) == f64::INFINITY {
            return TraversalAction::Prune;
        }
        if let Some(index) = node.leaf_data()
            && ray.triangle(mesh, index).is_some_and(|hit| hit.time_of_impact > 0.0)
        {
            found = true;
            return TraversalAction::EarlyExit;
        }
        TraversalAction::Continue
    });
    found
}
