//! The regulator with an integral.

use super::{CONTROL_DT, gain_of, law, made, position, robot, run};
use ballbot_core::control::{
    Controller, IntegralWeights, LimitOptions, Lqi, LqiOptions, Lqr, NamedLaw, Setpoint, controller_kind,
};
use ballbot_core::fields::Fields;
use ballbot_core::{LaneState, ModelKind, Params, State};
use nalgebra::Vector2;

/// Where a robot comes to rest under a controller of the nominal robot, m.
pub fn offset(
    params: &Params,
    kind: ModelKind,
    controller: &mut dyn Controller,
    setpoint: impl Fn(f64) -> Setpoint,
) -> f64 {
    let mut robot = robot(params, kind, &State::at_equilibrium(params, 0.0));
    let end = run(&mut robot, controller, 20.0, setpoint, |_, _| ()).unwrap().end;
    end.ball_position.xy().norm()
}

#[test]
fn a_wrong_center_of_mass_leaves_no_offset() {
    let nominal = Params::paper();
    let params = Params { body_com_offset: [5e-3, 0.0], ..Params::paper() };
    let mut lqr = Lqr::new(&nominal, CONTROL_DT).unwrap();
    // No torque at rest: the torque of the false tilt cancels the torque of the offset.
    let lean = (params.body_com_offset[0] / params.body_com_height).atan();
    let gain = &lqr.regulator().gain;
    let wheel = gain.column(0).iamax();
    let expected = (gain[(wheel, 3)] / gain[(wheel, 0)] * lean).abs();
    for kind in [ModelKind::Spatial, ModelKind::Contact] {
        let without = offset(&params, kind, &mut lqr, position(0.0, 0.0));
        let with = offset(&params, kind, &mut Lqi::with_defaults(&nominal, CONTROL_DT).unwrap(), position(0.0, 0.0));
        println!("{kind}: {:.3} mm, without the integral {:.1} mm", with * 1e3, without * 1e3);
        assert!((without / expected - 1.0).abs() < 0.01, "{kind}: {without} m, closed form {expected} m");
        assert!((without - 0.127).abs() < 0.002, "{kind}: {without} m");
        assert!(with < 1e-3, "{kind}: {with} m");
    }
}

/// A slope pushes in a direction of the inertial frame, so that a turning robot needs no other integral.
#[test]
fn a_slope_leaves_no_offset_under_a_robot_that_turns() {
    let params = Params { floor_tilt: [0.02, 0.03], ..Params::paper() };
    for (rate, most) in [(0.0, 1e-3), (0.5, 5e-3)] {
        let setpoint = |time: f64| Setpoint { yaw: rate * time, ..Setpoint::default() };
        let left = offset(&params, ModelKind::Contact, law("lqi", &params).as_mut(), setpoint);
        println!("turning at {rate} rad/s: {:.2} mm", left * 1e3);
        assert!(left < most, "turning at {rate} rad/s: {left} m");
    }
    assert!(offset(&params, ModelKind::Contact, law("lqr", &params).as_mut(), position(0.0, 0.0)) > 0.05);
}

#[test]
fn without_its_weight_the_gains_match_the_regulator() {
    let params = Params::paper();
    let plain = Lqr::new(&params, CONTROL_DT).unwrap().regulator().gain.clone();
    let off = |integral: f64| {
        let options = LqiOptions { integral: IntegralWeights { integral, ..Default::default() }, ..Default::default() };
        let lqi = Lqi::with_options(&params, CONTROL_DT, &options, &LimitOptions::TRACTION).unwrap();
        let gain = &lqi.regulator().gain;
        assert!(gain.columns(10, 2).amax() < 2.0 / integral);
        (gain.columns(0, 10) - &plain).amax() / plain.amax()
    };
    assert!(off(1.0) > 0.01 && off(1e5) < 1e-5, "{} {}", off(1.0), off(1e5));
    assert!((off(1e3) / off(1e4) - 10.0).abs() < 0.1);
}

#[test]
fn torques_match_the_gains() {
    let params = Params::paper();
    let lqi = Lqi::with_defaults(&params, CONTROL_DT).unwrap();
    let gain = &lqi.regulator().gain;
    assert!(lqi.regulator().residual < 1e-10);
    assert!((gain_of(&lqi, &params) - gain).amax() < 1e-8 * gain.amax());
}

/// The gains of one plane with the weight of an earlier study, which used the opposite sign of tilt and a virtual
/// torque.
#[test]
fn gains_match_an_independent_solution() {
    let params = Params::paper();
    let lqi = Lqi::with_options(
        &params,
        CONTROL_DT,
        &LqiOptions { integral: IntegralWeights { integral: 0.15, ..Default::default() }, ..Default::default() },
        &LimitOptions::TRACTION,
    );
    let gain = lqi.unwrap().regulator().gain.clone();
    let wheel = gain.column(1).iamax();
    // In the plane of y the lean is the tilt about −x.
    let row = [1, 2, 6, 7, 11].map(|place| gain[(wheel, place)]);
    let mut expected = [-2.280, 4.320, -1.976, 0.788, -1.041];
    // It integrates over the sample; here a sample counts with its initial position, half a sample earlier.
    expected[0] += 0.5 * CONTROL_DT * expected[4];
    let scale = row[1] / expected[1];
    for (found, expected) in row.iter().zip(expected) {
        assert!((found / (expected * scale) - 1.0).abs() < 1e-3, "{row:?}, expected {scale} {expected:?}");
    }
}

#[test]
fn the_integral_is_cut_and_held() {
    let params = Params::paper();
    let state = State::upright(&params);
    let kept_after = |target: f64, calls: usize| {
        let lqi = made("lqi", &params, &[]);
        let mut kept = [0.0; 2];
        let target = Setpoint { position: Vector2::new(0.0, target), ..Setpoint::default() };
        (0..calls).for_each(|_| {
            lqi.torques_one(&LaneState::from(&state), &(&target).into(), f64::INFINITY, &mut kept);
        });
        kept[1]
    };
    assert!((kept_after(0.05, 3) - -3.0 * 0.05 * CONTROL_DT).abs() < 1e-15);
    assert_eq!(kept_after(5.0, 100), 0.0);
    // The lean that the integral commands is 4 deg.
    let gain = Lqi::with_defaults(&params, CONTROL_DT).unwrap().regulator().gain.clone();
    let wheel = gain.column(1).iamax();
    let lean = gain[(wheel, 11)] / gain[(wheel, 2)] * kept_after(0.002, 1_000_000);
    assert!((lean.abs().to_degrees() - 4.0).abs() < 1e-6, "{} deg", lean.to_degrees());
}

#[test]
fn options_match_the_regulator_and_the_integral() {
    let names = |name: &str| {
        (controller_kind(name).unwrap().options)().into_iter().map(|option| option.name).collect::<Vec<_>>()
    };
    let further = ["delay", "lean_observer"];
    let weights: Vec<_> = names("lqr").into_iter().filter(|name| !further.contains(name)).collect();
    assert_eq!(names("lqi"), [weights, vec!["integral", "max_integral_lean", "delay"]].concat());
    let mut options = LqiOptions::defaults();
    options.set("yaw", &[0.3]).unwrap();
    options.set("max_integral_lean", &[0.01]).unwrap();
    assert_eq!((options.weights.yaw, options.integral.max_integral_lean), (0.3, 0.01));
    options.integral.integral = 0.0;
    assert!(options.check_limits().unwrap_err().to_string().contains("integral = 0 is out of range"));
}
