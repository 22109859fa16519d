//! Steps of whole batches, including resets, and the peak of the core:
//! `cargo bench --bench batch`.
//!
//! An element of a batch is one environment's control step, which is five model steps. An element of the peak is a
//! floating-point operation, a fused multiply-add being two: the test `operations_of_a_step_are_as_documented` counts N
//! of them in a step of the contact model, so that a batch reaches 5 · N · (elements/s).

mod runner;

use ballbot_core::actuator::MotorOptions;
use ballbot_core::batch::{BalanceConfig, Event, load_events};
use ballbot_core::perception::{DepthOptions, Instruments, LidarOptions, ScanOptions};
use ballbot_core::terrain::Terrain;
use ballbot_core::{ModelKind, Params};
use criterion::{Criterion, SamplingMode, Throughput, criterion_group, criterion_main};
use fearless_simd::prelude::*;
use fearless_simd::{Level, f64x8};
use runner::Runner;
use std::hint::black_box;
use std::sync::Arc;
use std::time::Duration;

fn batches(criterion: &mut Criterion) {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let mut group = criterion.benchmark_group("batch");
    group.sampling_mode(SamplingMode::Flat);
    for (model, sizes) in [
        (ModelKind::Spatial, &[1, 64, 1024][..]),
        (ModelKind::Contact, &[1, 64, 1024, 16384]),
        (ModelKind::Rigid, &[1, 64, 1024]),
    ] {
        for &n in sizes {
            group.throughput(Throughput::Elements(n as u64));
            // One environment is never on more than one thread.
            for threads in [1, cores].into_iter().take(if n > 1 && cores > 1 { 2 } else { 1 }) {
                let mut runner = Runner::new(model, n, Some(threads));
                group.bench_function(format!("{model}/{n} envs/{threads} threads"), |b| b.iter(|| runner.step()));
            }
        }
    }
    group.finish();
}

/// Every effect of the motors at once, compared with ideal motors.
fn motors(criterion: &mut Criterion) {
    let all = MotorOptions {
        delay: 0.026,
        strength: [0.9, 1.0, 1.1],
        lag: 0.007,
        stall_torque: 0.6,
        no_load_speed: 40.0,
        speed_limit: 20.0,
        peak_torque: 0.4,
        delay_jitter: 0.0,
    };
    let mut group = criterion.benchmark_group("motors");
    group.sampling_mode(SamplingMode::Flat);
    for (name, actuators) in [("ideal", MotorOptions::default()), ("all effects", all)] {
        group.throughput(Throughput::Elements(1024));
        let config = BalanceConfig { actuators, ..runner::config(ModelKind::Contact) };
        let mut runner = Runner::of(&config, 1024, Some(1));
        group.bench_function(format!("contact/1024 envs/1 threads/{name}"), |b| b.iter(|| runner.step()));
    }
    group.finish();
}

/// Cost of events: different robots, their resets with ten terms, and the checks when a batch is created.
fn events(criterion: &mut Criterion) {
    const ENVS: usize = 1024;
    let hard = load_events("hard").expect("it is part of the crate");
    let fields: Vec<Event> = hard.iter().filter(|event| event.term != "push" && event.id.is_none()).cloned().collect();
    let with = |events: &[Event]| BalanceConfig { events: events.to_vec(), ..runner::config(ModelKind::Contact) };
    let mut group = criterion.benchmark_group("events");
    group.throughput(Throughput::Elements(ENVS as u64));
    for (name, events) in [("none", &[][..]), ("ten terms", &fields[..10]), ("hard", &hard)] {
        let mut runner = Runner::of(&with(events), ENVS, Some(1));
        group.bench_function(format!("a step/{name}"), |b| b.iter(|| runner.step()));
        group.bench_function(format!("a reset/{name}"), |b| b.iter(|| runner.reset()));
    }
    group.throughput(Throughput::Elements(1));
    for (name, events) in [("none", &[][..]), ("hard", &hard)] {
        let make = || Runner::of(&with(events), 1, Some(1));
        group.bench_function(format!("a batch of one/{name}"), |b| b.iter(make));
    }
    group.finish();
}

/// Cost of uneven ground in a step and a reset.
fn ground(criterion: &mut Criterion) {
    const ENVS: usize = 1024;
    let hills = Terrain::generate("noise", 0, &[("slope", 0.15)]).expect("the default size");
    let mut group = criterion.benchmark_group("ground");
    group.throughput(Throughput::Elements(ENVS as u64));
    for (name, terrain) in [("level", None), ("noise", Some(Arc::new(hills)))] {
        let mut runner = Runner::of(&BalanceConfig { terrain, ..runner::config(ModelKind::Contact) }, ENVS, Some(1));
        group.bench_function(format!("a step/{name}"), |b| b.iter(|| runner.step()));
        group.bench_function(format!("a reset/{name}"), |b| b.iter(|| runner.reset()));
    }
    group.finish();
}

/// Cost of instruments in a step on uneven ground.
fn perception(criterion: &mut Criterion) {
    const ENVS: usize = 256;
    let hills = Arc::new(Terrain::generate("noise", 0, &[("slope", 0.15)]).expect("the default size"));
    let mut group = criterion.benchmark_group("perception");
    group.throughput(Throughput::Elements(ENVS as u64));
    let none = Instruments::default();
    let depth = |far| none.clone().with(DepthOptions { far, ..DepthOptions::default() });
    for (name, instruments) in [
        ("nothing", none.clone()),
        ("scan of 11 by 11", none.clone().with(ScanOptions::default())),
        ("depth of 32 by 24 to 3 m", depth(3.0)),
        ("depth of 32 by 24 to 10 m", depth(10.0)),
        ("lidar of 72 beams to 5 m", none.clone().with(LidarOptions::default())),
    ] {
        let terrain = Some(Arc::clone(&hills));
        let config = BalanceConfig { terrain, instruments, ..runner::config(ModelKind::Contact) };
        let mut runner = Runner::of(&config, ENVS, Some(1));
        group.bench_function(name, |b| b.iter(|| runner.step()));
    }
    group.finish();
}

/// Cost of roller wheels in a step.
fn rollers(criterion: &mut Criterion) {
    const ENVS: usize = 1024;
    let round = runner::config(ModelKind::Contact);
    let params = Params { roller_ripple: 1e-4, ..Params::paper() };
    let rippled = BalanceConfig { params, ..runner::config(ModelKind::Contact) };
    let mut group = criterion.benchmark_group("rollers");
    group.throughput(Throughput::Elements(ENVS as u64));
    for (name, config) in [("round wheels", &round), ("ripple", &rippled)] {
        let mut runner = Runner::of(config, ENVS, Some(1));
        group.bench_function(format!("a step/{name}"), |b| b.iter(|| runner.step()));
    }
    group.finish();
}

/// Multiply-adds of each chain in one run.
const LINKS: usize = 1000;

/// `CHAINS` chains of multiply-adds of eight numbers, none of which waits for another.
#[inline(always)]
fn chains<S: Simd, const CHAINS: usize>(simd: S, factor: f64, term: f64) -> [f64; 8] {
    let (factor, term) = (f64x8::splat(simd, factor), f64x8::splat(simd, term));
    // Equal chains would be computed once.
    let mut sums: [f64x8<S>; CHAINS] = std::array::from_fn(|i| f64x8::splat(simd, i as f64));
    for _ in 0..LINKS {
        for sum in &mut sums {
            *sum = sum.mul_add_precise(factor, term);
        }
    }
    let mut total = term;
    for sum in sums {
        total += sum;
    }
    let mut out = [0.0; 8];
    total.store_array(&mut out);
    out
}

/// Runs as many chains as hide an addition's latency and still fit the registers; returns their number.
fn run_chains(factor: f64, term: f64) -> usize {
    let level = Level::new();
    #[cfg(target_arch = "x86_64")]
    if let Some(simd) = level.as_avx512() {
        simd.vectorize(
            #[inline(always)]
            || black_box(chains::<_, 16>(simd, factor, term)),
        );
        return 16;
    } else if let Some(simd) = level.as_avx2() {
        simd.vectorize(
            #[inline(always)]
            || black_box(chains::<_, 6>(simd, factor, term)),
        );
        return 6;
    }
    #[cfg(target_arch = "aarch64")]
    if let Some(simd) = level.as_neon() {
        simd.vectorize(
            #[inline(always)]
            || black_box(chains::<_, 6>(simd, factor, term)),
        );
        return 6;
    }
    let _ = level;
    0
}

/// Multiply-adds of one core in lanes: the peak that the contact model's flops are compared with.
fn peak(criterion: &mut Criterion) {
    // Towards term / (1 − factor), neither overflowing nor denormal.
    let (factor, term) = (black_box(0.5), black_box(1.0));
    let chains = run_chains(factor, term);
    if chains == 0 {
        return;
    }
    let mut group = criterion.benchmark_group("peak");
    group.throughput(Throughput::Elements((2 * 8 * chains * LINKS) as u64));
    group.bench_function("fused multiply-adds/1 threads", |b| b.iter(|| run_chains(factor, term)));
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_secs(1))
        .measurement_time(Duration::from_secs(3));
    targets = peak, batches, motors, events, ground, rollers, perception
}
criterion_main!(benches);
