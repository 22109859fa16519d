//! Steps of whole batches, resets included: `cargo bench -p ballbot-core --bench batch`. An element is one environment's
//! control step (five model steps).

use ballbot_core::ModelKind;
use ballbot_core::env::{ACTION_LEN, Autoreset, BalanceConfig, Batch, OBSERVATION_LEN, Outcome, StepBuffers};
use criterion::{Criterion, SamplingMode, Throughput, criterion_group, criterion_main};
use std::time::Duration;

/// A batch with somewhere to write to.
struct Runner {
    batch: Batch,
    actions: Vec<f32>,
    observations: Vec<f32>,
    final_observations: Vec<f32>,
    rewards: Vec<f32>,
    terminated: Vec<bool>,
    truncated: Vec<bool>,
    outcomes: Vec<Outcome>,
}

impl Runner {
    /// `threads` as for [`Batch::new`].
    fn new(model: ModelKind, n: usize, threads: Option<usize>) -> Self {
        let config = BalanceConfig { model, ..BalanceConfig::default() };
        let mut batch = Batch::new(&config, n, Autoreset::NextStep, threads, 0).expect("the default task is valid");
        let mut observations = vec![0.0; n * OBSERVATION_LEN];
        batch.reset(None, &mut observations).expect("the buffer fits");
        Self {
            batch,
            // Each robot drifts its own way until it falls and is reset.
            actions: (0..n * ACTION_LEN).map(|i| 0.05 * (i as f32).sin()).collect(),
            final_observations: observations.clone(),
            observations,
            rewards: vec![0.0; n],
            terminated: vec![false; n],
            truncated: vec![false; n],
            outcomes: vec![Outcome::default(); n],
        }
    }

    fn step(&mut self) {
        let mut buffers = StepBuffers {
            observations: &mut self.observations,
            rewards: &mut self.rewards,
            terminated: &mut self.terminated,
            truncated: &mut self.truncated,
            final_observations: &mut self.final_observations,
            outcomes: &mut self.outcomes,
        };
        self.batch.step(&self.actions, &mut buffers).expect("actions are finite and buffers fit");
    }
}

fn batches(criterion: &mut Criterion) {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let mut group = criterion.benchmark_group("batch");
    group.sampling_mode(SamplingMode::Flat);
    for model in [ModelKind::Spatial, ModelKind::Rigid] {
        for n in [1, 64, 1024] {
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

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_secs(1))
        .measurement_time(Duration::from_secs(3));
    targets = batches
}
criterion_main!(benches);
