//! Allocations of a running batch, counted on this thread: steps of `planar`, `spatial` and `contact` make none, with or
//! without a controller.

use ballbot_core::ModelKind;
use ballbot_core::actuator::MotorOptions;
use ballbot_core::batch::{
    Autoreset, BalanceConfig, Batch, Episode, Event, History, Layer, Networks, Observation, StepResults, Under, When,
};
use ballbot_core::control::{Controller, Lqr, Pid, PidGains, controller_kinds};
use ballbot_core::kinematics::TorqueMap;
use ballbot_core::perception::{DepthOptions, Instruments, LidarOptions, ScanOptions};
use ballbot_core::sensor::SensorOptions;
use ballbot_core::task::{ACTION_LEN, Balance};
use ballbot_core::terrain::Terrain;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::f64::consts::PI;
use std::hint::black_box;
use std::sync::Arc;

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: every call is passed unchanged to the system's allocator, which keeps the contract of the trait.
#[expect(unsafe_code, reason = "an allocator is an unsafe trait")]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: the caller's layout, which has a size above zero.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's pointer, which came from `alloc` or `realloc` above and so from the system, with its layout.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: as in `dealloc`; the new size is the caller's, which is above zero.
        unsafe { System.realloc(pointer, layout, new_size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const ENVS: usize = 8;
const STEPS: usize = 100;

/// Allocations in [`STEPS`] steps of [`ENVS`] environments on this thread, after as many steps to warm up; under
/// `controller` if there is one.
fn allocations(config: &BalanceConfig, controller: Option<&dyn Controller>) -> usize {
    let mut batch = Batch::new(config, ENVS, Autoreset::SameStep, Some(1), 1).unwrap();
    let mut results = StepResults::new(&batch);
    batch.reset(None, &mut results.observations).unwrap();
    let mut actions: Vec<f32> = (0..ENVS * ACTION_LEN).map(|i| 0.02 * (i as f32).sin()).collect();
    let mut run = || {
        let before = ALLOCATIONS.get();
        for _ in 0..STEPS {
            let mut buffers = results.buffers();
            match controller {
                Some(controller) => batch.step_under(&Under::new(controller), &mut actions, &mut buffers).unwrap(),
                None => batch.step(&actions, &mut buffers).unwrap(),
            }
        }
        ALLOCATIONS.get() - before
    };
    run();
    run()
}

/// Episodes without an end: the closed-form models have no floor to fall on.
fn endless(model: ModelKind) -> BalanceConfig {
    let task = Balance { fall_tilt: PI, ..Balance::default() };
    BalanceConfig { model, max_episode_steps: usize::MAX, task, ..BalanceConfig::default() }
}

#[test]
fn steps_allocate_nothing() {
    for model in [ModelKind::Planar, ModelKind::Spatial] {
        assert_eq!(allocations(&endless(model), None), 0, "{model}");
    }
    // Including resets.
    let brief = BalanceConfig { max_episode_steps: 2, ..endless(ModelKind::Contact) };
    assert_eq!(allocations(&brief, None), 0, "contact");
    // Including events: at resets, and friction and pushes within episodes.
    let push = Event { when: When::Every([0.01, 0.02]), ..Event::new("push", [0.0, 1e-3]) };
    let friction = Event { when: When::At(0.01), optional: true, ..Event::new("floor_dynamic_friction", [0.9, 1.0]) };
    let events = vec![push, friction, Event::new("gravity", [9.0, 10.0]), Event::new("ball_radius", [0.112, 0.113])];
    assert_eq!(allocations(&BalanceConfig { events, ..brief.clone() }, None), 0, "contact with events");
    let scan = ScanOptions { noise: 0.01, dropout: 0.1, latency: 0.02, rate: 0.0, ..ScanOptions::default() };
    let depth = DepthOptions { noise: [0.001, 0.001], freeze: 0.1, rate: 50.0, ..DepthOptions::default() };
    let terrain = Some(Arc::new(Terrain::generate("noise", 0, &[("cell", 0.05)]).unwrap()));
    let lidar = LidarOptions { noise: 0.01, dropout: 0.1, misalignment: 0.01, rate: 0.0, ..LidarOptions::default() };
    let instruments = Instruments::default().with(scan).with(depth).with(lidar);
    let seeing = BalanceConfig { terrain, instruments, ..brief.clone() };
    assert_eq!(allocations(&seeing, None), 0, "contact with instruments");
    let actuators = MotorOptions { delay: 0.026, lag: 0.01, speed_limit: 20.0, ..MotorOptions::default() };
    let sensors = SensorOptions { gyro_noise: 0.01, encoder_ticks: 1e3, latency: 0.02, ..SensorOptions::default() };
    let slow = SensorOptions { imu_rate: 40.0, encoder_rate: 30.0, ..sensors };
    for config in [endless(ModelKind::Planar), endless(ModelKind::Spatial), brief] {
        let config = BalanceConfig { actuators: actuators.clone(), ..config };
        assert_eq!(allocations(&config, None), 0, "{} with motors", config.model);
        let unobserved = BalanceConfig { sensors: Some(slow.clone()), ..config.clone() };
        assert_eq!(allocations(&unobserved, None), 0, "{} with slow sensors", config.model);
        let observation = Observation::Sensors;
        let config = BalanceConfig {
            sensors: Some(sensors.clone()),
            observation,
            history: History::Ages(vec![0, 1, 30]),
            ..config
        };
        assert_eq!(allocations(&config, None), 0, "{} with sensors", config.model);
    }
    // For the record: a reset may allocate, and so does rapier.
    let brief = BalanceConfig { max_episode_steps: 2, ..endless(ModelKind::Spatial) };
    println!("spatial, a reset: {}", allocations(&brief, None) as f64 / (ENVS * STEPS / 2) as f64);
    let mut rigid = endless(ModelKind::Rigid);
    rigid.task.reset_tilt = 0.0;
    println!(
        "rigid, a step of {} substeps (rapier allocates, we do not): {}",
        rigid.substeps().unwrap(),
        allocations(&rigid, None) as f64 / (ENVS * STEPS) as f64
    );
}

#[test]
fn steps_under_a_controller_allocate_nothing() {
    for model in [ModelKind::Planar, ModelKind::Spatial, ModelKind::Contact] {
        let config = endless(model);
        let lqr = Lqr::new(&config.params, config.control_dt).unwrap();
        assert_eq!(allocations(&config, Some(&lqr)), 0, "{model} under LQR");
        // The PID has a different rate.
        for kind in controller_kinds().iter().filter(|kind| kind.control_dt.is_none()) {
            let options: &[(&str, &[f64])] = match kind.name {
                "lqr" => &[("delay", &[0.03]), ("lean_observer", &[1.0])],
                "lqi" => &[("delay", &[0.03])],
                "hierarchical_sliding_mode" => &[("adaptation", &[10.0]), ("lean_observer", &[1.0])],
                _ => &[],
            };
            let law = (kind.make)(&config.params, config.control_dt, &kind.limits, options).unwrap();
            assert_eq!(allocations(&config, Some(law.as_ref())), 0, "{model} under {}", kind.name);
        }
        let sensors = Some(SensorOptions { latency: 0.02, ..SensorOptions::default() });
        let measured = BalanceConfig { sensors, observation: Observation::Sensors, ..config.clone() };
        assert_eq!(allocations(&measured, Some(&lqr)), 0, "{model} under LQR on estimates");
        // A law with memory, at the rate of its gains; including resets of `contact`.
        let steps = if model == ModelKind::Contact { 2 } else { usize::MAX };
        let config = BalanceConfig { control_dt: Pid::PAPER_CONTROL_DT, max_episode_steps: steps, ..config };
        let pid = Pid::new(&config.params, config.control_dt, &PidGains::default(), TorqueMap::Consistent).unwrap();
        assert_eq!(allocations(&config, Some(&pid)), 0, "{model} under PID");
    }
}

#[test]
fn steps_under_networks_allocate_nothing() {
    for model in [ModelKind::Planar, ModelKind::Spatial, ModelKind::Contact] {
        let mut batch = Batch::new(&endless(model), ENVS, Autoreset::SameStep, Some(1), 1).unwrap();
        let inputs = batch.observation_len();
        let numbers = vec![0.01; ENVS * 32 * inputs];
        let layer = |inputs, outputs| Layer {
            inputs,
            outputs,
            weights: &numbers[..ENVS * outputs * inputs],
            biases: &numbers[..ENVS * outputs],
        };
        let networks = Networks::new(ENVS, &[layer(inputs, 32), layer(32, ACTION_LEN)]).unwrap();
        let mut episodes = [Episode::default(); ENVS];
        batch.reset(None, &mut vec![0.0; ENVS * inputs]).unwrap();
        let [few, many] = [1, STEPS].map(|steps| {
            let before = ALLOCATIONS.get();
            batch.episodes(&networks, steps, &mut episodes).unwrap();
            ALLOCATIONS.get() - before
        });
        assert_eq!(few, many, "{model}");
    }
}

#[test]
fn counting_allocator_detects_an_allocation() {
    let before = ALLOCATIONS.get();
    drop(black_box(vec![0_u8; 64]));
    assert_eq!(ALLOCATIONS.get() - before, 1);
}
