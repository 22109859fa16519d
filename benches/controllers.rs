//! One call of each controller, for one robot and for eight: `cargo bench --bench controllers`.
//!
//! Calm robots stay within the traction; for wild robots the torques are scaled down, and `mpc` iterates.

use ballbot_core::control::{Controller, LaneSetpoint, Setpoint, controller_kinds};
use ballbot_core::lanes::{EIGHT, Eight};
use ballbot_core::{LaneState, Params, State, planning};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::Vector2;
use std::time::Duration;

/// Robots at rest with tilts around the compass, rad.
fn robots(params: &Params, tilt: f64) -> LaneState<Eight> {
    let mut all = LaneState::default();
    for i in 0..EIGHT {
        let angle = 0.7 * i as f64;
        all.set_lane(i, &LaneState::from(&State::tilted(params, Vector2::new(angle.cos(), angle.sin()) * tilt, 0.1)));
    }
    all
}

fn calls(criterion: &mut Criterion) {
    planning::register().expect("its name is not taken");
    let params = Params::paper();
    let mut setpoints = LaneSetpoint::default();
    (0..EIGHT).for_each(|i| setpoints.set_lane(i, &(&Setpoint::default()).into()));
    for (kind, tilts) in [("calm", 0.02), ("wild", 0.35)] {
        let states = robots(&params, tilts);
        let mut group = criterion.benchmark_group(format!("controller/{kind}"));
        for known in controller_kinds() {
            let control_dt = known.control_dt.unwrap_or(0.01);
            let law =
                (known.make)(&params, control_dt, &known.limits, &[]).expect("the paper's robot can be controlled");
            let law: &dyn Controller = law.as_ref();
            let mut one = vec![0.0; law.memory_len()];
            let (state, setpoint) = (states.lane(0), setpoints.lane(0));
            group.throughput(Throughput::Elements(1));
            group.bench_function(BenchmarkId::new(known.name, "one"), |b| {
                b.iter(|| law.torques_one(&state, &setpoint, f64::INFINITY, &mut one));
            });
            let mut eight = vec![Eight::default(); law.memory_len()];
            group.throughput(Throughput::Elements(EIGHT as u64));
            group.bench_function(BenchmarkId::new(known.name, "eight"), |b| {
                b.iter(|| law.torques_eight(&states, &setpoints, f64::INFINITY, &mut eight));
            });
        }
        group.finish();
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default().warm_up_time(Duration::from_millis(200)).measurement_time(Duration::from_secs(1));
    targets = calls
}
criterion_main!(benches);
