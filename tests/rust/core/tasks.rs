//! The tasks with commands: contracts that hold for every task ([`contract`]), and the commands of each.

mod contract;
mod goal;
mod integral;
mod path;
mod push;
mod scaled;
mod traverse;
mod velocity;

use crate::run::Run;
use ballbot_core::batch::{Autoreset, TaskConfig, Under, task_kind};
use ballbot_core::control::{Lqr, Setpoint};
use ballbot_core::task::ACTION_LEN;
use ballbot_core::{Params, State};

const SEED: u64 = 7;

/// Robots of a task under the motors' full torque, rows in their units. By its name: a task that is named as a type is
/// compiled again for these tests.
fn config(task: &str, options: &[(&str, &[f64])]) -> Box<dyn TaskConfig> {
    let mut config = task_kind(task).unwrap().config();
    config.set("scale_observations", &[0.0]).unwrap();
    config.set("max_wheel_torque", &[Params::paper().max_wheel_torque]).unwrap();
    options.iter().for_each(|(name, values)| config.set(name, values).unwrap());
    config
}

fn run_of(config: &dyn TaskConfig, n: usize) -> Run {
    Run::new(config.batch(n, Autoreset::SameStep, Some(1), SEED).unwrap())
}

/// Steps under the regulator with the setpoints of the task, and the result of each.
fn regulate(run: &mut Run, steps: usize, mut after: impl FnMut(usize, &mut Run)) {
    let lqr = Lqr::new(&Params::paper(), run.batch.control_dt()).unwrap();
    let mut actions = vec![0.0; run.batch.len() * ACTION_LEN];
    for k in 0..steps {
        run.step_under(&Under::new(&lqr), &mut actions).unwrap();
        after(k, run);
    }
}

fn command(run: &Run, i: usize) -> Vec<f64> {
    let mut command = vec![0.0; run.batch.task().command.len()];
    run.batch.command(i, &mut command).unwrap();
    command
}

fn metrics(run: &Run, i: usize) -> Vec<f64> {
    let mut metrics = vec![0.0; run.batch.task().metrics.len()];
    run.batch.metrics(i, &mut metrics).unwrap();
    metrics
}

/// At rest, upright, at a position on the floor.
fn standing(x: f64, y: f64, yaw: f64) -> State {
    let params = Params::paper();
    let mut state = State::tilted(&params, nalgebra::Vector2::zeros(), yaw);
    for position in [&mut state.ball_position, &mut state.body_position] {
        position.x += x;
        position.y += y;
    }
    state
}

fn reset_to(run: &mut Run, starts: &[Option<State>]) {
    let request = ballbot_core::batch::ResetRequest { starts: Some(starts), ..Default::default() };
    run.batch.reset_with(&request, &mut run.observations).unwrap();
}

/// The setpoint of a task at rest.
fn at_rest(x: f64, y: f64) -> Setpoint {
    Setpoint { position: nalgebra::Vector2::new(x, y), ..Setpoint::default() }
}
