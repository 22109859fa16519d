//! The lidar of one robot.

use super::{bare, begun, drive, hills, made, standing};
use crate::run::Run;
use ballbot_core::perception::LidarOptions;
use ballbot_core::terrain::Terrain;
use ballbot_core::{Params, State};
use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

fn lidar(terrain: Option<&Arc<Terrain>>, options: &LidarOptions, start: &State) -> Run {
    let mut config = bare(terrain);
    config.instruments_mut().set(Arc::new(options.clone()));
    begun(&*config, start)
}

fn ranges(run: &Run) -> &[f32] {
    run.batch.perceived(0, "lidar").unwrap()
}

/// Origin and unit vectors of the beams in a state, by rotations about axes of the body.
fn beams(state: &State, options: &LidarOptions) -> (Vector3<f64>, Vec<Vector3<f64>>) {
    let attitude = state.body_quaternion;
    let yaw = 2.0 * attitude.k.atan2(attitude.w);
    let level = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
    let axes = if options.stabilized == 1.0 { level } else { attitude };
    let pitch = Rotation3::from_axis_angle(&Vector3::y_axis(), options.pitch);
    let down = Rotation3::from_axis_angle(&Vector3::y_axis(), options.depression);
    let turned = |k: usize| {
        let angle = ((k as f64 + 0.5) / options.beams - 0.5) * options.field_of_view;
        axes * (pitch * (Rotation3::from_axis_angle(&Vector3::z_axis(), angle) * (down * Vector3::x())))
    };
    let eye = state.ball_position + attitude * Vector3::from(options.position);
    (eye, (0..options.beams as usize).map(turned).collect())
}

/// Range of a beam to the ball.
fn to_ball(eye: &Vector3<f64>, beam: &Vector3<f64>, state: &State) -> f64 {
    let from = eye - state.ball_position;
    let along = -from.dot(beam);
    let root = along * along - from.norm_squared() + Params::paper().ball_radius.powi(2);
    if along > 0.0 && root >= 0.0 { along - root.sqrt() } else { f64::INFINITY }
}

#[test]
fn ranges_on_planes_are_exact_for_each_beam() {
    let body_fixed = LidarOptions {
        beams: 37.0,
        field_of_view: 5.0,
        position: [0.1, -0.05, 0.3],
        pitch: 0.3,
        depression: 0.4,
        rate: 0.0,
        ..Default::default()
    };
    let stabilized = LidarOptions { stabilized: 1.0, ..body_fixed };
    let steep = LidarOptions { depression: 1.2, position: [0.0, 0.0, 0.3], ..body_fixed };
    let far = LidarOptions { depression: 0.03, pitch: 0.0, ..body_fixed };
    let (mut of_ball, mut of_plane, mut of_nothing) = (0, 0, 0);
    for options in [body_fixed, stabilized, steep, far] {
        for slope in [0.0, 0.2] {
            let plane = Arc::new(Terrain::plane(slope, 2.1).unwrap());
            let terrain = (slope > 0.0).then_some(&plane);
            let mut run = lidar(terrain, &options, &standing(terrain, [0.3, 0.1], -0.8, [0.04, -0.03]));
            for k in 0..20 {
                let state = run.batch.state(0).unwrap();
                let (eye, beams) = beams(&state, &options);
                let normal = plane.normal(0.0, 0.0);
                for (k, (beam, read)) in beams.iter().zip(ranges(&run)).enumerate() {
                    let closing = -normal.dot(beam);
                    let ground = if closing > 0.0 { normal.dot(&eye) / closing } else { f64::INFINITY };
                    let ball = to_ball(&eye, beam, &state);
                    let expected = ball.min(ground).clamp(options.min_range, options.max_range);
                    of_ball += usize::from(ball < ground);
                    of_plane += usize::from(ground < options.max_range.min(ball));
                    of_nothing += usize::from(ground.min(ball) > options.max_range);
                    assert!((f64::from(*read) - expected).abs() < 2e-6 * expected, "beam {k}: {read}, {expected}");
                }
                drive(&mut run, k);
            }
        }
    }
    assert!(of_ball > 100 && of_plane > 1000 && of_nothing > 100, "{of_ball}, {of_plane}, {of_nothing}");
}

#[test]
fn an_upright_robot_on_level_ground_reads_one_range_all_around() {
    let options = LidarOptions { position: [0.0, 0.0, 0.4], depression: 0.5, ..Default::default() };
    let run = lidar(None, &options, &standing(None, [2.0, -1.0], 1.1, [0.0; 2]));
    let height = Params::paper().ball_radius + 0.4;
    assert_eq!(ranges(&run).len(), 72);
    for range in ranges(&run) {
        assert!((f64::from(*range) - height / 0.5_f64.sin()).abs() < 1e-6, "{range}");
    }
    // Level and rising beams hit nothing.
    for depression in [0.0, -0.3] {
        let options = LidarOptions { depression, ..options.clone() };
        let run = lidar(None, &options, &standing(None, [2.0, -1.0], 1.1, [0.0; 2]));
        assert!(ranges(&run).iter().all(|range| *range == 5.0), "{:?}", ranges(&run));
    }
    // Straight down is the ball; nearer than the least range reads as the least range.
    for (min_range, expected) in [(0.05, 0.4 - Params::paper().ball_radius), (0.35, 0.35)] {
        let options = LidarOptions { depression: FRAC_PI_2, min_range, ..options.clone() };
        let run = lidar(None, &options, &standing(None, [2.0, -1.0], 1.1, [0.0; 2]));
        assert!(ranges(&run).iter().all(|range| (f64::from(*range) - expected).abs() < 1e-6), "{:?}", ranges(&run));
    }
}

#[test]
fn beams_are_counterclockwise_about_the_axis_ahead() {
    // Four beams at -135, -45, 45 and 135 deg from ahead, on a plane that rises along x, seen with a yaw of 45 deg:
    // at -90, 0, 90 and 180 deg of the plane.
    let plane = Arc::new(Terrain::plane(0.3, 0.0).unwrap());
    let options = LidarOptions { beams: 4.0, depression: 0.25, stabilized: 1.0, max_range: 50.0, ..Default::default() };
    let run = lidar(Some(&plane), &options, &standing(Some(&plane), [0.0; 2], 0.25 * PI, [0.0; 2]));
    let [right, up, left, down] = ranges(&run) else { panic!("four beams") };
    assert!((right - left).abs() < 1e-5 && up < left && *down == 50.0, "{:?}", ranges(&run));
    // Half a turn: the beams divide it evenly, at -67.5, -22.5, 22.5 and 67.5 deg.
    let options = LidarOptions { field_of_view: PI, ..options };
    let run = lidar(Some(&plane), &options, &standing(Some(&plane), [0.0; 2], 0.0, [0.0; 2]));
    let [first, second, third, last] = ranges(&run) else { panic!("four beams") };
    assert!((first - last).abs() < 1e-5 && (second - third).abs() < 1e-5 && second < first, "{:?}", ranges(&run));
}

#[test]
fn a_gimbal_takes_tilt_out_of_the_ranges() {
    let ranges = |stabilized: f64, tilt: [f64; 2]| {
        let options = LidarOptions { depression: 0.6, stabilized, ..Default::default() };
        ranges(&lidar(None, &options, &standing(None, [0.0; 2], 0.3, tilt))).to_vec()
    };
    let spread = |ranges: &[f32]| {
        let (low, high) = ranges.iter().fold((f32::MAX, 0.0_f32), |(low, high), r| (low.min(*r), high.max(*r)));
        high - low
    };
    assert!(spread(&ranges(1.0, [0.1, 0.05])) < 1e-5);
    assert!(spread(&ranges(0.0, [0.1, 0.05])) > 0.1);
    assert_eq!(ranges(0.0, [0.0; 2]), ranges(1.0, [0.0; 2]));
}

#[test]
fn ranges_on_hills_match_small_steps_along_each_beam() {
    let terrain = hills();
    let options = LidarOptions { max_range: 3.0, ..Default::default() };
    for (place, yaw) in [([0.0, 0.0], 0.3), ([1.2, -1.5], 2.0), ([-2.5, 2.2], -2.4)] {
        let run = lidar(Some(&terrain), &options, &standing(Some(&terrain), place, yaw, [0.03, 0.1]));
        let state = run.batch.state(0).unwrap();
        let (eye, beams) = beams(&state, &options);
        for (k, (beam, read)) in beams.iter().zip(ranges(&run)).enumerate() {
            let is_above = |range: f64| {
                let at = eye + beam * range;
                at.z > terrain.height(at.x, at.y)
            };
            let (step, mut range) = (1e-4, 0.0);
            while range < options.max_range && is_above(range) {
                range += step;
            }
            let end = eye + beam * range;
            if end.x.abs().max(end.y.abs()) < terrain.half_size()[0] {
                let expected = range.min(to_ball(&eye, beam, &state)).min(options.max_range);
                assert!((f64::from(*read) - expected).abs() < 2.0 * step, "beam {k}: {read}, {expected}");
            }
        }
    }
}

#[test]
fn errors_have_the_given_size() {
    let read = |options: LidarOptions| {
        let options = LidarOptions { beams: 4096.0, depression: 0.6, rate: 0.0, ..options };
        let mut run = lidar(None, &options, &standing(None, [0.0; 2], 0.0, [0.0; 2]));
        let first = ranges(&run).to_vec();
        run.step(&[0.0; 3]).unwrap();
        (first, ranges(&run).to_vec())
    };
    let (exact, _) = read(LidarOptions::default());
    let deviation = |a: &[f32], b: &[f32]| {
        let squares: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
        (squares / a.len() as f64).sqrt()
    };
    let (first, second) = read(LidarOptions { noise: 0.02, ..Default::default() });
    assert!((deviation(&first, &exact) - 0.02).abs() < 0.001, "{}", deviation(&first, &exact));
    assert!((deviation(&first, &second) - 0.0283).abs() < 0.0014, "samples are independent");
    let (first, second) = read(LidarOptions { dropout: 0.2, ..Default::default() });
    for ranges in [&first, &second] {
        let lost = ranges.iter().filter(|range| **range == 5.0).count();
        assert!((lost as f64 / 4096.0 - 0.2).abs() < 0.025, "{lost}");
    }
    assert_ne!(first, second);
    let nothing = LidarOptions { noise: 0.02, depression: 0.0, ..Default::default() };
    let run = lidar(None, &nothing, &standing(None, [0.0; 2], 0.0, [0.0; 2]));
    assert!(ranges(&run).iter().all(|range| *range == 5.0), "nothing has no noise");
}

#[test]
fn a_mounting_error_turns_the_ring() {
    let mut config = bare(None);
    // Without the tilt of the robots at their starts.
    let options =
        LidarOptions { beams: 1.0, depression: 0.6, stabilized: 1.0, misalignment: 0.02, ..Default::default() };
    config.instruments_mut().set(Arc::new(options));
    let run = made(&*config, 512, 1);
    let height = Params::paper().ball_radius + 0.4;
    let mut squares = 0.0;
    for i in 0..512 {
        let range = f64::from(run.batch.perceived(i, "lidar").unwrap()[0]);
        squares += ((height / range).asin() - 0.6).powi(2);
    }
    let deviation = (squares / 512.0_f64).sqrt();
    assert!((deviation - 0.02).abs() < 0.002, "{deviation}");
}

#[test]
fn turns_are_held_between_samples_and_delayed() {
    // A turn every 4 control steps, read 6 later.
    let options = LidarOptions { rate: 25.0, latency: 0.06, ..Default::default() };
    let now = LidarOptions { rate: 0.0, latency: 0.0, ..options };
    let terrain = hills();
    let start = standing(Some(&terrain), [0.1, 0.2], 0.5, [0.02, 0.0]);
    let [mut late, mut exact] = [&options, &now].map(|options| lidar(Some(&terrain), options, &start));
    let mut turns = vec![ranges(&exact).to_vec()];
    for k in 0..40_usize {
        assert_eq!(ranges(&late), turns[k.saturating_sub(6) / 4 * 4], "step {k}");
        for run in [&mut late, &mut exact] {
            run.step(&[0.0; 3]).unwrap();
            assert!(!run.terminated[0]);
        }
        turns.push(ranges(&exact).to_vec());
    }
}
