//! Lets a tilted ballbot balance itself and prints how it does.
//!
//! ```text
//! cargo run --release --example balance                    # rigid bodies, 5 degrees
//! cargo run --release --example balance -- spatial 10      # model (planar, spatial, contact, rigid) and tilt in degrees
//! ```

use ballbot_core::control::{Controller, Lqr, Setpoint};
use ballbot_core::{Ballbot, ModelKind, Params, State};
use nalgebra::Vector2;
use std::error::Error;
use std::process::ExitCode;

/// Time step of the simulation and time between two decisions of the controller, s.
const SIM_DT: f64 = 0.001;
const CONTROL_DT: f64 = 0.005;

fn run() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let model: ModelKind = args.next().as_deref().unwrap_or("rigid").parse()?;
    let degrees = args.next().unwrap_or_else(|| "5".into());
    let degrees: f64 = degrees.parse().map_err(|_| format!("tilt '{degrees}' is not a number of degrees"))?;

    let params = Params::paper();
    let mut robot = Ballbot::new(&params, model, SIM_DT)?;
    // A tilt about the y axis leans the mast towards +x: the ball must run that way to get under it.
    let tilt = Vector2::new(0.0, degrees.to_radians());
    robot.reset(&State::tilted(&params, tilt, 0.0))?;
    let mut lqr = Lqr::new(&params, CONTROL_DT)?;

    println!("model {model}, start {degrees} deg\n");
    println!("{:>6} {:>9} {:>8} {:>10} {:>12}", "time s", "tilt deg", "x mm", "speed m/s", "torque N·m");
    for step in 0..=400 {
        let state = robot.state();
        let torques = lqr.wheel_torques(&state, &Setpoint::default());
        if step % 20 == 0 {
            let largest = torques.iter().fold(0.0_f64, |largest, torque| largest.max(torque.abs()));
            println!(
                "{:6.2} {:9.3} {:8.2} {:10.3} {:12.3}",
                robot.time(),
                state.tilt().to_degrees(),
                1e3 * state.ball_position.x,
                state.ball_velocity.norm(),
                largest
            );
        }
        if robot.bot_on_floor() {
            return Err(format!("the robot lies on the floor after {:.2} s", robot.time()).into());
        }
        robot.step(torques, (CONTROL_DT / SIM_DT).round() as usize)?;
    }
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
