//! Rolling, spinning and roller friction against closed forms, and against the spatial model.

use super::{Motion, Simulation, close, for_both, run};
use ballbot_core::control::{Controller, Lqr, Setpoint};
use ballbot_core::models::{SpatialModel, SpatialMotion};
use ballbot_core::{Model, Params, State, Wheels, attitude};
use nalgebra::{UnitQuaternion, Vector2, Vector3, Vector6};

/// The paper's robot on a solid ball.
fn solid_ball() -> Params {
    let params = Params::paper();
    Params { ball_inertia: 0.4 * params.ball_mass * params.ball_radius.powi(2), ..params }
}

/// Places a ball that rolls and spins, with the bot far above it. Its losses need the load of a first step; the state
/// after that step is returned.
fn place_alone(robot: &mut dyn Model, velocity: Vector2<f64>, spin: f64) -> State {
    let params = robot.params().clone();
    let mut state = State::rolling(&params, velocity, spin, UnitQuaternion::identity(), Vector3::zeros());
    state.body_position.z += 200.0;
    state.body_velocity = Vector3::zeros();
    state.wheel_speeds = Wheels([0.0; 3]);
    robot.reset(&state).unwrap();
    robot.step([0.0; 3]);
    robot.state()
}

/// A solid ball stops after (2/5) m r² ω / torque, having turned with a constant deceleration, and does not turn back.
fn a_spinning_ball_stops_at_the_closed_form_time(simulation: Simulation) {
    let lever = 2e-3;
    let params = Params { floor_spinning_friction: lever, ..solid_ball() };
    let dt = 1e-3;
    let mut robot = simulation.robot(&params, dt);
    let spin = place_alone(robot.as_mut(), Vector2::zeros(), 3.0).ball_angular_velocity.z;
    let torque = lever * params.ball_mass * params.gravity;
    let stop = 0.4 * params.ball_mass * params.ball_radius.powi(2) * spin / torque;
    let half = (0.5 * stop / dt).floor();
    run(robot.as_mut(), [0.0; 3], half as usize);
    let limit = simulation.pick(1e-4, 1e-9);
    close("spin", robot.state().ball_angular_velocity.z, spin * (1.0 - half * dt / stop), limit);
    run(robot.as_mut(), [0.0; 3], (stop / dt - half).ceil() as usize - 2);
    let last = robot.state().ball_angular_velocity.z;
    assert!(last > 0.0 && last < 3.0 * spin * dt / stop, "two steps before its stop: {last} rad/s");
    run(robot.as_mut(), [0.0; 3], 3);
    for _ in 0..100 {
        let rate = robot.state().ball_angular_velocity.z;
        assert!(rate.abs() <= 1e-9, "turns with {rate:e} rad/s after its stop");
        robot.step([0.0; 3]);
    }
}

/// A rolling ball loses c g / (r (1 + J / (m r²))) of its speed per second, keeps its direction, and stays where it
/// stops.
fn a_rolling_ball_stops_at_the_closed_form_time(simulation: Simulation) {
    let lever = 3e-3;
    let params = Params { floor_rolling_friction: lever, ..solid_ball() };
    let deceleration = lever * params.gravity / (params.ball_radius * 1.4);
    let dt = 1e-3;
    let mut robot = simulation.robot(&params, dt);
    let placed = place_alone(robot.as_mut(), Vector2::new(0.12, -0.16), 0.5);
    let (from, start) = (placed.ball_position, placed.ball_velocity.xy());
    let stop = start.norm() / deceleration;
    let half = (0.5 * stop / dt).floor();
    run(robot.as_mut(), [0.0; 3], half as usize);
    let expected = start * (1.0 - half * dt / stop);
    let limit = simulation.pick(1e-4, 1e-9);
    let state = robot.state();
    close("velocity", (state.ball_velocity.xy() - expected).norm(), 0.0, limit);
    close("spin", state.ball_angular_velocity.z, 0.5, 1e-9);
    // The last speed, about the loss of one step, decays by J / (J + m r²) per step.
    run(robot.as_mut(), [0.0; 3], (stop / dt - half).ceil() as usize + 100);
    let stopped = robot.state().ball_position;
    // A step adds or removes half of what it travels.
    let distance = ((stopped - from).xy().norm() - 0.5 * start.norm() * stop).abs();
    close("distance", distance, 0.0, start.norm() * dt);
    run(robot.as_mut(), [0.0; 3], 500);
    close("creep", (robot.state().ball_position - stopped).norm(), 0.0, simulation.pick(1e-8, 1e-12));
}

/// Motors turn ball and body against each other. Spinning friction above their torque holds the ball except for the
/// creep at which losing all spin in a step equals their torque: the body then has the yaw acceleration of a robot with
/// its ball held.
fn spinning_friction_holds_the_ball_under_a_turning_body(simulation: Simulation) {
    let torque = 0.02;
    let paper = Params::paper();
    let weight = (paper.ball_mass + paper.body_mass) * paper.gravity;
    let pinned = SpatialModel::new(&paper, true, false);
    let upright = UnitQuaternion::identity();
    let held = pinned.accelerations(&upright, &Vector6::zeros(), Wheels::of_column(Vector3::repeat(torque)))[4];
    // Some of the torque turns the wheels against the body.
    let (k, sine) = (paper.gear_ratio(), paper.wheel_zenith.sin());
    let on_ball = 3.0 * k * sine * (torque + paper.wheel_inertia * (k + 1.0) * sine * held);
    for (share, holds) in [(1.01, true), (0.99, false)] {
        let params = Params { floor_spinning_friction: share * on_ball / weight, ..paper.clone() };
        let mut robot = simulation.robot(&params, 1e-3);
        run(robot.as_mut(), [torque; 3], 100);
        let state = robot.state();
        let spin = state.ball_angular_velocity.z;
        if holds {
            let creep = on_ball * 1e-3 / paper.ball_inertia;
            close("creep", spin.abs(), creep, 0.01 * creep);
            close("yaw rate", state.body_angular_velocity.z, held * 0.1, 0.5 * creep);
        } else {
            assert!(spin.abs() > 1e-3, "held beyond its friction: {spin} rad/s");
        }
    }
}

/// Rolling friction above the motors' effect on the ball holds it except for a creep of first order in the time step:
/// the body falls over.
fn rolling_friction_holds_the_ball(simulation: Simulation) {
    let params = Params { floor_rolling_friction: 0.05, floor_spinning_friction: 0.01, ..Params::paper() };
    let [coarse, fine] = [2e-3, 1e-3].map(|sim_dt| {
        let mut robot = simulation.robot(&params, sim_dt);
        let start = State::tilted(&params, Vector2::new(0.02, 0.01), 0.0);
        robot.reset(&start).unwrap();
        run(robot.as_mut(), [0.05, -0.03, 0.02], (0.2 / sim_dt).round() as usize);
        let state = robot.state();
        assert!(state.tilt() > 1.2 * start.tilt(), "does not tip over");
        state.ball_position - start.ball_position
    });
    close("extrapolated to no time step", (fine * 2.0 - coarse).norm(), 0.0, 0.05 * fine.norm());
    assert!(coarse.norm() < 2e-3, "moves by {} m", coarse.norm());
}

/// Force against the motion of an upright robot at a speed along x, with these loads of its wheels: its power divided
/// by the speed.
fn drag(params: &Params, speed: f64, loads: [f64; 3]) -> f64 {
    let cosine = params.wheel_zenith.cos();
    params
        .wheel_azimuths
        .iter()
        .zip(loads)
        .map(|(azimuth, load)| {
            let free = azimuth.cos().abs();
            let roller = (params.roller_friction + params.roller_friction_slope * speed * free) * load * free;
            // The joint turns with the other component.
            let turn = azimuth.sin().abs() * cosine / params.wheel_radius;
            roller + (params.wheel_coulomb_friction + params.wheel_viscous_friction * turn * speed) * turn
        })
        .sum()
}

/// asRoBallet with rollers that, together with its joint friction, give its measured drag.
fn with_rollers() -> Params {
    Params { roller_friction: 0.008, roller_friction_slope: 0.084, ..Params::preset("asroballet").unwrap() }
}

/// Energy that a robot loses in motion: the drag at the speed and the loads of each step, times its distance.
fn rollers_have_the_drag_of_the_closed_form(simulation: Simulation) {
    let params = with_rollers();
    for (speed, measured) in [(0.05, 3.9), (0.2, 5.5), (0.5, 8.3)] {
        let fitted = drag(&params, speed, [params.static_wheel_load(); 3]);
        assert!((fitted / measured - 1.0_f64).abs() <= 0.02, "{fitted} N, measured {measured} N at {speed} m/s");
        let mut robot = simulation.robot(&params, 1e-3);
        let velocity = Vector2::new(speed, 0.0);
        robot.reset(&State::rolling(&params, velocity, 0.0, UnitQuaternion::identity(), Vector3::zeros())).unwrap();
        // The first step establishes the loads.
        robot.step([0.0; 3]);
        let before = robot.energy();
        let mut expected = 0.0;
        for _ in 0..20 {
            let (start, loads) = (robot.state(), robot.contacts().wheel_normal_forces);
            robot.step([0.0; 3]);
            let end = robot.state();
            // Of the ball against the body, which the rollers turn with it.
            let rolling = |state: &State| state.ball_angular_velocity.y - state.body_angular_velocity.y;
            let middle = 0.5 * params.ball_radius * (rolling(&start) + rolling(&end));
            expected += drag(&params, middle, loads.0) * middle * 1e-3;
        }
        let found = before - robot.energy();
        println!("{speed} m/s: loses {found} J, closed form {expected} J, with loads at rest {fitted} N");
        assert!((found / expected - 1.0).abs() <= 0.01, "{found} J, expected {expected} J at {speed} m/s");
    }
}

/// All three frictions of a paper's robot, as strong as its slope allows.
fn lossy() -> Params {
    Params {
        floor_rolling_friction: 1e-3,
        floor_spinning_friction: 1e-3,
        roller_friction: 0.02,
        roller_friction_slope: 0.1,
        ..Params::paper()
    }
}

/// State after 0.2 s of rolling, spinning and turning.
pub(super) fn rolled(robot: &mut dyn Model, params: &Params) -> State {
    robot.set_params(params).unwrap();
    let rate = Vector3::new(0.1, -0.2, 0.6);
    let start = State::rolling(params, Vector2::new(0.4, 0.1), 0.8, attitude(Vector2::new(0.02, -0.01), 0.3), rate);
    robot.reset(&start).unwrap();
    run(robot, [0.0; 3], 200);
    robot.state()
}

fn losses_of_a_rolling_robot_match_the_spatial_model(simulation: Simulation) {
    let paper = Params::paper();
    let free = rolled(&mut SpatialMotion::new(&paper, 1e-3), &paper);
    let distances = |a: &State, b: &State| {
        [(a.ball_velocity - b.ball_velocity).norm(), (a.ball_angular_velocity.z - b.ball_angular_velocity.z).abs()]
    };
    let only = |change: &dyn Fn(&mut Params)| {
        let mut params = paper.clone();
        change(&mut params);
        params
    };
    for params in [
        lossy(),
        only(&|p| p.floor_rolling_friction = 1e-3),
        only(&|p| p.floor_spinning_friction = 1e-3),
        only(&|p| p.roller_friction = 0.03),
        only(&|p| p.roller_friction_slope = 0.1),
    ] {
        let exact = rolled(&mut SpatialMotion::new(&params, 1e-3), &params);
        let found = rolled(simulation.paper().as_mut(), &params);
        let [velocity, spin] = distances(&found, &exact);
        let matters = distances(&free, &exact);
        println!("apart {velocity:e} m/s of {:e}, {spin:e} rad/s of {:e}", matters[0], matters[1]);
        assert!(matters[0] + matters[1] > 1e-3, "the friction does nothing: {matters:?}");
        assert!(velocity <= 2e-2 * (matters[0] + 0.01), "{velocity} m/s apart, friction makes {}", matters[0]);
        assert!(spin <= 2e-2 * (matters[1] + 0.05), "{spin} rad/s apart, friction makes {}", matters[1]);
    }
}

/// A robot that balances with losses, in both simulations: where it is held, it rests.
fn a_regulated_robot_with_losses_balances_and_obeys_its_bounds(simulation: Simulation) {
    let params = lossy();
    let mut robot = simulation.robot(&params, 2e-3);
    robot.reset(&State::tilted(&params, Vector2::new(0.03, -0.04), 0.3)).unwrap();
    let mut lqr = Lqr::new(&params, 0.01).unwrap();
    for _ in 0..400 {
        let torques = lqr.wheel_torques(&robot.state(), &Setpoint::default());
        run(robot.as_mut(), torques.0, 5);
        assert!(robot.healthy() && robot.state().tilt() < 0.2);
    }
    assert!(robot.state().tilt() < 0.03, "tilt {}", robot.state().tilt());
}

/// Into the fall and over the floor, where rare contacts are solved together with these frictions: they add no energy.
fn falls_with_losses_gain_no_energy(simulation: Simulation) {
    let params = Params { wheel_coulomb_friction: 0.01, ..lossy() };
    let mut robot = simulation.robot(&params, 1e-3);
    robot.reset(&State::tilted(&params, Vector2::new(0.2, 0.1), 0.4)).unwrap();
    let mut lowest = robot.energy();
    let scale = params.body_mass * params.gravity * params.body_com_height;
    for _ in 0..1500 {
        robot.step([0.0; 3]);
        let energy = robot.energy();
        assert!(energy - lowest <= simulation.pick(1e-2, 1e-4) * scale, "rises by {} J", energy - lowest);
        lowest = lowest.min(energy);
    }
    assert!(robot.bot_on_floor() && robot.healthy());
}

for_both!(
    a_spinning_ball_stops_at_the_closed_form_time,
    a_rolling_ball_stops_at_the_closed_form_time,
    spinning_friction_holds_the_ball_under_a_turning_body,
    rolling_friction_holds_the_ball,
    rollers_have_the_drag_of_the_closed_form,
    losses_of_a_rolling_robot_match_the_spatial_model,
    a_regulated_robot_with_losses_balances_and_obeys_its_bounds,
    falls_with_losses_gain_no_energy,
);
