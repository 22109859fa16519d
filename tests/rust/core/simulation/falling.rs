//! Falls, and lying on the floor.

use super::{Motion, Simulation, close, for_both, leaning, run};
use ballbot_core::kinematics::Omniwheels;
use ballbot_core::{Model, Params, State};
use nalgebra::{UnitQuaternion, Vector2, Vector3};

fn toppled_robots_fall_to_the_floor(simulation: Simulation) {
    let mut robot = simulation.paper();
    robot.reset(&State::tilted(&Params::paper(), Vector2::new(0.2, 0.1), 0.0)).unwrap();
    let start = robot.energy();
    let mut highest = start;
    for _ in 0..4000 {
        robot.step([0.0; 3]);
        highest = highest.max(robot.energy());
    }
    let state = robot.state();
    assert!(robot.contacts().bot_on_floor);
    assert!(state.tilt() > 1.0 && state.body_position.z > 0.0, "{state:?}");
    assert!(highest <= start * (1.0 + 1e-3), "energy rose from {start} to {highest} J");
    assert!(state.body_angular_velocity.norm() < 1.0, "still tumbling: {state:?}");
}

fn bots_in_the_floor_are_rejected(simulation: Simulation) {
    let params = Params::paper();
    let mut robot = simulation.robot(&params, 1e-3);
    for (tilt, part) in [(2.0, "body"), (3.1, "body")] {
        let message = robot.reset(&State::tilted(&params, Vector2::new(tilt, 0.0), 0.0)).unwrap_err().to_string();
        assert!(message.starts_with(&format!("height of the lowest point of the {part} = -")), "{message}");
    }
    // Lying with its wheels at the floor's level, but the body lifted clear.
    let mut state = State::tilted(&params, Vector2::new(3.1, 0.0), 0.0);
    state.body_position.z = 1.0;
    state.ball_position.z = 2.0;
    robot.reset(&state).unwrap();
}

/// Height of the bot's lowest point: wheels as spheres, the body as the cylinder that the simulations use.
fn lowest_point(params: &Params, state: &State) -> f64 {
    let reach = params.ball_radius + params.wheel_radius;
    let wheels = Omniwheels::new(params).contact_directions;
    let height = |point: Vector3<f64>| (state.body_position + state.body_quaternion * point).z;
    let wheel = wheels.map(|p| height(p * reach) - params.wheel_radius);
    let rim = reach * params.wheel_zenith.sin() * state.tilt().sin();
    let half_height = (3.0 * params.body_inertia[0].max(params.body_inertia[1]) / params.body_mass).sqrt();
    let ends = [1.05 * params.ball_radius, params.body_com_height + half_height];
    let body = ends.map(|end| height(Vector3::z() * end) - rim);
    wheel.into_iter().chain(body).fold(f64::INFINITY, f64::min)
}

/// Released at rest: in which step the bot touches the floor, and the states after each step until 0.1 s later.
fn fall(robot: &mut dyn Model, degrees: f64) -> (usize, Vec<State>) {
    robot.reset(&leaning(robot.params(), degrees)).unwrap();
    let mut states = Vec::new();
    while !robot.bot_on_floor() {
        assert!(robot.time() < 2.0, "does not fall");
        robot.step([0.0; 3]);
        states.push(robot.state());
    }
    let touch = states.len();
    for _ in 0..100 {
        robot.step([0.0; 3]);
        states.push(robot.state());
    }
    (touch, states)
}

#[test]
fn floor_impacts_of_falling_robots_agree() {
    for degrees in [5.0, 7.5, 10.0] {
        let [(expected, rigid), (found, contact)] =
            [Simulation::Rigid, Simulation::Contact].map(|s| fall(s.paper().as_mut(), degrees));
        close(&format!("{degrees} deg: step of touch"), found as f64, expected as f64, 1.0);
        let touch = found.min(expected);
        // The impact takes both a step or two: afterwards a lag of about a step remains.
        for (when, step, rate_limit, tilt_limit) in
            [("before", touch - 5, 3e-3, 1e-3), ("after", touch + 50, 0.015, 1e-3)]
        {
            let (r, c) = (&rigid[step], &contact[step]);
            let label = format!("{degrees} deg {when}");
            close(&format!("{label}: tilt"), c.tilt(), r.tilt(), tilt_limit);
            let rate = r.body_angular_velocity.norm();
            let off = (c.body_angular_velocity - r.body_angular_velocity).norm();
            close(&format!("{label}: rate, of {rate} rad/s"), off / rate, 0.0, rate_limit);
            let off = (c.ball_velocity - r.ball_velocity).norm() / r.ball_velocity.norm();
            close(&format!("{label}: ball velocity"), off, 0.0, 0.01);
        }
    }
}

fn fallen_robots_come_to_rest_on_the_floor(simulation: Simulation) {
    let params = Params::paper();
    let (rise_limit, impact_depth, depth) = simulation.pick((2e-5, 6e-5, 1e-9), (2e-7, 2e-5, 1e-7));
    for degrees in [5.0, 10.0, 20.0] {
        let mut robot = simulation.paper();
        let (touch, states) = fall(robot.as_mut(), degrees);
        let impact = states[touch - 1..].iter().map(|state| -lowest_point(&params, state)).fold(0.0, f64::max);
        let (mut before, mut rise, mut deepest) = (robot.energy(), 0.0_f64, 0.0_f64);
        for k in 0..3000 {
            robot.step([0.0; 3]);
            rise = rise.max(robot.energy() - before);
            before = robot.energy();
            if k >= 500 {
                deepest = deepest.max(-lowest_point(&params, &robot.state()));
                assert!(robot.bot_on_floor(), "{degrees} deg: off the floor in step {k}");
            }
        }
        let rate = robot.state().body_angular_velocity.norm();
        println!("{degrees} deg: rises by {rise:e} J, {impact:e} and {deepest:e} m deep, {rate:e} rad/s");
        assert!(rise <= rise_limit, "{degrees} deg: energy rises by {rise:e} J in a step");
        assert!(impact <= impact_depth, "{degrees} deg: {impact:e} m into the floor");
        assert!(deepest <= depth, "{degrees} deg: lies {deepest:e} m in the floor");
        // It continues to roll and rock a little.
        assert!(rate < 0.05, "{degrees} deg: still turns with {rate} rad/s");
    }
}

#[test]
fn rest_poses_of_fallen_robots_agree() {
    for degrees in [5.0, 10.0, 20.0] {
        let [r, c] = [Simulation::Rigid, Simulation::Contact].map(|simulation| {
            let mut robot = simulation.paper();
            robot.reset(&leaning(robot.params(), degrees)).unwrap();
            run(robot.as_mut(), [0.0; 3], 4000);
            assert!(robot.bot_on_floor());
            robot.state().tilt()
        });
        close(&format!("{degrees} deg: tilt"), c.to_degrees(), r.to_degrees(), 0.01);
        // On the side of its body, whose rims are both at the floor.
        close(&format!("{degrees} deg: lying"), c.to_degrees(), 90.0, 0.01);
    }
}

/// The floor's friction opposes the slip of what lies on it, along whichever axes it is counted; only `contact`, since
/// rapier's friction has its own axes.
#[test]
fn sliding_of_fallen_robots_is_isotropic() {
    // A bot that turns more easily about one axis than about the other, as seen from the point that it slides on.
    let params = Params { body_inertia: [0.0583, 0.03, 0.0337], ..Params::paper() };
    let fallen = |yaw: f64| {
        let mut robot = Simulation::Contact.robot(&params, 1e-3);
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
        let lean = turn * Vector3::new(0.2, 0.7, 0.0);
        let mut start = State::tilted(&params, lean.xy(), yaw);
        start.body_velocity = turn * Vector3::new(1.0, -0.5, 0.0);
        start.ball_velocity = start.body_velocity;
        robot.reset(&start).unwrap();
        run(robot.as_mut(), [0.0; 3], 400);
        assert!(robot.bot_on_floor());
        let state = robot.state();
        (turn.inverse() * state.body_position, turn.inverse() * state.body_quaternion)
    };
    let (place, attitude) = fallen(0.0);
    for yaw in [0.4, 1.0, 2.5] {
        let (found, turned) = fallen(yaw);
        close(&format!("yaw {yaw}: place"), (found - place).norm(), 0.0, 1e-9);
        close(&format!("yaw {yaw}: attitude"), turned.angle_to(&attitude), 0.0, 1e-9);
    }
}

for_both!(toppled_robots_fall_to_the_floor, bots_in_the_floor_are_rejected, fallen_robots_come_to_rest_on_the_floor,);
