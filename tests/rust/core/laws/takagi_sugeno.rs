//! Takagi-Sugeno fuzzy control.

use super::{CONTROL_DT, gain_of, law, presets, uneven};
use ballbot_core::control::{Controller, LimitOptions, LqrWeights, NamedLaw, Setpoint, TakagiSugeno};
use ballbot_core::models::{BallSpin, LeaningPlane, LinearModel, SpatialModel, WheelSpin};
use ballbot_core::{LaneState, Params, State, Wheels};
use nalgebra::{UnitQuaternion, Vector2, Vector3, Vector4, Vector6};

/// At rest at its lean a plane is the spatial model.
#[test]
fn leaning_planes_are_exact_at_rest() {
    for params in [Params::paper(), uneven()] {
        let model = SpatialModel::new(&params, WheelSpin::Absolute, BallSpin::Free);
        let to_balance = params.to_balance_frame();
        for (axis, towards) in [(0, Vector3::y()), (1, -Vector3::x())] {
            for lean in [0.1, 0.5, -0.3] {
                let plane = LeaningPlane::new(&params, axis, lean);
                let torques = Vector3::new(0.1, -0.2, 0.15);
                let change = plane.a * Vector4::new(0.7, lean, 0.0, 0.0) + plane.b * torques;
                let attitude = UnitQuaternion::from_scaled_axis(towards * lean) * to_balance;
                let expected = model.accelerations(&attitude, &Vector6::zeros(), Wheels::of_column(torques));
                let turning = towards.dot(&(to_balance * expected.fixed_rows::<3>(2).into_owned()));
                assert!((change[2] - expected[axis]).abs() < 1e-11 && (change[3] - turning).abs() < 1e-11);
            }
            // At small leans it is the linear model.
            let (small, none) = (LeaningPlane::new(&params, axis, 1e-4), LeaningPlane::new(&params, axis, 0.0));
            assert!((small.a - none.a).amax() < 1e-4 * none.a.amax(), "{} {}", small.a, none.a);
            assert!((small.b - none.b).amax() < 1e-3 * none.b.amax(), "{} {}", small.b, none.b);
        }
    }
}

#[test]
fn for_the_upright_robot_it_equals_the_regulator() {
    for (name, params) in presets() {
        let [found, expected] = ["takagi_sugeno", "lqr"].map(|name| gain_of(law(name, &params).as_ref(), &params));
        let off = (&found - &expected).amax() / expected.amax();
        println!("{name}: {off:.1e}");
        assert!(off < 1e-5, "{name}: {found} {expected}");
    }
}

/// Within 5.2 % up to 30 deg: on this plant the method is a linear regulator.
#[test]
fn the_gains_differ_little() {
    let law = TakagiSugeno::with_defaults(&Params::paper(), CONTROL_DT).unwrap();
    println!("largest change of the cost in a step: {:?}", law.decay());
    for plane in law.gains() {
        for (rule, gains) in plane.iter().enumerate() {
            let off: Vec<_> = gains.iter().zip(&plane[0]).map(|(k, upright)| k / upright - 1.0).collect();
            println!("{} deg: {:.2?} %", 15 * rule, off.iter().map(|off| 100.0 * off).collect::<Vec<_>>());
            assert!(off.iter().all(|off| off.abs() < 0.052), "{off:?}");
            assert!(rule == 0 || off[3].abs() > 1e-3, "{off:?}");
        }
    }
    assert!(law.decay().iter().all(|ratio| *ratio < 1.0 && *ratio > 0.9));
}

/// The torques at a lean follow from the gains of the neighboring rules.
#[test]
fn rules_count_by_the_tilt() {
    let params = Params { max_wheel_torque: 1e3, ..Params::paper() };
    let weights = LqrWeights { max_lean: 1e3, max_speed: 1e3, ..Default::default() };
    let law = TakagiSugeno::with_options(&params, CONTROL_DT, &weights, &LimitOptions::capped(1e3)).unwrap();
    let torques_of = LinearModel::new(&params).b.fixed_view::<3, 3>(7, 0).try_inverse().unwrap();
    for degrees in [0.0_f64, 4.0, 15.0, 20.0, 29.0, 30.0, 41.0] {
        let place = (degrees / 15.0).min(2.0);
        let first = (place.floor() as usize).min(1);
        let share = place - first as f64;
        for (axis, direction) in [(0, Vector2::new(0.0, 1.0)), (1, Vector2::new(-1.0, 0.0))] {
            let mut state = State::tilted(&params, direction * degrees.to_radians(), 0.0);
            state.ball_position[axis] += 0.07;
            let x = Vector4::new(0.07, degrees.to_radians(), 0.0, 0.0);
            let [near, far] = [first, first + 1].map(|rule| Vector4::from(law.gains()[axis][rule]).dot(&x));
            let acceleration = -(near * (1.0 - share) + far * share);
            let expected = torques_of * direction.push(0.0) * acceleration;
            let setpoint = (&Setpoint::default()).into();
            let found = law.torques_one(&LaneState::from(&state), &setpoint, f64::INFINITY, &mut []).column();
            assert!((found - expected).amax() < 1e-9, "{degrees} deg: {found}, expected {expected}");
        }
    }
}

#[test]
fn a_controller_without_a_stability_proof_is_rejected() {
    // Over a second the robot topples so far that rules which are 1 % apart do not fit each other.
    let message = TakagiSugeno::with_defaults(&Params::paper(), 1.0).unwrap_err().to_string();
    assert!(message.contains("no proof that the fuzzy model is stable"), "{message}");
    for (name, params) in presets() {
        for dt in [0.005, 0.01, 0.02] {
            let made = TakagiSugeno::with_defaults(&params, dt);
            assert!(made.is_ok(), "{name}, {dt} s: {made:?}");
        }
    }
}
