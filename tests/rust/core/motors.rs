//! Motors and sensors of environments: closed forms of each effect, and what batches do with their memory.

mod batches;
mod closed_forms;
mod gravity;
mod jitter;
mod measured;
mod options;
mod rates;
mod readings;
mod sensing;
mod wheels;

use ballbot_core::actuator::{Actuator, MotorOptions, Motors};
use ballbot_core::lanes::{Memory, Scalar};
use ballbot_core::{ModelKind, Params, Wheels};

/// Torque of an action of 1, N·m.
const TORQUE: f64 = 0.5;

/// Every effect at once, in model steps of 2 ms; the delay is not a whole number of control steps of 10 ms.
fn everything() -> MotorOptions {
    MotorOptions {
        delay: 0.026,
        strength: [0.9, 1.0, 1.1],
        lag: 0.007,
        stall_torque: 0.6,
        no_load_speed: 40.0,
        speed_limit: 20.0,
        peak_torque: 0.4,
        delay_jitter: 0.0,
    }
}

/// The models that are compiled, and how many robots of each: for `contact` a block of eight and part of another.
fn models() -> Vec<(ModelKind, usize)> {
    let mut models = vec![(ModelKind::Planar, 3), (ModelKind::Spatial, 3), (ModelKind::Contact, 11)];
    if cfg!(feature = "rigid") {
        models.push((ModelKind::Rigid, 3));
    }
    models
}

/// Motors of one robot with their memory.
struct Shaft {
    motors: Motors,
    memory: Vec<f64>,
}

impl Shaft {
    /// Motors of the paper's robot whose command of 1 is `action_torque`.
    fn new(options: &MotorOptions, action_torque: f64, sim_dt: f64, substeps: usize) -> Self {
        let motors = Motors::new(options, &Params::paper(), action_torque, sim_dt, substeps).unwrap();
        Self { memory: vec![0.0; motors.memory_len()], motors }
    }

    /// Torques of the next model step.
    fn torques(&mut self, commands: [f64; 3], speeds: [f64; 3]) -> [f64; 3] {
        self.motors.torques(Wheels(commands), Wheels(speeds), &mut Memory::<f64>::new(Scalar, &mut self.memory)).0
    }
}
