//! Forces from outside on the body over time: their momentum and moment, equilibria in closed form, times, copies and
//! neighbors.

use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, Event, StepBuffers, StepResults, When};
use ballbot_core::kinematics::{Omniwheels, TorqueMap};
use ballbot_core::models::{BallSpin, PointForce, SpatialModel, WheelSpin};
use ballbot_core::task::{ACTION_LEN, Balance};
use ballbot_core::{Ballbot, Error, Force, ModelKind, Params, State, Wheels};
use nalgebra::{Vector2, Vector3, Vector6};
use std::f64::consts::TAU;

const SIM_DT: f64 = 1e-3;

/// The models that have forces over time.
const MODELS: [ModelKind; 3] = [ModelKind::Spatial, ModelKind::Contact, ModelKind::Rigid];

fn robot(params: &Params, model: ModelKind, state: &State) -> Ballbot {
    let mut robot = Ballbot::new(params, model, SIM_DT).unwrap();
    robot.reset(state).unwrap();
    robot
}

/// A robot in the air whose body is clear of its ball, so that nothing else acts on the body.
fn flying(model: ModelKind) -> Ballbot {
    let params = Params::paper();
    let mut state = State::tilted(&params, Vector2::new(0.4, -0.7), 1.1);
    state.ball_position.z = 1.0;
    state.body_position.z = 30.0;
    robot(&params, model, &state)
}

/// Momentum of the body without the momentum by its weight.
fn momentum(robot: &Ballbot) -> Vector3<f64> {
    let (params, state) = (robot.params(), robot.state());
    let rate = state.body_quaternion * state.body_angular_velocity;
    let velocity = state.body_velocity + rate.cross(&(state.body_quaternion * params.body_com()));
    (velocity + Vector3::z() * params.gravity * robot.time()) * params.body_mass
}

/// Integral of a sine of 1 N from its begin.
fn impulse_of_sine(frequency: f64, phase: f64, seconds: f64) -> f64 {
    let turn = TAU * frequency;
    (phase.cos() - (phase + turn * seconds).cos()) / turn
}

#[test]
fn a_force_changes_the_momentum_by_its_integral() {
    let force = Vector3::new(2.0, -1.0, 0.5);
    for (model, limit) in [(ModelKind::Contact, 1e-11), (ModelKind::Rigid, 1e-4)] {
        for (frequency, phase) in [(0.0, 0.0), (3.7, 0.0), (499.0, 0.3), (0.02, -1.0)] {
            let mut robot = flying(model);
            let given = Force {
                frequency,
                phase,
                delay: 0.02,
                duration: 0.1,
                ..Force::constant(force, Some(Vector3::new(0.03, 0.0, 0.1)))
            };
            robot.apply_force(&given).unwrap();
            for step in 1..=200 {
                robot.step([0.0; 3], 1).unwrap();
                let seconds = (f64::from(step) * SIM_DT - given.delay).clamp(0.0, given.duration);
                let share = if frequency == 0.0 { seconds } else { impulse_of_sine(frequency, phase, seconds) };
                let error = (momentum(&robot) - force * share).norm() / force.norm();
                assert!(error < limit, "{model}, {frequency} Hz, step {step}: {error:e}");
            }
            assert!(!robot.has_force());
        }
    }
}

/// In the models with contacts a constant force is a push of each step, to the last bit: at the point on the moving body.
#[test]
fn a_force_is_a_push_of_each_step() {
    let (force, point) = (Vector3::new(1.0, 0.7, -0.2), Vector3::new(0.05, -0.02, 0.3));
    let uneven = Params { body_com_offset: [5e-3, -3e-3], ..Params::paper() };
    for (model, params) in [ModelKind::Contact, ModelKind::Rigid]
        .into_iter()
        .flat_map(|model| [Params::paper(), uneven.clone()].map(|params| (model, params)))
    {
        let state = State::tilted(&params, Vector2::new(0.03, -0.02), 0.4);
        let (mut forced, mut pushed) = (robot(&params, model, &state), robot(&params, model, &state));
        forced.apply_force(&Force::constant(force, Some(point))).unwrap();
        forced.step([0.01, -0.02, 0.03], 100).unwrap();
        for _ in 0..100 {
            pushed.push(&(force * SIM_DT), Some(&point)).unwrap();
            pushed.step([0.01, -0.02, 0.03], 1).unwrap();
        }
        let error = (forced.state().to_array().iter().zip(pushed.state().to_array()))
            .fold(0.0_f64, |worst, (a, b)| worst.max((a - b).abs()));
        assert!(error < 1e-12, "{model}: {error:e}");
    }
}

/// Lean towards a horizontal force F at height h, and the wheel torques, with which the robot rests: M_b g l sin θ + F h cos θ +
/// F r_k = 0 and τ = −F r_w.
fn resting(params: &Params, force: Vector2<f64>, height: f64) -> (State, Wheels<f64>) {
    let size = force.norm();
    let weight = params.body_mass * params.gravity * params.body_com_height;
    let moment = weight.hypot(size * height);
    let lean = -(size * params.ball_radius / moment).asin() - (size * height).atan2(weight);
    let tilt = Vector2::new(-force.y, force.x) * (lean / size);
    let virtual_torques = Vector3::new(-force.y, force.x, 0.0) * params.wheel_radius;
    (State::tilted(params, tilt, 0.0), Omniwheels::new(params).wheel_torques(&virtual_torques, TorqueMap::Consistent))
}

#[test]
fn a_robot_rests_under_a_force_at_the_lean_of_the_closed_form() {
    for name in Params::preset_names() {
        let params = Params { wheel_viscous_friction: 0.0, ..Params::preset(name).unwrap() };
        let params = Params { wheel_coulomb_friction: 0.0, ..params };
        let model = SpatialModel::new(&params, WheelSpin::Absolute, BallSpin::Free);
        let weight = (params.body_mass + params.ball_mass) * params.gravity;
        for (azimuth, share) in [(0.0_f64, 0.01), (0.5 * TAU / 2.0, 0.02), (2.1, 0.005)] {
            for height in [0.0, params.body_com_height, 2.0 * params.body_com_height] {
                let force = Vector2::new(azimuth.cos(), azimuth.sin()) * (share * weight);
                let load = PointForce { force: force.push(0.0), point: Vector3::z() * height };
                let (state, torques) = resting(&params, force, height);
                let accelerations =
                    model.accelerations_under(&state.body_quaternion, &Vector6::zeros(), torques, &[load]);
                // A tilt in two planes at once turns the axes of the wheels by its square.
                let tolerance = if azimuth == 0.0 { 1e-12 } else { 1e-2 * share };
                assert!(accelerations.amax() < tolerance * 100.0, "{name}, {azimuth}, {height}: {accelerations}");
                let contacts = model.contacts_under(&state.body_quaternion, &Vector6::zeros(), torques, &[load]);
                let floor = Vector3::new(-force.x, -force.y, weight);
                let error = (contacts.floor_force - floor).norm() / weight;
                assert!(error < tolerance, "{name}, {azimuth}, {height}: {}", contacts.floor_force);
            }
        }
    }
}

/// Also in the simulations: the tilt grows only from rounding and the compliance of contacts, the floor reacts.
#[test]
fn the_simulations_rest_there_too() {
    let params = Params::paper();
    for model in MODELS {
        for height in [0.0, 0.142, 0.3] {
            let force = Vector2::new(1.0, 0.0);
            let (state, torques) = resting(&params, force, height);
            let mut robot = robot(&params, model, &state);
            robot.apply_force(&Force::constant(force.push(0.0), Some(Vector3::z() * height))).unwrap();
            robot.step(torques, 100).unwrap();
            let turned = robot.state().body_quaternion.angle_to(&state.body_quaternion);
            let floor = robot.contacts().floor_force;
            println!("{model} {height}: {turned:e} {floor:?}");
            // Without the force it would turn by more than 0.01 rad.
            assert!(turned < 3e-4, "{model}, {height}: {turned:e}");
            assert!((floor.x + 1.0).abs() < 1e-2 && floor.y.abs() < 1e-2, "{model}, {height}: {floor}");
        }
    }
}

/// The closed-form model integrates a force by its own method: the error of a step falls with its fourth power.
#[test]
fn the_error_of_the_closed_form_model_is_of_fourth_order() {
    let params = Params::paper();
    let start = State::tilted(&params, Vector2::new(0.02, -0.01), 0.0);
    let end = |steps: usize| {
        let mut robot = Ballbot::new(&params, ModelKind::Spatial, 0.32 / steps as f64).unwrap();
        robot.reset(&start).unwrap();
        robot.apply_force(&Force::constant(Vector3::new(3.0, 2.0, 1.0), Some(Vector3::new(0.05, 0.0, 0.3)))).unwrap();
        robot.step([0.05, -0.02, 0.1], steps).unwrap();
        robot.state().body_quaternion
    };
    let exact = end(5120);
    let errors = [16, 32, 64].map(|steps| end(steps).angle_to(&exact));
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((3.5..4.6).contains(&order), "order {order}, errors {errors:?}");
    }
}

#[test]
fn the_models_agree_under_a_sine() {
    let params = Params::paper();
    let after = |model: ModelKind| {
        let mut robot = robot(&params, model, &State::upright(&params));
        let force = Force { frequency: 4.0, ..Force::constant(Vector3::new(2.0, -1.0, 0.0), None) };
        robot.apply_force(&force).unwrap();
        robot.step([0.0; 3], 300).unwrap();
        robot.state()
    };
    let expected = after(ModelKind::Spatial);
    assert!(expected.tilt() > 0.01, "{}", expected.tilt());
    for model in [ModelKind::Contact, ModelKind::Rigid] {
        let found = after(model);
        let turned = found.body_quaternion.angle_to(&expected.body_quaternion) / expected.tilt();
        let moved = (found.ball_position - expected.ball_position).norm();
        println!("{model}: {turned:e}, {moved:e} m");
        assert!(turned < 2e-2 && moved < 2e-3, "{model}: {turned:e}, {moved:e} m");
    }
}

#[test]
fn a_force_ends_with_a_reset_a_zero_and_its_duration() {
    let params = Params::paper();
    for model in MODELS {
        let start = State::upright(&params);
        let mut forced = robot(&params, model, &start);
        let force = Force::constant(Vector3::x(), None);
        for end in 0..3 {
            forced.reset(&start).unwrap();
            forced.apply_force(&Force { duration: if end == 2 { 0.005 } else { f64::INFINITY }, ..force }).unwrap();
            assert!(forced.has_force());
            forced.step([0.0; 3], 5).unwrap();
            match end {
                0 => forced.reset(&start).unwrap(),
                1 => forced.apply_force(&Force::constant(Vector3::zeros(), None)).unwrap(),
                _ => {}
            }
            assert!(!forced.has_force(), "{model}, {end}");
        }
        forced.reset(&start).unwrap();
        forced.step([0.01; 3], 20).unwrap();
        let mut fresh = robot(&params, model, &start);
        fresh.step([0.01; 3], 20).unwrap();
        assert_eq!(forced.state(), fresh.state(), "{model}");
    }
}

#[test]
fn a_snapshot_keeps_a_force() {
    let params = Params::paper();
    for model in MODELS {
        let start = State::tilted(&params, Vector2::new(0.01, 0.02), 0.3);
        let mut one = robot(&params, model, &start);
        let force =
            Force { frequency: 3.0, phase: 0.4, duration: 0.05, ..Force::constant(Vector3::new(1.0, 2.0, 0.0), None) };
        one.apply_force(&force).unwrap();
        one.step([0.01, 0.0, 0.0], 17).unwrap();
        let mut other = robot(&params, model, &State::upright(&params));
        other.load(&one.save()).unwrap();
        for robot in [&mut one, &mut other] {
            robot.step([0.0, 0.01, 0.0], 60).unwrap();
        }
        assert_eq!(one.state(), other.state(), "{model}");
        assert_eq!(one.contacts(), other.contacts(), "{model}");
    }
}

#[test]
fn forces_out_of_range_are_rejected_by_name() {
    let params = Params::paper();
    let given = Force::constant(Vector3::x(), None);
    let wrong = [
        ("force[1]", Force { force: Vector3::new(0.0, f64::NAN, 0.0), ..given }),
        ("force[0]", Force { force: Vector3::new(1.1e5, 0.0, 0.0), ..given }),
        ("force[2]", Force { force: Vector3::new(0.0, 0.0, f64::NEG_INFINITY), ..given }),
        ("point[2]", Force { point: Some(Vector3::new(0.0, 0.0, 101.0)), ..given }),
        ("frequency", Force { frequency: 501.0, ..given }),
        ("frequency", Force { frequency: -1.0, ..given }),
        ("frequency", Force { frequency: f64::NAN, ..given }),
        ("phase", Force { phase: f64::INFINITY, ..given }),
        ("delay", Force { delay: -1e-3, ..given }),
        ("delay", Force { delay: f64::INFINITY, ..given }),
        ("duration", Force { duration: f64::NAN, ..given }),
    ];
    for model in MODELS {
        let mut robot = robot(&params, model, &State::upright(&params));
        for (expected, force) in &wrong {
            match robot.apply_force(force) {
                Err(Error::OutOfRange { name, .. }) => assert_eq!(name, *expected),
                other => panic!("{expected}: {other:?}"),
            }
            assert!(!robot.has_force());
        }
        // The largest force throws the robot, and the next steps are finite or a divergence.
        robot.apply_force(&Force::constant(Vector3::new(1e5, -1e5, 1e5), Some(Vector3::new(100.0, 0.0, 0.0)))).unwrap();
        match robot.step([0.0; 3], 200) {
            Ok(()) => assert!(robot.state().to_array().iter().all(|number| number.is_finite())),
            // The engine of `rigid` keeps parts of a failed step.
            Err(Error::Diverged { .. }) if model == ModelKind::Rigid => {}
            Err(Error::Diverged { .. }) => assert!(robot.state().to_array().iter().all(|number| number.is_finite())),
            Err(other) => panic!("{model}: {other}"),
        }
    }
    let mut planar = robot(&params, ModelKind::Planar, &State::upright(&params));
    let error = planar.apply_force(&given).unwrap_err().to_string();
    assert!(error.contains("'planar'"), "{error}");
}

fn config(model: ModelKind) -> BalanceConfig {
    BalanceConfig { model, task: Balance { reset_tilt: 0.0, ..Balance::default() }, ..BalanceConfig::default() }
}

fn step(batch: &mut Batch, results: &mut StepResults, times: usize) {
    let actions = vec![0.0; batch.len() * ACTION_LEN];
    for _ in 0..times {
        let mut buffers: StepBuffers<'_> = results.buffers();
        batch.step(&actions, &mut buffers).unwrap();
    }
}

fn batch(config: &BalanceConfig, count: usize) -> (Batch, StepResults) {
    let mut batch = Batch::new(config, count, Autoreset::SameStep, Some(1), 5).unwrap();
    let mut results = StepResults::new(&batch);
    batch.reset(None, &mut results.observations).unwrap();
    (batch, results)
}

/// On one robot of a batch it leaves the others their bits, and gives the robot the bits of a robot alone.
#[test]
fn a_force_on_one_robot_leaves_its_neighbors() {
    for model in MODELS {
        let config = config(model);
        let force = Force { frequency: 2.0, ..Force::constant(Vector3::new(0.0, 1.5, 0.0), Some(Vector3::z() * 0.2)) };
        let ((mut plain, mut first), (mut forced, mut second)) = (batch(&config, 11), batch(&config, 11));
        forced.apply_force(3, &force).unwrap();
        step(&mut plain, &mut first, 20);
        step(&mut forced, &mut second, 20);
        for i in 0..11 {
            let same = plain.state(i).unwrap() == forced.state(i).unwrap();
            assert_eq!(same, i != 3, "{model}, robot {i}");
        }
        let mut alone = Batch::new(&config, 1, Autoreset::SameStep, Some(1), 8).unwrap();
        let mut results = StepResults::new(&alone);
        alone.reset(None, &mut results.observations).unwrap();
        alone.apply_force(0, &force).unwrap();
        step(&mut alone, &mut results, 20);
        assert_eq!(alone.state(0).unwrap(), forced.state(3).unwrap(), "{model}");
        assert!(forced.apply_force(11, &force).is_err());
    }
}

fn event(range: [f64; 2]) -> Event {
    Event { when: When::At(0.05), duration: 0.1, ..Event::new("force", range) }
}

#[test]
fn an_event_is_the_force_that_it_draws() {
    for model in MODELS {
        let with = BalanceConfig { events: vec![Event { frequency: 5.0, ..event([0.5, 1.0]) }], ..config(model) };
        let ((mut drawn, mut first), (mut given, mut second)) = (batch(&with, 3), batch(&config(model), 3));
        step(&mut drawn, &mut first, 6);
        step(&mut given, &mut second, 5);
        for i in 0..3 {
            let draws = drawn.draws(i).unwrap();
            let [size, azimuth] = [draws[0], draws[1]];
            assert!((0.5..=1.0).contains(&size));
            let force = Vector3::new(azimuth.cos(), azimuth.sin(), 0.0) * size;
            let force = Force { frequency: 5.0, duration: 0.1, ..Force::constant(force, None) };
            given.apply_force(i, &force).unwrap();
        }
        step(&mut given, &mut second, 1);
        step(&mut drawn, &mut first, 14);
        step(&mut given, &mut second, 14);
        for i in 0..3 {
            assert_eq!(drawn.state(i).unwrap(), given.state(i).unwrap(), "{model}, robot {i}");
        }
        assert_eq!(drawn.push_count(0).unwrap(), 0);
    }
}

#[test]
fn events_of_forces_are_checked() {
    let refused = |model: ModelKind, event: Event| {
        let config = BalanceConfig { events: vec![event], ..config(model) };
        Batch::new(&config, 1, Autoreset::SameStep, Some(1), 0).err().map(|error| error.to_string()).unwrap_or_default()
    };
    let contact = ModelKind::Contact;
    assert_eq!(refused(contact, event([0.0, 1.0])), "");
    assert!(refused(ModelKind::Planar, event([0.0, 1.0])).contains("the model 'planar' has no force over time"));
    assert!(refused(contact, event([0.0, 1e6])).contains("force[0] = 1000000"));
    assert!(refused(contact, event([-1.0, 1.0])).contains("the direction of a force is its azimuth"));
    let fast = Event { frequency: 1e4, ..event([0.0, 1.0]) };
    assert!(refused(contact, fast).contains("frequency"));
    let reset = Event { when: When::Reset, ..event([0.0, 1.0]) };
    assert!(refused(contact, reset).contains("a force has mode 'interval' or 'at'"));
    let long = Event { when: When::Every([1.0, 2.0]), duration: 1.5, ..event([0.0, 1.0]) };
    assert!(refused(contact, long).contains("when the next force may come"));
}

#[test]
fn another_engine_rejects_a_force_by_name() {
    let (mut batch, mut results) = batch(&config(ModelKind::Contact), 2);
    batch.apply_force(1, &Force::constant(Vector3::x(), None)).unwrap();
    let moved = batch.step_with(&[0.0; 6], &mut results.buffers(), |before| Ok::<_, Error>(before.states.clone()));
    assert_eq!(moved.unwrap_err().to_string(), "a force acts on robot 1, but another engine takes pushes only");
}
