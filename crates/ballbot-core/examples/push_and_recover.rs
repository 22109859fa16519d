//! Pushes a balancing ballbot of rigid bodies and prints how far it leans, how far it rolls and when it is back.
//!
//! ```text
//! cargo run --release --example push_and_recover           # 0.25 N·s
//! cargo run --release --example push_and_recover -- 0.5    # a harder push, N·s
//! ```

use ballbot_core::control::{Controller, Lqr, Setpoint};
use ballbot_core::{Ballbot, ModelKind, Params};
use nalgebra::Vector3;
use std::error::Error;
use std::process::ExitCode;

/// Time step of the simulation and time between two decisions of the controller, s.
const SIM_DT: f64 = 0.001;
const CONTROL_DT: f64 = 0.005;

fn run() -> Result<(), Box<dyn Error>> {
    let impulse = std::env::args().nth(1).unwrap_or_else(|| "0.25".into());
    let impulse: f64 = impulse.parse().map_err(|_| format!("push '{impulse}' is not a number of N·s"))?;

    let params = Params::paper();
    // A new robot is upright at rest at the origin.
    let mut robot = Ballbot::new(&params, ModelKind::Rigid, SIM_DT)?;
    let mut lqr = Lqr::new(&params, CONTROL_DT)?;
    robot.push(&Vector3::new(impulse, 0.0, 0.0), None)?;

    let (mut largest_tilt, mut excursion, mut recovered) = (0.0_f64, 0.0_f64, 0.0);
    while robot.time() < 6.0 {
        let torques = lqr.wheel_torques(&robot.state(), &Setpoint::default());
        robot.step(torques, (CONTROL_DT / SIM_DT).round() as usize)?;
        let (tilt, distance) = (robot.state().tilt().to_degrees(), robot.state().ball_position.xy().norm());
        largest_tilt = largest_tilt.max(tilt);
        excursion = excursion.max(distance);
        if tilt > 0.5 || distance > 0.01 {
            recovered = robot.time();
        }
        if robot.bot_on_floor() {
            return Err(format!("{impulse} N·s: the robot lies on the floor after {:.2} s", robot.time()).into());
        }
    }
    println!("push            {impulse:8.2} N·s");
    println!("largest tilt    {largest_tilt:8.2} deg");
    println!("excursion       {:8.1} mm", 1e3 * excursion);
    println!("recovered after {recovered:8.2} s (tilt below 0.5 deg and ball within 10 mm from then on)");
    Ok(())
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}
