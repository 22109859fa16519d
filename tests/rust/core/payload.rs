//! Payloads that move on the body: closed forms, conserved quantities, agreement of the models, copies and events.

use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, Event, ResetRequest, StepResults};
use ballbot_core::models::{BallSpin, SpatialModel, WheelSpin};
use ballbot_core::{Ballbot, Deflection, Error, ModelKind, PAYLOADS, Params, State, Wheels, kinematics::Omniwheels};
use nalgebra::{DMatrix, DVector, Matrix3, UnitQuaternion, Vector2, Vector3, Vector6};
use std::f64::consts::TAU;

const MODELS: [ModelKind; 3] = [ModelKind::Spatial, ModelKind::Contact, ModelKind::Rigid];

/// A payload of a fraction of the body's mass above its CoM, with this frequency (Hz) and damping ratio on a body at rest.
fn carrying(params: &Params, share: f64, hertz: [f64; 3], damping: f64) -> Params {
    let mass = share * params.body_mass;
    let stiffness = hertz.map(|hertz| mass * (TAU * hertz).powi(2));
    let damping = stiffness.map(|k| 2.0 * damping * (k * mass).sqrt());
    let position = [0.0, 0.0, 1.5 * params.body_com_height];
    Params { payload_stiffness: stiffness, payload_damping: damping, ..params.with_payload(0, mass, position) }
}

/// A payload off the mast, soft along every axis.
pub fn lopsided(params: &Params) -> Params {
    let loaded = carrying(params, 0.3, [1.1, 1.7, 2.3], 0.0);
    let h = params.body_com_height;
    loaded.with_payload(0, loaded.payload_mass, [0.1 * h, -0.2 * h, 1.3 * h])
}

/// Two payloads off the mast, the second an arm on the other side.
fn doubled(params: &Params) -> Params {
    let one = lopsided(params);
    let (mass, h) = (0.15 * params.body_mass, params.body_com_height);
    let stiffness = [3.0, 2.1, 5.3].map(|hertz: f64| mass * (TAU * hertz).powi(2));
    Params { second_payload_stiffness: stiffness, ..one.with_payload(1, mass, [-0.3 * h, 0.2 * h, 0.6 * h]) }
}

/// One payload, and two.
fn loads(params: &Params) -> [Params; 2] {
    [lopsided(params), doubled(params)]
}

fn robot(params: &Params, model: ModelKind, sim_dt: f64, state: &State) -> Ballbot {
    let mut robot = Ballbot::new(params, model, sim_dt).unwrap();
    robot.reset(state).unwrap();
    robot
}

/// Mass of each payload, with its position and velocity in the inertial frame.
fn payloads(robot: &Ballbot) -> [(f64, [Vector3<f64>; 2]); PAYLOADS] {
    let (state, deflections, params) = (robot.state(), robot.payloads(), robot.params().payloads());
    std::array::from_fn(|i| {
        let [d, rate] = [deflections[i].position, deflections[i].velocity].map(|v| Vector3::new(v.x, v.y, v.z));
        let arm = Vector3::from(params[i].position) + d;
        let turn = state.body_quaternion;
        let velocity = state.body_velocity + turn * (state.body_angular_velocity.cross(&arm) + rate);
        (params[i].mass, [state.body_position + turn * arm, velocity])
    })
}

/// Momentum and angular momentum about the origin of body, wheels and payloads.
fn momenta(robot: &Ballbot) -> [Vector3<f64>; 2] {
    let (params, state) = (robot.params(), robot.state());
    let alone = params.without_payloads();
    let (turn, rate) = (state.body_quaternion, state.body_angular_velocity);
    let arm = alone.body_com();
    let place = state.body_position + turn * arm;
    let momentum = (state.body_velocity + turn * rate.cross(&arm)) * alone.body_mass;
    let wheels = Omniwheels::new(params);
    let spins = state.wheel_speeds.column() - wheels.axles * rate;
    let own = turn * (alone.body_inertia_matrix() * rate - wheels.axles.transpose() * spins * params.wheel_inertia);
    let mut sums = [momentum, place.cross(&momentum) + own];
    for (mass, [position, velocity]) in payloads(robot) {
        sums[0] += velocity * mass;
        sums[1] += position.cross(&(velocity * mass));
    }
    sums
}

fn tumbling(params: &Params) -> State {
    let mut state = State::tilted(params, Vector2::new(0.4, -0.7), 1.1);
    state.ball_position.z = 1.0;
    state.body_position.z = 30.0;
    state.body_angular_velocity = Vector3::new(2.0, -1.0, 3.0);
    state
}

#[test]
fn in_flight_momentum_and_angular_momentum_are_kept() {
    let models = [(ModelKind::Contact, [1e-11, 1e-5]), (ModelKind::Rigid, [1e-3, 1e-3])];
    for (params, (model, limit)) in
        loads(&Params::paper()).into_iter().flat_map(|params| models.map(|m| (params.clone(), m)))
    {
        let sim_dt = 1e-4;
        let mut robot = robot(&params, model, sim_dt, &tumbling(&params));
        let [momentum, turning] = momenta(&robot);
        let weight = Vector3::z() * (-params.gravity * params.body_mass);
        let (mut largest, mut moment) = (0.0_f64, Vector3::zeros());
        for _ in 0..3000 {
            moment += center(&robot).cross(&weight) * sim_dt;
            robot.step([0.0; 3], 1).unwrap();
            largest = largest.max(robot.payloads()[0].position.x.abs());
        }
        let [now, turned] = momenta(&robot);
        let error = (now - momentum - weight * robot.time()).norm() / now.norm();
        assert!(error < limit[0], "{model}: momentum {error:e}");
        let error = (turned - turning - moment).norm() / turning.norm();
        assert!(error < limit[1], "{model}: angular momentum {error:e}");
        assert!(largest > 1e-2, "the payload moves: {largest}");
    }
}

/// The common CoM of body, wheels and payloads.
fn center(robot: &Ballbot) -> Vector3<f64> {
    let (state, params) = (robot.state(), robot.params());
    let alone = params.without_payloads();
    let of_body = (state.body_position + state.body_quaternion * alone.body_com()) * alone.body_mass;
    let of_payloads: Vector3<f64> = payloads(robot).iter().map(|(mass, [position, _])| position * *mass).sum();
    (of_body + of_payloads) / params.body_mass
}

fn lossless(params: &Params) -> Params {
    Params {
        wheel_viscous_friction: 0.0,
        wheel_coulomb_friction: 0.0,
        ball_viscous_friction: 0.0,
        roller_friction: 0.0,
        roller_friction_slope: 0.0,
        floor_rolling_friction: 0.0,
        floor_spinning_friction: 0.0,
        ..params.clone()
    }
}

/// The linear equations of ball, lean and payload in the plane, M q'' + K q = 0, from the mass matrix of the body alone.
fn linear(params: &Params) -> DMatrix<f64> {
    let alone = params.without_payloads();
    let model = SpatialModel::new(&alone, WheelSpin::Absolute, BallSpin::Free);
    let unit = |i: usize| Vector6::from_fn(|row, _| f64::from(u8::from(row == i)));
    let [x, lean] = [0, 3].map(|i| model.momenta(&UnitQuaternion::identity(), &unit(i)));
    let (m, h) = (params.payload_mass, params.payload_position[2]);
    let mut mass = Matrix3::new(x[0], lean[0], 0.0, x[3], lean[3], 0.0, 0.0, 0.0, 0.0);
    // The velocity of the payload is x' + h lean' + d'.
    let row = Vector3::new(1.0, h, 1.0);
    mass += row * row.transpose() * m;
    let g = params.gravity;
    let toppling = (alone.body_mass * alone.body_com_height + m * h) * g;
    let stiffness = Matrix3::new(0.0, 0.0, 0.0, 0.0, -toppling, -m * g, 0.0, -m * g, params.payload_stiffness[0]);
    let damping = Matrix3::from_diagonal(&Vector3::new(0.0, 0.0, params.payload_damping[0]));
    let inverse = mass.try_inverse().unwrap();
    let mut system = DMatrix::zeros(6, 6);
    system.view_mut((0, 3), (3, 3)).fill_with_identity();
    system.view_mut((3, 0), (3, 3)).copy_from(&(-inverse * stiffness));
    system.view_mut((3, 3), (3, 3)).copy_from(&(-inverse * damping));
    system
}

#[test]
fn small_motions_follow_the_linear_equations_of_ball_lean_and_payload() {
    for name in Params::preset_names() {
        let preset = lossless(&Params::preset(name).unwrap());
        for (share, hertz, damping) in [(0.05, 2.0, 0.0), (0.3, 1.0, 0.1), (0.6, 4.0, 0.3)] {
            let params = carrying(&preset, share, [hertz, hertz, 20.0], damping);
            let lean = 1e-6;
            let state = State::tilted(&params, Vector2::new(0.0, lean), 0.0);
            let mut robot = robot(&params, ModelKind::Spatial, 1e-3, &state);
            let system = linear(&params);
            for step in 1..=5 {
                robot.step([0.0; 3], 100).unwrap();
                let seconds = 0.1 * f64::from(step);
                let start = DVector::from_column_slice(&[0.0, lean, 0.0, 0.0, 0.0, 0.0]);
                let expected = (&system * seconds).exp() * start;
                let (state, deflection) = (robot.state(), robot.payloads()[0]);
                let found = Vector3::new(state.ball_position.x, state.tilt_components().y, deflection.position.x);
                let expected = Vector3::new(expected[0], expected[1], expected[2]);
                let error = (found - expected).norm() / expected.norm();
                assert!(error < 1e-7, "{name}, {share}, {hertz} Hz, {seconds} s: {error:e}, {found} {expected}");
            }
        }
    }
}

/// The torques of a sine on each wheel, so that every degree of freedom moves.
fn torques(step: usize, size: f64) -> Wheels<f64> {
    Wheels::from_fn(|i| size * (0.02 * step as f64 + i as f64).sin())
}

#[test]
fn energy_is_kept_without_torque_and_falls_by_damping() {
    let preset = lossless(&Params::paper());
    for (model, sim_dt, limit) in
        [(ModelKind::Spatial, 1e-3, 1e-9), (ModelKind::Contact, 1e-4, 5e-3), (ModelKind::Rigid, 2e-4, 1e-2)]
    {
        for params in loads(&preset) {
            let state = State::tilted(&params, Vector2::new(0.05, -0.03), 0.3);
            let mut robot = robot(&params, model, sim_dt, &state);
            let before = robot.energy();
            let scale = params.body_mass * params.gravity * params.body_com_height * 0.05;
            let mut same = Ballbot::new(&params.with_payloads_fixed(), model, sim_dt).unwrap();
            same.reset(&state).unwrap();
            assert!((same.energy() - before).abs() < 1e-12 * before.abs(), "the energy of fixed payloads");
            robot.step([0.0; 3], (0.4 / sim_dt) as usize).unwrap();
            assert!((robot.energy() - before).abs() < limit * scale, "{model}: {} {before}", robot.energy());
            assert!(robot.payloads()[0].position.x.abs() > 1e-4);
        }
    }
    let params = carrying(&preset, 0.3, [2.0, 2.0, 5.0], 0.2);
    let mut robot = robot(&params, ModelKind::Spatial, 1e-3, &State::tilted(&params, Vector2::new(0.05, 0.0), 0.0));
    let mut before = robot.energy();
    for _ in 0..50 {
        robot.step([0.0; 3], 10).unwrap();
        assert!(robot.energy() < before);
        before = robot.energy();
    }
}

/// Largest difference of states and deflections of two models under the same torques.
fn difference(a: &mut Ballbot, b: &mut Ballbot, seconds: f64) -> f64 {
    let steps = [&*a, &*b].map(|robot| (0.005 / robot.sim_dt()).round() as usize);
    let mut worst = 0.0_f64;
    for k in 0..(seconds / 0.005) as usize {
        let torque = torques(k, 0.05 * a.params().max_wheel_torque.min(2.0));
        a.step(torque, steps[0]).unwrap();
        b.step(torque, steps[1]).unwrap();
        let rows = [&*a, &*b].map(|robot| {
            let state = robot.state();
            let of_payloads = robot.payloads().into_iter().map(|payload| payload.position);
            [state.ball_position.x, state.ball_position.y]
                .into_iter()
                .chain(of_payloads.flat_map(|d| [d.x, d.y, d.z]))
                .chain(state.tilt_components().iter().copied().collect::<Vec<_>>())
                .collect::<Vec<_>>()
        });
        worst = rows[0].iter().zip(&rows[1]).fold(worst, |worst, (a, b)| worst.max((a - b).abs()));
    }
    worst
}

#[test]
fn contact_and_rigid_converge_to_spatial() {
    let [one, two] = loads(&Params::paper());
    for params in [one, two, carrying(&Params::preset("kugle").unwrap(), 0.5, [1.5, 1.5, 6.0], 0.1)] {
        let state = State::tilted_from_equilibrium(&params, Vector2::new(0.02, -0.03), 0.4);
        for (model, coarse) in [(ModelKind::Contact, 1e-3), (ModelKind::Rigid, 1e-3)] {
            let errors = [coarse, 0.25 * coarse].map(|sim_dt| {
                let mut exact = robot(&params, ModelKind::Spatial, 1e-3, &state);
                difference(&mut robot(&params, model, sim_dt, &state), &mut exact, 0.4)
            });
            assert!(errors[1] < 0.4 * errors[0] && errors[0] < 1e-3, "{model}: {errors:?}");
        }
    }
}

/// A payload that is cut in two halves, each on half of the springs, moves as before.
#[test]
fn two_halves_of_a_payload_move_as_the_payload() {
    let paper = Params::paper();
    let whole = Params { payload_damping: [2.0, 3.0, 4.0], ..lopsided(&paper) };
    let (mass, place) = (0.5 * whole.payload_mass, whole.payload_position);
    let half = |of: [f64; 3]| of.map(|x| 0.5 * x);
    let halves = Params {
        payload_stiffness: half(whole.payload_stiffness),
        payload_damping: half(whole.payload_damping),
        second_payload_stiffness: half(whole.payload_stiffness),
        second_payload_damping: half(whole.payload_damping),
        ..whole.with_payload(0, mass, place).with_payload(1, mass, place)
    };
    assert!((halves.body_mass - whole.body_mass).abs() < 1e-12);
    for model in MODELS {
        let state = State::tilted(&whole, Vector2::new(0.02, -0.03), 0.4);
        let (mut one, mut two) = (robot(&whole, model, 1e-3, &state), robot(&halves, model, 1e-3, &state));
        for k in 0..300 {
            let torque = torques(k, 0.05);
            one.step(torque, 1).unwrap();
            two.step(torque, 1).unwrap();
        }
        let [expected, first, second] = [one.payloads()[0], two.payloads()[0], two.payloads()[1]].map(|d| d.to_array());
        assert!(expected[0].abs() > 1e-3);
        let numbers = |robot: &Ballbot| robot.state().to_array();
        let pairs = [(&first[..], &expected[..]), (&second, &expected), (&numbers(&two), &numbers(&one))]
            .iter()
            .flat_map(|(a, b)| a.iter().zip(*b).map(|(a, b)| (a - b).abs()))
            .fold(0.0, f64::max);
        let limit = if model == ModelKind::Rigid { 1e-6 } else { 1e-9 };
        assert!(pairs < limit, "{model}: {pairs:e}");
    }
}

#[test]
fn a_stiff_payload_moves_as_a_fixed_payload() {
    let params = carrying(&Params::paper(), 0.3, [60.0; 3], 0.5);
    for model in MODELS {
        let state = State::tilted(&params, Vector2::new(0.02, -0.03), 0.4);
        let fixed = params.with_payloads_fixed();
        let (mut loose, mut fixed) = (robot(&params, model, 2e-4, &state), robot(&fixed, model, 2e-4, &state));
        let error = difference(&mut loose, &mut fixed, 0.3);
        assert!(error < 3e-4, "{model}: {error:e}");
    }
}

#[test]
fn a_robot_at_rest_in_equilibrium_stays_with_its_payload_at_its_place() {
    for name in Params::preset_names() {
        let loads = loads(&Params::preset(name).unwrap());
        for (params, model) in loads.iter().flat_map(|params| MODELS.map(|model| (params, model))) {
            let mut robot = robot(params, model, 1e-3, &State::at_equilibrium(params, 0.7));
            robot.step([0.0; 3], 100).unwrap();
            let places = robot.payloads().into_iter().flat_map(|Deflection { position: d, .. }| [d.x, d.y, d.z]);
            let error = places.fold(0.0_f64, |most, d| most.max(d.abs())) / params.body_com_height;
            let limit = if model == ModelKind::Rigid { 1e-4 } else { 1e-9 };
            assert!(error < limit, "{name}, {model}: {error:e}");
        }
    }
}

#[test]
fn an_arm_moves_its_load_and_its_period_is_the_robots() {
    let still = carrying(&Params::paper(), 0.1, [20.0; 3], 0.7);
    let params = Params { payload_amplitude: [0.02, 0.0, 0.0], payload_period: 0.8, ..still };
    for model in MODELS {
        let mut robot = robot(&params, model, 1e-3, &State::upright(&params));
        robot.step([0.0; 3], 200).unwrap();
        let x = robot.payloads()[0].position.x;
        assert!((x - 0.02).abs() < 2e-3, "{model}: {x}");
        assert!(robot.state().ball_position.x.abs() > 1e-5);
    }
}

#[test]
fn a_load_is_picked_up_and_put_down_in_motion() {
    let alone = Params { payload_stiffness: [400.0; 3], payload_damping: [5.0; 3], ..Params::paper() };
    let loaded = alone.with_payload(0, 1.5, [0.01, 0.0, 0.4]);
    let again = loaded.with_payload(0, 0.0, [0.0; 3]);
    assert!((again.body_com() - alone.body_com()).norm() < 1e-12);
    assert!((loaded.without_payloads().body_inertia_matrix() - alone.body_inertia_matrix()).norm() < 1e-12);
    for model in MODELS {
        let state = State::tilted(&alone, Vector2::new(0.02, -0.03), 0.4);
        let mut robot = robot(&alone, model, 1e-3, &state);
        robot.step([0.0; 3], 100).unwrap();
        let before = robot.state();
        assert!(robot.set_params(&loaded).unwrap(), "{model}: the motion continues");
        let change = |robot: &Ballbot| {
            let pairs = robot.state().to_array().into_iter().zip(before.to_array());
            pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
        };
        assert!(change(&robot) < 1e-9, "{model}: {}", change(&robot));
        let began = robot.payloads()[0].to_array().into_iter().fold(0.0_f64, |most, number| most.max(number.abs()));
        assert!(began < 1e-12, "{model}: {began:e}");
        robot.step([0.0; 3], 50).unwrap();
        assert!(robot.payloads()[0].position.x != 0.0);
        assert!(robot.set_params(&again).unwrap());
        robot.step([0.0; 3], 50).unwrap();
        assert_eq!(robot.payloads()[0].position.x, 0.0);
    }
}

#[test]
fn a_robot_continues_from_a_deflection() {
    let params = doubled(&Params::paper());
    let state = State::tilted(&params, Vector2::new(0.02, -0.03), 0.4);
    for model in MODELS {
        let mut one = robot(&params, model, 1e-3, &state);
        one.step([0.01, 0.0, -0.01], 57).unwrap();
        let deflection = one.payloads()[0];
        let mut other = robot(&params, model, 1e-3, &one.state());
        for deflection in other.payloads() {
            assert!(deflection.to_array().iter().all(|x| x.abs() < 1e-12), "{model}: a reset puts it at its place");
        }
        other.set_payloads(&one.payloads()).unwrap();
        assert!((deflection.position.x - other.payloads()[0].position.x).abs() < 1e-12);
        for robot in [&mut one, &mut other] {
            robot.step([0.0, 0.02, -0.01], 80).unwrap();
        }
        let numbers = |robot: &Ballbot| robot.payloads().map(|deflection| deflection.to_array()).concat();
        let pairs = numbers(&one).into_iter().zip(numbers(&other));
        let error = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        // The contacts' initial guess is of the last step, or of rest.
        let limit = if model == ModelKind::Rigid { 2e-4 } else { 1e-6 };
        assert!(error < limit, "{model}: {error:e}");
        assert!(deflection.position.x.abs() > 1e-4 && one.payloads()[1].position.x.abs() > 1e-5);
    }
}

#[test]
fn invalid_deflections_are_rejected_by_name() {
    let params = lopsided(&Params::paper());
    let mut robot = robot(&params, ModelKind::Contact, 1e-3, &State::upright(&params));
    for number in [f64::NAN, 1e4] {
        let deflection = Deflection::from_array([0.0, 0.0, 0.0, 0.0, number, 0.0]);
        let error = robot.set_payloads(&[deflection, Deflection::default()]).unwrap_err().to_string();
        assert!(error.contains("payloads[0][4]") && error.contains("1000"), "{error}");
        assert_eq!(robot.payloads()[0].velocity.y, 0.0);
    }
    let [rest, moved] = [0.0, 0.1].map(|number| Deflection::from_array([number; 6]));
    let error = robot.set_payloads(&[rest, moved]).unwrap_err().to_string();
    assert!(error.contains("payloads[1]") && error.contains("second_payload_mass"), "{error}");
    let mut alone = Ballbot::new(&Params::paper(), ModelKind::Planar, 1e-3).unwrap();
    alone.set_payloads(&[rest; PAYLOADS]).unwrap();
    let error = alone.set_payloads(&[moved, rest]).unwrap_err().to_string();
    assert!(error.contains("payload_mass"), "{error}");
}

#[test]
fn a_snapshot_continues_to_the_last_bit() {
    let params = doubled(&Params::paper());
    let state = State::tilted(&params, Vector2::new(0.02, -0.03), 0.4);
    for model in MODELS {
        let mut one = robot(&params, model, 1e-3, &state);
        one.step([0.01, 0.0, -0.01], 57).unwrap();
        let mut other = Ballbot::new(&params, model, 1e-3).unwrap();
        other.load(&one.save()).unwrap();
        for robot in [&mut one, &mut other] {
            robot.step([0.0, 0.02, -0.01], 80).unwrap();
        }
        assert_eq!(one.state().to_array(), other.state().to_array(), "{model}");
        assert_eq!(one.payloads(), other.payloads(), "{model}");
    }
}

#[test]
fn a_rider_at_rest_changes_no_bit() {
    let params = doubled(&Params::paper());
    let state = State::tilted(&params, Vector2::new(0.02, -0.03), 0.4);
    for model in MODELS {
        let [mut moved, mut still] = [0, 1].map(|_| robot(&params, model, 1e-3, &state));
        moved.move_payload(0, [0.0; 3]).unwrap();
        moved.move_payload(1, [0.0; 3]).unwrap();
        for k in 0..100 {
            moved.step(torques(k, 0.05), 1).unwrap();
            still.step(torques(k, 0.05), 1).unwrap();
        }
        assert_eq!(moved.state().to_array(), still.state().to_array(), "{model}");
        assert_eq!(moved.payloads(), still.payloads(), "{model}");
        // A lean that lasts until a reset.
        moved.move_payload(0, [0.01, 0.0, 0.0]).unwrap();
        moved.step([0.0; 3], 100).unwrap();
        still.step([0.0; 3], 100).unwrap();
        assert!(moved.payloads()[0].position.x - still.payloads()[0].position.x > 1e-3, "{model}");
        for robot in [&mut moved, &mut still] {
            robot.reset(&state).unwrap();
            robot.step([0.0; 3], 100).unwrap();
        }
        assert_eq!(moved.payloads(), still.payloads(), "{model}");
    }
}

#[test]
fn energy_is_kept_while_riders_hold_a_lean() {
    let params = doubled(&lossless(&Params::paper()));
    let state = State::tilted(&params, Vector2::new(0.05, -0.03), 0.3);
    let mut robot = robot(&params, ModelKind::Spatial, 5e-4, &state);
    let upright = robot.energy();
    let offsets = [[0.02, -0.03, 0.01], [-0.01, 0.02, 0.03]];
    let mut springs = 0.0;
    for (i, payload) in params.payloads().iter().enumerate() {
        robot.move_payload(i, offsets[i]).unwrap();
        springs += payload.stiffness.iter().zip(offsets[i]).map(|(k, r)| 0.5 * k * r * r).sum::<f64>();
    }
    let before = robot.energy();
    assert!((before - upright - springs).abs() < 1e-12 * before.abs(), "{before} {upright} {springs}");
    robot.step([0.0; 3], 800).unwrap();
    let scale = params.body_mass * params.gravity * params.body_com_height * 0.05;
    assert!((robot.energy() - before).abs() < 1e-9 * scale, "{} {before}", robot.energy());
}

#[test]
fn a_snapshot_keeps_the_lean_of_a_rider() {
    let params = doubled(&Params::paper());
    let state = State::tilted(&params, Vector2::new(0.02, -0.03), 0.4);
    for model in MODELS {
        let mut one = robot(&params, model, 1e-3, &state);
        one.move_payload(0, [0.02, -0.01, 0.0]).unwrap();
        one.move_payload(1, [0.0, 0.01, 0.03]).unwrap();
        one.step([0.01, 0.0, -0.01], 20).unwrap();
        let mut other = Ballbot::new(&params, model, 1e-3).unwrap();
        other.load(&one.save()).unwrap();
        for robot in [&mut one, &mut other] {
            robot.step([0.0, 0.02, -0.01], 80).unwrap();
        }
        assert_eq!(one.state().to_array(), other.state().to_array(), "{model}");
        assert_eq!(one.payloads(), other.payloads(), "{model}");
    }
}

#[test]
fn robots_in_lanes_carry_riders_as_single_robots() {
    let params = doubled(&Params::paper());
    let config = BalanceConfig { params: params.clone(), ..BalanceConfig::default() };
    let mut batch = Batch::new(&config, 9, Autoreset::Disabled, Some(1), 3).unwrap();
    let mut results = StepResults::new(&batch);
    let start = |i: usize| State::tilted_from_equilibrium(&params, Vector2::new(0.01 * i as f64, -0.03), 0.4);
    let starts: Vec<_> = (0..9).map(|i| Some(start(i))).collect();
    let request = ResetRequest { starts: Some(&starts), ..Default::default() };
    batch.reset_with(&request, &mut results.observations).unwrap();
    let mut alone: Vec<_> = (0..9).map(|i| robot(&params, ModelKind::Contact, batch.sim_dt(), &start(i))).collect();
    for k in 0..20 {
        for (i, one) in alone.iter_mut().enumerate() {
            let offset = [0.01 * (k as f64 + i as f64).sin(), 0.001 * i as f64, 0.0];
            batch.move_payload(i, 0, offset).unwrap();
            one.move_payload(0, offset).unwrap();
            let second = offset.map(|x| -2.0 * x);
            batch.move_payload(i, 1, second).unwrap();
            one.move_payload(1, second).unwrap();
            one.step([0.0; 3], 5).unwrap();
        }
        batch.step(&[0.0; 27], &mut results.buffers()).unwrap();
        for (i, one) in alone.iter().enumerate() {
            assert_eq!(batch.state(i).unwrap(), one.state(), "robot {i}, step {k}");
            assert_eq!(batch.payloads(i).unwrap(), one.payloads(), "robot {i}, step {k}");
        }
    }
}

#[test]
fn invalid_leans_are_rejected_by_name() {
    let params = lopsided(&Params::paper());
    let mut loaded = Ballbot::new(&params, ModelKind::Contact, 1e-3).unwrap();
    for offset in [[f64::NAN, 0.0, 0.0], [0.0, f64::INFINITY, 0.0], [0.0, 0.0, -1001.0]] {
        let before = loaded.save();
        let error = loaded.move_payload(0, offset).unwrap_err();
        assert!(matches!(&error, Error::OutOfRange { name, .. } if name.starts_with("offset[")), "{error}");
        assert_eq!(loaded.save(), before);
    }
    let mut alone = Ballbot::new(&Params::paper(), ModelKind::Contact, 1e-3).unwrap();
    for (index, expected) in [(0, "payload_mass"), (1, "second_payload_mass"), (2, "payload = 2")] {
        let error = alone.move_payload(index, [0.0; 3]).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn invalid_payloads_are_rejected_by_name() {
    let paper = Params::paper();
    let loaded = carrying(&paper, 0.2, [2.0; 3], 0.1);
    let cases = [
        (Params { payload_mass: loaded.body_mass, ..loaded.clone() }, "payload_mass"),
        (Params { payload_position: [0.0, 0.0, 30.0], ..loaded.clone() }, "moment of inertia of the body without"),
        (Params { payload_stiffness: [0.0, 10.0, 10.0], ..loaded.clone() }, "payload_stiffness[0]"),
        (Params { payload_stiffness: [1e7; 3], ..loaded.clone() }, "sim_dt"),
        (Params { payload_damping: [1e6; 3], ..loaded.clone() }, "payload_damping[0]"),
        (Params { second_payload_mass: 0.1, ..paper }, "there must be a first payload"),
        (Params { second_payload_mass: loaded.body_mass, ..loaded.clone() }, "payload_mass + second_payload_mass"),
        (Params { second_payload_mass: 0.1, ..loaded }, "second_payload_stiffness[0]"),
    ];
    for (params, expected) in cases {
        let error = Ballbot::new(&params, ModelKind::Contact, 1e-3).err().unwrap().to_string();
        assert!(error.contains(expected), "{error}");
    }
    let error = Ballbot::new(&loaded, ModelKind::Planar, 1e-3).err().unwrap();
    assert!(matches!(&error, Error::Inconsistent(text) if text.contains("payload_mass")), "{error}");
}

#[test]
fn events_load_a_robot_that_its_law_does_not_expect() {
    let params = Params { payload_stiffness: [400.0; 3], payload_damping: [5.0; 3], ..Params::paper() };
    let params = Params { payload_position: [0.0, 0.0, 0.4], ..params };
    let config = BalanceConfig {
        params: params.clone(),
        events: vec![Event::new("payload_mass", [0.5, 1.5])],
        ..BalanceConfig::default()
    };
    let mut batch = Batch::new(&config, 16, Autoreset::SameStep, Some(1), 3).unwrap();
    let mut results = StepResults::new(&batch);
    batch.reset(None, &mut results.observations).unwrap();
    for i in 0..16 {
        let changed = batch.params(i).unwrap();
        assert!((0.5..=1.5).contains(&changed.payload_mass));
        let expected = params.body_mass + changed.payload_mass;
        assert!((changed.body_mass - expected).abs() < 1e-12);
        assert!(changed.body_com_height > params.body_com_height);
    }
}
