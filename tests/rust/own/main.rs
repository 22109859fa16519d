//! Tasks, controllers, stages and instruments of another crate, and registration of names, which holds for the whole process.

mod mppi;
mod nmpc;
mod own_instrument;
mod own_stages;
mod own_task;
#[path = "../support/run.rs"]
mod run;
