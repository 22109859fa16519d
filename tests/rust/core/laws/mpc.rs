//! Model predictive control.

use super::{CONTROL_DT, basin_of, made, presets, push_of, robot, scattered_states};
use ballbot_core::control::{
    Controller, LaneSetpoint, LimitOptions, Lqr, LqrWeights, Mpc, MpcOptions, NamedLaw, Setpoint, riccati,
};
use ballbot_core::fields::Fields;
use ballbot_core::lanes::{EIGHT, Eight};
use ballbot_core::models::{LinearModel, LoadMap, Scale};
use ballbot_core::{LaneState, ModelKind, Params, State, attitude};
use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus};
use nalgebra::{DMatrix, DVector, Vector2, Vector3};
use std::hint::black_box;
use std::time::Instant;

/// Weight of torques that keeps the torques of all robots within their limits, N·m.
const TORQUE: f64 = 0.2;

/// A stage as long as the sampling time.
fn short() -> MpcOptions {
    let wide = MpcOptions { max_lean: 1e6, max_speed: 1e6, torque: TORQUE, ..MpcOptions::default() };
    MpcOptions { horizon: 1e-3, iterations: 2000.0, ..wide }
}

#[test]
fn without_a_limit_the_torques_match_the_regulator() {
    for (name, params) in presets() {
        let limits = LimitOptions { traction: Some(1.0), ..LimitOptions::CAP };
        let mut mpc = Mpc::with_options(&params, CONTROL_DT, &short(), &limits).unwrap();
        let weights = LqrWeights { max_lean: 1e6, max_speed: 1e6, torque: TORQUE, ..LqrWeights::default() };
        let mut lqr = Lqr::with_weights(&params, CONTROL_DT, &weights, &limits).unwrap();
        for (number, state) in scattered_states(&params)[..4].iter().enumerate() {
            let setpoint = Setpoint { velocity: Vector2::new(0.01, 0.0), ..Setpoint::default() };
            let (found, expected) = (mpc.wheel_torques(state, &setpoint), lqr.wheel_torques(state, &setpoint));
            for (found, expected) in found.into_iter().zip(expected) {
                assert!(
                    (found - expected).abs() < 1e-10,
                    "{name}, state {number}: {found}, the regulator has {expected}"
                );
            }
        }
    }
}

/// The first input of the original problem, in states and torques over the stages, by Clarabel.
fn optimum(params: &Params, options: &MpcOptions, stage: f64, traction: f64, x: &DVector<f64>) -> DVector<f64> {
    const STAGES: usize = 25;
    let (a, b) = LinearModel::new(params).discretize(stage);
    let a = DMatrix::from_column_slice(10, 10, a.as_slice());
    let b = DMatrix::from_column_slice(10, 3, b.as_slice());
    let (q, r) = Scale::of(params).fit(options).weights().matrices();
    let last = riccati::solve(&a, &b, &q, &r).unwrap().cost;
    // Torques that turn the body only about horizontal axes.
    let turning = LinearModel::new(params).b.fixed_view::<3, 3>(7, 0).try_inverse().unwrap();
    let tilting = DMatrix::from_column_slice(3, 2, turning.fixed_columns::<2>(0).into_owned().as_slice());
    // Each row on (ϑ, τ): value = constant + row · (ϑ_x, ϑ_y, τ), as fractions.
    let map = LoadMap::new(params);
    let rate_squared = x[7] * x[7] + x[8] * x[8];
    let friction = traction * params.wheel_dynamic_friction;
    let mut rows: Vec<(f64, DVector<f64>)> = Vec::new();
    for wheel in 0..3 {
        let (load, drive) = (map.loads[wheel], map.tractions[wheel]);
        let parts = |w: ballbot_core::models::WheelLoad| {
            let row = [w.per_tilt.as_slice(), w.per_torque.as_slice()].concat();
            (w.at_rest + w.per_rate_squared * rate_squared, DVector::from_vec(row))
        };
        let ((n, per_n), (f, per_f)) = (parts(load), parts(drive));
        let unit = load.at_rest;
        rows.push(((f - friction * n) / unit, (&per_f - &per_n * friction) / unit));
        rows.push(((-f - friction * n) / unit, (-&per_f - &per_n * friction) / unit));
        rows.push(((0.3 * unit - n) / unit, -per_n / unit));
        for sign in [1.0, -1.0] {
            let mut row = DVector::zeros(5);
            row[2 + wheel] = sign / params.max_wheel_torque;
            rows.push((-1.0, row));
        }
    }
    let (inputs, slacks) = (2 * STAGES, rows.len() * STAGES);
    // x_k = `free` + `forced` u.
    let (mut free, mut forced) = (x.clone(), DMatrix::zeros(10, inputs));
    let (mut hessian, mut slope) = (DMatrix::zeros(inputs, inputs), DVector::zeros(inputs));
    let (mut entries, mut bounds): (Vec<(usize, usize, f64)>, Vec<f64>) = (Vec::new(), Vec::new());
    for k in 0..STAGES {
        let mut choose = DMatrix::zeros(3, inputs);
        choose.columns_mut(2 * k, 2).copy_from(&tilting);
        hessian += forced.transpose() * &q * &forced + choose.transpose() * &r * &choose;
        slope += forced.transpose() * &q * &free;
        for (constant, row) in &rows {
            let (tilt, torque) = (row.rows(0, 2), row.rows(2, 3));
            let line = tilt.transpose() * forced.rows(2, 2) + torque.transpose() * &choose;
            let place = bounds.len();
            entries.extend((0..inputs).map(|j| (place, j, line[j])).filter(|entry| entry.2 != 0.0));
            entries.push((place, inputs + place, -1.0));
            bounds.push(-constant - (tilt.transpose() * free.rows(2, 2))[0]);
        }
        (free, forced) = (&a * free, &a * forced + &b * choose);
    }
    hessian += forced.transpose() * &last * &forced;
    slope += forced.transpose() * &last * &free;
    let size = inputs + slacks;
    let (mut i, mut j, mut v) = (Vec::new(), Vec::new(), Vec::new());
    for column in 0..inputs {
        for row in 0..=column {
            i.push(row);
            j.push(column);
            v.push(hessian[(row, column)]);
        }
    }
    for slack in inputs..size {
        i.push(slack);
        j.push(slack);
        v.push(options.violation.powi(-2));
    }
    let p = CscMatrix::new_from_triplets(size, size, i, j, v);
    let [i, j] = [0, 1].map(|n| entries.iter().map(|entry| [entry.0, entry.1][n]).collect());
    let a = CscMatrix::new_from_triplets(slacks, size, i, j, entries.iter().map(|entry| entry.2).collect());
    let q: Vec<_> = slope.iter().copied().chain(std::iter::repeat_n(0.0, slacks)).collect();
    let settings = DefaultSettings {
        verbose: false,
        tol_gap_abs: 1e-12,
        tol_gap_rel: 1e-12,
        tol_feas: 1e-12,
        ..DefaultSettings::default()
    };
    let mut solver = DefaultSolver::new(&p, &q, &a, &bounds, &[NonnegativeConeT(slacks)], settings).unwrap();
    solver.solve();
    assert!(matches!(solver.solution.status, SolverStatus::Solved | SolverStatus::AlmostSolved));
    tilting * DVector::from_column_slice(&solver.solution.x[..2])
}

/// Against an interior-point method, on the original problem: with states, the cost of the infinite horizon at
/// its end and the loads of the wheels.
#[test]
fn the_optimum_matches_an_interior_point_method() {
    let setpoint = Setpoint::default();
    let mut limited = 0;
    for (name, params) in presets() {
        for horizon in [1e-3, 3.0] {
            // Other robots have larger loads per torque, and with them larger curvatures.
            let iterations = if name == "paper" { 2000.0 } else { 10_000.0 };
            let options = MpcOptions { horizon, iterations, ..short() };
            let limits = LimitOptions { traction: Some(0.9), ..LimitOptions::CAP };
            let mpc = Mpc::with_options(&params, CONTROL_DT, &options, &limits).unwrap();
            let plain =
                Mpc::with_options(&params, CONTROL_DT, &MpcOptions { violation: 1e3, ..options }, &limits).unwrap();
            let view = Lqr::new(&params, CONTROL_DT).unwrap();
            for (tilt, rate) in [([0.2, 0.1], [0.0, 0.0]), ([0.02, -0.3], [0.5, 0.9]), ([-0.1, 0.2], [-1.0, 0.5])] {
                // Robots other than the paper's fall from such tilts.
                let share = if name == "paper" { 1.0 } else { 0.5 };
                let body = attitude(Vector2::from(tilt) * share, 0.0);
                let state = State::rolling(&params, Vector2::zeros(), 0.0, body, Vector3::new(rate[0], rate[1], 0.0));
                let mut x = view.deviation(&state, &setpoint);
                // The yaw torque is not part of the prediction.
                (x[4], x[9]) = (0.0, 0.0);
                let x = DVector::from_column_slice(x.as_slice());
                let expected = optimum(&params, &options, mpc.stage(), 0.9, &x);
                let found = DVector::from_column_slice(mpc.desired(&state, &setpoint).as_slice());
                let unlimited = DVector::from_column_slice(plain.desired(&state, &setpoint).as_slice());
                // Nor has the regulator's yaw torque.
                let yaw = found.sum() / 3.0 - expected.sum() / 3.0;
                let error = (&found - &expected).add_scalar(-yaw).amax() / params.max_wheel_torque;
                limited += usize::from((&unlimited - &found).amax() > 1e-2 * params.max_wheel_torque);
                println!("{name}, {horizon}: {error:.1e} of the motors' torque");
                // On asroballet the largest number of iterations is not quite enough.
                let limit = if name == "asroballet" { 1e-4 } else { 1e-6 };
                assert!(error < limit, "{name}: {found}, expected {expected}");
            }
        }
    }
    assert!(limited >= 12, "limits matter in {limited} problems of 24");
}

/// Few iterations cost little: the cost until a robot is upright, relative to many iterations.
#[test]
fn few_iterations_are_as_good_as_many() {
    let params = Params::paper();
    let (q, r) = MpcOptions::defaults().weights().matrices();
    let view = Lqr::new(&params, CONTROL_DT).unwrap();
    let cost = |iterations: f64, degrees: f64| {
        let mut controller = made("mpc", &params, &[("iterations", &[iterations])]);
        let start = State::tilted(&params, Vector2::new(1.0, 0.3).normalize() * degrees.to_radians(), 0.0);
        let mut robot = robot(&params, ModelKind::Contact, &start);
        let mut cost = 0.0;
        for _ in 0..400 {
            let x = DVector::from_column_slice(view.deviation(&robot.state(), &Setpoint::default()).as_slice());
            let mut torques = [0.0; 3];
            let found = run_once(&mut robot, controller.as_mut(), &mut torques);
            assert!(found, "{iterations} iterations, {degrees} deg");
            let u = DVector::from_column_slice(&torques);
            cost += (x.transpose() * &q * &x)[0] + (u.transpose() * &r * &u)[0];
        }
        cost
    };
    for degrees in [10.0, 18.0, 25.0] {
        let [few, many] = [10.0, 1000.0].map(|iterations| cost(iterations, degrees));
        println!("{degrees} deg: cost {few:.1} with 10 iterations, {many:.1} with 1000");
        assert!((few / many - 1.0).abs() < 0.01, "{degrees} deg: {few}, {many}");
    }
}

fn run_once(robot: &mut ballbot_core::Ballbot, controller: &mut dyn Controller, torques: &mut [f64; 3]) -> bool {
    *torques = controller.wheel_torques(&robot.state(), &Setpoint::default()).0;
    robot.step(*torques, super::STEPS).is_ok() && robot.state().tilt() < 1.0
}

/// Basins and pushes of the regulator and of the prediction with limits of the lean, deg, and a fraction of the
/// friction.
fn limited_leans(friction: f64, limits: &[f64]) -> [Vec<(f64, f64)>; 2] {
    let paper = Params::paper();
    let params = Params {
        wheel_dynamic_friction: friction * paper.wheel_dynamic_friction,
        wheel_static_friction: friction * paper.wheel_static_friction,
        ..paper
    };
    ["lqr", "mpc"].map(|name| {
        let one = |max_lean: &f64| {
            let make = || made(name, &params, &[("max_lean", &[max_lean.to_radians()])]);
            let (tilt, push) = (basin_of(&params, &make), push_of(&params, &make));
            println!("{name}, {friction} of the friction, max_lean {max_lean} deg: {tilt} deg, {push:.1} N·s");
            (tilt, push)
        };
        limits.iter().map(one).collect()
    })
}

/// The benefit of the prediction: the regulator depends on its limit of the lean.
#[test]
fn the_prediction_replaces_the_limit_of_the_lean() {
    for (friction, least) in [(1.0, 2.0), (0.5, 1.0)] {
        let [lqr, mpc] = limited_leans(friction, &[600.0]).map(|found| found[0]);
        assert!(mpc.0 >= lqr.0 + least && mpc.1 >= lqr.1 + 0.2, "without limit: {mpc:?}, regulator {lqr:?}");
    }
}

#[test]
#[ignore = "a measurement, which takes long"]
fn limits_of_the_lean() {
    for friction in [1.0, 0.5] {
        limited_leans(friction, &[5.0, 10.0, 15.0, 20.0, 600.0]);
    }
}

/// Time of a call in lanes, of robots at the limits and of robots within them. With `--release`.
#[test]
#[ignore = "a measurement, for an optimized build"]
fn time_of_a_call() {
    const CALLS: u32 = 20_000;
    let params = Params::paper();
    let setpoints = LaneSetpoint::<Eight>::default();
    for name in ["lqr", "mpc"] {
        for degrees in [1.0_f64, 20.0] {
            let controller = made(name, &params, &[]);
            let mut states = LaneState::<Eight>::default();
            let start = State::tilted(&params, Vector2::new(1.0, 0.3).normalize() * degrees.to_radians(), 0.0);
            (0..EIGHT).for_each(|i| states.set_lane(i, &LaneState::from(&start)));
            let mut memory = vec![Eight::default(); controller.memory_len()];
            let start = Instant::now();
            for _ in 0..CALLS {
                black_box(controller.torques_eight(black_box(&states), &setpoints, f64::INFINITY, &mut memory));
            }
            let time = start.elapsed().as_secs_f64() / f64::from(CALLS) / EIGHT as f64;
            println!("{name}, {degrees} deg: {:.3} µs a robot", 1e6 * time);
        }
    }
}
