//! Rays and triangle meshes. parry finds the same hits; its boxes divide for each ray, which took most of a picture.

use super::shape::Hit;
use nalgebra::Vector3;
use parry3d_f64::math::Vector;
use parry3d_f64::partitioning::{BvhNode, TraversalAction};
use parry3d_f64::query::details::local_ray_intersection_with_triangle;
use parry3d_f64::query::{Ray, RayIntersection};
use parry3d_f64::shape::TriMesh;

/// A ray with what the test of a box needs of it.
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

    /// Distance to a box, zero within it; infinite for a ray that misses it.
    #[inline(always)]
    fn enters(&self, node: &BvhNode) -> f64 {
        let (low, high, origin) = (node.mins(), node.maxs(), self.ray.origin);
        let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
        for i in 0..3 {
            // 0 · ∞ of a ray within a face is NaN, which these comparisons skip; `f64::min` and `max` take longer.
            let (a, b) = ((low[i] - origin[i]) * self.inverse[i], (high[i] - origin[i]) * self.inverse[i]);
            let (near, far) = if a < b { (a, b) } else { (b, a) };
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

/// First hit within `limit`; the normal is towards the origin of the ray.
pub(super) fn first(mesh: &TriMesh, origin: &Vector3<f64>, direction: &Vector3<f64>, limit: f64) -> Option<Hit> {
    let ray = MeshRay::new(origin, direction);
    let enters = |node: &BvhNode, best: f64| {
        let distance = ray.enters(node);
        if distance < best { distance } else { f64::MAX }
    };
    let (_, hit) = mesh.bvh().find_best(limit, enters, |index, _| ray.triangle(mesh, index))?;
    Some(Hit { distance: hit.time_of_impact, normal: Vector3::new(hit.normal.x, hit.normal.y, hit.normal.z) })
}

/// Whether anything is hit at all, which a shadow asks.
pub(super) fn any(mesh: &TriMesh, origin: &Vector3<f64>, direction: &Vector3<f64>) -> bool {
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

#[cfg(test)]
mod tests {
    use super::*;
    use parry3d_f64::query::RayCast;
    use parry3d_f64::shape::Cuboid;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// A box of triangles with its faces in planes of the axes, and as many triangles anywhere.
    fn meshes(rng: &mut ChaCha8Rng) -> [TriMesh; 2] {
        let (points, triangles) = Cuboid::new(Vector::new(0.3, 0.5, 0.4)).to_trimesh();
        let scattered: Vec<_> = (0..300).map(|_| random(rng)).collect();
        let indices = (0..100).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        [TriMesh::new(points, triangles).unwrap(), TriMesh::new(scattered, indices).unwrap()]
    }

    fn random(rng: &mut ChaCha8Rng) -> Vector {
        Vector::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0))
    }

    #[test]
    fn hits_are_those_of_parry() {
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        let mut hits = 0;
        for mesh in meshes(&mut rng) {
            for i in 0..6000 {
                let (origin, mut direction) = (random(&mut rng) * 1.5, random(&mut rng));
                if i % 3 == 0 {
                    // Parallel to two or four faces of the box.
                    direction.x = 0.0;
                    direction.y = if i % 2 == 0 { 0.0 } else { direction.y };
                }
                let limit = if i % 5 == 0 { 2.0 } else { f64::INFINITY };
                let expected = mesh.cast_local_ray_and_get_normal(&Ray::new(origin, direction), limit, false);
                let (origin, direction) =
                    (Vector3::new(origin.x, origin.y, origin.z), Vector3::new(direction.x, direction.y, direction.z));
                let found = first(&mesh, &origin, &direction, limit);
                assert_eq!(
                    found.map(|hit| hit.distance),
                    expected.map(|hit| hit.time_of_impact),
                    "{origin} {direction}"
                );
                hits += usize::from(found.is_some());
                if limit == f64::INFINITY {
                    let is_ahead = expected.is_some_and(|hit| hit.time_of_impact > 0.0);
                    assert_eq!(any(&mesh, &origin, &direction), is_ahead, "{origin} {direction}");
                }
            }
        }
        assert!(hits > 1000, "{hits}");
    }
}
