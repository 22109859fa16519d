//! Pictures: geometry against closed forms and against parry's own queries, and what must change when something moves.

use ballbot_core::render::{Arrow, Camera, Label, Link, Paint, Part, Picture, Renderer, Scene, Shape, srgb};
use ballbot_core::{Params, State, Wheels};
use nalgebra::{UnitQuaternion, Vector2, Vector3};
use parry3d_f64::math::Vector;
use parry3d_f64::query::Ray;
use parry3d_f64::shape::SharedShape;
use std::f64::consts::TAU;
use std::path::Path;

const WIDTH: usize = 160;
const HEIGHT: usize = 120;

struct Shot {
    rgb: Vec<u8>,
    depth: Vec<f32>,
    labels: Vec<u8>,
}

impl Shot {
    fn of(renderer: &Renderer, state: &State, arrows: &[Arrow]) -> Self {
        let (width, height) = renderer.size();
        let pixels = width * height;
        let mut shot = Self { rgb: vec![0; 3 * pixels], depth: vec![0.0; pixels], labels: vec![0; pixels] };
        let picture =
            Picture { rgb: Some(&mut shot.rgb), depth: Some(&mut shot.depth), labels: Some(&mut shot.labels) };
        renderer.render(state, arrows, picture).unwrap();
        shot
    }

    fn count(&self, label: Label) -> usize {
        self.labels.iter().filter(|&&l| l == label as u8).count()
    }

    /// Mean column of the pixels with a label.
    fn column(&self, label: Label) -> f64 {
        let columns = self.labels.iter().enumerate().filter(|(_, l)| **l == label as u8).map(|(i, _)| i % WIDTH);
        columns.sum::<usize>() as f64 / self.count(label) as f64
    }

    /// Pixels whose color differs from another picture, by label.
    fn changed(&self, other: &Self) -> Vec<u8> {
        let pairs = self.rgb.chunks(3).zip(other.rgb.chunks(3)).zip(&self.labels);
        pairs.filter(|((a, b), _)| a != b).map(|(_, label)| *label).collect()
    }
}

fn camera(azimuth: f64) -> Camera {
    Camera { azimuth, ..Camera::following(0.7) }
}

fn renderer(camera: Camera) -> Renderer {
    Renderer::new(Scene::of(&Params::paper()), WIDTH, HEIGHT, 1, camera).unwrap()
}

/// A scene of one part in the inertial frame.
fn lone(shape: Shape, position: Vector3<f64>, attitude: UnitQuaternion<f64>) -> Scene {
    let paint = Paint::Plain(srgb(0xffffff));
    Scene::new(&Params::paper(), vec![Part { link: Link::Inertial, position, attitude, shape, paint }])
}

#[test]
fn depth_is_the_distance_along_the_axis_to_floor_and_sphere() {
    let radius = 0.2;
    let at = Vector3::new(0.1, -0.2, 0.5);
    let scene = lone(Shape::Sphere { radius }, at, UnitQuaternion::identity());
    let looking = Camera { target: at, elevation: 0.5, follows: false, ..camera(0.7) };
    let renderer = Renderer::new(scene, WIDTH + 1, HEIGHT + 1, 1, looking).unwrap();
    let shot = Shot::of(&renderer, &State::upright(&Params::paper()), &[]);
    // With an odd number of pixels, the ray of the middle pixel is the axis.
    let center = shot.depth[(HEIGHT / 2) * (WIDTH + 1) + WIDTH / 2];
    assert!((f64::from(center) - (looking.distance - radius)).abs() < 1e-6, "{center}");
    // The sphere's outline is an ellipse of this area (a cone about the axis, seen head on, is a circle).
    let tan = radius / (looking.distance.powi(2) - radius * radius).sqrt();
    let pixel = 2.0 * (0.5 * looking.field_of_view).tan() / (HEIGHT + 1) as f64;
    let area = std::f64::consts::PI * (tan / pixel).powi(2);
    let found = shot.count(Label::Arrow) as f64;
    assert!((found / area - 1.0).abs() < 0.02, "{found} pixels, expected {area}");
    // The middle of the lowest row sees the floor at this depth.
    let below = 0.5 * looking.field_of_view;
    let slope = (below.tan() - 0.5 * pixel).atan();
    let height = at.z + looking.distance * looking.elevation.sin();
    let expected = height / (looking.elevation + slope).sin() * slope.cos();
    let floor = f64::from(shot.depth[HEIGHT * (WIDTH + 1) + WIDTH / 2]);
    assert!((floor - expected).abs() < 1e-5, "{floor}, expected {expected}");
}

#[test]
fn uneven_wheels_are_rendered_at_their_positions() {
    let even = Params::paper();
    let uneven = Params {
        wheel_azimuths: [0.3, TAU / 3.0, 2.0 * TAU / 3.0 - 0.2],
        wheel_zenith_offsets: [0.0, 0.15, -0.1],
        ..Params::paper()
    };
    uneven.validate().unwrap();
    let middle_of = |params: &Params, looking: Camera| {
        let renderer = Renderer::new(Scene::of(params), WIDTH, HEIGHT, 1, looking).unwrap();
        Shot::of(&renderer, &State::upright(params), &[])
    };
    for (i, label) in [Label::Wheel0, Label::Wheel1, Label::Wheel2].into_iter().enumerate() {
        let (zenith, azimuth) = (uneven.wheel_zenith + uneven.wheel_zenith_offsets[i], uneven.wheel_azimuths[i]);
        let reach = uneven.ball_radius + uneven.wheel_radius;
        let out = reach * zenith.sin();
        let target = Vector3::new(out * azimuth.cos(), out * azimuth.sin(), uneven.ball_radius + reach * zenith.cos());
        // Level and from outside, the wheel is symmetric about the middle of the picture.
        let looking = Camera { target, azimuth, elevation: 0.0, distance: 0.5, follows: false, ..camera(0.0) };
        let shot = middle_of(&uneven, looking);
        assert_eq!(shot.labels[HEIGHT / 2 * WIDTH + WIDTH / 2], label as u8, "wheel {i}");
        let column = shot.column(label) - 0.5 * (WIDTH - 1) as f64;
        assert!(column.abs() < 0.6, "wheel {i} is {column} pixels off");
        let elsewhere = middle_of(&even, looking).changed(&shot);
        assert!(elsewhere.len() > 100, "wheel {i} of the robot with evenly spaced wheels is at the same position");
    }
}

#[test]
fn ray_intersections_equal_parry() {
    let half = Vector3::new(0.1, 0.2, 0.15);
    let shapes = [
        (Shape::Sphere { radius: 0.2 }, SharedShape::ball(0.2)),
        (Shape::Cylinder { radius: 0.1, half_length: 0.2 }, SharedShape::cylinder(0.2, 0.1)),
        (Shape::Cone { radius: 0.15, half_length: 0.2 }, SharedShape::cone(0.2, 0.15)),
        (Shape::Cuboid { half_extents: half }, SharedShape::cuboid(half.x, half.y, half.z)),
    ];
    let attitude = UnitQuaternion::from_euler_angles(0.3, -0.5, 0.9);
    let at = Vector3::new(0.0, 0.0, 0.6);
    for (shape, theirs) in shapes {
        // Cylinders and cones of parry have the axis y.
        let round = matches!(shape, Shape::Cylinder { .. } | Shape::Cone { .. });
        let onto_y = UnitQuaternion::from_euler_angles(std::f64::consts::FRAC_PI_2 * f64::from(round), 0.0, 0.0);
        let looking = Camera { target: at, follows: false, elevation: 0.4, ..camera(0.3) };
        let renderer = Renderer::new(lone(shape.clone(), at, attitude), WIDTH, HEIGHT, 1, looking).unwrap();
        let shot = Shot::of(&renderer, &State::upright(&Params::paper()), &[]);
        let (mut met, mut missed) = (0, 0);
        for (row, column) in (0..HEIGHT).flat_map(|row| (0..WIDTH).map(move |column| (row, column))) {
            let (origin, direction) = ray(&looking, row, column);
            let into = |v: Vector3<f64>| {
                let v = (attitude * onto_y).inverse() * v;
                Vector::new(v.x, v.y, v.z)
            };
            let expected = theirs.cast_local_ray(&Ray::new(into(origin - at), into(direction)), 1e3, true);
            let index = row * WIDTH + column;
            let found = (shot.labels[index] == Label::Arrow as u8).then(|| f64::from(shot.depth[index]));
            match (found, expected) {
                (Some(found), Some(expected)) => {
                    met += 1;
                    assert!((found - expected).abs() < 2e-4, "{shape:?} at {row}, {column}: {found}, parry {expected}");
                }
                (None, None) => (),
                _ => missed += 1,
            }
        }
        assert!(met > 500, "{shape:?} is met by {met} rays");
        // Rounding may decide for a ray along an edge.
        assert!(missed <= 3, "{shape:?}: {missed} rays meet it here or there alone");
    }
}

/// The ray of a pixel's center, 1 deep, from the definition of the camera.
fn ray(camera: &Camera, row: usize, column: usize) -> (Vector3<f64>, Vector3<f64>) {
    let (sin, cos) = camera.elevation.sin_cos();
    let out = Vector3::new(cos * camera.azimuth.cos(), cos * camera.azimuth.sin(), sin);
    let right = Vector3::z().cross(&out).normalize();
    let up = out.cross(&right);
    let pixel = 2.0 * (0.5 * camera.field_of_view).tan() / HEIGHT as f64;
    let (x, y) = (column as f64 + 0.5 - 0.5 * WIDTH as f64, row as f64 + 0.5 - 0.5 * HEIGHT as f64);
    (camera.target + out * camera.distance, -out + right * (x * pixel) - up * (y * pixel))
}

#[test]
fn meshes_look_like_the_shapes_they_triangulate() {
    let half = Vector3::new(0.1, 0.2, 0.15);
    let corners: Vec<_> = (0..8)
        .map(|i| half.component_mul(&Vector3::from_fn(|k, _| if i >> k & 1 == 1 { 1.0 } else { -1.0 })))
        .collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles: Vec<_> = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    let mesh = Shape::mesh(&corners, &triangles).unwrap();
    let attitude = UnitQuaternion::from_euler_angles(0.4, 0.2, 0.1);
    let shot = |shape: Shape| {
        let scene = lone(shape, Vector3::new(0.0, 0.0, 0.4), attitude);
        Shot::of(&Renderer::new(scene, WIDTH, HEIGHT, 1, camera(0.2)).unwrap(), &State::upright(&Params::paper()), &[])
    };
    let (mesh, cuboid) = (shot(mesh), shot(Shape::Cuboid { half_extents: half }));
    let changed = mesh.changed(&cuboid).len();
    assert!(cuboid.count(Label::Arrow) > 500 && changed <= 5, "{changed} pixels differ");
    assert!(Shape::mesh(&corners, &[[0, 1, 8]]).unwrap_err().to_string().contains("index 8"));
    assert!(Shape::mesh(&corners, &[]).is_err());
}

#[test]
fn tilted_robots_lean_in_the_picture() {
    let params = Params::paper();
    // Seen from −y, x points to the right.
    let renderer = renderer(camera(-std::f64::consts::FRAC_PI_2));
    let columns = [-0.3, 0.0, 0.3].map(|tilt| {
        let shot = Shot::of(&renderer, &State::tilted(&params, Vector2::new(0.0, tilt), 0.0), &[]);
        (shot.column(Label::Body), shot.column(Label::Ball))
    });
    let [left, upright, right] = columns.map(|(body, ball)| body - ball);
    assert!(upright.abs() < 1.0, "{upright} columns apart");
    assert!(left < -8.0 && right > 8.0, "leans by {left} and {right} columns");
}

#[test]
fn rotated_parts_change_the_picture_locally() {
    let params = Params::paper();
    let renderer = renderer(camera(0.4));
    let still = State::upright(&params);
    let before = Shot::of(&renderer, &still, &[]);
    let wheel = State { wheel_angles: Wheels([0.8, 0.0, 0.0]), ..still };
    let changed = before.changed(&Shot::of(&renderer, &wheel, &[]));
    assert!(changed.len() > 20 && changed.iter().all(|l| *l == Label::Wheel0 as u8), "{changed:?}");
    let rolled = State { ball_quaternion: UnitQuaternion::from_euler_angles(0.5, 0.0, 0.0), ..State::upright(&params) };
    let changed = before.changed(&Shot::of(&renderer, &rolled, &[]));
    assert!(changed.len() > 100 && changed.iter().all(|l| *l == Label::Ball as u8), "{changed:?}");
}

#[test]
fn all_parts_and_arrows_are_visible_from_some_view() {
    let params = Params::paper();
    let mut seen = [0; 8];
    let arrow = Arrow { from: Vector3::new(0.4, 0.0, 0.4), to: Vector3::new(0.2, 0.0, 0.4), color: srgb(0xe03131) };
    for azimuth in [0.0, 2.0, 4.0] {
        let low = Camera { elevation: 0.1, ..camera(azimuth) };
        let shot = Shot::of(&renderer(low), &State::upright(&params), &[arrow]);
        for label in shot.labels {
            seen[usize::from(label)] += 1;
        }
    }
    assert!(seen.iter().all(|&count| count > 20), "{seen:?}");
}

#[test]
fn shadow_of_the_robot_falls_on_the_floor() {
    let params = Params::paper();
    let renderer = renderer(camera(0.4));
    let near = State::upright(&params);
    let mut lifted = near.clone();
    lifted.ball_position.z += 50.0;
    lifted.body_position.z += 50.0;
    let (with, without) = (Shot::of(&renderer, &near, &[]), Shot::of(&renderer, &lifted, &[]));
    let sum = |shot: &Shot, i: usize| shot.rgb[3 * i..3 * i + 3].iter().map(|&c| u32::from(c)).sum::<u32>();
    let floor = |i: &usize| [&with, &without].iter().all(|shot| shot.labels[*i] == Label::Floor as u8);
    let pixels: Vec<_> = (0..WIDTH * HEIGHT).filter(floor).collect();
    let darker = pixels.iter().filter(|&&i| sum(&with, i) + 60 < sum(&without, i)).count();
    let lighter = pixels.iter().filter(|&&i| sum(&with, i) > sum(&without, i)).count();
    assert!(darker > 200, "{darker} pixels in the shadow");
    assert_eq!(lighter, 0, "a robot gives no light");
}

#[test]
fn pictures_do_not_depend_on_threads() {
    let state = State::tilted(&Params::paper(), Vector2::new(0.1, 0.2), 0.4);
    let shot = |threads| Shot::of(&renderer(camera(0.4)).with_threads(threads).unwrap(), &state, &[]);
    let first = shot(1);
    for threads in [1, 2, 3] {
        let other = shot(threads);
        assert!(first.rgb == other.rgb && first.depth == other.depth && first.labels == other.labels);
    }
    assert!(renderer(camera(0.4)).with_threads(0).is_err());
}

#[test]
fn wide_pictures_show_parts_at_their_edges() {
    let radius = 0.3;
    for (at, fov) in [(Vector3::new(0.0, 0.9, 1.4), 2.6), (Vector3::new(0.2, -1.1, 0.6), 2.4)] {
        let scene = lone(Shape::Sphere { radius }, at, UnitQuaternion::identity());
        let wide = Camera {
            target: Vector3::new(0.0, 0.0, 1.0),
            distance: 0.8,
            azimuth: 0.0,
            elevation: 0.1,
            field_of_view: fov,
            follows: false,
        };
        let renderer = Renderer::new(scene, WIDTH, HEIGHT, 1, wide).unwrap();
        let shot = Shot::of(&renderer, &State::upright(&Params::paper()), &[]);
        let mut seen = 0;
        for (row, column) in (0..HEIGHT).flat_map(|row| (0..WIDTH).map(move |column| (row, column))) {
            let (origin, direction) = ray(&wide, row, column);
            let (to, length) = (at - origin, direction.norm());
            let along = to.dot(&direction) / length;
            let miss = (to.norm_squared() - along * along).sqrt() / radius;
            let label = shot.labels[row * WIDTH + column];
            if along > radius && miss < 0.999 {
                seen += 1;
                assert_eq!(label, Label::Arrow as u8, "row {row}, column {column} misses the sphere");
            }
        }
        assert!(seen > 100, "{seen} pixels see the sphere");
    }
}

#[test]
fn shadows_do_not_depend_on_order_and_number_of_parts() {
    let far = |i: usize| Arrow {
        from: Vector3::new(200.0, i as f64, 1.0),
        to: Vector3::new(200.0, i as f64, 1.1),
        color: srgb(0xe03131),
    };
    let near = Arrow { from: Vector3::new(0.5, 0.0, 0.5), to: Vector3::new(0.1, 0.6, 0.9), color: srgb(0xe03131) };
    let renderer = renderer(camera(0.4));
    let state = State::upright(&Params::paper());
    let after: Vec<_> = (0..200).map(far).chain([near]).collect();
    let before: Vec<_> = [near].into_iter().chain((0..200).map(far)).collect();
    let shots = [&[near][..], &after, &before].map(|arrows| Shot::of(&renderer, &state, arrows).rgb);
    assert!(shots[1] == shots[2], "the order of arrows changes the picture");
    assert!(shots[0] == shots[1], "arrows out of sight change the picture");
}

#[test]
fn shadow_of_a_rod_has_no_gap() {
    let rod = |radius| {
        let flat = UnitQuaternion::from_euler_angles(0.0, std::f64::consts::FRAC_PI_2, 0.0);
        lone(Shape::Cylinder { radius, half_length: 2.0 }, Vector3::new(0.0, 0.0, 0.6), flat)
    };
    let down = Camera {
        target: Vector3::zeros(),
        distance: 0.55,
        elevation: 1.57,
        azimuth: 0.0,
        field_of_view: 1.6,
        follows: false,
    };
    let state = State::upright(&Params::paper());
    let light = |radius: f64| {
        let renderer = Renderer::new(rod(radius), WIDTH, HEIGHT, 1, down).unwrap();
        Shot::of(&renderer, &state, &[]).rgb
    };
    let (with, without) = (light(0.01), light(1e-9));
    // Along a line across the shadow, light falls to a minimum and rises again: no lit strip within.
    let column = WIDTH / 2;
    for line in [column, column + 7] {
        let across_rows = |rgb: &[u8], row: usize| f64::from(rgb[3 * (row * WIDTH + line)]);
        let across_columns = |rgb: &[u8], c: usize| f64::from(rgb[3 * ((HEIGHT / 2) * WIDTH + c)]);
        let rows: Vec<f64> = (0..HEIGHT).map(|r| across_rows(&with, r) / across_rows(&without, r)).collect();
        let columns: Vec<f64> = (0..WIDTH).map(|c| across_columns(&with, c) / across_columns(&without, c)).collect();
        let spread = |v: &[f64]| v.iter().copied().fold(0.0, f64::max) - v.iter().copied().fold(1.0, f64::min);
        let profile = if spread(&rows) > spread(&columns) { rows } else { columns };
        let shaded: Vec<usize> = (0..profile.len()).filter(|&i| profile[i] < 0.99).collect();
        let gaps = (shaded[0]..=shaded[shaded.len() - 1]).filter(|&i| profile[i] > 0.995).count();
        assert!(shaded.len() > 3, "no shadow: {profile:?}");
        assert_eq!(gaps, 0, "{profile:?}");
    }
}

#[test]
fn more_samples_keep_areas_and_soften_edges() {
    let state = State::upright(&Params::paper());
    let shot = |samples| {
        let renderer = Renderer::new(Scene::of(&Params::paper()), WIDTH, HEIGHT, samples, camera(0.4)).unwrap();
        Shot::of(&renderer, &state, &[])
    };
    let (one, four) = (shot(1), shot(4));
    assert_eq!(one.labels, four.labels);
    let differing = one.changed(&four).len();
    assert!((200..WIDTH * HEIGHT / 2).contains(&differing), "{differing} pixels differ");
}

#[test]
fn shipped_urdfs_are_rendered() {
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets");
    let scene = Scene::from_urdf(&assets.join("bot.urdf"), &assets.join("ball.urdf")).unwrap();
    assert!((0.6..0.9).contains(&scene.height()), "{} m high", scene.height());
    let renderer = Renderer::new(scene, WIDTH, HEIGHT, 1, camera(0.4)).unwrap();
    let shot = Shot::of(&renderer, &State::upright(&Params::paper()), &[]);
    for label in [Label::Ball, Label::Body, Label::Wheel0, Label::Floor] {
        assert!(shot.count(label) > 30, "{label:?} is not seen");
    }
}

#[test]
#[cfg(unix)]
fn a_mesh_that_is_a_device_or_a_pipe_is_rejected() {
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets");
    let folder = std::env::temp_dir().join(format!("ballbot-mesh-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let pipe = folder.join("pipe.stl");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let text = std::fs::read_to_string(assets.join("bot.urdf")).unwrap();
    let bot = folder.join("bot.urdf");
    for mesh in [Path::new("/dev/zero"), &pipe] {
        let edited = text.replacen("meshes/body_plates.stl", mesh.to_str().unwrap(), 1);
        assert_ne!(edited, text);
        std::fs::write(&bot, edited).unwrap();
        let error = Scene::from_urdf(&bot, &assets.join("ball.urdf")).err().unwrap();
        assert_eq!(error.to_string(), format!("cannot read {}: not a regular file", mesh.display()));
    }
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn contents_that_are_not_stl_are_rejected() {
    let scale = Vector3::repeat(1.0);
    // A binary STL: 80 bytes of header, the number of triangles, and 50 bytes for each.
    let binary = |count: u32, corner: f32| {
        let mut contents = vec![0_u8; 80];
        contents.extend(count.to_le_bytes());
        let corners = [0.0, 0.0, 1.0, corner, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        contents.extend(corners.iter().flat_map(|x: &f32| x.to_le_bytes()));
        contents.extend([0, 0]);
        contents
    };
    assert!(matches!(Shape::stl(&binary(1, 0.0), &scale).unwrap(), Shape::Mesh(_)));
    for (contents, reason) in [
        (binary(u32::MAX, 0.0), "not a readable STL"),
        (binary(1, f32::NAN), "must be finite"),
        (binary(2, 0.0), "not a readable STL"),
        (binary(1, 0.0)[..133].to_vec(), "not a readable STL"),
        (binary(0, 0.0), "mesh"),
        (vec![], "not a readable STL"),
        (b"solid x\nfacet normal 0 0 1\n".to_vec(), "not a readable STL"),
    ] {
        let error = Shape::stl(&contents, &scale).unwrap_err().to_string();
        assert!(error.contains(reason), "{error}");
    }
}

#[test]
fn errors_of_invalid_arguments_name_them() {
    let scene = || Scene::of(&Params::paper());
    let rejected = |renderer: Result<Renderer, ballbot_core::Error>| renderer.err().unwrap().to_string();
    let ok = camera(0.0);
    assert!(rejected(Renderer::new(scene(), 0, 10, 1, ok)).contains("width"));
    assert!(rejected(Renderer::new(scene(), 10, 9000, 1, ok)).contains("height"));
    assert!(rejected(Renderer::new(scene(), 10, 10, 3, ok)).contains("samples"));
    assert!(rejected(Renderer::new(scene(), 10, 10, 1, Camera { distance: f64::NAN, ..ok })).contains("distance"));
    assert!(rejected(Renderer::new(scene(), 10, 10, 1, Camera { field_of_view: 4.0, ..ok })).contains("field of view"));
    let sunk = Camera { elevation: -0.5, ..ok };
    assert!(rejected(Renderer::new(scene(), 10, 10, 1, sunk)).contains("camera height"));
    let renderer = Renderer::new(scene(), 10, 10, 1, ok).unwrap();
    let state = State::upright(&Params::paper());
    let mut short = [0; 10];
    let picture = Picture { rgb: Some(&mut short), ..Picture::default() };
    assert!(renderer.render(&state, &[], picture).unwrap_err().to_string().contains("rgb"));
    let endless = Arrow { from: Vector3::zeros(), to: Vector3::x() * 1e200, color: srgb(0) };
    assert!(renderer.render(&state, &[endless], Picture::default()).unwrap_err().to_string().contains("arrow"));
    let lost = State { ball_position: Vector3::repeat(f64::NAN), ..state };
    assert!(renderer.render(&lost, &[], Picture::default()).is_err());
}
