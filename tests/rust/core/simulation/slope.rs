//! Robots on a tilted floor, against closed forms and against `spatial`.

use super::general::{any_gripping_robot, apart, lowest_point, off_spatial, sampled};
use super::{Motion, Simulation, close, for_both, run};
use crate::support::general::crooked;
use crate::support::{any_floor_tilt, any_start, largest, natural_rate, torques, vector};
use ballbot_core::models::SpatialModel;
use ballbot_core::{Contacts, Model, Params, State, Wheels, attitude};
use nalgebra::{UnitQuaternion, Vector2, Vector3, Vector6};

/// The paper's robot on a solid ball, on a floor that goes down by 0.4 rad towards its azimuth of 0.5 rad.
fn steep() -> Params {
    let params = Params::paper();
    let (sin, cos) = 0.5_f64.sin_cos();
    Params {
        ball_inertia: 0.4 * params.ball_mass * params.ball_radius.powi(2),
        floor_tilt: [-0.4 * sin, 0.4 * cos],
        ..params
    }
}

fn downhill() -> Vector2<f64> {
    let (sin, cos) = 0.5_f64.sin_cos();
    Vector2::new(cos, sin)
}

/// The ball at rest, with the bot far above it; its state after a first step.
fn place_alone(robot: &mut dyn Model) -> State {
    let params = robot.params().clone();
    let mut state = State::rolling(&params, Vector2::zeros(), 0.0, UnitQuaternion::identity(), Vector3::zeros());
    state.body_position.z += 200.0;
    robot.reset(&state).unwrap();
    robot.step([0.0; 3]);
    robot.state()
}

/// With γ = J_k / (M_k r_k²) its acceleration is g sin θ / (1 + γ), straight down, and it does not spin.
fn a_ball_rolls_down_as_in_closed_form(simulation: Simulation) {
    let params = steep();
    let mut robot = simulation.robot(&params, 1e-3);
    let first = place_alone(robot.as_mut());
    run(robot.as_mut(), [0.0; 3], 500);
    let state = robot.state();
    let gained = (state.ball_velocity - first.ball_velocity).xy() / 0.5;
    let expected = downhill() * (params.gravity * 0.4_f64.sin() / 1.4);
    close("acceleration", (gained - expected).norm(), 0.0, simulation.pick(1e-4, 1e-11));
    close("rolling", state.ball_angular_velocity.xy().norm() * params.ball_radius, state.ball_velocity.norm(), 1e-4);
    close("spin", state.ball_angular_velocity.z, 0.0, 1e-9);
    close("load", robot.contacts().floor_force.z, params.ball_mass * params.gravity * 0.4_f64.cos(), 1e-6);
}

/// Below the friction tan θ γ / (1 + γ) that rolling needs, it slides with g (sin θ − μ cos θ).
fn a_ball_slides_down_as_in_closed_form(simulation: Simulation) {
    let friction = 0.05;
    let params = Params { floor_static_friction: friction, floor_dynamic_friction: friction, ..steep() };
    let mut robot = simulation.robot(&params, 1e-3);
    let first = place_alone(robot.as_mut());
    run(robot.as_mut(), [0.0; 3], 500);
    let gained = (robot.state().ball_velocity - first.ball_velocity).xy() / 0.5;
    let (sin, cos) = 0.4_f64.sin_cos();
    let expected = downhill() * (params.gravity * (sin - friction * cos));
    close("acceleration", (gained - expected).norm(), 0.0, simulation.pick(1e-4, 1e-11));
}

/// How a robot rests on its slope, the torques that hold it, and its contact forces by `spatial`. `None` where a
/// wheel carries almost no load: with so much friction, lifting off is also a solution.
fn standing(params: &Params, yaw: f64) -> Option<(State, Wheels<f64>, Contacts)> {
    let start = State::tilted_from_equilibrium(params, params.slope_lean().ok()?, yaw);
    let held = params.holding_torques(yaw).ok()?;
    let model = SpatialModel::new(params, true, true);
    let contacts = model.contacts(&start.body_quaternion, &Vector6::zeros(), held);
    let least = 0.1 * params.body_mass * params.gravity;
    contacts.wheel_normal_forces.into_iter().all(|load| load >= least).then_some((start, held, contacts))
}

fn robots_rest_on_a_slope(simulation: Simulation) {
    let (mut balanced, mut worst) = (0, [0.0_f64; 2]);
    for (params, floor_tilt, yaw) in sampled(&(any_gripping_robot(), any_floor_tilt(0.15), -3.0..3.0), 40) {
        let params = Params { floor_tilt, ..params };
        let Some((start, held, expected)) = standing(&params, yaw) else { continue };
        let mut robot = simulation.robot(&params, 0.005 / natural_rate(&params));
        robot.reset(&start).unwrap();
        balanced += 1;
        let weight = (params.body_mass + params.ball_mass) * params.gravity;
        for _ in 0..100 {
            robot.step(held);
            let contacts = robot.contacts();
            let loads = contacts.wheel_normal_forces.column() - expected.wheel_normal_forces.column();
            let off = loads.amax().max((contacts.floor_force - expected.floor_force).amax()) / weight;
            worst = [worst[0].max(off), worst[1].max(largest(apart(&params, &robot.state(), &start)))];
        }
    }
    println!("{balanced} robots: loads off by {:e} of the weight, moved by {:e}", worst[0], worst[1]);
    assert!(balanced >= 20, "only {balanced} robots can balance");
    let (loads, moved) = simulation.pick((1e-5, 1e-7), (1e-9, 1e-11));
    assert!(worst[0] <= loads && worst[1] <= moved, "loads, places: {worst:?}");
}

fn robots_on_a_slope_converge_to_the_spatial_model(simulation: Simulation) {
    let motions = (any_gripping_robot(), any_floor_tilt(0.15), any_start(0.05, 0.1), vector(0.1));
    let (mut compared, mut worst) = (0, [0.0_f64; 3]);
    for (i, (params, floor_tilt, start, shares)) in sampled(&motions, 40).into_iter().enumerate() {
        let params = Params { floor_tilt, ..params };
        let Some((still, held, _)) = standing(&params, start.yaw) else { continue };
        let rolling = start.of(&params);
        let state = State::rolling(
            &params,
            rolling.ball_velocity.xy(),
            rolling.ball_angular_velocity.z,
            attitude(start.tilt, 0.0) * still.body_quaternion,
            rolling.body_angular_velocity,
        );
        let motors = (held + Wheels(torques(&params, &shares))).0;
        let run = |steps| off_spatial(simulation, &params, &state, &motors, steps);
        let Some(((coarse, fine), finest)) = run(100).zip(run(200)).zip(run(2000)) else { continue };
        compared += 1;
        for (what, (coarse, fine)) in ["places", "velocities"].into_iter().zip(coarse.into_iter().zip(fine)) {
            assert!(fine <= 0.6 * coarse + 1e-6, "robot {i}: {what} off by {coarse:e}, in half the step by {fine:e}");
        }
        worst = [0, 1, 2].map(|k| worst[k].max(finest[k]));
    }
    println!("{compared} robots: places, velocities and loads within {worst:?}");
    assert!(compared >= 20, "only {compared} robots keep their wheels on the ball");
    assert!(worst[0] <= 5e-4 && worst[1] <= 2e-3 && worst[2] <= 1e-3, "{worst:?}");
}

/// A robot that falls on a slope gains no energy and stays above the floor, wherever its ball rolls.
fn falls_on_a_slope_gain_no_energy(simulation: Simulation) {
    let params = Params { floor_tilt: [0.1, 0.15], ..crooked() };
    for tilt in [[0.2, 0.1], [-0.3, 0.05]] {
        let mut robot = simulation.robot(&params, 1e-3);
        robot.reset(&State::tilted(&params, tilt.into(), 0.4)).unwrap();
        let (mut deepest, mut rise, mut lowest) = (0.0_f64, 0.0_f64, robot.energy());
        for _ in 0..3000 {
            robot.step([0.0; 3]);
            lowest = lowest.min(robot.energy());
            rise = rise.max(robot.energy() - lowest);
            deepest = deepest.max(-lowest_point(&params, &robot.state()));
        }
        println!("{tilt:?}: rises by {rise:e} J, {deepest:e} m deep");
        assert!(robot.bot_on_floor() && robot.healthy(), "{tilt:?}");
        assert!(rise <= simulation.pick(5e-3, 1e-4), "{tilt:?}: energy rises by {rise:e} J");
        assert!(deepest <= 1e-4, "{tilt:?}: {deepest:e} m into the floor");
    }
}

for_both!(
    a_ball_rolls_down_as_in_closed_form,
    a_ball_slides_down_as_in_closed_form,
    robots_rest_on_a_slope,
    robots_on_a_slope_converge_to_the_spatial_model,
    falls_on_a_slope_gain_no_energy,
);
