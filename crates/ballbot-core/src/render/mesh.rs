//! Rays and triangle meshes. parry finds the same hits; its boxes divide for each ray, which took most of a picture.

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
            // The sign of the direction, -0 included, tells the near face: NaN has no order.
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
pub(super) fn first(
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

    const HALF: [f64; 3] = [0.3, 0.5, 0.4];

    /// Points that fill a cube of half edge 1 evenly: multiples of the plastic number's powers (Roberts 2018, R3).
    struct Points(f64);

    impl Points {
        fn next(&mut self) -> Vector {
            self.0 += 1.0;
            let coordinate = |step: f64| 2.0 * (0.5 + self.0 * step).fract() - 1.0;
            Vector::new(coordinate(0.819_172_513), coordinate(0.671_043_606_7), coordinate(0.549_700_477_9))
        }
    }

    /// A box of triangles with its faces in planes of the axes, and as many triangles anywhere.
    fn meshes(points: &mut Points) -> [TriMesh; 2] {
        let (vertices, triangles) = Cuboid::new(Vector::from_array(HALF)).to_trimesh();
        let scattered: Vec<_> = (0..300).map(|_| points.next()).collect();
        let indices = (0..100).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        [TriMesh::new(vertices, triangles).unwrap(), TriMesh::new(scattered, indices).unwrap()]
    }

    fn assert_hits_are_those_of_parry(mesh: &TriMesh, origin: Vector, direction: Vector, limit: f64) -> bool {
        let expected = mesh.cast_local_ray_and_get_normal(&Ray::new(origin, direction), limit, false);
        let (origin, direction) = (Vector3::from(origin.to_array()), Vector3::from(direction.to_array()));
        let found = first(mesh, &origin, &direction, limit);
        let context = format!("{origin:?} {direction:?}");
        assert_eq!(found.map(|(distance, _)| distance), expected.map(|hit| hit.time_of_impact), "{context}");
        if limit == f64::INFINITY {
            let is_ahead = expected.is_some_and(|hit| hit.time_of_impact > 0.0);
            assert_eq!(any(mesh, &origin, &direction), is_ahead, "{context}");
        }
        found.is_some()
    }

    #[test]
    fn hits_are_those_of_parry() {
        let mut points = Points(0.0);
        let mut hits = 0;
        for mesh in meshes(&mut points) {
            for i in 0..6000 {
                let (origin, mut direction) = (points.next() * 1.5, points.next());
                if i % 3 == 0 {
                    // Parallel to two or four faces of the box.
                    direction.x = 0.0;
                    direction.y = if i % 2 == 0 { 0.0 } else { direction.y };
                }
                let limit = if i % 5 == 0 { 2.0 } else { f64::INFINITY };
                hits += usize::from(assert_hits_are_those_of_parry(&mesh, origin, direction, limit));
            }
        }
        assert!(hits > 1000, "{hits}");
    }

    #[test]
    fn rays_within_the_plane_of_a_face_hit() {
        let mesh = &meshes(&mut Points(0.0))[0];
        let mut hits = 0;
        for axis in 0..3 {
            for case in 0..8 {
                let sign = |bit: u32| if case >> bit & 1 == 0 { 1.0 } else { -1.0 };
                let (side, zero, along) = (sign(0), sign(1) * 0.0, sign(2));
                let mut origin = [0.1; 3];
                let mut direction = [zero; 3];
                (origin[axis], origin[(axis + 1) % 3]) = (side * HALF[axis], -2.0 * along);
                direction[(axis + 1) % 3] = along;
                let (origin, direction) = (Vector::from_array(origin), Vector::from_array(direction));
                hits += usize::from(assert_hits_are_those_of_parry(mesh, origin, direction, f64::INFINITY));
            }
        }
        assert!(hits > 0, "{hits}");
    }
}
