//! One step and one reset of each model: `cargo bench --bench models`.

use ballbot_core::{Ballbot, ModelKind, Params, State, attitude};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::{Vector2, Vector3};
use std::time::{Duration, Instant};

/// Time step of all models, s.
const SIM_DT: f64 = 0.001;

/// Steps from one start to the next: 0.2 s, in which the robot neither comes to rest nor falls.
const RUN: u64 = 200;

/// Leaning, rolling and turning.
fn start(params: &Params) -> State {
    let body = attitude(Vector2::new(0.03, -0.05), 0.6);
    State::rolling(params, Vector2::new(0.1, -0.05), 0.2, body, Vector3::new(0.2, -0.1, 0.3))
}

/// Time of `steps` steps in mid-motion; the resets between them are not counted.
fn time_steps(robot: &mut Ballbot, steps: u64) -> Duration {
    let start = start(robot.params());
    let mut spent = Duration::ZERO;
    let mut left = steps;
    while left > 0 {
        robot.reset(&start).expect("every model can start from here");
        let run = left.min(RUN);
        let begin = Instant::now();
        for _ in 0..run {
            robot.step([0.02, -0.01, 0.01], 1).expect("the robot does not diverge");
        }
        spent += begin.elapsed();
        left -= run;
    }
    spent
}

fn models(criterion: &mut Criterion) {
    let params = Params::paper();
    let mut group = criterion.benchmark_group("model");
    group.throughput(Throughput::Elements(1));
    for kind in ModelKind::ALL {
        let mut robot = Ballbot::new(&params, kind, SIM_DT).expect("the paper's robot can be built");
        group.bench_function(format!("step/{kind}"), |b| b.iter_custom(|steps| time_steps(&mut robot, steps)));
        let start = start(&params);
        group.bench_function(format!("reset/{kind}"), |b| b.iter(|| robot.reset(&start)));
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(2));
    targets = models
}
criterion_main!(benches);
