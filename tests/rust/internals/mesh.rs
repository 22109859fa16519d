//! Rays hit meshes where parry's do.

use ballbot_render::mesh::{any, first};
use nalgebra::Vector3;
use parry3d_f64::math::Vector;
use parry3d_f64::query::{Ray, RayCast};
use parry3d_f64::shape::{Cuboid, TriMesh};

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

/// A box of triangles with axis-aligned faces, and as many triangles anywhere.
fn meshes(points: &mut Points) -> [TriMesh; 2] {
    let (vertices, triangles) = Cuboid::new(Vector::from_array(HALF)).to_trimesh();
    let scattered: Vec<_> = (0..300).map(|_| points.next()).collect();
    let indices = (0..100).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    [TriMesh::new(vertices, triangles).unwrap(), TriMesh::new(scattered, indices).unwrap()]
}

fn assert_hits_match_parry(mesh: &TriMesh, origin: Vector, direction: Vector, limit: f64) -> bool {
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
fn hits_match_parry() {
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
            hits += usize::from(assert_hits_match_parry(&mesh, origin, direction, limit));
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
            hits += usize::from(assert_hits_match_parry(mesh, origin, direction, f64::INFINITY));
        }
    }
    assert!(hits > 0, "{hits}");
}
