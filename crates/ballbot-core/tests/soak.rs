//! Long runs under random torques, pushes, resets and throws out of bounds. Nothing may panic, all numbers are finite, only
//! thrown robots diverge, and memory does not grow.
//!
//! An ordinary test run takes a few seconds of it; `make soak` sets `BALLBOT_SOAK_STEPS`, the time steps of `rigid` (of
//! `contact` it takes ten times as many).

use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, Outcome, StepBuffers};
use ballbot_core::task::{ACTION_LEN, Balance, DIVERGED};
use ballbot_core::{Error, ModelKind};
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::time::Instant;

const NUM_ENVS: usize = 64;
const NUM_THREADS: usize = 2;

/// Time steps of `rigid` where nothing else is asked for.
const STEPS: usize = 20_000;

/// Largest growth of resident memory after a tenth of the run, KiB.
const MEMORY: i64 = 4096;

/// A push that a robot may survive, and one that throws it out of bounds, N·s.
const PUSH: f64 = 1.0;
const THROW: f64 = 1e3;

struct Soak {
    batch: Batch,
    rng: ChaCha8Rng,
    actions: Vec<f32>,
    observations: Vec<f32>,
    last: Vec<f32>,
    rewards: Vec<f64>,
    terminated: Vec<bool>,
    truncated: Vec<bool>,
    outcomes: Vec<Outcome>,
    /// Environments thrown since the last step.
    thrown: Vec<bool>,
    ends: [usize; 4],
}

impl Soak {
    fn new(model: ModelKind) -> Self {
        let config = BalanceConfig {
            model,
            max_episode_steps: 60,
            max_wheel_torque: Some(2.0),
            task: Balance { fall_tilt: 1.5, ..Balance::default() },
            ..BalanceConfig::default()
        };
        let batch = Batch::new(&config, NUM_ENVS, Autoreset::NextStep, Some(NUM_THREADS), 1).unwrap();
        let rows = batch.observation_len();
        let mut soak = Self {
            batch,
            rng: ChaCha8Rng::seed_from_u64(7),
            actions: vec![0.0; NUM_ENVS * ACTION_LEN],
            observations: vec![0.0; NUM_ENVS * rows],
            last: vec![0.0; NUM_ENVS * rows],
            rewards: vec![0.0; NUM_ENVS],
            terminated: vec![false; NUM_ENVS],
            truncated: vec![false; NUM_ENVS],
            outcomes: vec![Outcome::default(); NUM_ENVS],
            thrown: vec![false; NUM_ENVS],
            ends: [0; 4],
        };
        soak.batch.reset(None, &mut soak.observations).unwrap();
        soak.batch.stagger();
        soak
    }

    /// Disturbances between two steps.
    fn disturb(&mut self) -> Result<(), Error> {
        // Torques that last a few steps, or they would cancel.
        for action in &mut self.actions {
            if self.rng.random_bool(0.1) {
                // Calm often enough for some to survive to the end.
                let most = if self.rng.random_bool(0.2) { 1.0_f32 } else { 0.02 };
                *action = self.rng.random_range(-most..=most);
            }
        }
        let i = self.rng.random_range(0..NUM_ENVS);
        let mut vector = |most: f64| Vector3::from_fn(|_, _| self.rng.random_range(-most..=most));
        let (impulse, point) = (vector(PUSH), vector(0.5));
        self.batch.push(i, &impulse, Some(&point))?;
        if self.rng.random_bool(0.05) {
            let impulse = Vector3::new(THROW, 0.0, 0.0);
            self.batch.push(i, &impulse, None)?;
            self.thrown[i] = true;
        }
        if self.rng.random_bool(0.02) {
            let mask: Vec<bool> = (0..NUM_ENVS).map(|_| self.rng.random_bool(0.1)).collect();
            self.batch.reset(Some(&mask), &mut self.observations)?;
            self.thrown.iter_mut().zip(&mask).for_each(|(thrown, &reset)| *thrown &= !reset);
        }
        Ok(())
    }

    fn step(&mut self) -> Result<(), Error> {
        self.disturb()?;
        let mut buffers = StepBuffers {
            observations: &mut self.observations,
            rewards: &mut self.rewards,
            terminated: &mut self.terminated,
            truncated: &mut self.truncated,
            final_observations: &mut self.last,
            outcomes: &mut self.outcomes,
        };
        self.batch.step(&self.actions, &mut buffers)?;
        let model = self.batch.model();
        assert!(self.observations.iter().all(|v| v.is_finite()), "{model}: an observation is not finite");
        assert!(self.rewards.iter().all(|v| v.is_finite()), "{model}: a reward is not finite");
        for (i, outcome) in self.outcomes.iter().enumerate() {
            if let Some(reason) = outcome.terminated {
                let reasons = &self.batch.task().terminations;
                let reason_index = reasons.iter().position(|(name, _)| *name == reason).expect("a described reason");
                self.ends[reason_index] += 1;
                assert!(reason != DIVERGED || self.thrown[i], "{model}: environment {i} diverged by itself");
            }
            self.ends[3] += usize::from(outcome.truncated);
        }
        self.thrown.fill(false);
        Ok(())
    }
}

/// Resident memory of this process, KiB; none where the system does not report it.
fn resident() -> Option<i64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    line.split_whitespace().next()?.parse().ok()
}

fn run(model: ModelKind, steps: usize) {
    let mut soak = Soak::new(model);
    let per_step = NUM_ENVS * soak.batch.substeps();
    let rounds = steps.div_ceil(per_step);
    let mut warm = None;
    let start = Instant::now();
    for round in 0..rounds {
        if round == rounds / 10 {
            warm = resident();
        }
        soak.step().unwrap();
    }
    let [tilted, floor, diverged, lasted] = soak.ends;
    let seconds = start.elapsed().as_secs_f64();
    println!(
        "{model}: {} steps in {seconds:.1} s; episodes ended {tilted} by tilt, {floor} on the floor, {diverged} diverged, \
         {lasted} at full length",
        rounds * per_step
    );
    if let (Some(before), Some(after)) = (warm, resident()) {
        println!("{model}: {before} KiB resident after a tenth, {after} KiB at the end");
        assert!(after - before <= MEMORY, "{model}: memory grew from {before} to {after} KiB");
    }
    assert!(floor > 10 && diverged > 0 && lasted > 0, "too few episodes of some kind: {:?}", soak.ends);
}

/// One after the other: each watches the memory of the whole process.
#[test]
fn long_runs_are_finite_with_constant_memory() {
    let steps = std::env::var("BALLBOT_SOAK_STEPS").map_or(STEPS, |text| text.parse().expect("a number of steps"));
    run(ModelKind::Rigid, steps);
    run(ModelKind::Contact, 10 * steps);
}
