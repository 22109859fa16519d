//! Robots without symmetry: equilibrium, motion about it, energy, and controllers.

mod slope;
mod task;

use crate::support::general::{any_robot_on_rollers, any_small_tilt, crooked};
use crate::support::{any_start, natural_rate, torques, vector, without_losses};
use ballbot_core::control::{Controller, LimitOptions, Lqr, LqrWeights, Pid, PidGains, Sampled, Setpoint};
use ballbot_core::kinematics::{Omniwheels, TorqueMap};
use ballbot_core::models::{LinearModel, PlanarModel, SpatialModel, SpatialMotion, WheelInertia, traction_torque};
use ballbot_core::{Ballbot, Error, Model, ModelKind, Params, State, Wheels, mechanical_energy};
use nalgebra::{DMatrix, SVector, UnitQuaternion, Vector2, Vector3, Vector6};
use proptest::prelude::*;
use std::f64::consts::PI;

const CONTROL_DT: f64 = 0.005;

/// Angle between the vertical and the line from the ball's center to the body's center of mass.
fn lean(params: &Params, state: &State) -> f64 {
    let [x, y] = params.body_com_offset;
    let com = state.body_quaternion * Vector3::new(x, y, params.body_com_height);
    com.xy().norm().atan2(com.z)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_equilibrium_is_a_fixed_point_with_its_wheel_loads(params in any_robot_on_rollers(), yaw in -PI..PI) {
        let state = State::at_equilibrium(&params, yaw);
        let [x, y] = params.body_com_offset;
        let closed_form = x.hypot(y).atan2(params.body_com_height);
        prop_assert!((state.tilt() - closed_form).abs() < 1e-14, "leans {}, not {closed_form}", state.tilt());
        prop_assert!((state.yaw() - yaw).abs() < 1e-14, "heads {}, not {yaw}", state.yaw());
        prop_assert!(lean(&params, &state) < 1e-15);
        let tilt = Vector2::new(0.06, -0.08);
        let tilted = State::tilted_from_equilibrium(&params, tilt, yaw);
        prop_assert!((lean(&params, &tilted) - tilt.norm()).abs() < 1e-14, "tilted by {}", lean(&params, &tilted));

        let model = SpatialModel::new(&params, true, true);
        let found = model.accelerations(&state.body_quaternion, &Vector6::zeros(), Wheels::default());
        let scale = natural_rate(&params).powi(2);
        prop_assert!(found.rows(2, 4).amax() <= 1e-13 * scale, "turns: {found}");
        prop_assert!(found.rows(0, 2).amax() <= 1e-13 * scale * params.body_com_height, "moves: {found}");

        let contacts = model.contacts(&state.body_quaternion, &Vector6::zeros(), Wheels::default());
        let weight = params.body_mass * params.gravity;
        for (load, expected) in contacts.wheel_normal_forces.iter().zip(params.equilibrium_wheel_loads()) {
            prop_assert!((load - expected).abs() <= 1e-13 * weight, "load {load}, not {expected}");
        }
        // The loads hold the weight: their sum is vertical and passes through the center of mass.
        let wheels = Omniwheels::new(&params);
        let sum: Vector3<f64> =
            (0..3).map(|i| wheels.contact_directions[i] * params.equilibrium_wheel_loads()[i]).sum();
        let held = state.body_quaternion * sum;
        prop_assert!((held - Vector3::z() * weight).norm() <= 1e-13 * weight, "{held}");
    }

    /// Near the equilibrium the robot moves as the linear model, in the coordinates of the regulator.
    #[test]
    fn small_motion_matches_the_linear_model(
        params in any_robot_on_rollers(),
        tilt in any_small_tilt(1e-5),
        push in vector(1.0),
        yaw in -PI..PI,
    ) {
        let params = Params { wheel_coulomb_friction: 0.0, ..params };
        let time = 1.0 / natural_rate(&params);
        let (steps, dt) = (200, time / 200.0);
        // In the heading frame the linear model does not depend on the yaw.
        let heading = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
        let tilt_in_space = (heading * tilt.push(0.0)).xy();
        let mut robot = SpatialMotion::new(&params, dt);
        robot.place(&State::tilted_from_equilibrium(&params, tilt_in_space, yaw));
        let motors = torques(&params, &(push * 1e-5));
        let (a, b) = LinearModel::new(&params).discretize(dt);
        let mut expected = SVector::<f64, 10>::zeros();
        expected.fixed_rows_mut::<2>(2).copy_from(&tilt);
        robot.advance(Wheels(motors), steps);
        for _ in 0..steps {
            expected = a * expected + b * Vector3::from(motors);
        }
        let lqr = regulator(&params);
        let found = lqr.deviation(&robot.state(), &Setpoint { yaw, ..Setpoint::default() });
        // Lengths relative to the height of the center of mass, rates relative to the natural rate.
        let (length, rate) = (params.body_com().norm(), natural_rate(&params));
        let units = [length, length, 1.0, 1.0, 1.0, length * rate, length * rate, rate, rate, rate];
        let scaled = |v: &SVector<f64, 10>| SVector::<f64, 10>::from_fn(|i, _| v[i] / units[i]);
        let (error, size) = (scaled(&(found - expected)).amax(), scaled(&expected).amax());
        prop_assert!(error <= 1e-4 * size, "off by {error:e} of {size:e}: {found} not {expected}");
    }

    #[test]
    fn energy_is_conserved_and_equals_the_energy_of_the_bodies(
        params in any_robot_on_rollers(),
        start in any_start(0.5, 1.0),
    ) {
        let params = without_losses(&params);
        let mut robot = SpatialMotion::new(&params, 5e-4 / natural_rate(&params));
        robot.place(&start.of(&params));
        let wheels = Omniwheels::new(&params);
        let before = robot.energy();
        let scale = params.body_mass * params.gravity * params.body_com().norm() + before.abs();
        for _ in 0..10 {
            robot.advance(Wheels::default(), 200);
            let (now, bodies) = (robot.energy(), mechanical_energy(&params, &wheels, &robot.state()));
            prop_assert!((now - before).abs() <= 1e-9 * scale, "energy {before} becomes {now}");
            prop_assert!((now - bodies).abs() <= 1e-12 * scale, "{now}, but the bodies have {bodies}");
        }
    }

    /// The work of an impulse is the change of the kinetic energy: its mean velocity times it.
    #[test]
    fn a_push_does_exactly_its_work(
        params in any_robot_on_rollers(),
        start in any_start(1.0, 1.0),
        impulse in vector(1.0),
        point in vector(1.0),
    ) {
        let mut robot = SpatialMotion::new(&params, 1e-3);
        robot.place(&start.of(&params));
        let point = point * params.body_com_height;
        let impulse = impulse * (params.body_mass * params.body_com_height * natural_rate(&params));
        let velocity = |state: &State| {
            state.body_velocity + state.body_quaternion * state.body_angular_velocity.cross(&point)
        };
        let (before, first) = (robot.energy(), velocity(&robot.state()));
        robot.push(&impulse, &point);
        let work = impulse.dot(&(first + velocity(&robot.state()))) * 0.5;
        let change = robot.energy() - before;
        let scale = impulse.norm() * (first.norm() + velocity(&robot.state()).norm()) + before.abs();
        prop_assert!((change - work).abs() <= 1e-12 * scale, "energy rises by {change}, work is {work}");
    }

    #[test]
    fn traction_torque_is_where_the_first_wheel_slips(params in any_robot_on_rollers()) {
        let params = Params { max_wheel_torque: 1e9, ..params };
        let torque = traction_torque(&params);
        prop_assert!(grips(&params, 0.9999 * torque), "a wheel slips below {torque} N·m");
        prop_assert!(!grips(&params, 1.03 * torque), "no wheel slips above {torque} N·m");
    }
}

/// Whether the wheels of a robot in equilibrium carry a tilt torque in every direction, the largest wheel torque being
/// `torque`.
fn grips(params: &Params, torque: f64) -> bool {
    let model = SpatialModel::new(params, true, true);
    let q = params.equilibrium_attitude(0.0);
    let wheels = Omniwheels::new(params);
    (0..480).all(|k| {
        let angle = f64::from(k) * PI / 240.0;
        let on_body = q.inverse_transform_vector(&Vector3::new(angle.cos(), angle.sin(), 0.0));
        // Motors turn the body by Uᵀτ.
        let torques = wheels.u.transpose().lu().solve(&on_body).unwrap();
        let torques = torques * (torque / torques.amax());
        let contacts = model.contacts(&q, &Vector6::zeros(), Wheels::of_column(torques));
        contacts.friction_utilization(params)[..3].iter().all(|share| *share <= 1.0)
    })
}

/// A regulator whose weights go with the size of the robot, and whose sampling goes with how fast it falls: on a light
/// ball four times as fast as by its natural rate.
fn regulator(params: &Params) -> Sampled<Lqr> {
    let (length, rate) = (params.body_com().norm(), natural_rate(params));
    let weights = LqrWeights {
        position: length,
        velocity: length * rate,
        tilt_rate: rate,
        yaw: 1.0,
        yaw_rate: rate,
        torque: params.body_mass * params.gravity * params.wheel_radius,
        ..LqrWeights::default()
    };
    let open = DMatrix::from_column_slice(10, 10, LinearModel::new(params).a.as_slice()).complex_eigenvalues();
    let falling = open.iter().map(|pole| pole.re).fold(0.0, f64::max);
    Lqr::with_weights(params, 0.05 / falling, &weights, &LimitOptions::capped(params.max_wheel_torque)).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 100, failure_persistence: None, ..ProptestConfig::default() })]

    /// It leans with its ball at the setpoint: neither an offset nor a torque remains.
    #[test]
    fn lqr_brings_any_robot_to_rest_at_its_setpoint(
        params in any_robot_on_rollers(),
        tilt in any_small_tilt(0.02),
        yaw in -PI..PI,
    ) {
        // Second-order terms leave the ball spinning about the vertical; only joint friction would be affected.
        let params = without_losses(&params);
        let mut lqr = regulator(&params);
        let sim_dt = lqr.control_dt() / 4.0;
        let mut robot = SpatialMotion::new(&params, sim_dt);
        robot.place(&State::tilted_from_equilibrium(&params, tilt, yaw));
        let (length, rate) = (params.body_com().norm(), natural_rate(&params));
        let setpoint = Setpoint { position: Vector2::new(0.1, -0.2) * length, yaw, ..Setpoint::default() };
        let unit = params.body_mass * params.gravity * params.wheel_radius;
        let mut left = [f64::NAN; 4];
        // A body on a heavy ball takes long.
        for _ in 0..50 {
            let mut motors = [0.0; 3];
            for _ in 0..1000 {
                motors = lqr.wheel_torques(&robot.state(), &setpoint).0;
                robot.advance(Wheels(motors), 4);
            }
            let state = robot.state();
            left = [
                (state.ball_position.xy() - setpoint.position).norm() / length,
                lean(&params, &state),
                state.body_angular_velocity.norm() / rate,
                Vector3::from(motors).amax() / unit,
            ];
            if left.iter().all(|share| *share <= 1e-9) {
                return Ok(());
            }
        }
        prop_assert!(false, "distance, lean, rate and torque remain: {left:?}");
    }
}

#[test]
fn a_symmetric_robot_balances_exactly_upright() {
    for name in Params::preset_names() {
        let params = Params::preset(name).unwrap();
        assert!(params.is_symmetric(), "{name}");
        assert_eq!(params.to_balance_frame(), UnitQuaternion::identity());
        assert_eq!(State::at_equilibrium(&params, 0.0), State::upright(&params));
        let tilt = Vector2::new(0.1, -0.2);
        assert_eq!(State::tilted_from_equilibrium(&params, tilt, 0.7), State::tilted(&params, tilt, 0.7));
        assert_eq!(params.equilibrium_wheel_loads(), Wheels([params.static_wheel_load(); 3]));
    }
}

/// The general formulas reduce to the formulas of the symmetric robot.
#[test]
fn a_nearly_symmetric_robot_moves_like_the_symmetric_robot() {
    let paper = Params::paper();
    let hardly = Params {
        body_com_offset: [1e-10, -1e-10],
        body_products_of_inertia: [1e-12; 3],
        wheel_zenith_offsets: [1e-10, 0.0, -1e-10],
        ..Params::paper()
    };
    assert!(!hardly.is_symmetric());
    for (load, other) in hardly.equilibrium_wheel_loads().iter().zip(paper.equilibrium_wheel_loads()) {
        assert!((load / other - 1.0).abs() < 1e-8, "{load}, not {other}");
    }
    let gain = |params: &Params| Lqr::new(params, CONTROL_DT).unwrap().regulator().gain.clone();
    let off = (gain(&hardly) - gain(&paper)).amax();
    assert!(off < 1e-7, "gains differ by {off}");
    assert!((traction_torque(&hardly) / traction_torque(&paper) - 1.0).abs() < 1e-8);
}

#[test]
fn pid_holds_the_lean() {
    let params = crooked();
    let mut robot = Ballbot::new(&params, ModelKind::Spatial, 1e-3).unwrap();
    robot.reset(&State::tilted_from_equilibrium(&params, Vector2::new(0.6, -0.8) * 3.0_f64.to_radians(), 0.3)).unwrap();
    let mut pid = Pid::new(&params, 1e-3, &PidGains::default(), TorqueMap::Consistent).unwrap();
    for _ in 0..3000 {
        robot.step(pid.wheel_torques(&robot.state(), &Setpoint::default()), 1).unwrap();
        let lean = lean(&params, &robot.state()).to_degrees();
        assert!(lean < 3.01, "{lean} deg at {} s", robot.time());
        assert!(robot.time() < 0.5 || lean < 0.5, "{lean} deg at {} s", robot.time());
    }
    // The mast leans: tilt and lean differ here.
    assert!((robot.state().tilt() - 5e-3_f64.hypot(3e-3).atan2(0.142)).abs() < 1e-3, "{}", robot.state().tilt());
}

#[test]
fn the_printed_torque_map_is_rejected_for_uneven_wheels() {
    let pid = |params: &Params, map| Pid::new(params, 1e-3, &PidGains::default(), map).map(|_| ());
    let off_mast = Params { body_com_offset: [5e-3, 0.0], ..Params::paper() };
    assert!(pid(&off_mast, TorqueMap::AsPrinted).is_ok());
    assert!(pid(&crooked(), TorqueMap::Consistent).is_ok());
    let error = pid(&crooked(), TorqueMap::AsPrinted).unwrap_err();
    assert!(matches!(error, Error::Inconsistent(_)), "{error:?}");
    for part in ["eq. (8)", "wheel_zenith_offsets = [0.02, -0.01, 0.015]", "zeros"] {
        assert!(error.to_string().contains(part), "'{error}' does not contain '{part}'");
    }
}

#[test]
fn planar_rejects_rolling_spinning_and_roller_friction() {
    let paper = Params::paper();
    for name in Params::LOSSES {
        let params = paper.replace([(name, &[1e-3][..])]).unwrap();
        let mut robot = Ballbot::new(&paper, ModelKind::Planar, 1e-3).unwrap();
        for error in [
            PlanarModel::new(&params, WheelInertia::ThreeWheels).map(|_| ()).unwrap_err(),
            Ballbot::new(&params, ModelKind::Planar, 1e-3).map(|_| ()).unwrap_err(),
            robot.set_params(&params).map(|_| ()).unwrap_err(),
        ] {
            assert!(matches!(error, Error::Inconsistent(_)), "{error:?}");
            assert!(error.to_string().contains(&format!("{name} = 0.001, but it requires 0")), "{error}");
        }
        assert_eq!(robot.params(), &paper);
        assert!(Ballbot::new(&params, ModelKind::Spatial, 1e-3).is_ok());
    }
}

#[test]
fn models_without_slip_reject_wheels_with_ripple() {
    let paper = Params::paper();
    let params = paper.replace([("roller_ripple", &[1e-4][..])]).unwrap();
    for kind in ModelKind::ALL {
        let mut robot = Ballbot::new(&paper, kind, 1e-3).unwrap();
        let rejected = matches!(kind, ModelKind::Planar | ModelKind::Spatial);
        for result in [Ballbot::new(&params, kind, 1e-3).map(|_| ()), robot.set_params(&params).map(|_| ())] {
            assert_eq!(result.is_err(), rejected, "{kind}");
            if let Err(error) = result {
                assert!(matches!(error, Error::Inconsistent(_)), "{error:?}");
                assert!(error.to_string().contains("roller_ripple = 0.0001 m, but it requires 0"), "{error}");
            }
        }
        assert_eq!(robot.params() == &paper, rejected, "{kind}");
    }
}

#[test]
fn planar_rejects_robots_that_are_not_symmetric() {
    let paper = Params::paper();
    let cases: [(&str, &[f64], &str); 5] = [
        ("body_com_offset", &[0.0, 1e-9], "body_com_offset = [0.0, 1e-9], but it requires zeros"),
        ("body_products_of_inertia", &[0.0, 1e-6, 0.0], "body_products_of_inertia = [0.0, 1e-6, 0.0]"),
        ("wheel_zenith_offsets", &[0.01, 0.0, 0.0], "wheel_zenith_offsets = [0.01, 0.0, 0.0]"),
        ("wheel_azimuths", &[0.01, 2.0, 4.0], "wheel_azimuths = [0.01, 2.0, 4.0], but it requires 2 pi / 3 rad"),
        ("roller_angle", &[-1e-3], "roller_angle = -0.001 rad, but it requires 0"),
    ];
    for (name, values, words) in cases {
        let params = paper.replace([(name, values)]).unwrap();
        let mut robot = Ballbot::new(&paper, ModelKind::Planar, 1e-3).unwrap();
        let errors = [
            PlanarModel::new(&params, WheelInertia::ThreeWheels).map(|_| ()).unwrap_err(),
            Ballbot::new(&params, ModelKind::Planar, 1e-3).map(|_| ()).unwrap_err(),
            robot.set_params(&params).map(|_| ()).unwrap_err(),
        ];
        for error in errors {
            assert!(matches!(error, Error::Inconsistent(_)), "{error:?}");
            assert!(error.to_string().contains(words), "'{error}' does not contain '{words}'");
            assert!(error.to_string().contains("'spatial', 'contact' and 'rigid' take any"), "{error}");
        }
        assert_eq!(robot.params(), &paper);
        assert!(Ballbot::new(&params, ModelKind::Spatial, 1e-3).is_ok());
    }
}
