//! Tests that need no separate process: one program, since each program links the whole library.

mod batch;
mod closed_loop;
mod control;
mod crowd;
mod different_robots;
mod environment;
mod forces;
mod general_body;
mod inverse_dynamics;
mod kinematics;
mod laws;
mod limits;
#[path = "../support/motion.rs"]
mod motion;
mod motors;
mod newton_euler;
mod obstacles;
mod params;
mod payload;
mod perception;
mod perturbed_floor;
mod planar;
mod policy;
mod presets;
mod properties;
mod randomization;
mod references;
mod render;
mod riccati;
mod robot;
#[path = "../support/run.rs"]
mod run;
mod simulation;
mod spatial;
mod stage;
#[path = "../support/mod.rs"]
mod support;
mod tasks;
mod terrain;
mod traction;
mod urdf;
mod web;
