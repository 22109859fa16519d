//! One picture of 640 by 480: `cargo bench --bench render`.

use ballbot_core::render::{Camera, Picture, Renderer, Scene, Shape, srgb};
use ballbot_core::render::{Link, Paint, Part};
use ballbot_core::{Params, State};
use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{UnitQuaternion, Vector2, Vector3};
use std::f64::consts::TAU;
use std::time::Duration;

const SIZE: (usize, usize) = (640, 480);

/// A ball and a body of 20 000 triangles each in place of primitives.
fn meshes(params: &Params) -> Scene {
    let part = |link, height: f64, radius: f64, half_length: f64| Part {
        link,
        position: Vector3::new(0.0, 0.0, height),
        attitude: UnitQuaternion::identity(),
        shape: ellipsoid(100, 100, radius, half_length),
        paint: Paint::Plain(srgb(0x0b7285)),
    };
    let ball = part(Link::Ball, 0.0, params.ball_radius, params.ball_radius);
    Scene::new(params, vec![ball, part(Link::Body, 0.35, 0.13, 0.2)])
}

fn ellipsoid(rings: u32, sectors: u32, radius: f64, half_length: f64) -> Shape {
    let point = |i: u32, j: u32| {
        let (zenith, azimuth) = (0.5 * TAU * f64::from(i) / f64::from(rings), TAU * f64::from(j) / f64::from(sectors));
        let ring = radius * zenith.sin();
        Vector3::new(ring * azimuth.cos(), ring * azimuth.sin(), half_length * zenith.cos())
    };
    let points: Vec<_> = (0..=rings).flat_map(|i| (0..sectors).map(move |j| point(i, j))).collect();
    let index = |i: u32, j: u32| i * sectors + j % sectors;
    let quad = |i: u32, j: u32| [index(i, j), index(i + 1, j), index(i + 1, j + 1), index(i, j + 1)];
    let quads = (0..rings).flat_map(|i| (0..sectors).map(move |j| quad(i, j)));
    let triangles: Vec<_> = quads.flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    Shape::mesh(&points, &triangles).expect("the indices are within the points")
}

fn render(criterion: &mut Criterion) {
    let params = Params::paper();
    let state = State::tilted(&params, Vector2::new(0.05, 0.2), 0.3);
    let mut rgb = vec![0; 3 * SIZE.0 * SIZE.1];
    let mut group = criterion.benchmark_group("render");
    for (name, scene) in [("primitives", Scene::of(&params)), ("meshes", meshes(&params))] {
        for samples in [1, 4] {
            let camera = Camera::following(scene.height());
            let renderer = Renderer::new(scene.clone(), SIZE.0, SIZE.1, samples, camera).expect("a picture");
            group.bench_function(format!("{name}/{samples}"), |b| {
                b.iter(|| renderer.render(&state, &[], Picture { rgb: Some(&mut rgb), ..Picture::default() }));
            });
        }
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(3));
    targets = render
}
criterion_main!(benches);
