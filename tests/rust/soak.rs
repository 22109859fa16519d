//! Long runs with everything random at once: rough ground, hard events, ripple of the rollers, motors with delay, sensors with
//! latency, scans and pictures with dropouts, goals, torques, pushes, resets and throws out of bounds. Nothing may panic, all
//! numbers are finite and within their bounds, only thrown robots diverge, and memory does not grow.
//!
//! An ordinary test run takes a few seconds; `make soak` sets `BALLBOT_SOAK_RIGID` and `BALLBOT_SOAK_CONTACT`, the time
//! steps of the two models.

use ballbot_core::actuator::MotorOptions;
use ballbot_core::batch::{Autoreset, Batch, EnvConfig, History, Observation, Outcome, StepBuffers, load_events};
use ballbot_core::perception::{DepthOptions, Instruments, LidarOptions, ScanOptions};
use ballbot_core::sensor::SensorOptions;
use ballbot_core::task::{ACTION_LEN, DIVERGED, Goal};
use ballbot_core::terrain::Terrain;
use ballbot_core::{Error, ModelKind, Params};
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

const NUM_ENVS: usize = 64;
const NUM_THREADS: usize = 2;

/// Default count of time steps.
const RIGID_STEPS: usize = 20_000;
const CONTACT_STEPS: usize = 200_000;

/// Largest magnitude of an observation: rows are scaled, readings of instruments are in meters.
const LARGEST: f32 = 10.0;

/// Largest command of a goal, m.
const FARTHEST: f64 = 1.0;

/// Largest growth of resident memory after a tenth of the run, KiB.
const MEMORY: i64 = 4096;

/// Largest number of a state, in SI units.
const MAX_MAGNITUDE: f64 = 1e9;

/// How an episode that reached its length ended.
const LASTED: &str = "at its full length";

/// A push that a robot may survive, and a push that throws it out of bounds, N·s.
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
    /// Episodes by their reason for ending, [`LASTED`] for none.
    ends: BTreeMap<&'static str, usize>,
}

impl Soak {
    fn new(model: ModelKind) -> Self {
        let ground = [("size_x", 4.0), ("size_y", 4.0), ("slope", 0.1)];
        let config = EnvConfig::<Goal> {
            params: Params { roller_ripple: 5e-4, floor_rolling_friction: 1e-4, ..Params::paper() },
            model,
            max_episode_steps: 60,
            max_wheel_torque: Some(2.0),
            terrain: Some(Arc::new(Terrain::generate("noise", 3, &ground).unwrap())),
            actuators: MotorOptions { delay: 0.004, delay_jitter: 0.004, lag: 0.005, ..MotorOptions::default() },
            sensors: Some(SensorOptions {
                gyro_noise: 1e-3,
                gyro_bias: 0.02,
                gyro_bias_walk: 1e-3,
                accelerometer_noise: 1e-2,
                accelerometer_bias: 0.1,
                imu_misalignment: 0.01,
                encoder_ticks: 4096.0,
                latency: 0.02,
                ..SensorOptions::default()
            }),
            instruments: Instruments::default()
                .with(ScanOptions {
                    points: [5.0, 4.0],
                    noise: 0.01,
                    dropout: 0.1,
                    latency: 0.02,
                    ..Default::default()
                })
                .with(DepthOptions { size: [6.0, 4.0], dropout: 0.1, freeze: 0.05, ..Default::default() })
                .with(LidarOptions { beams: 12.0, noise: 0.01, dropout: 0.1, ..Default::default() }),
            observation: Observation::Sensors,
            history: History::Last(2),
            task: Goal { fall_tilt: 1.5, ..Goal::default() },
            events: load_events("hard").unwrap(),
            ..EnvConfig::default()
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
            ends: BTreeMap::new(),
        };
        soak.batch.reset(None, &mut soak.observations).unwrap();
        soak.batch.stagger();
        soak
    }

    /// Disturbances between two steps.
    fn disturb(&mut self) -> Result<(), Error> {
        // Torques that last a few steps; otherwise they would cancel.
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
        if self.rng.random_bool(0.2) {
            let goal = [0, 1].map(|_| self.rng.random_range(-FARTHEST..=FARTHEST));
            self.batch.set_command(self.rng.random_range(0..NUM_ENVS), &goal)?;
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
        let largest =
            self.observations.iter().fold(0.0, |most: f32, v| if v.is_nan() { f32::NAN } else { most.max(v.abs()) });
        assert!(largest <= LARGEST, "{model}: an observation is {largest}");
        let i = self.rng.random_range(0..NUM_ENVS);
        let (state, estimate, contacts) = (self.batch.state(i)?, self.batch.estimate(i)?, self.batch.contacts(i)?);
        let forces = [contacts.wheel_normal_forces, contacts.wheel_tractions, contacts.wheel_slip_speeds];
        let numbers = state.to_array().into_iter().chain(estimate.to_array()).chain(forces.into_iter().flatten());
        let worst = numbers.chain(contacts.floor_force.iter().copied()).find(|v| v.abs() > MAX_MAGNITUDE || v.is_nan());
        assert!(worst.is_none(), "{model}: environment {i} has {worst:?}");
        assert!(self.rewards.iter().all(|v| v.is_finite()), "{model}: a reward is not finite");
        for (i, outcome) in self.outcomes.iter().enumerate() {
            if let Some(reason) = outcome.terminated {
                *self.ends.entry(reason).or_default() += 1;
                assert!(reason != DIVERGED || self.thrown[i], "{model}: environment {i} diverged by itself");
            }
            *self.ends.entry(LASTED).or_default() += usize::from(outcome.truncated);
        }
        self.thrown.fill(false);
        Ok(())
    }
}

/// Resident memory of this process, KiB; `None` where the system does not report it.
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
    let seconds = start.elapsed().as_secs_f64();
    println!("{model}: {} steps in {seconds:.1} s; episodes by their end: {:?}", rounds * per_step, soak.ends);
    if let (Some(before), Some(after)) = (warm, resident()) {
        println!("{model}: {before} KiB resident after a tenth, {after} KiB at the end");
        assert!(after - before <= MEMORY, "{model}: memory grew from {before} to {after} KiB");
    }
    let ended = |reason: &str| soak.ends.get(reason).copied().unwrap_or(0);
    assert!(ended(DIVERGED) > 0 && ended(LASTED) > 10 && soak.ends.len() > 2, "episodes are missing: {:?}", soak.ends);
}

/// One after the other: each monitors the memory of the whole process.
#[test]
fn long_runs_are_finite_with_constant_memory() {
    let steps =
        |name: &str, default| std::env::var(name).map_or(default, |text| text.parse().expect("a number of steps"));
    run(ModelKind::Rigid, steps("BALLBOT_SOAK_RIGID", RIGID_STEPS));
    run(ModelKind::Contact, steps("BALLBOT_SOAK_CONTACT", CONTACT_STEPS));
}
