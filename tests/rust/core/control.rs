//! Controllers: the Riccati equation by its cost, the regulator and the paper's PID by the motion of the robot; the
//! estimator that they may use.

mod estimator;

use ballbot_core::batch::{BalanceConfig, Environment};
use ballbot_core::control::riccati::{self, Regulator};
use ballbot_core::control::{
    Controller, LimitOptions, Lqr, LqrWeights, Pid, PidGains, Sampled, Setpoint, default_max_torque,
};
use ballbot_core::fields::Fields;
use ballbot_core::kinematics::{Omniwheels, TorqueMap};
use ballbot_core::models::{LinearModel, SpatialModel, traction_torque};
use ballbot_core::{Ballbot, Error, ModelKind, Params, State, Wheels, attitude};
use nalgebra::{DMatrix, DVector, UnitQuaternion, Vector2, Vector3, Vector6};
use std::f64::consts::{PI, TAU};

/// Time step of the models and sampling time of the controllers, s: 1 kHz and 200 Hz.
const SIM_DT: f64 = 0.001;
const CONTROL_DT: f64 = 0.005;

fn scalar(value: f64) -> DMatrix<f64> {
    DMatrix::from_element(1, 1, value)
}

/// The regulator of the paper's robot at 200 Hz: A, B, Q, R and the solution.
fn robot_problem() -> ([DMatrix<f64>; 4], Regulator) {
    let params = Params::paper();
    let (a, b) = LinearModel::new(&params).discretize(CONTROL_DT);
    let a = DMatrix::from_column_slice(10, 10, a.as_slice());
    let b = DMatrix::from_column_slice(10, 3, b.as_slice());
    let w = LqrWeights::defaults();
    let (x, v, t, r) = (w.position, w.velocity, w.tilt, w.tilt_rate);
    let deviations = DVector::from_column_slice(&[x, x, t, t, w.yaw, v, v, r, r, w.yaw_rate]);
    let q = DMatrix::from_diagonal(&deviations.map(|d| 1.0 / (d * d)));
    let r = DMatrix::identity(3, 3) / (w.torque * w.torque);
    let regulator = Lqr::new(&params, CONTROL_DT).unwrap().regulator().clone();
    ([a, b, q, r], regulator)
}

/// Cost of 60 s of closed loop under `gain`.
fn cost_of([a, b, q, r]: &[DMatrix<f64>; 4], gain: &DMatrix<f64>, start: &DVector<f64>) -> f64 {
    let mut x = start.clone();
    let mut cost = 0.0;
    for _ in 0..12_000 {
        let u = -gain * &x;
        cost += x.dot(&(q * &x)) + u.dot(&(r * &u));
        x = a * &x + b * &u;
    }
    cost
}

#[test]
fn cost_matrix_is_the_cost_of_the_closed_loop() {
    let (problem, regulator) = robot_problem();
    let p = &regulator.cost;
    assert!(regulator.residual < 1e-12, "residual {:e}", regulator.residual);
    assert!((p - p.transpose()).norm() <= 1e-12 * p.norm());
    for i in 0..10 {
        let start = DVector::from_fn(10, |j, _| if i == j { 1.0 } else { 0.1 * (j as f64 - 4.0) });
        let (found, expected) = (cost_of(&problem, &regulator.gain, &start), start.dot(&(p * &start)));
        assert!((found / expected - 1.0).abs() < 1e-9, "start {i}: cost {found}, xᵀPx = {expected}");
    }
}

#[test]
fn cost_of_nearby_gains_is_higher() {
    let (problem, regulator) = robot_problem();
    let start = DVector::from_fn(10, |j, _| 0.1 * (j as f64 - 4.5));
    let best = cost_of(&problem, &regulator.gain, &start);
    for entry in 0..30 {
        for change in [-0.02, 0.02] {
            let mut gain = regulator.gain.clone();
            gain[entry] += change * gain.amax();
            let cost = cost_of(&problem, &gain, &start);
            assert!(cost > best, "entry {entry} changed by {change}: {cost}, optimum {best}");
        }
    }
}

#[test]
fn linear_model_is_the_derivative_of_the_spatial_model() {
    let params =
        Params { ball_viscous_friction: 3.0, wheel_viscous_friction: 1e-3, wheel_zenith: 0.6, ..Params::paper() };
    let model = SpatialModel::new(&params, true, true);
    // Angular momentum of the upright robot about the vertical is zero: J_k s + J_z Ω − 3 J_w sin α (ψ̇ − Ω sin α) = 0
    // with ψ̇ = k sin α (s − Ω).
    let (sin, k) = (params.wheel_zenith.sin(), params.gear_ratio());
    let wheels = 3.0 * params.wheel_inertia * sin * sin;
    let ball_spin = -(params.body_inertia[2] + wheels * (k + 1.0)) / (params.ball_inertia - wheels * k);
    let accelerations = |x: DVector<f64>| {
        let velocity = Vector6::new(x[5], x[6], x[7], x[8], x[9], x[9] * ball_spin);
        let torques = Vector3::new(x[10], x[11], x[12]);
        model.accelerations(&attitude(Vector2::new(x[2], x[3]), x[4]), &velocity, Wheels::of_column(torques))
    };
    let LinearModel { a, b } = LinearModel::new(&params);
    for j in 0..13 {
        let small = DVector::from_fn(13, |i, _| if i == j { 1e-6 } else { 0.0 });
        let slope = (accelerations(small.clone()) - accelerations(-small)) / 2e-6;
        let found = if j < 10 { a.column(j) } else { b.column(j - 10) };
        let off = (found.rows(5, 5) - slope.rows(0, 5)).amax();
        assert!(off < 1e-6 * slope.amax().max(1.0), "column {j}: {found}, expected {slope}");
    }
}

#[test]
fn scalar_riccati_equation_has_its_closed_form() {
    for (a, b, q, r) in [(1.2, 0.5, 2.0, 0.3), (0.7, 1.0, 1.0, 10.0), (3.0, -0.2, 0.1, 1.0)] {
        let f: f64 = r - a * a * r - q * b * b;
        // b² p² + (r − a² r − q b²) p − q r = 0
        let p = (-f + (f * f + 4.0 * b * b * q * r).sqrt()) / (2.0 * b * b);
        let found = riccati::solve(&scalar(a), &scalar(b), &scalar(q), &scalar(r)).unwrap();
        assert!((found.cost[0] / p - 1.0).abs() < 1e-12, "P = {}, expected {p}", found.cost[0]);
        let k = a * b * p / (r + b * b * p);
        assert!((found.gain[0] / k - 1.0).abs() < 1e-12, "K = {}, expected {k}", found.gain[0]);
    }
}

#[test]
fn riccati_equations_without_a_stabilizing_solution_are_rejected() {
    let two = |diagonal: [f64; 2]| DMatrix::from_diagonal(&DVector::from_column_slice(&diagonal));
    let rejected = |a: DMatrix<f64>, b: DMatrix<f64>, r: DMatrix<f64>| {
        let error = riccati::solve(&a, &b, &DMatrix::identity(a.nrows(), a.nrows()), &r).unwrap_err();
        assert!(matches!(error, Error::Riccati(_)), "{error:?}");
        error.to_string()
    };
    for r in [-1.0, 0.0, f64::NAN] {
        let message = rejected(scalar(1.1), scalar(1.0), scalar(r));
        assert!(message.contains("R is not positive definite"), "{message}");
    }
    // The input does not reach the growing mode, or any mode.
    rejected(two([0.9, 1.1]), DMatrix::from_column_slice(2, 1, &[1.0, 0.0]), scalar(1.0));
    rejected(scalar(1.0), scalar(0.0), scalar(1.0));
    rejected(scalar(f64::NAN), scalar(1.0), scalar(1.0));
}

/// Record of a regulated robot.
#[derive(Debug)]
struct Recovery {
    /// Largest tilt, rad, and distance of the ball from the origin, m.
    tilt: f64,
    excursion: f64,
    /// Time after which the tilt stays below half a degree, s.
    settled: f64,
}

/// Runs a controller towards the origin, in the heading that the robot has.
fn drive(robot: &mut Ballbot, controller: &mut dyn Controller, seconds: f64) -> Recovery {
    let mut recovery = Recovery { tilt: 0.0, excursion: 0.0, settled: 0.0 };
    let setpoint = Setpoint { yaw: robot.state().yaw(), ..Setpoint::default() };
    for _ in 0..(seconds / CONTROL_DT).round() as usize {
        let torques = controller.wheel_torques(&robot.state(), &setpoint);
        robot.step(torques, (CONTROL_DT / robot.sim_dt()).round() as usize).unwrap();
        let state = robot.state();
        recovery.tilt = recovery.tilt.max(state.tilt());
        recovery.excursion = recovery.excursion.max(state.ball_position.xy().norm());
        if state.tilt() > 0.5_f64.to_radians() {
            recovery.settled = robot.time();
        }
    }
    println!("{} {recovery:?}", robot.kind());
    recovery
}

fn robot(params: &Params, kind: ModelKind, tilt: Vector2<f64>, yaw: f64) -> Ballbot {
    let mut robot = Ballbot::new(params, kind, SIM_DT).unwrap();
    robot.reset(&State::tilted(params, tilt, yaw)).unwrap();
    robot
}

#[test]
fn lqr_recovers_from_five_degrees() {
    let params = Params::paper();
    for kind in [ModelKind::Spatial, ModelKind::Rigid] {
        for (azimuth, yaw) in [(0.0, 0.0), (1.9, 0.0), (0.6, -2.5)] {
            let tilt = Vector2::new(f64::cos(azimuth), f64::sin(azimuth)) * 5.0_f64.to_radians();
            let mut robot = robot(&params, kind, tilt, yaw);
            let mut lqr = Lqr::new(&params, CONTROL_DT).unwrap();
            let recovery = drive(&mut robot, &mut lqr, 4.0);
            assert!(recovery.settled < 1.2, "{kind} at {azimuth}, {yaw}: {recovery:?}");
            assert!(recovery.excursion < 0.045, "{kind} at {azimuth}, {yaw}: {recovery:?}");
        }
    }
}

#[test]
fn lqr_recovers_from_a_push() {
    let params = Params::paper();
    for kind in [ModelKind::Spatial, ModelKind::Rigid] {
        let mut robot = robot(&params, kind, Vector2::zeros(), 0.0);
        robot.push(&Vector3::new(0.25, 0.0, 0.0), None).unwrap();
        let recovery = drive(&mut robot, &mut Lqr::new(&params, CONTROL_DT).unwrap(), 4.0);
        assert!(recovery.tilt < 3.0_f64.to_radians() && recovery.excursion < 0.05, "{kind}: {recovery:?}");
        assert!(robot.state().ball_position.xy().norm() < 1e-3, "{kind} does not come back: {:?}", robot.state());
    }
}

/// Two degrees, then the motion in the second ten seconds.
fn balance(params: &Params, kind: ModelKind) -> Recovery {
    let mut robot = robot(params, kind, Vector2::new(0.02, -0.0285), 0.4);
    let mut lqr = Lqr::new(params, CONTROL_DT).unwrap();
    drive(&mut robot, &mut lqr, 10.0);
    drive(&mut robot, &mut lqr, 10.0)
}

#[test]
fn lqr_brings_all_presets_to_rest() {
    for name in Params::preset_names() {
        let params = Params { wheel_coulomb_friction: 0.0, ..Params::preset(name).unwrap() };
        for kind in ModelKind::ALL {
            let end = balance(&params, kind);
            assert!(end.tilt < 0.01_f64.to_radians() && end.excursion < 1e-3, "{name}, {kind}: {end:?}");
        }
    }
}

#[test]
fn lqr_has_a_limit_cycle_under_dry_friction() {
    // Dry friction of the wheels, which no linear regulator models: a limit cycle, 0.59 deg and 96 mm wide here.
    let params = Params::preset("asroballet").unwrap();
    assert_eq!(params.wheel_coulomb_friction, 0.1);
    for kind in ModelKind::ALL {
        let end = balance(&params, kind);
        assert!(end.tilt < 1.0_f64.to_radians() && end.excursion < 0.15, "{kind}: {end:?}");
        assert!(end.tilt > 0.1_f64.to_radians(), "{kind} comes to rest: {end:?}");
    }
}

#[test]
fn lqr_reaches_setpoint_and_heading() {
    let params = Params::paper();
    // The short way round from −170 deg to 170 deg is through 180 deg.
    let mut robot = robot(&params, ModelKind::Spatial, Vector2::zeros(), -170.0_f64.to_radians());
    let mut lqr = Lqr::new(&params, CONTROL_DT).unwrap();
    let setpoint = Setpoint { position: Vector2::new(0.2, -0.1), yaw: 170.0_f64.to_radians(), ..Setpoint::default() };
    for _ in 0..1200 {
        robot.step(lqr.wheel_torques(&robot.state(), &setpoint), 5).unwrap();
        assert!(robot.state().yaw().abs() > 169.0_f64.to_radians(), "went the long way: {}", robot.state().yaw());
    }
    let state = robot.state();
    assert!((state.ball_position.xy() - setpoint.position).norm() < 2e-3, "at {}", state.ball_position);
    assert!((state.yaw() - setpoint.yaw).abs() < 1e-3, "heading {}", state.yaw());
}

#[test]
fn yaw_deviation_takes_the_short_way_around() {
    let params = Params::paper();
    let lqr = Lqr::new(&params, CONTROL_DT).unwrap();
    for (yaw, setpoint, expected) in
        [(3.0, -3.0, 6.0 - TAU), (-3.0, 3.0, TAU - 6.0), (0.5, 0.2, 0.3), (0.1, 0.1 + 2.0 * TAU, 0.0)]
    {
        let state = State::tilted(&params, Vector2::zeros(), yaw);
        let found = lqr.deviation(&state, &Setpoint { yaw: setpoint, ..Setpoint::default() })[4];
        assert!((found - expected).abs() < 1e-12, "from {yaw} to {setpoint}: {found}, expected {expected}");
    }
    let state = State::tilted(&params, Vector2::zeros(), 1.0);
    let opposite = lqr.deviation(&state, &Setpoint { yaw: 1.0 - PI, ..Setpoint::default() })[4];
    assert!((opposite.abs() - PI).abs() < 1e-12, "{opposite}");
}

#[test]
fn deviation_is_invariant_under_position_and_heading() {
    let params = Params::paper();
    let lqr = Lqr::new(&params, CONTROL_DT).unwrap();
    let deviation = |yaw: f64, offset: Vector2<f64>| {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
        let turned = |x: f64, y: f64| (turn * Vector3::new(x, y, 0.0)).xy();
        let body = attitude(turned(0.1, -0.05), yaw + 0.3);
        let mut state = State::rolling(&params, turned(0.2, 0.4), 0.0, body, Vector3::new(0.3, -0.1, 0.2));
        state.ball_position += offset.push(0.0);
        let position = offset + turned(-0.2, 0.1);
        lqr.deviation(&state, &Setpoint { position, velocity: turned(0.1, 0.0), yaw, ..Setpoint::default() })
    };
    let expected = deviation(0.0, Vector2::zeros());
    for (yaw, offset) in [(2.0, Vector2::new(3.0, -1.0)), (-3.0, Vector2::new(0.0, 7.0))] {
        let found = deviation(yaw, offset);
        assert!((found - expected).amax() < 1e-12, "{found}, expected {expected}");
    }
}

/// States from calm to wild, by a fixed pattern.
fn scattered_states(params: &Params) -> impl Iterator<Item = State> {
    (0..400).map(|k| {
        let wave = |i: i32| (f64::from(k) * 0.37 + f64::from(i) * 1.7).sin() * f64::from(k) / 400.0;
        let body = attitude(Vector2::new(wave(0), wave(1)) * 1.5, wave(2) * 3.0);
        let rate = Vector3::new(wave(3), wave(4), wave(5)) * 10.0;
        let mut state = State::rolling(params, Vector2::new(wave(6), wave(7)) * 3.0, 0.0, body, rate);
        state.ball_position += Vector3::new(wave(8), wave(9), 0.0) * 5.0;
        state
    })
}

#[test]
fn torques_are_within_the_limit() {
    let params = Params { max_wheel_torque: 0.9, ..Params::paper() };
    let lqr = Lqr::with_weights(&params, CONTROL_DT, &LqrWeights::default(), &LimitOptions::CAP).unwrap();
    let tight = Lqr::with_weights(&params, CONTROL_DT, &LqrWeights::default(), &LimitOptions::capped(0.05)).unwrap();
    let pid = |limits| Pid::with_map(&params, CONTROL_DT, &PidGains::default(), TorqueMap::AsPrinted, limits).unwrap();
    let (pid, strong) = (pid(&LimitOptions::CAP), pid(&LimitOptions::capped(0.9)));
    let grip = default_max_torque(&params);
    let limited: [(Box<dyn Controller>, f64); 4] =
        [(Box::new(lqr), grip), (Box::new(tight), 0.05), (Box::new(pid), grip), (Box::new(strong), 0.9)];
    for (mut controller, limit) in limited {
        let mut largest = 0.0_f64;
        for state in scattered_states(&params) {
            let torques = controller.wheel_torques(&state, &Setpoint::default());
            largest = largest.max(torques.column().amax());
        }
        assert!(largest <= limit, "{largest} N·m, limit {limit}");
        assert!(largest >= limit * (1.0 - 1e-12), "never at its limit {limit}: {largest}");
    }
}

/// Whether the wheels carry a tilt torque in every direction, the largest wheel torque being `torque`.
fn grips(params: &Params, torque: f64) -> bool {
    let model = SpatialModel::new(params, true, true);
    (0..360).all(|degrees| {
        let angle = f64::from(degrees).to_radians();
        let tilting = Vector3::new(angle.cos(), angle.sin(), 0.0);
        let torques = Omniwheels::new(params).wheel_torques(&tilting, TorqueMap::Consistent);
        let torques = torques * (torque / torques.column().amax());
        let contacts = model.contacts(&UnitQuaternion::identity(), &Vector6::zeros(), torques);
        contacts.friction_utilization(params)[..3].iter().all(|share| *share <= 1.0)
    })
}

#[test]
fn traction_torque_is_where_the_first_wheel_slips() {
    for name in Params::preset_names() {
        let params = Params { max_wheel_torque: 100.0, ..Params::preset(name).unwrap() };
        let torque = traction_torque(&params);
        assert!(grips(&params, 0.99 * torque), "{name}: a wheel slips below {torque} N·m");
        assert!(!grips(&params, 1.01 * torque), "{name}: no wheel slips above {torque} N·m");
    }
    let weak = Params { max_wheel_torque: 0.1, ..Params::paper() };
    assert_eq!(traction_torque(&weak), 0.1);
    assert_eq!(default_max_torque(&weak), 0.9 * 0.1);
}

/// The starts of the balance task: with tilt, speed and tilt rate at once a robot needs more grip than at rest.
#[test]
fn lqr_balances_all_presets_from_the_starts_of_the_task() {
    for name in Params::preset_names() {
        let params = Params::preset(name).unwrap();
        let torque = params.max_wheel_torque;
        let config = BalanceConfig { max_wheel_torque: Some(torque), params, ..BalanceConfig::default() };
        for seed in 0..12 {
            let mut environment = Environment::new(&config, seed).unwrap();
            let mut observation = vec![0.0; environment.observation_len()];
            environment.reset(&mut observation);
            let mut lqr = Lqr::new(&config.params, config.control_dt).unwrap();
            for _ in 0..300 {
                let torques = lqr.wheel_torques(&environment.robot().state(), &Setpoint::default());
                let action = torques.map(|torque| (torque / config.action_torque()) as f32);
                let outcome = environment.step(action.as_slice(), &mut observation);
                assert_eq!(outcome.terminated, None, "{name}, seed {seed}");
            }
        }
    }
}

#[test]
fn saturation_keeps_the_direction_of_the_torques() {
    let params = Params { max_wheel_torque: 1e6, ..Params::paper() };
    let state = State::tilted(&params, Vector2::new(0.4, -0.3), 0.2);
    let torques = |limit: f64| {
        let mut lqr =
            Lqr::with_weights(&params, CONTROL_DT, &LqrWeights::default(), &LimitOptions::capped(limit)).unwrap();
        lqr.wheel_torques(&state, &Setpoint::default()).column()
    };
    let (free, limited) = (torques(1e6), torques(0.1));
    assert!(free.amax() > 0.5, "not saturated: {free}");
    assert!((limited - free * (0.1 / free.amax())).norm() < 1e-15, "{limited}, not along {free}");
}

#[test]
fn pid_brings_both_tilts_to_zero() {
    let params = Params::paper();
    for map in [TorqueMap::Consistent, TorqueMap::AsPrinted] {
        let start = Vector2::new(0.6, -0.8) * 3.0_f64.to_radians();
        let mut robot = robot(&params, ModelKind::Spatial, start, 0.0);
        let mut pid = Pid::new(&params, SIM_DT, &PidGains::default(), map).unwrap();
        for _ in 0..3000 {
            robot.step(pid.wheel_torques(&robot.state(), &Setpoint::default()), 1).unwrap();
            let tilt = robot.state().tilt().to_degrees();
            assert!(tilt < 3.01, "{map:?}: {tilt} deg at {} s", robot.time());
            assert!(robot.time() < 0.5 || tilt < 0.5, "{map:?}: {tilt} deg at {} s", robot.time());
        }
    }
}

/// Virtual torques about x and y for a tilt error, from the wheel torques of a robot upright.
fn virtual_torques(params: &Params, pid: &mut Sampled<Pid>, error: Vector2<f64>) -> Vector2<f64> {
    let setpoint = Setpoint { tilt: error, ..Setpoint::default() };
    let torques = pid.wheel_torques(&State::upright(params), &setpoint).column();
    let wheels = Omniwheels::new(params);
    let about = |axis: Vector3<f64>| {
        let column = wheels.wheel_torques(&axis, TorqueMap::Consistent).column();
        torques.dot(&column) / column.norm_squared()
    };
    Vector2::new(about(Vector3::x()), about(Vector3::y()))
}

#[test]
fn a_reset_pid_equals_a_new_pid() {
    let params = Params { max_wheel_torque: 1e6, ..Params::paper() };
    let run =
        |pid: &mut Sampled<Pid>| [0.1, -0.2, 0.05].map(|e| virtual_torques(&params, pid, Vector2::new(e, 2.0 * e)));
    let (gains, limits) = (PidGains::default(), LimitOptions::capped(1e6));
    let mut pid = Pid::with_map(&params, CONTROL_DT, &gains, TorqueMap::Consistent, &limits).unwrap();
    let first = run(&mut pid);
    assert_ne!(first, run(&mut pid));
    pid.reset();
    assert_eq!(first, run(&mut pid));
    // No derivative kick and no integral yet: k_p times the error.
    assert!((first[0] - Vector2::new(0.1, 0.2) * 20.39).norm() < 1e-13, "{}", first[0]);
}

#[test]
fn pid_holds_its_integral_while_saturated() {
    let params = Params { max_wheel_torque: 0.01, ..Params::paper() };
    let mut pid = Pid::new(&params, CONTROL_DT, &PidGains::default(), TorqueMap::Consistent).unwrap();
    let leaning = State::tilted(&params, Vector2::new(0.1, 0.0), 0.0);
    for _ in 0..1000 {
        pid.wheel_torques(&leaning, &Setpoint::default());
    }
    // The filter starts at 0.1 rad and stays there: what remains is one step of the derivative, nothing of 5 s of error.
    let mut fresh = Pid::new(&params, CONTROL_DT, &PidGains::default(), TorqueMap::Consistent).unwrap();
    fresh.wheel_torques(&leaning, &Setpoint::default());
    let upright = State::upright(&params);
    // The filters settle, and the integral remains.
    let settled =
        |pid: &mut Sampled<Pid>| (0..30).map(|_| pid.wheel_torques(&upright, &Setpoint::default())).last().unwrap();
    assert_eq!(settled(&mut pid), settled(&mut fresh));
    assert!(settled(&mut fresh).column().amax() < 1e-6, "the integral did not stay at zero");
}

#[test]
fn errors_of_invalid_numbers_name_the_value() {
    let params = Params::paper();
    let gains = PidGains::default();
    let pid = |gains: PidGains, dt| Pid::new(&params, dt, &gains, TorqueMap::Consistent).map(|_| ());
    let strength = |torque| {
        let limits = LimitOptions::capped(torque);
        Pid::with_map(&params, CONTROL_DT, &gains, TorqueMap::Consistent, &limits).map(|_| ())
    };
    let weights = LqrWeights::default();
    let lqr = |weights, dt, torque| Lqr::with_weights(&params, dt, &weights, &LimitOptions::capped(torque)).map(|_| ());
    for (result, message) in [
        (pid(PidGains { proportional: -1.0, ..gains }, CONTROL_DT), "proportional = -1 "),
        (pid(PidGains { integral: f64::NAN, ..gains }, CONTROL_DT), "integral = NaN "),
        (pid(PidGains { derivative: f64::INFINITY, ..gains }, CONTROL_DT), "derivative = inf "),
        (pid(PidGains { filter_coefficient: 0.0, ..gains }, CONTROL_DT), "filter_coefficient = 0 "),
        (pid(gains, 0.0), "control_dt = 0 "),
        (strength(-1.0), "max_torque = -1 "),
        (lqr(LqrWeights { tilt: 0.0, ..weights }, CONTROL_DT, 1.0), "tilt = 0 "),
        (lqr(LqrWeights { yaw_rate: -2.0, ..weights }, CONTROL_DT, 1.0), "yaw_rate = -2 "),
        (lqr(LqrWeights { velocity: f64::NAN, ..weights }, CONTROL_DT, 1.0), "velocity = NaN "),
        (lqr(weights, -0.01, 1.0), "control_dt = -0.01 "),
        (lqr(weights, CONTROL_DT, 0.0), "max_torque = 0 "),
        (Lqr::new(&Params { body_mass: -2.0, ..Params::paper() }, CONTROL_DT).map(|_| ()), "body_mass = -2 "),
    ] {
        let error = result.expect_err(message);
        assert!(matches!(error, Error::OutOfRange { .. }), "{error:?}");
        assert!(error.to_string().starts_with(message), "{error}, expected {message}");
    }
}
