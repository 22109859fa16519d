//! Instruments of environments.

use super::{bare, drive, hills, made};
use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, TaskConfig};
use ballbot_core::perception::{DepthOptions, Instruments, LidarOptions, ScanOptions, instrument_kind};
use std::sync::Arc;

/// Noisy instruments with latency.
fn equipped() -> Box<dyn TaskConfig> {
    let mut config = bare(Some(&hills()));
    config.set("max_episode_steps", &[40.0]).unwrap();
    config.instruments_mut().set(Arc::new(ScanOptions {
        points: [5.0, 3.0],
        latency: 0.05,
        noise: 0.01,
        dropout: 0.2,
        drift: [0.01, 0.01],
        ..Default::default()
    }));
    config.instruments_mut().set(Arc::new(DepthOptions {
        size: [6.0, 4.0],
        rate: 20.0,
        latency: 0.02,
        noise: [0.001, 0.002],
        dropout: 0.1,
        freeze: 0.2,
        misalignment: 0.02,
        ..Default::default()
    }));
    config.instruments_mut().set(Arc::new(LidarOptions {
        beams: 10.0,
        rate: 20.0,
        latency: 0.03,
        noise: 0.005,
        dropout: 0.1,
        misalignment: 0.02,
        ..Default::default()
    }));
    config
}

#[test]
fn readings_do_not_depend_on_neighbors_or_threads_and_do_not_change_the_motion() {
    let mut many = made(&*equipped(), 21, 2);
    let mut few = made(&*equipped(), 3, 1);
    let mut blind = equipped();
    for name in ["scan", "depth", "lidar"] {
        blind.instruments_mut().remove(name);
    }
    let mut blind = made(&*blind, 3, 1);
    let rows = blind.batch.observation_len();
    let width = few.batch.observation_len();
    assert_eq!(width, rows + 15 + 24 + 10);
    for k in 0..150 {
        for i in 0..3 {
            let row = &few.observations[i * width..(i + 1) * width];
            assert_eq!(row, &many.observations[i * width..(i + 1) * width], "environment {i} at step {k}");
            assert_eq!(&row[..rows], &blind.observations[i * rows..(i + 1) * rows]);
        }
        drive(&mut many, k);
        drive(&mut few, k);
        drive(&mut blind, k);
    }
}

#[test]
fn snapshots_contain_pending_samples() {
    let mut run = made(&*equipped(), 2, 1);
    for k in 0..57 {
        drive(&mut run, k);
    }
    let saved = run.batch.save(0).unwrap();
    let width = run.batch.observation_len();
    let mut seen = Vec::new();
    for k in 57..130 {
        drive(&mut run, k);
        seen.push(run.observations[..width].to_vec());
    }
    let mut other = made(&*equipped(), 2, 1);
    other.batch.load(0, &saved).unwrap();
    for (k, expected) in (57..130).zip(&seen) {
        drive(&mut other, k);
        assert_eq!(&other.observations[..width], expected, "step {k}");
    }
    let mut without = equipped();
    without.instruments_mut().remove("scan");
    let error = made(&*without, 2, 1).batch.load(0, &saved).unwrap_err().to_string();
    assert!(error.contains("instruments"), "{error}");
}

#[test]
fn scaled_observations_have_multiples_of_typical_readings() {
    let mut config = equipped();
    config.set("scale_observations", &[1.0]).unwrap();
    let run = made(&*config, 1, 1);
    let [scan, depth, lidar] = ["scan", "depth", "lidar"].map(|name| run.batch.perceived(0, name).unwrap());
    let rows = run.batch.observation_len() - 49;
    for (scaled, height) in run.observations[rows..].iter().zip(scan) {
        assert!((scaled - height / 0.1).abs() < 1e-5);
    }
    for (scaled, depth) in run.observations[rows + 15..].iter().zip(depth) {
        assert!((scaled - depth / 3.0).abs() < 1e-6);
    }
    for (scaled, range) in run.observations[rows + 39..].iter().zip(lidar) {
        assert!((scaled - range / 5.0).abs() < 1e-6);
    }
}

#[test]
fn bad_options_are_named() {
    let bad = |instrument: &str, name: &str, values: &[f64]| {
        (instrument_kind(instrument).unwrap().make)(&[(name, values)]).unwrap_err().to_string()
    };
    let scan = |name: &str, values: &[f64]| bad("scan", name, values);
    let depth = |name: &str, values: &[f64]| bad("depth", name, values);
    let lidar = |name: &str, values: &[f64]| bad("lidar", name, values);
    for (error, words) in [
        (scan("points", &[2.5, 3.0]), "scan.points = 2.5"),
        (scan("points", &[0.0, 3.0]), "scan.points[0] = 0"),
        (scan("spacing", &[-1.0]), "scan.spacing = -1"),
        (scan("noise", &[f64::NAN]), "scan.noise = NaN"),
        (scan("dropout", &[1.5]), "scan.dropout = 1.5"),
        (scan("nose", &[1.0]), "unknown option of scan 'nose'"),
        (scan("points", &[3.0]), "scan.points has 1 values, expected 2"),
        (depth("far", &[0.04]), "depth.near = 0.05"),
        (depth("field_of_view", &[3.2]), "depth.field_of_view = 3.2"),
        (depth("size", &[300.0, 3.0]), "depth.size[0] = 300"),
        (lidar("beams", &[0.0]), "lidar.beams = 0"),
        (lidar("beams", &[7.5]), "lidar.beams = 7.5"),
        (lidar("field_of_view", &[6.3]), "lidar.field_of_view = 6.3"),
        (lidar("stabilized", &[0.5]), "lidar.stabilized = 0.5"),
        (lidar("max_range", &[0.02]), "lidar.min_range = 0.05"),
    ] {
        assert!(error.contains(words), "{error}");
    }
    let batch = |instruments| {
        let config = BalanceConfig { instruments, ..Default::default() };
        Batch::new(&config, 1, Autoreset::SameStep, None, 0).map(|_| ()).unwrap_err().to_string()
    };
    let late = ScanOptions { latency: 0.015, ..Default::default() };
    assert!(batch(Instruments::default().with(late)).contains("scan.latency / control_dt = 1.5"));
    let inside = DepthOptions { position: [0.05, 0.0, 0.05], ..Default::default() };
    assert!(batch(Instruments::default().with(inside)).contains("above ball_radius"));
    let inside = LidarOptions { position: [0.0, 0.0, 0.1], ..Default::default() };
    assert!(
        batch(Instruments::default().with(inside)).contains("distance of lidar.position from the ball's center = 0.1")
    );
    let run = made(&*bare(None), 1, 1);
    let missing = |name| run.batch.perceived(0, name).unwrap_err().to_string();
    assert!(missing("scan").contains("the robots have no scan"), "{}", missing("scan"));
    assert!(missing("scam").contains("did you mean 'scan'?"), "{}", missing("scam"));
}

#[test]
fn robots_that_have_left_the_simulation_read_nothing_new() {
    let mut config = equipped();
    config.set("fall_tilt", &[3.0]).unwrap();
    let mut run = made(&*config, 1, 1);
    for k in 0..200 {
        run.step(&[1.0, -1.0, if k % 2 == 0 { 1.0 } else { -1.0 }]).unwrap();
        assert!(run.observations.iter().all(|value| value.is_finite()), "step {k}");
    }
}

#[test]
fn the_order_of_readings_is_the_order_of_the_registry() {
    let forward = Instruments::default().with(ScanOptions::default()).with(DepthOptions::default());
    let backward = Instruments::default().with(DepthOptions::default()).with(ScanOptions::default());
    assert_eq!(forward, backward);
    assert_eq!(forward.iter().map(|one| one.name()).collect::<Vec<_>>(), ["scan", "depth"]);
    assert_eq!(forward.clone().with(ScanOptions::default()), forward, "one instrument of each kind");
    assert_ne!(forward.clone().with(ScanOptions { rate: 7.0, ..Default::default() }), forward);
}
