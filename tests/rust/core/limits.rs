//! Requests that would take all memory, all threads or all day are rejected, or end when the caller stops them; bad
//! snapshots change nothing.

use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, Environment, StepResults};
use ballbot_core::control::{Controller, Lqr, Pid, PidGains, Setpoint};
use ballbot_core::kinematics::TorqueMap;
use ballbot_core::task::ACTION_LEN;
use ballbot_core::{Ballbot, Error, ModelKind, Params, State, attitude, stoppable, unit_quaternion};
use nalgebra::{Vector2, Vector3};
use std::time::{Duration, Instant};

const OBSERVATION_LEN: usize = 16;

/// Whether the time since its creation has elapsed.
fn after(milliseconds: u64) -> impl Fn() -> bool + 'static {
    let start = Instant::now();
    move || start.elapsed() > Duration::from_millis(milliseconds)
}

fn step(batch: &mut Batch) -> ballbot_core::Result<()> {
    let actions = vec![0.0; batch.len() * ACTION_LEN];
    batch.step(&actions, &mut StepResults::new(batch).buffers())
}

fn reset(batch: &mut Batch, mask: Option<&[bool]>) -> ballbot_core::Result<()> {
    let n = batch.len();
    batch.reset(mask, &mut vec![0.0; n * OBSERVATION_LEN])
}

#[test]
fn too_many_environments_and_threads_are_rejected() {
    let rejection = |num_envs: usize, num_threads: usize| {
        let batch = Batch::new(&BalanceConfig::default(), num_envs, Autoreset::SameStep, Some(num_threads), 0);
        batch.err().expect("accepted").to_string()
    };
    for num_envs in [(1 << 20) + 1, 100_000_000, usize::MAX] {
        assert_eq!(rejection(num_envs, 1), format!("num_envs = {num_envs}, it must be at most 1048576"));
    }
    for num_threads in [257, 1_000_000, usize::MAX] {
        assert_eq!(rejection(2, num_threads), format!("num_threads = {num_threads}, it must be at most 256"));
    }
}

#[cfg(feature = "render")]
#[test]
fn too_many_threads_of_a_renderer_are_rejected() {
    use ballbot_core::render::{Camera, Renderer, Scene};
    let scene = Scene::of(&Params::paper());
    let camera = Camera::following(scene.height());
    let renderer = Renderer::new(scene, 8, 8, 1, camera).unwrap();
    let error = renderer.with_threads(1_000_000).err().expect("accepted").to_string();
    assert_eq!(error, "num_threads = 1000000, it must be at most 256");
}

#[cfg(feature = "render")]
#[test]
fn a_long_rendering_stops_when_its_caller_requests_it() {
    use ballbot_core::render::{Camera, Picture, Renderer, Scene};
    let params = Params::paper();
    let scene = Scene::of(&params);
    let camera = Camera::following(scene.height());
    let renderer = Renderer::new(scene, 4096, 4096, 4, camera).unwrap();
    let mut rgb = vec![0; 3 * 4096 * 4096];
    let picture = Picture { rgb: Some(&mut rgb), ..Picture::default() };
    let result = stoppable(after(0), || renderer.render(&State::upright(&params), &[], picture));
    assert!(matches!(result, Err(Error::Interrupted)), "{result:?}");
}

#[test]
fn a_long_run_of_a_robot_stops_when_its_caller_requests_it() {
    for kind in ModelKind::ALL {
        let mut robot = Ballbot::new(&Params::paper(), kind, 1e-6).unwrap();
        let result = stoppable(after(100), || robot.step([0.0; 3], usize::MAX));
        assert!(matches!(result, Err(Error::Interrupted)), "{kind}: {result:?}");
        // It keeps the state it has reached, and continues.
        let time = robot.time();
        assert!(time > 0.0, "{kind}");
        robot.step([0.0; 3], 1).unwrap();
        assert!(robot.time() > time, "{kind}");
    }
}

#[test]
fn an_interrupted_step_requires_a_reset() {
    // A step of 40 seconds.
    let slow = BalanceConfig { model: ModelKind::Spatial, sim_dt: 1e-6, control_dt: 0.01, ..BalanceConfig::default() };
    for threads in [1, 2] {
        let mut batch = Batch::new(&slow, 3000, Autoreset::SameStep, Some(threads), 0).unwrap();
        reset(&mut batch, None).unwrap();
        let result = stoppable(after(0), || step(&mut batch));
        assert!(matches!(result, Err(Error::Interrupted)), "{threads} threads: {result:?}");
        let error = step(&mut batch).unwrap_err().to_string();
        assert!(error.starts_with("the last step was interrupted: reset all environments"), "{error}");
        // A part of them is not enough.
        let mut mask = vec![true; 3000];
        mask[7] = false;
        reset(&mut batch, Some(&mask)).unwrap();
        assert!(step(&mut batch).unwrap_err().to_string().contains("interrupted"));
        reset(&mut batch, None).unwrap();
        let result = stoppable(after(0), || step(&mut batch));
        assert!(matches!(result, Err(Error::Interrupted)), "it steps again: {result:?}");
    }
}

#[test]
fn a_step_before_the_first_reset_is_rejected_in_every_mode() {
    for mode in Autoreset::ALL {
        let mut batch = Batch::new(&BalanceConfig::default(), 3, mode, Some(1), 0).unwrap();
        let error = step(&mut batch).unwrap_err().to_string();
        assert!(error.contains("before the first reset") || error.contains("has not begun"), "{mode:?}: {error}");
        // One environment is enough where the others are reset by their step.
        reset(&mut batch, Some(&[false, true, false])).unwrap();
        assert_eq!(step(&mut batch).is_ok(), mode == Autoreset::NextStep, "{mode:?}");
        reset(&mut batch, None).unwrap();
        step(&mut batch).unwrap();
    }
}

#[test]
fn a_clone_of_a_controller_is_another_controller() {
    let params = Params::paper();
    let lqr = Lqr::new(&params, 0.01).unwrap();
    assert_ne!(Controller::id(&lqr), Controller::id(&lqr.clone()));
    let mut pid = Pid::new(&params, 0.002, &PidGains::default(), TorqueMap::Consistent).unwrap();
    // So small that no motor is at its limit, which would freeze the integral.
    let leaning = State::tilted(&params, Vector2::new(0.002, 0.001), 0.0);
    let setpoint = Setpoint::default();
    let first = pid.wheel_torques(&leaning, &setpoint);
    let later = pid.wheel_torques(&leaning, &setpoint);
    assert_ne!(first, later, "its integral has grown");
    let mut clone = pid.clone();
    assert_ne!(Controller::id(&pid), Controller::id(&clone));
    // It starts empty, and its memory is its own.
    assert_eq!(clone.wheel_torques(&leaning, &setpoint), first);
    let third = pid.wheel_torques(&leaning, &setpoint);
    assert_eq!(clone.wheel_torques(&leaning, &setpoint), later);
    assert_ne!(third, later);
}

/// A state without zeros, whose ball position is easy to find in bytes.
fn lively() -> State {
    let body = attitude(Vector2::new(0.05, -0.03), 0.6);
    let mut state = State::rolling(&Params::paper(), Vector2::new(0.1, -0.05), 0.0, body, Vector3::new(0.0, 0.0, 0.3));
    for position in [&mut state.ball_position, &mut state.body_position] {
        (position.x, position.y) = (0.123456789, 0.987654321);
    }
    state
}

/// The snapshot with `value` in place of every `old`, its checksum right.
fn forged(snapshot: &[u8], old: f64, value: f64) -> Vec<u8> {
    let mut bytes = snapshot[..snapshot.len() - 4].to_vec();
    let places: Vec<_> =
        bytes.windows(8).enumerate().filter(|(_, w)| **w == old.to_le_bytes()).map(|(i, _)| i).collect();
    assert!(!places.is_empty(), "{old} is not in the snapshot");
    for place in places {
        bytes[place..place + 8].copy_from_slice(&value.to_le_bytes());
    }
    let checksum = crc32fast::hash(&bytes);
    bytes.extend(checksum.to_le_bytes());
    bytes
}

#[test]
fn snapshots_with_invalid_numbers_are_rejected_and_change_nothing() {
    for model in ModelKind::ALL {
        let mut robot = Ballbot::new(&Params::paper(), model, 0.002).unwrap();
        robot.reset(&lively()).unwrap();
        let x = lively().ball_position.x;
        let good = robot.save();
        let config = BalanceConfig { model, ..BalanceConfig::default() };
        let mut environment = Environment::new(&config, 0).unwrap();
        environment.reset_to(&lively(), &mut [0.0; OBSERVATION_LEN]).unwrap();
        let mut batch = Batch::new(&config, 9, Autoreset::SameStep, Some(1), 0).unwrap();
        reset(&mut batch, None).unwrap();
        batch.load(8, &environment.save()).unwrap();
        for value in [f64::NAN, f64::INFINITY, 1e300] {
            let before = robot.save();
            let error = robot.load(&forged(&good, x, value)).unwrap_err().to_string();
            assert!(error.starts_with("cannot decode snapshot of a robot: ball_position[0]"), "{model}: {error}");
            assert!(robot.save() == before, "{model}: rejected, but the robot has changed");
            let bytes = forged(&environment.save(), x, value);
            let before = environment.save();
            assert!(environment.load(&bytes).is_err(), "{model}");
            assert!(environment.save() == before, "{model}: rejected, but the environment has changed");
            let before: Vec<_> = (0..9).map(|i| batch.save(i).unwrap()).collect();
            assert!(batch.load(8, &bytes).is_err(), "{model}");
            let unchanged = before.iter().enumerate().all(|(i, before)| batch.save(i).unwrap() == *before);
            assert!(unchanged, "{model}: rejected, but the batch has changed");
        }
        robot.load(&forged(&good, x, 0.25)).unwrap();
        assert_eq!(robot.state().ball_position.x, 0.25, "{model}");
    }
}

#[test]
fn a_unit_quaternion_keeps_its_bits() {
    let attitude = attitude(Vector2::new(0.05, -0.03), 0.6);
    let own = [attitude.w, attitude.i, attitude.j, attitude.k];
    let off = own.map(|v| v * (1.0 + f64::EPSILON));
    for values in [own, off] {
        let q = unit_quaternion("q", values).unwrap();
        assert_eq!([q.w, q.i, q.j, q.k], values);
    }
    let longer = unit_quaternion("q", own.map(|v| v * (1.0 + 1e-9))).unwrap();
    assert!((longer.norm() - 1.0).abs() < 1e-15);
}

/// A reset to the robot's own state continues from there: to the last bit where the model keeps nothing else, within
/// rounding where it keeps other coordinates, and within the first step's forces where it keeps the forces of its
/// contacts.
#[test]
fn a_robot_continues_from_its_state() {
    for (model, tolerance) in
        [(ModelKind::Spatial, 0.0), (ModelKind::Planar, 1e-12), (ModelKind::Contact, 1e-4), (ModelKind::Rigid, 1e-3)]
    {
        let mut robot = Ballbot::new(&Params::paper(), model, 0.001).unwrap();
        robot.reset(&State::tilted(&Params::paper(), Vector2::new(0.05, 0.03), 0.4)).unwrap();
        let mut lqr = Lqr::new(&Params::paper(), 0.005).unwrap();
        for _ in 0..60 {
            let torques = lqr.wheel_torques(&robot.state(), &Setpoint::default());
            robot.step(torques, 5).unwrap();
        }
        let mut other = Ballbot::new(&Params::paper(), model, 0.001).unwrap();
        other.reset(&robot.state()).unwrap_or_else(|error| panic!("{model}: {error}"));
        let mut worst = 0.0_f64;
        for _ in 0..100 {
            let torques = lqr.wheel_torques(&robot.state(), &Setpoint::default());
            robot.step(torques, 5).unwrap();
            other.step(torques, 5).unwrap();
            let pairs = robot.state().to_array().into_iter().zip(other.state().to_array());
            worst = pairs.map(|(a, b)| (a - b).abs()).fold(worst, f64::max);
        }
        assert!(worst <= tolerance, "{model}: {worst:e}, limit {tolerance:e}");
        println!("{model}: {worst:e}");
    }
}
