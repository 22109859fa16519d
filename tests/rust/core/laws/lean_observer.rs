//! The estimate of the equilibrium.

use super::lqi::offset;
use super::{CONTROL_DT, SIM_DT, around, lanes_equal_one_robot, law, made, position, recovers, robot, run};
use ballbot_core::control::{
    Controller, LaneSetpoint, LimitOptions, Lqr, LqrOptions, NamedLaw, ObserverOptions, Setpoint,
};
use ballbot_core::models::LinearModel;
use ballbot_core::{LaneState, ModelKind, Params, State, attitude};
use nalgebra::{SVector, Vector2, Vector3};

/// The laws that have the observer.
const OBSERVING: [&str; 5] = ["lqr", "lqr_pi", "mpc", "cascade_pid", "hierarchical_sliding_mode"];

const RATE: &[f64] = &[1.0];
const ON: &[(&str, &[f64])] = &[("lean_observer", RATE)];

/// First number of the observer in the memory of a law: θ̂₀ in the planes of x and y, then û₀.
fn first(controller: &dyn Controller) -> usize {
    controller.memory_len() - 11
}

/// Runs a law; returns the state and its memory.
fn settled(params: &Params, controller: &dyn Controller, seconds: f64, force: Vector3<f64>) -> (State, Vec<f64>) {
    let mut robot = robot(params, ModelKind::Contact, &State::at_equilibrium(params, 0.4));
    let mut memory = vec![0.0; controller.memory_len()];
    let setpoint = LaneSetpoint::from(&Setpoint { yaw: 0.4, ..Setpoint::default() });
    for _ in 0..(seconds / CONTROL_DT) as usize {
        let torques = controller.torques_one(&LaneState::from(&robot.state()), &setpoint, f64::INFINITY, &mut memory);
        for _ in 0..10 {
            robot.push(&(force * SIM_DT), None).unwrap();
            robot.step(torques, 1).unwrap();
        }
    }
    (robot.state(), memory)
}

/// In the linear model under a constant disturbance the error of the estimate decays by e^(−L T) per sample.
#[test]
fn the_estimate_converges_at_its_rate() {
    let params = Params::paper();
    let limits = LimitOptions { traction: None, ..LimitOptions::CAP };
    let (a, b) = LinearModel::new(&params).discretize(CONTROL_DT);
    let equilibrium = SVector::<f64, 10>::from_fn(|i, _| if i == 3 { 0.07 } else { 0.0 });
    let wheels = Lqr::new(&params, CONTROL_DT).unwrap().regulator().gain.column(3).into_owned();
    let resting = Vector3::from_column_slice(wheels.as_slice()) * 0.02;
    let resting_acceleration = (LinearModel::new(&params).b * resting)[8];
    for rate in [0.3, 1.0, 4.0] {
        let options = LqrOptions { observer: ObserverOptions { lean_observer: rate }, ..LqrOptions::default() };
        let lqr = Lqr::with_options(&params, CONTROL_DT, &options, &limits).unwrap();
        let mut memory = vec![0.0; lqr.memory_len()];
        let mut x = SVector::<f64, 10>::from_fn(|i, _| if i == 5 { 0.1 } else { 0.0 });
        for k in 0..200 {
            let body = attitude(Vector2::new(x[2], x[3]), 0.0);
            let turning = Vector3::new(x[7], x[8], x[9]);
            let mut state = State::rolling(&params, Vector2::new(x[5], x[6]), 0.0, body, turning);
            state.ball_position += Vector3::new(x[0], x[1], 0.0);
            let setpoint = LaneSetpoint::from(&Setpoint::default());
            let torques = lqr.torques_one(&LaneState::from(&state), &setpoint, f64::INFINITY, &mut memory).column();
            let left = (-rate * CONTROL_DT * f64::from(k)).exp();
            let (lean, acceleration) = (0.07 * (1.0 - left), resting_acceleration * (1.0 - left));
            assert!((memory[0] - lean).abs() < 1e-9, "{rate}, sample {k}: {} rad, expected {lean}", memory[0]);
            assert!((memory[2] - acceleration).abs() < 1e-7, "{} rad/s², expected {acceleration}", memory[2]);
            assert!(memory[1].abs() < 1e-12 && memory[3].abs() < 1e-10);
            x = a * (x - equilibrium) + b * (torques - resting) + equilibrium;
        }
    }
}

/// The lean puts the robot's center of mass above the contact; the torque holds the slope.
#[test]
fn on_a_slope_the_estimate_is_the_closed_form() {
    let params = Params { floor_tilt: [0.02, 0.03], ..Params::paper() };
    let driven = LinearModel::new(&params).b;
    for name in OBSERVING {
        let controller = made(name, &params, ON);
        let (state, memory) = settled(&params, controller.as_ref(), 30.0, Vector3::zeros());
        let tilt = params.slope_lean().unwrap();
        let at = first(controller.as_ref());
        let (lean, acceleration) = (&memory[at..at + 2], &memory[at + 2..at + 4]);
        // Leaning towards y turns about −x.
        assert!((lean[0] - tilt.y).abs() < 2e-5 && (lean[1] + tilt.x).abs() < 2e-5, "{name}: {lean:?}, {tilt}");
        let turning = driven * params.holding_torques(0.4).unwrap().column();
        let (sin, cos) = 0.4_f64.sin_cos();
        let expected = [cos * turning[8] + sin * turning[7], sin * turning[8] - cos * turning[7]];
        for axis in 0..2 {
            let off = acceleration[axis] - expected[axis];
            assert!(off.abs() < 0.02, "{name}: {acceleration:?} rad/s², expected {expected:?}");
        }
        assert!(state.ball_position.xy().norm() < 1e-4, "{name}: {} m left", state.ball_position.xy().norm());
    }
}

/// A wrong center of mass is a false tilt of atan(d/l), at which no torque is needed.
#[test]
fn for_a_wrong_center_of_mass_the_estimate_is_the_closed_form() {
    let nominal = Params::paper();
    let params = Params { body_com_offset: [5e-3, 0.0], ..Params::paper() };
    let controller = made("lqr", &nominal, ON);
    let (_, memory) = settled(&params, controller.as_ref(), 30.0, Vector3::zeros());
    let false_lean = (params.body_com_offset[0] / params.body_com_height).atan();
    let expected = [-false_lean * 0.4_f64.cos(), -false_lean * 0.4_f64.sin()];
    for axis in 0..2 {
        assert!((memory[axis] - expected[axis]).abs() < 2e-5, "{:?}, expected {expected:?}", &memory[..2]);
        assert!(memory[2 + axis].abs() < 5e-3, "{:?} rad/s²", &memory[2..4]);
    }
}

#[test]
fn disturbances_leave_no_offset() {
    let nominal = Params::paper();
    let slope = |degrees: f64| Params { floor_tilt: [0.0, degrees.to_radians()], ..Params::paper() };
    let off = |offset: f64| Params { body_com_offset: [offset, 0.0], ..Params::paper() };
    let none = Vector3::zeros();
    for (what, params, force) in [
        ("slope of 3 deg", slope(3.0), none),
        ("slope of 5 deg", slope(5.0), none),
        ("1 N", nominal.clone(), Vector3::x()),
        ("center of mass 5 mm off", off(5e-3), none),
        ("center of mass 10 mm off", off(10e-3), none),
    ] {
        let left = |name: &str, options: &[(&str, &[f64])]| {
            let controller = made(name, &nominal, options);
            settled(&params, controller.as_ref(), 15.0, force).0.ball_position.xy().norm() * 1e3
        };
        let without: Vec<_> = ["lqr", "lqi"].map(|name| format!("{name} {:.1}", left(name, &[]))).to_vec();
        let with: Vec<_> = OBSERVING.map(|name| (name, left(name, ON))).to_vec();
        println!("{what}: {} mm; observed {with:.3?} mm", without.join(", "));
        assert!(with.iter().all(|(_, left)| *left < 1.0), "{what}: {with:?} mm");
    }
}

/// A slope and a force keep their direction as the robot turns.
#[test]
fn turning_robots_need_no_other_estimate() {
    let params = Params { floor_tilt: [0.03, 0.04], ..Params::paper() };
    for name in OBSERVING {
        let setpoint = |time: f64| Setpoint { yaw: 0.5 * time, ..Setpoint::default() };
        let left = offset(&params, ModelKind::Contact, made(name, &params, ON).as_mut(), setpoint);
        println!("{name}: {:.2} mm", left * 1e3);
        assert!(left < 5e-3, "{name}: {left} m");
    }
}

#[test]
fn without_a_rate_a_controller_is_unchanged() {
    let params = Params::paper();
    let start = State::tilted(&params, Vector2::new(0.2, -0.1), 0.3);
    for name in OBSERVING {
        let end = |mut controller: Box<dyn Controller>| {
            let mut robot = robot(&params, ModelKind::Contact, &start);
            run(&mut robot, controller.as_mut(), 2.0, position(0.1, 0.2), |_, _| ()).unwrap().end
        };
        let off: &[(&str, &[f64])] = &[("lean_observer", &[0.0])];
        assert_eq!(made(name, &params, off).memory_len(), law(name, &params).memory_len());
        assert_eq!(made(name, &params, ON).memory_len(), law(name, &params).memory_len() + 11);
        assert_eq!(end(made(name, &params, off)), end(law(name, &params)));
        assert_ne!(end(made(name, &params, ON)), end(law(name, &params)));
        lanes_equal_one_robot(name, ON);
    }
}

/// An impulse is a large force for a short time: as an equilibrium lean it would be tens of degrees.
#[test]
fn impulses_and_limits_move_the_estimate_by_little() {
    let params = Params::paper();
    let controller = made("lqr", &params, ON);
    let setpoint = LaneSetpoint::from(&Setpoint::default());
    let mut memory = vec![0.0; 11];
    let mut call = |state: &State, largest: f64| {
        controller.torques_one(&LaneState::from(state), &setpoint, largest, &mut memory);
        memory[0].hypot(memory[1])
    };
    let upright = State::upright(&params);
    let pushed = State { ball_velocity: Vector3::new(0.3, 0.2, 0.0), ..upright.clone() };
    assert_eq!(call(&upright, f64::INFINITY), 0.0);
    let part = 1.0 - (-CONTROL_DT).exp();
    let moved = call(&pushed, 1e-3);
    assert!((0.5 * part * 0.3..=part * 0.3 + 1e-12).contains(&moved), "{moved} rad");
    // The torques were limited.
    assert_eq!(call(&upright, f64::INFINITY), moved);
    assert!(call(&pushed, f64::INFINITY) != moved);
    for k in 0..2000 {
        let speed = if k % 2 == 0 { 0.02 * f64::from(k) } else { 0.0 };
        let state = State { ball_velocity: Vector3::new(speed, 0.0, 0.0), ..upright.clone() };
        assert!(call(&state, f64::INFINITY) <= 0.3 + 1e-12);
    }
}

/// Cost of the estimate: tilts and impulses, worst of 12 directions.
#[test]
fn the_estimate_costs_no_balance() {
    let params = Params::paper();
    for (name, tilt, push) in [("lqr", 26.0, 1.9), ("hierarchical_sliding_mode", 26.0, 1.9)] {
        let make = || made(name, &params, ON);
        for direction in around(12) {
            let tilted = State::tilted(&params, direction * f64::to_radians(tilt), 0.0);
            assert!(recovers(&params, &make, &tilted, Vector3::zeros()), "{name} falls from {tilt} deg");
            let impulse = direction.push(0.0) * push;
            assert!(recovers(&params, &make, &State::upright(&params), impulse), "{name} falls of {push} N·s");
        }
    }
}

/// Tilts, impulses and delays as a function of the rate: figures for `docs/laws.md`.
#[test]
#[ignore = "minutes"]
fn balance_by_the_rate_of_the_estimate() {
    let params = Params::paper();
    for name in OBSERVING {
        for rate in [0.0, 0.5, 1.0, 2.0, 4.0] {
            let options: &[(&str, &[f64])] = &[("lean_observer", &[rate])];
            let make = || made(name, &params, options);
            let (tilt, push) = (super::basin_of(&params, &make), super::push_of(&params, &make));
            let delays = (0..=10).map(|k| 0.01 * f64::from(k)).take_while(|&delay| {
                around(6).all(|way| {
                    let start = State::tilted(&params, way * 4_f64.to_radians(), 0.0);
                    super::delay::recovers(&params, make().as_mut(), delay, &start, Vector3::zeros())
                })
            });
            println!("{name}, {rate} 1/s: {tilt} deg, {push:.1} N·s, {:.2} s", delays.last().unwrap_or(-1.0));
        }
    }
}
