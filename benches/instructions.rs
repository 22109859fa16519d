//! The workloads whose instructions `make instructions` counts, one per run: `instructions <model> <workload> <times>`.
//!
//! The work before the counted part is the same for every number of times, so that the difference between a run with
//! some and a run with none is only the counted part.

mod runner;

use ballbot_core::{Ballbot, ModelKind, Params, State, attitude};
use fearless_simd::Level;
use nalgebra::{Vector2, Vector3};
use runner::Runner;

/// Time step of the models, s.
const SIM_DT: f64 = 0.001;

/// Steps before the counted steps, in which the contacts of a start settle and caches and buffers are filled.
const SETTLING: usize = 100;
const SETTLING_BATCH: usize = 5;

/// Environments of a batch.
const ENVS: usize = 64;

/// No robot may fall over within the counted steps: that would be a different motion.
const UPRIGHT: f64 = 0.3;

/// Leaning a little, rolling and turning.
fn start(params: &Params) -> State {
    let body = attitude(Vector2::new(0.01, -0.02), 0.6);
    State::rolling(params, Vector2::new(0.1, -0.05), 0.2, body, Vector3::new(0.02, -0.01, 0.3))
}

fn robot(kind: ModelKind) -> Ballbot {
    Ballbot::new(&Params::paper(), kind, SIM_DT).expect("the paper's robot can be built")
}

/// Steps of one robot, in one call: it checks for divergence only after every 64th step.
fn steps(kind: ModelKind, times: usize) {
    let mut robot = robot(kind);
    let torques = [0.02, -0.01, 0.01];
    robot.reset(&start(robot.params())).expect("every model can start from here");
    robot.step(torques, SETTLING).expect("the robot does not diverge");
    robot.step(torques, times).expect("the robot does not diverge");
    let tilt = robot.state().tilt();
    assert!(tilt < UPRIGHT && !robot.bot_on_floor(), "the robot has fallen: its tilt is {tilt} rad");
}

fn resets(kind: ModelKind, times: usize) {
    let mut robot = robot(kind);
    let start = start(robot.params());
    // In the first run, buffers may still grow.
    for _ in 0..=times {
        robot.reset(&start).expect("every model can start from here");
    }
}

/// Control steps of [`ENVS`] environments on this thread.
fn batch_steps(kind: ModelKind, times: usize) {
    let mut runner = Runner::new(kind, ENVS, Some(1));
    for _ in 0..SETTLING_BATCH + times {
        runner.step();
        assert!(!runner.terminated.contains(&true), "a robot has fallen");
    }
}

fn batch_resets(kind: ModelKind, times: usize) {
    let mut runner = Runner::new(kind, ENVS, Some(1));
    for _ in 0..=times {
        runner.reset();
    }
}

/// The instruction set for robots in lanes, which valgrind may hide from the program.
fn lanes() -> &'static str {
    let level = Level::new();
    #[cfg(target_arch = "x86_64")]
    if level.as_avx512().is_some() {
        return "avx512";
    } else if level.as_avx2().is_some() {
        return "avx2";
    }
    #[cfg(target_arch = "aarch64")]
    if level.as_neon().is_some() {
        return "neon";
    }
    let _ = level;
    "none"
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [model, workload, times] = &arguments[..] else {
        println!("instructions are counted by `make instructions`");
        return;
    };
    let kind: ModelKind = model.parse().expect("the name of a model");
    let times: usize = times.parse().expect("a number");
    match workload.as_str() {
        "step" => steps(kind, times),
        "reset" => resets(kind, times),
        "batch-step" => batch_steps(kind, times),
        "batch-reset" => batch_resets(kind, times),
        _ => panic!("workload '{workload}' is none of step, reset, batch-step, batch-reset"),
    }
    println!("lanes {}", lanes());
}
