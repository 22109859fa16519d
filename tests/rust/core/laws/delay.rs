//! Motors whose torque acts later than commanded.

use super::{CONTROL_DT, SIM_DT, STEPS, around, gain_of, made, position, robot, run, uneven};
use ballbot_core::control::{
    Controller, DelayOptions, IntegralWeights, LimitOptions, Lqr, LqrOptions, LqrWeights, NamedLaw, controller_kind,
    riccati,
};
use ballbot_core::kinematics::{Omniwheels, TorqueMap};
use ballbot_core::models::LinearModel;
use ballbot_core::{ModelKind, Params, State, Wheels};
use nalgebra::{DMatrix, DVector, Vector3};
use std::cell::RefCell;
use std::collections::VecDeque;

/// Gains of an independent computation in one plane, per (y, θ, ẏ, θ̇) and per torque in transit, oldest first.
const PLANAR: [(f64, [f64; 4], &[f64]); 3] = [
    (0.01, [-1.045, -3.994, -1.341, -0.701], &[0.196]),
    (0.02, [-1.045, -4.228, -1.351, -0.743], &[0.212, 0.196]),
    (0.03, [-1.045, -4.478, f64::NAN, -0.786], &[0.229, 0.212, 0.196]),
];

#[test]
fn gains_match_an_independent_computation() {
    let params = Params::paper();
    let wheels = Omniwheels::new(&params).torques_on_body(&Vector3::y(), TorqueMap::Consistent);
    let wheels = DVector::from_column_slice(wheels.as_slice());
    for (delay, expected, history) in PLANAR {
        let gain = gain_of(made("lqr", &params, &[("delay", &[delay])]).as_ref(), &params);
        assert_eq!(gain.ncols(), 10 + 3 * history.len());
        // The plane of x, in which the virtual torque is −τ_y.
        let planar = |column: DVector<f64>| wheels.dot(&column) / wheels.norm_squared();
        for (place, expected) in [0, 3, 5, 8].into_iter().zip(expected) {
            let found = -planar(gain.column(place).into_owned());
            assert!(expected.is_nan() || (found - expected).abs() < 2e-3, "{delay} s: {found}, expected {expected}");
        }
        for (sample, expected) in history.iter().enumerate() {
            let found = planar(gain.columns(10 + 3 * sample, 3) * &wheels);
            assert!((found - expected).abs() < 1e-3, "{delay} s, sample {sample}: {found}, expected {expected}");
        }
    }
}

/// Against the Riccati equation of the model with the torques in transit as states; `lqi` has the integral as two more
/// states.
#[test]
fn the_prediction_is_the_regulator_with_the_torques_as_states() {
    let params = uneven();
    for (name, samples) in [("lqr", 1), ("lqr", 3), ("lqr", 10), ("lqi", 1), ("lqi", 5), ("lqi", 10)] {
        let own = if name == "lqi" { 12 } else { 10 };
        let size = own + 3 * samples;
        let (model_a, model_b) = LinearModel::new(&params).discretize(CONTROL_DT);
        let (mut a, mut b) = (DMatrix::zeros(size, size), DMatrix::zeros(size, 3));
        a.view_mut((0, 0), (10, 10)).copy_from(&model_a);
        a.view_mut((0, own), (10, 3)).copy_from(&model_b);
        for sample in 1..samples {
            a.view_mut((own - 3 + 3 * sample, own + 3 * sample), (3, 3)).fill_with_identity();
        }
        b.view_mut((size - 3, 0), (3, 3)).fill_with_identity();
        let (cost, r) = LqrWeights::default().matrices();
        let mut q = DMatrix::zeros(size, size);
        q.view_mut((0, 0), (10, 10)).copy_from(&cost);
        for integral in 10..own {
            (a[(integral, integral)], a[(integral, integral - 10)]) = (1.0, CONTROL_DT);
            q[(integral, integral)] = IntegralWeights::default().integral.powi(-2);
        }
        let expected = riccati::solve(&a, &b, &q, &r).unwrap().gain;
        let delay = samples as f64 * CONTROL_DT;
        let found = gain_of(made(name, &params, &[("delay", &[delay])]).as_ref(), &params);
        let error = (&found - &expected).amax() / expected.amax();
        println!("{name}, {samples} samples: {error:.1e}");
        assert!(error < 1e-6, "{name}: {found}, expected {expected}");
    }
}

/// The double loop is not a regulator of the whole: its gains are the gains without a delay, applied to the predicted
/// state.
#[test]
fn the_double_loop_acts_on_the_state_that_is_predicted() {
    for (params, samples) in [(Params::paper(), 3), (uneven(), 1), (uneven(), 10)] {
        let plain = gain_of(made("lqr_pi", &params, &[]).as_ref(), &params);
        let (a, b) = LinearModel::new(&params).discretize(CONTROL_DT);
        let mut expected = DMatrix::zeros(3, 12 + 3 * samples);
        expected.columns_mut(0, 12).copy_from(&plain);
        let mut of_state = plain.fixed_columns::<10>(0).clone_owned();
        for sample in (0..samples).rev() {
            expected.columns_mut(12 + 3 * sample, 3).copy_from(&(&of_state * b));
            of_state *= a;
        }
        expected.columns_mut(0, 10).copy_from(&of_state);
        let delay = samples as f64 * CONTROL_DT;
        let found = gain_of(made("lqr_pi", &params, &[("delay", &[delay])]).as_ref(), &params);
        let error = (&found - &expected).amax() / expected.amax();
        println!("{samples} samples: {error:.1e}");
        assert!(error < 1e-6, "{found}, expected {expected}");
    }
}

#[test]
fn delays_are_checked() {
    let params = Params::paper();
    for name in ["lqr", "lqi", "lqr_pi"] {
        let kind = controller_kind(name).unwrap();
        for (delay, expected) in [
            (0.015, "delay = 0.015 s is not a multiple of control_dt = 0.01 s"),
            (0.2, "delay = 0.2 is out of range: it must be from 0 to 10 control_dt = 0.1 s"),
            (-0.01, "delay"),
        ] {
            let error = (kind.make)(&params, CONTROL_DT, &kind.limits, &[("delay", &[delay])]).map(|_| ()).unwrap_err();
            let error = error.to_string();
            assert!(error.contains(expected), "{name}: {error}");
        }
    }
    let delayed = LqrOptions { delay: DelayOptions { delay: 0.1 }, ..LqrOptions::default() };
    assert_eq!(
        Lqr::with_options(&params, CONTROL_DT, &delayed, &LimitOptions::TRACTION).unwrap().regulator().gain,
        Lqr::new(&params, CONTROL_DT).unwrap().regulator().gain
    );
}

/// Whether the robot recovers after a start and an impulse, with motors whose torque acts `delay` later, in `contact`.
pub fn recovers(
    params: &Params,
    controller: &mut dyn Controller,
    delay: f64,
    start: &State,
    impulse: Vector3<f64>,
) -> bool {
    let steps = (delay / SIM_DT).round() as usize;
    let on_their_way = RefCell::new(VecDeque::from(vec![Wheels::default(); steps]));
    let mut robot = robot(params, ModelKind::Contact, start);
    robot.push(&impulse, None).unwrap();
    let end = run(&mut robot, controller, 6.0, position(0.0, 0.0), |_, torques| {
        let mut waiting = on_their_way.borrow_mut();
        waiting.push_back(*torques);
        *torques = waiting.pop_front().unwrap();
    });
    end.is_some_and(|run| run.end.tilt() < 0.03 && run.end.ball_position.xy().norm() < 0.2)
}

/// Tilts from rest in steps of 1 deg and impulses in steps of 0.1 N·s, worst of 12 directions.
#[test]
fn a_delay_that_is_predicted_costs_less() {
    assert_eq!(STEPS, 10);
    let params = Params::paper();
    for (name, delay, least) in
        [("lqr", 0.03, 21.0), ("lqr", 0.05, 18.0), ("lqr", 0.07, 14.0), ("lqr_pi", 0.05, 17.0), ("lqr_pi", 0.07, 14.0)]
    {
        let [plain, predicted] = [0.0, delay].map(|known| {
            let holds = |tilt: f64, push: f64| {
                around(12).all(|way| {
                    let start = State::tilted(&params, way * tilt.to_radians(), 0.0);
                    let mut law = made(name, &params, &[("delay", &[known])]);
                    recovers(&params, law.as_mut(), delay, &start, way.push(0.0) * push)
                })
            };
            let tilt = (0..30).map(f64::from).take_while(|&tilt| holds(tilt, 0.0)).last().unwrap_or(-1.0);
            let push = (0..25).map(|k| 0.1 * f64::from(k)).take_while(|&push| holds(0.0, push)).last().unwrap_or(-1.0);
            (tilt, push)
        });
        println!("{delay} s: {name} {plain:?}, with the delay predicted {predicted:?} (deg, N·s)");
        assert!(predicted.0 >= least && predicted.0 >= plain.0 && predicted.1 >= plain.1, "{plain:?}, {predicted:?}");
        assert!(delay < 0.06 || plain.0 < 2.0, "beyond its margin of delay the regulator falls: {plain:?}");
    }
}

/// The integral is also predicted, and held where it may not grow.
#[test]
fn a_controller_with_an_integral_withstands_a_delay() {
    let params = Params::paper();
    let survives = |known: f64, delay: f64, tilt: f64, push: f64| {
        around(12).all(|way| {
            let start = State::tilted(&params, way * tilt.to_radians(), 0.0);
            let mut lqi = made("lqi", &params, &[("delay", &[known])]);
            recovers(&params, lqi.as_mut(), delay, &start, way.push(0.0) * push)
        })
    };
    assert!(survives(0.05, 0.05, 4.0, 0.0) && survives(0.05, 0.05, 18.0, 0.0) && survives(0.05, 0.05, 0.0, 1.4));
    assert!(survives(0.07, 0.07, 14.0, 0.0) && !survives(0.0, 0.07, 4.0, 0.0));
    for observed in [0.5, 1.0, 2.0] {
        for direction in around(6) {
            let start = State::tilted(&params, direction * f64::to_radians(18.0), 0.0);
            let mut lqr = made("lqr", &params, &[("delay", &[0.05]), ("lean_observer", &[observed])]);
            assert!(recovers(&params, lqr.as_mut(), 0.05, &start, Vector3::zeros()), "{observed} 1/s");
        }
    }
}

/// A delay changes nothing in equilibrium: a disturbance that leaves no offset without a delay leaves none with it.
#[test]
fn behind_a_delay_no_offset_is_left() {
    let params = Params { floor_tilt: [0.0, 1_f64.to_radians()], ..Params::paper() };
    let delayed: (&str, &[f64]) = ("delay", &[0.05]);
    for (name, options) in [("lqi", vec![delayed]), ("lqr", vec![delayed, ("lean_observer", &[1.0])])] {
        let on_their_way = RefCell::new(VecDeque::from(vec![Wheels::default(); 50]));
        let mut robot = robot(&params, ModelKind::Contact, &State::upright(&params));
        let mut controller = made(name, &params, &options);
        let end = run(&mut robot, controller.as_mut(), 25.0, position(0.0, 0.0), |_, torques| {
            let mut waiting = on_their_way.borrow_mut();
            waiting.push_back(*torques);
            *torques = waiting.pop_front().unwrap();
        });
        let left = end.unwrap_or_else(|| panic!("{name} falls")).end.ball_position.xy().norm();
        println!("{name}: {:.3} mm", left * 1e3);
        assert!(left < 1e-3, "{name}: {left} m");
    }
}
