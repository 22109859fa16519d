//! Stages of the caller: terms, rows and terminations on tasks of the core.

use crate::run::{Run, actions};
use ballbot_core::batch::{
    Autoreset, Batch, BatchStage, CustomStage, EnvConfig, Environment, ROBOT_ROW_LEN, RobotRows, StageLayout,
    StageResults, Under,
};
use ballbot_core::control::Lqr;
use ballbot_core::task::{Bare, Row, Task, Term, Velocity};
use ballbot_core::{Error, ModelKind, Result};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Costs the wheel speeds, shows the yaw rate, and ends episodes in which the ball is fast.
struct Spin {
    layout: StageLayout,
    fails: AtomicBool,
}

/// Columns of wheel speeds and ball velocity in [`RobotRows::truth`].
const WHEELS: usize = 6;
const VELOCITY: usize = 15;

const FAST: f32 = 0.1;

impl Spin {
    fn new() -> Arc<Self> {
        let layout = StageLayout {
            terms: vec![Term::cost("spin", 0.5, "wheel speeds²")],
            rows: vec![Row::new("body rate", "rad/s", 3.0, 1.0), Row::new("steps", "", 1e3, 10.0)],
            terminations: vec![("fast", "the ball is faster than 0.1 m/s")],
            ..Default::default()
        };
        Arc::new(Self { layout, fails: AtomicBool::new(false) })
    }

    fn rows(&self, observed: &[f32], steps: &[i64], rows: &mut [f64]) {
        for ((robot, steps), out) in observed.chunks_exact(ROBOT_ROW_LEN).zip(steps).zip(rows.chunks_exact_mut(2)) {
            out.copy_from_slice(&[f64::from(robot[5]), *steps as f64]);
        }
    }
}

fn observed<'a>(robots: &RobotRows<'a>) -> &'a [f32] {
    if robots.observed.is_empty() { robots.truth } else { robots.observed }
}

impl BatchStage for Spin {
    fn layout(&self) -> &StageLayout {
        &self.layout
    }

    fn begin(&self, robots: &RobotRows<'_>, rows: &mut [f64]) -> Result<()> {
        assert!(robots.steps.iter().all(|steps| *steps == 0));
        self.rows(observed(robots), robots.steps, rows);
        Ok(())
    }

    fn step(&self, robots: &RobotRows<'_>, results: &mut StageResults<'_>) -> Result<()> {
        if self.fails.load(Ordering::Relaxed) {
            return Err(Error::Inconsistent("the stage fails".into()));
        }
        for (i, robot) in robots.truth.chunks_exact(ROBOT_ROW_LEN).enumerate() {
            results.terms[i] = robot[WHEELS..][..3].iter().map(|speed| f64::from(speed * speed)).sum();
            results.terminations[i] = u32::from(robot[VELOCITY].hypot(robot[VELOCITY + 1]) > FAST);
        }
        self.rows(observed(robots), robots.steps, results.rows);
        Ok(())
    }

    fn observe(&self, robots: &RobotRows<'_>, rows: &mut [f64]) -> Result<()> {
        self.rows(robots.truth, robots.steps, rows);
        Ok(())
    }
}

fn config<T: Task>(model: ModelKind, stage: Option<&Arc<Spin>>) -> EnvConfig<T> {
    EnvConfig {
        model,
        max_episode_steps: 30,
        stage: stage.map(|stage| CustomStage(Arc::clone(stage) as Arc<dyn BatchStage>)),
        ..Default::default()
    }
}

fn run<T: Task>(config: &EnvConfig<T>, n: usize, autoreset: Autoreset, threads: usize) -> Run {
    Run::new(Batch::new(config, n, autoreset, Some(threads), 5).unwrap())
}

#[test]
fn robots_of_a_batch_equal_single_robots() {
    let n = 11;
    for autoreset in [Autoreset::SameStep, Autoreset::NextStep] {
        for model in [ModelKind::Contact, ModelKind::Spatial] {
            let config = config::<Velocity>(model, Some(&Spin::new()));
            let mut many = run(&config, n, autoreset, 2);
            let mut alone: Vec<_> =
                (0..n).map(|i| Run::new(Batch::new(&config, 1, autoreset, Some(1), 5 + i as u64).unwrap())).collect();
            let mut reasons = std::collections::BTreeSet::new();
            for k in 0..120 {
                many.step(&actions(0, n, k, 0.4)).unwrap();
                for (i, one) in alone.iter_mut().enumerate() {
                    one.step(&actions(i, 1, k, 0.4)).unwrap();
                    assert_eq!(one.bits(0), many.bits(i), "{model}, environment {i}, step {k}");
                    reasons.insert(one.outcomes[0].terminated);
                }
            }
            assert!(reasons.contains(&Some("fast")) && reasons.contains(&None));
        }
    }
}

#[test]
fn results_match_the_stage_and_the_task_is_unchanged() {
    let n = 9;
    let mut plain = run(&config::<Velocity>(ModelKind::Contact, None), n, Autoreset::Disabled, 1);
    let stage = Spin::new();
    let mut staged = run(&config::<Velocity>(ModelKind::Contact, Some(&stage)), n, Autoreset::Disabled, 1);
    let (rows, terms) = (plain.batch.observation_len(), plain.batch.task().terms.len());
    assert_eq!(staged.batch.observation_len(), rows + 2);
    for k in 0..30 {
        let actions = actions(0, n, k, 0.2);
        plain.step(&actions).unwrap();
        staged.step(&actions).unwrap();
        for i in 0..n {
            let state = staged.batch.state(i).unwrap();
            assert_eq!(plain.batch.state(i).unwrap(), state);
            let (before, after) = (plain.observation(i), staged.observation(i));
            assert_eq!(before, &after[..rows]);
            let yaw_rate = state.body_angular_velocity.z.clamp(-3.0, 3.0);
            assert!((f64::from(after[rows]) - yaw_rate).abs() < 1e-6);
            assert_eq!(after[rows + 1], ((k + 1) as f32 / 10.0).min(10.0));
            let mut values = vec![0.0; terms + 1];
            staged.batch.reward_terms(i, &mut values).unwrap();
            let cost: f64 = state.wheel_speeds.iter().map(|speed| f64::from((*speed as f32).powi(2))).sum();
            assert!((values[terms] + 0.5 * cost).abs() <= 1e-6 * cost);
            assert!((staged.rewards[i] - plain.rewards[i] - values[terms]).abs() <= 1e-9 * cost.max(1.0));
            let is_fast = state.ball_velocity.xy().norm() > f64::from(FAST);
            assert_eq!(staged.terminated[i], is_fast || plain.terminated[i]);
            assert!(!is_fast || staged.truncated[i] == (plain.truncated[i] && !staged.terminated[i]));
        }
        let over: Vec<_> = (0..n).map(|i| staged.terminated[i] || staged.truncated[i]).collect();
        staged.reset(&over);
        // Snapshots differ; the same starts keep both together.
        if over.contains(&true) {
            break;
        }
    }
}

#[test]
fn a_single_stage_can_be_a_whole_task() {
    let config = config::<Bare>(ModelKind::Contact, Some(&Spin::new()));
    let mut run = run(&config, 5, Autoreset::SameStep, 1);
    assert_eq!(run.batch.observation_len(), 2);
    let lqr = Lqr::new(&config.params, config.control_dt).unwrap();
    let mut actions = vec![0.0; 15];
    for _ in 0..40 {
        run.step_under(&Under::new(&lqr), &mut actions).unwrap();
        assert!(run.rewards.iter().all(|reward| *reward <= 0.0));
    }
    let saved = run.snapshots();
    run.step(&actions).unwrap();
    let after = run.bits(0);
    run.batch.load(0, &saved[0]).unwrap();
    run.step(&actions).unwrap();
    assert_eq!(run.bits(0), after);
}

#[test]
fn after_an_error_all_environments_must_be_reset() {
    let stage = Spin::new();
    let mut run = run(&config::<Velocity>(ModelKind::Contact, Some(&stage)), 4, Autoreset::SameStep, 1);
    stage.fails.store(true, Ordering::Relaxed);
    assert!(run.step(&[0.0; 12]).unwrap_err().to_string().contains("the stage fails"));
    stage.fails.store(false, Ordering::Relaxed);
    assert!(run.step(&[0.0; 12]).unwrap_err().to_string().contains("reset"));
    run.reset(&[true; 4]);
    run.step(&[0.0; 12]).unwrap();
}

#[test]
fn taken_names_and_invalid_numbers_are_rejected() {
    type Change = fn(&mut StageLayout);
    let cases: [(&str, Change); 5] = [
        ("reward term 'velocity'", |layout| layout.terms[0].name = "velocity"),
        ("termination 'tilt'", |layout| layout.terminations[0].0 = "tilt"),
        ("observation row 'wheel speed 0'", |layout| layout.rows[0].name = "wheel speed 0"),
        ("bound of body rate = NaN", |layout| layout.rows[0].bound = f32::NAN),
        ("reward.spin = inf", |layout| layout.terms[0].scale = f64::INFINITY),
    ];
    for (message, change) in cases {
        let mut layout = Spin::new().layout.clone();
        change(&mut layout);
        let stage = Arc::new(Spin { layout, fails: AtomicBool::new(false) });
        let error = Batch::new(&config::<Velocity>(ModelKind::Contact, Some(&stage)), 2, Autoreset::SameStep, None, 0);
        let error = error.err().unwrap().to_string();
        assert!(error.contains(message), "{error}");
    }
    let error = Environment::new(&config::<Velocity>(ModelKind::Contact, Some(&Spin::new())), 0).err().unwrap();
    assert!(error.to_string().contains("a stage needs a Batch"));
}
