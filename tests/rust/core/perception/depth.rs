//! The depth camera of one robot.

use super::{bare, begun, drive, hills, standing};
use ballbot_core::perception::DepthOptions;
use ballbot_core::terrain::Terrain;
use ballbot_core::{Params, State};
use nalgebra::Vector3;
use std::sync::Arc;

/// Eye and rays of a picture, rows from the top, by trigonometry.
fn rays(state: &State, options: &DepthOptions) -> (Vector3<f64>, Vec<Vector3<f64>>) {
    let [columns, rows] = options.size;
    let half = (0.5 * options.field_of_view).tan();
    let eye = state.ball_position + state.body_quaternion * Vector3::from(options.position);
    let mut out = Vec::new();
    for row in 0..rows as usize {
        for column in 0..columns as usize {
            let up = half * (1.0 - 2.0 * (row as f64 + 0.5) / rows);
            let right = half * columns / rows * (2.0 * (column as f64 + 0.5) / columns - 1.0);
            // Camera coordinates: x forward, y left, z up; then pitch down about y, then yaw about z.
            let (x, y, z) = (1.0, -right, up);
            let (sin, cos) = options.pitch.sin_cos();
            let (x, z) = (cos * x + sin * z, cos * z - sin * x);
            let (sin, cos) = options.yaw.sin_cos();
            out.push(state.body_quaternion * Vector3::new(cos * x - sin * y, sin * x + cos * y, z));
        }
    }
    (eye, out)
}

/// Parameter of a ray at which it enters the ball.
fn to_ball(eye: &Vector3<f64>, ray: &Vector3<f64>, state: &State) -> f64 {
    let from = eye - state.ball_position;
    let (a, b) = (ray.norm_squared(), from.dot(ray));
    let c = from.norm_squared() - Params::paper().ball_radius.powi(2);
    let root = b * b - a * c;
    let share = (-b - root.max(0.0).sqrt()) / a;
    if root >= 0.0 && share > 0.0 { share } else { f64::INFINITY }
}

/// Parameter of a ray at which it first is below the ground, by small steps and bisection.
fn to_ground(eye: &Vector3<f64>, ray: &Vector3<f64>, terrain: &Terrain, far: f64) -> f64 {
    let above = |share: f64| {
        let at = eye + ray * share;
        at.z - terrain.height(at.x, at.y)
    };
    let step = 1e-3;
    let mut share = 0.0;
    while above(share + step) > 0.0 {
        share += step;
        if share > far {
            return far;
        }
    }
    let (mut low, mut high) = (share, share + step);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if above(middle) > 0.0 { low = middle } else { high = middle }
    }
    low
}

#[test]
fn images_match_planes_and_the_ball() {
    let options = DepthOptions {
        size: [24.0, 18.0],
        pitch: 0.9,
        yaw: 0.4,
        position: [0.05, 0.02, 0.35],
        field_of_view: 1.6,
        rate: 0.0,
        ..Default::default()
    };
    for slope in [0.0, 0.2] {
        let plane = Arc::new(Terrain::plane(slope, 2.1).unwrap());
        let terrain = (slope > 0.0).then_some(&plane);
        let mut config = bare(terrain);
        config.instruments_mut().set(Arc::new(options.clone()));
        let mut run = begun(&*config, &standing(terrain, [0.3, 0.1], -0.8, [0.04, -0.03]));
        let (mut of_ball, mut of_sky) = (0, 0);
        for k in 0..20 {
            let state = run.batch.state(0).unwrap();
            let (eye, rays) = rays(&state, &options);
            for (pixel, (ray, read)) in rays.iter().zip(run.batch.perceived(0, "depth").unwrap()).enumerate() {
                let normal = plane.normal(0.0, 0.0);
                let closing = -normal.dot(ray);
                let ground = if closing > 0.0 { normal.dot(&eye) / closing } else { f64::INFINITY };
                let ball = to_ball(&eye, ray, &state);
                of_ball += usize::from(ball < ground);
                of_sky += usize::from(ball.min(ground) > options.far);
                let expected = ball.min(ground).clamp(options.near, options.far);
                assert!((f64::from(*read) - expected).abs() < 2e-6 * expected, "pixel {pixel}: {read}, {expected}");
            }
            drive(&mut run, k);
        }
        assert!(of_ball > 100 && of_sky > 100, "{of_ball} pixels of the ball, {of_sky} of the sky");
    }
}

#[test]
fn images_of_hills_match_small_steps_along_each_ray() {
    let terrain = hills();
    let options = DepthOptions { size: [20.0, 15.0], pitch: 0.35, field_of_view: 1.2, rate: 0.0, ..Default::default() };
    let mut config = bare(Some(&terrain));
    config.instruments_mut().set(Arc::new(options.clone()));
    for (place, yaw) in [([0.0, 0.0], 0.3), ([1.2, -1.5], 2.0), ([-2.5, 2.2], -2.4)] {
        let run = begun(&*config, &standing(Some(&terrain), place, yaw, [0.03, 0.1]));
        let state = run.batch.state(0).unwrap();
        let (eye, rays) = rays(&state, &options);
        let edges = terrain.half_size();
        for (pixel, (ray, read)) in rays.iter().zip(run.batch.perceived(0, "depth").unwrap()).enumerate() {
            let ground = to_ground(&eye, ray, &terrain, options.far);
            let at = eye + ray * ground;
            if at.x.abs() > edges[0] || at.y.abs() > edges[1] {
                continue;
            }
            let expected = ground.min(to_ball(&eye, ray, &state)).clamp(options.near, options.far);
            assert!((f64::from(*read) - expected).abs() < 2e-5, "pixel {pixel}: {read}, {expected}");
        }
    }
}

#[test]
fn errors_of_images_are_the_requested_errors() {
    let read = |options: DepthOptions| {
        let mut config = bare(None);
        config.instruments_mut().set(Arc::new(DepthOptions { size: [64.0, 48.0], rate: 0.0, far: 2.0, ..options }));
        let mut run = begun(&*config, &standing(None, [0.0; 2], 0.0, [0.0; 2]));
        let first = run.batch.perceived(0, "depth").unwrap().to_vec();
        run.step(&[0.0; 3]).unwrap();
        (first, run.batch.perceived(0, "depth").unwrap().to_vec())
    };
    let (exact, still) = read(DepthOptions::default());
    assert!(exact.iter().zip(&still).all(|(a, b)| (a - b).abs() < 1e-3));
    let (holed, _) = read(DepthOptions { dropout: 0.1, ..Default::default() });
    let holes = exact.iter().zip(&holed).filter(|(a, b)| a != b).count();
    assert!(holed.iter().zip(&exact).all(|(b, a)| a == b || *b == 2.0));
    assert!((holes as f64 / 3072.0 - 0.1).abs() < 0.03, "{holes}");
    let (noisy, _) = read(DepthOptions { noise: [0.001, 0.002], ..Default::default() });
    let (mut squares, mut count) = (0.0, 0.0);
    for (exact, noisy) in exact.iter().zip(&noisy).filter(|(exact, _)| **exact < 1.9) {
        let deviation = 0.001 + 0.002 * f64::from(exact * exact);
        squares += (f64::from(noisy - exact) / deviation).powi(2);
        count += 1.0;
    }
    assert!((squares / count - 1.0_f64).abs() < 0.1, "{}", squares / count);
    assert!(noisy.iter().zip(&exact).all(|(noisy, exact)| *exact < 2.0 || *noisy == 2.0), "the sky has no noise");
    let (first, second) = read(DepthOptions { noise: [0.01, 0.0], freeze: 1.0, ..Default::default() });
    assert_eq!(first, second);
    let (turned, _) = read(DepthOptions { misalignment: 0.05, ..Default::default() });
    assert!(turned.iter().zip(&exact).any(|(a, b)| (a - b).abs() > 0.01));
}
