//! Tasks, controllers and stages of another crate, and what registers a name, which is there for the whole process.

mod mppi;
mod own_stages;
mod own_task;
#[path = "../support/run.rs"]
mod run;
