//! The checked robot: invalid input is rejected before anything moves, divergence is reported, resets and snapshots are
//! exact.

use ballbot_core::control::{Controller, Lqr, Setpoint};
use ballbot_core::models::SpatialModel;
use ballbot_core::{Ballbot, Contacts, Error, ModelKind, Params, State, Wheels, attitude};
use nalgebra::{Quaternion, UnitQuaternion, Vector2, Vector3, Vector6};

fn robot(kind: ModelKind) -> Ballbot {
    Ballbot::new(&Params::paper(), kind, 0.002).unwrap()
}

/// The paper's robot with friction in its wheel joints: viscous, N·m/(rad/s), and dry, N·m.
fn with_joint_friction(viscous: f64, dry: f64) -> Params {
    Params { wheel_viscous_friction: viscous, wheel_coulomb_friction: dry, ..Params::paper() }
}

/// Leaning, turning and rolling: nothing in it is zero.
fn lively() -> State {
    let body = attitude(Vector2::new(0.05, -0.03), 0.6);
    State::rolling(&Params::paper(), Vector2::new(0.1, -0.05), 0.2, body, Vector3::new(0.2, -0.1, 0.3))
}

/// States of half a second under feedback and a push, to the last bit.
fn trace(robot: &mut Ballbot) -> Vec<[f64; State::LEN]> {
    let mut lqr = Lqr::new(&Params::paper(), 0.01).unwrap();
    let step = |k| {
        if k == 10 {
            robot.push(&Vector3::new(0.05, 0.1, 0.0), Some(&Vector3::new(0.02, 0.0, 0.3))).unwrap();
        }
        let torques = lqr.wheel_torques(&robot.state(), &Setpoint::default());
        robot.step(torques, 5).unwrap();
        robot.state().to_array()
    };
    (0..50).map(step).collect()
}

/// The trace that a new robot leaves from [`lively`].
fn fresh_trace(kind: ModelKind) -> Vec<[f64; State::LEN]> {
    let mut robot = robot(kind);
    robot.reset(&lively()).unwrap();
    trace(&mut robot)
}

/// Asserts that `act` fails and leaves the robot unchanged; returns the message.
#[track_caller]
fn rejected(robot: &mut Ballbot, act: impl FnOnce(&mut Ballbot) -> Result<(), Error>) -> String {
    let before = robot.save();
    let error = act(robot).expect_err("accepted");
    assert!(!matches!(error, Error::Diverged { .. }), "{error:?}");
    assert_eq!(robot.save(), before, "{}: rejected, but something moved", robot.kind());
    error.to_string()
}

#[test]
fn models_are_chosen_by_name() {
    for (name, kind) in [("planar", ModelKind::Planar), ("spatial", ModelKind::Spatial), ("rigid", ModelKind::Rigid)] {
        assert_eq!(name.parse::<ModelKind>().unwrap(), kind);
        assert_eq!(kind.to_string(), name);
        assert_eq!(robot(kind).kind(), kind);
    }
    let error = "mujoco".parse::<ModelKind>().unwrap_err();
    assert_eq!(error.to_string(), "unknown model 'mujoco': expected one of planar, spatial, contact, rigid");
}

#[test]
fn time_steps_out_of_range_are_rejected() {
    for kind in ModelKind::ALL {
        for sim_dt in [0.0, -0.001, 9e-7, 0.0201, f64::NAN, f64::INFINITY] {
            let error = Ballbot::new(&Params::paper(), kind, sim_dt).err().expect("accepted").to_string();
            assert!(
                error.starts_with(&format!("sim_dt = {sim_dt} ")) && error.contains(">= 1e-6 and <= 0.02 s"),
                "{error}"
            );
        }
        for sim_dt in [1e-6, 0.02] {
            assert_eq!(Ballbot::new(&Params::paper(), kind, sim_dt).unwrap().sim_dt(), sim_dt);
        }
    }
}

#[test]
fn invalid_parameters_are_rejected() {
    for kind in ModelKind::ALL {
        let error = Ballbot::new(&Params { gravity: -9.81, ..Params::paper() }, kind, 0.001).err().expect("accepted");
        assert!(error.to_string().starts_with("gravity = -9.81 "), "{error}");
    }
    // Wheels that leave the body no inertia: only separate bodies show it.
    let heavy = Params { wheel_mass: 0.7, ..Params::paper() };
    assert!(Ballbot::new(&heavy, ModelKind::Spatial, 0.001).is_ok());
    let error = Ballbot::new(&heavy, ModelKind::Rigid, 0.001).err().expect("accepted");
    assert!(matches!(error, Error::Inconsistent(_)) && error.to_string().contains("wheel_mass = 0.7 kg"), "{error}");
}

#[test]
fn torques_beyond_the_motor_limit_are_rejected() {
    for kind in ModelKind::ALL {
        let mut robot = robot(kind);
        robot.reset(&lively()).unwrap();
        robot.step([5.0, -5.0, 0.0], 1).expect("the limit itself is allowed");
        for (i, bad) in [(0, f64::NAN), (1, 5.01), (2, -5.01), (2, f64::INFINITY)] {
            let mut torques = [0.1; 3];
            torques[i] = bad;
            let message = rejected(&mut robot, |robot| robot.step(torques, 3));
            assert!(message.starts_with(&format!("wheel_torques[{i}] = {bad} ")), "{message}");
            assert!(message.contains("±max_wheel_torque = 5 N·m"), "{message}");
        }
    }
}

#[test]
fn states_out_of_bounds_are_rejected() {
    let with = |change: &dyn Fn(&mut State)| {
        let mut state = lively();
        change(&mut state);
        state
    };
    let cases = [
        (with(&|s| s.ball_position.z = 0.1), "ball_position[2] = 0.1 "),
        (with(&|s| s.body_velocity.y = f64::NAN), "body_velocity[1] = NaN "),
        (with(&|s| s.wheel_speeds[2] = f64::INFINITY), "wheel_speeds[2] = inf "),
        (with(&|s| s.ball_position.x = 2e4), "distance of the ball from the origin = 20000"),
        (with(&|s| s.ball_velocity.x = 101.0), "ball speed = 101"),
        (with(&|s| s.body_angular_velocity.z = -2e4), "body rate = 20000"),
        (with(&|s| s.wheel_speeds[0] = -2e4), "wheel speed = 20000"),
        (
            with(&|s| s.body_quaternion = UnitQuaternion::new_unchecked(Quaternion::new(1.01, 0.0, 0.0, 0.0))),
            "the length of body_quaternion = 1.01 ",
        ),
    ];
    for kind in ModelKind::ALL {
        let mut robot = robot(kind);
        robot.reset(&lively()).unwrap();
        robot.step([0.1, -0.2, 0.05], 7).unwrap();
        for (state, words) in &cases {
            let message = rejected(&mut robot, |robot| robot.reset(state));
            assert!(message.contains(words), "{kind}: '{message}' does not contain '{words}'");
        }
    }
}

#[test]
fn slipping_starts_need_a_model_with_contacts() {
    let mut slipping = lively();
    slipping.wheel_speeds[1] += 1.0;
    for kind in [ModelKind::Planar, ModelKind::Spatial] {
        let message = rejected(&mut robot(kind), |robot| robot.reset(&slipping));
        assert!(message.starts_with("wheel_speeds[1] = "), "{kind}: {message}");
    }
    let mut rigid = robot(ModelKind::Rigid);
    rigid.reset(&slipping).unwrap();
    assert!((rigid.state().wheel_speeds[1] - slipping.wheel_speeds[1]).abs() < 1e-12);
}

#[test]
fn invalid_pushes_and_joint_friction_are_rejected() {
    for kind in ModelKind::ALL {
        let mut robot = robot(kind);
        let nan = Vector3::new(0.0, f64::NAN, 0.0);
        assert!(rejected(&mut robot, |r| r.push(&nan, None)).starts_with("impulse[1] = NaN "));
        assert!(rejected(&mut robot, |r| r.push(&Vector3::x(), Some(&nan))).starts_with("point[1] = NaN "));
        for (viscous, dry, words) in
            [(-0.1, 0.0, "wheel_viscous_friction = -0.1 "), (0.0, f64::NAN, "wheel_coulomb_friction = NaN ")]
        {
            let params = with_joint_friction(viscous, dry);
            let message = rejected(&mut robot, |robot| robot.set_params(&params).map(|_| ()));
            assert!(message.starts_with(words), "{message}");
        }
    }
}

#[test]
fn divergence_is_reported_until_a_reset() {
    for kind in ModelKind::ALL {
        let expected = fresh_trace(kind);
        for impulse in [1e3, 1e4] {
            let mut robot = robot(kind);
            robot.reset(&lively()).unwrap();
            robot.push(&Vector3::new(impulse, 0.0, 0.0), None).unwrap();
            let error = robot.step([0.0; 3], 5).expect_err("a robot at this speed has diverged");
            let Error::Diverged { time, reason } = &error else { panic!("{kind}, {impulse} N·s: {error:?}") };
            assert!(
                (time - 0.01).abs() < 1e-12 && (reason.contains("limit") || reason.contains("not finite")),
                "{kind}, {impulse} N·s: {error}"
            );
            assert_eq!(robot.diverged().as_ref(), Some(reason));
            for _ in 0..300 {
                let again = robot.step([0.0; 3], 10).expect_err("comes back by itself");
                assert_eq!(again.to_string(), error.to_string(), "{kind}, {impulse} N·s");
            }
            robot.reset(&lively()).unwrap();
            assert_eq!(robot.diverged(), None);
            assert!(trace(&mut robot) == expected, "{kind}: {impulse} N·s left a trace through the reset");
        }
    }
}

#[test]
fn reset_robots_equal_new_robots_bit_for_bit() {
    for kind in ModelKind::ALL {
        let expected = fresh_trace(kind);
        let mut robot = robot(kind);
        robot.reset(&State::tilted(&Params::paper(), Vector2::new(0.3, 0.2), -1.0)).unwrap();
        robot.step([0.4, 0.1, -0.2], 300).unwrap();
        robot.push(&Vector3::new(0.0, 3.0, 0.0), None).unwrap();
        robot.reset(&lively()).unwrap();
        assert_eq!(robot.time(), 0.0);
        assert!(trace(&mut robot) == expected, "{kind}: the reset left something");
    }
}

#[test]
fn state_after_a_reset_is_the_given_one() {
    let mut state = lively();
    state.ball_position += Vector3::new(1.0, -2.0, 0.0);
    state.body_position = state.ball_position;
    state.ball_quaternion = UnitQuaternion::from_scaled_axis(Vector3::new(0.3, 0.2, -0.9));
    state.wheel_angles = Wheels([0.5, -1.0, 2.0]);
    for kind in [ModelKind::Spatial, ModelKind::Rigid] {
        let mut robot = robot(kind);
        robot.reset(&state).unwrap();
        let (found, expected) = (robot.state().to_array(), state.to_array());
        let off = found.iter().zip(expected).map(|(f, e)| (f - e).abs()).fold(0.0, f64::max);
        assert!(off < 1e-12, "{kind}: off by {off:e}: {found:?}, expected {expected:?}");
    }
}

#[test]
fn loaded_robots_continue_bit_for_bit() {
    for kind in ModelKind::ALL {
        let mut robot = robot(kind);
        robot.reset(&lively()).unwrap();
        let params = with_joint_friction(1e-4, 1e-3);
        assert!(robot.set_params(&params).unwrap());
        robot.step([0.1, -0.05, 0.02], 11).unwrap();
        let saved = robot.save();
        let expected = trace(&mut robot);
        let message = rejected(&mut self::robot(kind), |other| other.load(&saved));
        assert!(message.contains("parameters differ"), "{kind}: {message}");
        let mut other = Ballbot::new(&params, kind, 0.002).unwrap();
        other.load(&saved).unwrap();
        assert!(trace(&mut other) == expected, "{kind}: the saved robot went another way");
        let message = rejected(&mut other, |other| other.load(&saved[..20]));
        assert!(message.starts_with("cannot decode snapshot of a robot: "), "{kind}: {message}");
    }
}

#[test]
fn joint_friction_persists_through_a_reset() {
    let params = with_joint_friction(2e-3, 0.01);
    for kind in ModelKind::ALL {
        let expected = fresh_trace(kind);
        let mut robot = robot(kind);
        assert_eq!(robot.params(), &Params::paper());
        assert!(robot.set_params(&params).unwrap());
        robot.reset(&lively()).unwrap();
        assert_eq!(robot.params(), &params);
        let slowed = trace(&mut robot);
        assert!(slowed != expected, "{kind}: friction without effect");
        // The same friction from the start.
        let mut built = Ballbot::new(&params, kind, 0.002).unwrap();
        built.reset(&lively()).unwrap();
        assert!(trace(&mut built) == slowed, "{kind}: differs from a robot built with that friction");
    }
}

#[test]
fn friction_utilization_is_the_fraction_of_the_dynamic_limit() {
    let params = Params { wheel_dynamic_friction: 0.5, floor_dynamic_friction: 0.8, ..Params::paper() };
    let contacts = Contacts {
        wheel_normal_forces: Wheels([10.0, 0.0, -1.0]),
        wheel_tractions: Wheels([-2.0, 0.0, 0.1]),
        floor_force: Vector3::new(3.0, -4.0, 25.0),
        ..Contacts::default()
    };
    assert_eq!(contacts.friction_utilization(&params), [0.4, 0.0, f64::INFINITY, 0.25]);
    // A lifted wheel that would have to drive.
    let lifted = Contacts { wheel_tractions: Wheels([0.0, 0.5, 0.0]), ..contacts };
    assert_eq!(lifted.friction_utilization(&params)[1], f64::INFINITY);
}

#[test]
fn friction_utilization_of_a_turning_ball_has_its_closed_form() {
    // Equal torques turn the ball under the upright body and load all wheels alike. The planar model counts the wheels'
    // energy as the paper does, the others their absolute spin.
    let params = Params::paper();
    for (kind, absolute_spin, tolerance) in
        [(ModelKind::Planar, false, 1e-9), (ModelKind::Spatial, true, 1e-9), (ModelKind::Rigid, true, 5e-3)]
    {
        let model = SpatialModel::new(&params, absolute_spin, true);
        let contacts =
            model.contacts(&UnitQuaternion::identity(), &Vector6::zeros(), Wheels::of_column(Vector3::repeat(0.2)));
        let expected = contacts.wheel_tractions[0] / (params.wheel_dynamic_friction * params.static_wheel_load());
        let mut robot = robot(kind);
        robot.step([0.2; 3], 20).unwrap();
        let share = robot.contacts().friction_utilization(&params);
        for wheel in &share[..3] {
            assert!((wheel / expected - 1.0).abs() < tolerance, "{kind}: {share:?}, expected {expected}");
        }
        assert!(share[3] < 1e-3, "{kind}: the floor is loaded by {}", share[3]);
    }
}

#[test]
fn diverged_robots_keep_their_last_finite_state() {
    // Far beyond the bounds within one call: some of these end where squares overflow, but the numbers do not.
    let params = Params { body_inertia: [0.0583, 0.05, 0.0137], ..Params::paper() };
    for kind in [ModelKind::Planar, ModelKind::Spatial, ModelKind::Contact] {
        let mut diverged = 0;
        for (push, steps) in (0..50).flat_map(|push| (1..=6).map(move |steps| (push, steps))) {
            let mut robot = Ballbot::new(&params, kind, 0.02).unwrap();
            robot.reset(&State::upright(&params)).unwrap();
            let impulse = Vector3::new(1.0, -0.5, 0.2) * 1.2_f64.powi(push);
            robot.push(&impulse, Some(&Vector3::new(0.3, 0.2, 0.5))).unwrap();
            diverged += u32::from(robot.step([0.0; 3], steps).is_err());
            let state = robot.state().to_array();
            assert!(state.iter().all(|v| v.is_finite()), "{kind}, push {push}, after {steps} steps: {state:?}");
        }
        assert!(diverged > 100, "{kind}: only {diverged} of 300 diverged");
    }
}
