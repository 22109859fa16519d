//! The height scan of one robot.

use super::{bare, begun, drive, hills, standing};
use ballbot_core::perception::ScanOptions;
use ballbot_core::terrain::Terrain;
use ballbot_core::{Params, State};
use std::sync::Arc;

/// The reading of a scan in a state, point by point from the terrain's height.
fn expected(state: &State, terrain: Option<&Terrain>, options: &ScanOptions) -> Vec<f32> {
    let yaw = 2.0 * state.body_quaternion.k.atan2(state.body_quaternion.w);
    let [nx, ny] = options.points;
    let mut out = Vec::new();
    for j in 0..ny as usize {
        for i in 0..nx as usize {
            let ahead = options.offset[0] + options.spacing * (i as f64 - 0.5 * (nx - 1.0));
            let lateral = options.offset[1] + options.spacing * (j as f64 - 0.5 * (ny - 1.0));
            let x = state.ball_position.x + yaw.cos() * ahead - yaw.sin() * lateral;
            let y = state.ball_position.y + yaw.sin() * ahead + yaw.cos() * lateral;
            let height = terrain.map_or(0.0, |terrain| terrain.height(x, y));
            out.push((state.ball_position.z - Params::paper().ball_radius - height) as f32);
        }
    }
    out
}

fn assert_close(read: &[f32], expected: &[f32]) {
    assert_eq!(read.len(), expected.len());
    for (i, (read, expected)) in read.iter().zip(expected).enumerate() {
        assert!((read - expected).abs() < 1e-6, "point {i}: {read} against {expected}");
    }
}

#[test]
fn scans_are_the_heights_at_the_points_of_the_grid() {
    let plane = Arc::new(Terrain::plane(0.15, 0.7).unwrap());
    let options =
        ScanOptions { points: [7.0, 4.0], spacing: 0.13, offset: [0.2, -0.05], rate: 0.0, ..Default::default() };
    for terrain in [None, Some(&plane), Some(&hills())] {
        for yaw in [0.0, 1.3, -2.6] {
            let mut config = bare(terrain);
            config.instruments_mut().set(Arc::new(options.clone()));
            let start = standing(terrain, [0.4, -0.7], yaw, [0.02, 0.05]);
            let mut run = begun(&*config, &start);
            for k in 0..30 {
                let state = run.batch.state(0).unwrap();
                let read = run.batch.perceived(0, "scan").unwrap().to_vec();
                assert_close(&read, &expected(&state, terrain.map(|terrain| &**terrain), &options));
                assert_eq!(run.observations[run.observations.len() - 28..], read);
                drive(&mut run, k);
            }
        }
    }
}

#[test]
fn level_ground_reads_zero_and_far_ground_the_bound() {
    let mut config = bare(None);
    config.instruments_mut().set(Arc::new(ScanOptions::default()));
    let run = begun(&*config, &standing(None, [3.0, 1.0], 0.4, [0.0; 2]));
    assert!(run.batch.perceived(0, "scan").unwrap().iter().all(|height| height.abs() < 1e-7));
    let steep = Arc::new(Terrain::plane(0.3, 0.0).unwrap());
    let mut config = bare(Some(&steep));
    config.instruments_mut().set(Arc::new(ScanOptions { points: [3.0, 1.0], spacing: 6.0, ..Default::default() }));
    let run = begun(&*config, &standing(Some(&steep), [0.0; 2], 0.0, [0.0; 2]));
    let [below, _, above] = run.batch.perceived(0, "scan").unwrap() else { panic!("three points") };
    assert_eq!([*below, *above], [1.0, -1.0]);
}

#[test]
fn scans_are_held_between_samples_and_delayed() {
    let terrain = hills();
    // A sample every 4 control steps, read 6 later.
    let options = ScanOptions { points: [3.0, 3.0], rate: 25.0, latency: 0.06, ..Default::default() };
    let mut config = bare(Some(&terrain));
    config.instruments_mut().set(Arc::new(options.clone()));
    let mut run = begun(&*config, &standing(Some(&terrain), [0.1, 0.2], 0.5, [0.02, 0.0]));
    let mut states = vec![run.batch.state(0).unwrap()];
    for k in 0..40_usize {
        let sample = k.saturating_sub(6) / 4 * 4;
        assert_close(run.batch.perceived(0, "scan").unwrap(), &expected(&states[sample], Some(&terrain), &options));
        run.step(&[0.0; 3]).unwrap();
        assert!(!run.terminated[0]);
        states.push(run.batch.state(0).unwrap());
    }
}

#[test]
fn errors_have_the_given_size() {
    let read = |options: ScanOptions| {
        let mut config = bare(None);
        config.instruments_mut().set(Arc::new(ScanOptions { points: [64.0, 64.0], rate: 0.0, ..options }));
        let mut run = begun(&*config, &standing(None, [0.0; 2], 0.0, [0.0; 2]));
        let first = run.batch.perceived(0, "scan").unwrap().to_vec();
        run.step(&[0.0; 3]).unwrap();
        (first, run.batch.perceived(0, "scan").unwrap().to_vec())
    };
    let deviation = |values: &[f32]| {
        let square: f64 = values.iter().map(|value| f64::from(*value).powi(2)).sum();
        (square / values.len() as f64).sqrt()
    };
    let (first, second) = read(ScanOptions { noise: 0.01, ..Default::default() });
    assert!((deviation(&first) - 0.01).abs() < 0.0005, "{}", deviation(&first));
    let differences: Vec<_> = first.iter().zip(&second).map(|(a, b)| a - b).collect();
    assert!((deviation(&differences) - 0.0141).abs() < 0.0007, "samples are independent");
    let (first, second) = read(ScanOptions { noise: 0.01, dropout: 0.3, ..Default::default() });
    assert!(first.iter().all(|value| *value != 0.0), "a first scan is whole");
    let kept = first.iter().zip(&second).filter(|(a, b)| a == b).count();
    assert!((kept as f64 / 4096.0 - 0.3).abs() < 0.03, "{kept}");
    let (first, second) = read(ScanOptions { drift: [0.0, 0.05], ..Default::default() });
    assert!(first[0] != 0.0 && first.iter().chain(&second).all(|value| (value - first[0]).abs() < 1e-6));
}

#[test]
fn a_drift_moves_the_grid() {
    let plane = Arc::new(Terrain::plane(0.2, 0.0).unwrap());
    let mut config = bare(Some(&plane));
    config.instruments_mut().set(Arc::new(ScanOptions {
        points: [1.0, 1.0],
        rate: 0.0,
        drift: [0.05, 0.0],
        ..Default::default()
    }));
    let run = super::made(&*config, 256, 1);
    let mut squares = 0.0;
    for i in 0..256 {
        let state = run.batch.state(i).unwrap();
        let exact = state.ball_position.z - Params::paper().ball_radius - plane.height(state.ball_position.x, 0.0);
        squares += ((f64::from(run.batch.perceived(i, "scan").unwrap()[0]) - exact) / 0.2_f64.tan()).powi(2);
    }
    assert!(((squares / 256.0).sqrt() - 0.05).abs() < 0.008, "{}", (squares / 256.0).sqrt());
}
