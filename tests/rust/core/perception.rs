//! Instruments against closed forms, and in environments.

mod batches;
mod depth;
mod lidar;
mod scan;

use crate::run::Run;
use ballbot_core::ModelKind;
use ballbot_core::batch::{Autoreset, ResetRequest, TaskConfig, task_kind};
use ballbot_core::terrain::Terrain;
use ballbot_core::{Ballbot, Params, State};
use nalgebra::Vector2;
use std::sync::Arc;

/// Options of robots without a task, whose episodes do not end.
fn bare(terrain: Option<&Arc<Terrain>>) -> Box<dyn TaskConfig> {
    let mut config = task_kind("bare").unwrap().config();
    config.set_terrain(terrain.cloned());
    config.set("scale_observations", &[0.0]).unwrap();
    config
}

fn made(config: &dyn TaskConfig, n: usize, threads: usize) -> Run {
    Run::new(config.batch(n, Autoreset::SameStep, Some(threads), 5).unwrap())
}

/// One environment that begins in a state.
fn begun(config: &dyn TaskConfig, start: &State) -> Run {
    let mut run = made(config, 1, 1);
    let starts = [Some(start.clone())];
    run.batch.reset_with(&ResetRequest { starts: Some(&starts), ..Default::default() }, &mut run.observations).unwrap();
    run
}

/// The paper's robot at rest on a terrain.
fn standing(terrain: Option<&Arc<Terrain>>, place: [f64; 2], yaw: f64, tilt: [f64; 2]) -> State {
    let mut robot = Ballbot::new(&Params::paper(), ModelKind::Contact, 0.002).unwrap();
    robot.set_terrain(terrain).unwrap();
    robot.place_on_ground(place[0], place[1], yaw, Some(Vector2::from(tilt))).unwrap();
    robot.state()
}

fn hills() -> Arc<Terrain> {
    Arc::new(Terrain::generate("noise", 3, &[("slope", 0.2), ("wavelength", 1.0)]).unwrap())
}

/// Actions that move robots about and push some over.
fn drive(run: &mut Run, k: usize) {
    let actions: Vec<f32> =
        (0..3 * run.batch.len()).map(|i| ((i / 3 * 7 + i % 3 * 2 + k / 3) % 5) as f32 * 0.2 - 0.4).collect();
    run.step(&actions).unwrap();
}
