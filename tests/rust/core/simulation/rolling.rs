//! Motion without slip: it equals the spatial model.

use super::{Motion, Simulation, for_both, run};
use ballbot_core::control::{Controller, Lqr, Setpoint};
use ballbot_core::kinematics::Omniwheels;
use ballbot_core::models::SpatialMotion;
use ballbot_core::{Model, Params, State, attitude};
use nalgebra::{Vector2, Vector3};

/// States every 10 ms of two seconds under the regulator, from a tilted start with a heading error.
fn regulated_run(robot: &mut dyn Model) -> Vec<State> {
    let params = robot.params().clone();
    robot.reset(&State::tilted(&params, Vector2::new(0.03, -0.04), 0.3)).unwrap();
    let mut lqr = Lqr::new(&params, 0.01).unwrap();
    let substeps = (0.01 / robot.sim_dt()).round() as usize;
    let control = |_| {
        let torques = lqr.wheel_torques(&robot.state(), &Setpoint::default());
        run(robot, torques.0, substeps);
        robot.state()
    };
    (0..200).map(control).collect()
}

/// States every 10 ms of half a second under torques that topple and turn the robot: with a longer run, the instability
/// (e^{6.09 t}) would show the solver's rounding instead of its physics.
fn toppling_run(robot: &mut dyn Model) -> Vec<State> {
    let substeps = (0.01 / robot.sim_dt()).round() as usize;
    let topple = |_| {
        run(robot, [0.02, 0.005, 0.01], substeps);
        robot.state()
    };
    (0..50).map(topple).collect()
}

/// Largest distance of the balls (m) and angle between the bodies (rad) over two runs.
fn apart(a: &[State], b: &[State]) -> (f64, f64) {
    let distance = |(f, e): (&State, &State)| (f.ball_position - e.ball_position).xy().norm();
    let angle = |(f, e): (&State, &State)| f.body_quaternion.angle_to(&e.body_quaternion);
    (a.iter().zip(b).map(distance).fold(0.0, f64::max), a.iter().zip(b).map(angle).fold(0.0, f64::max))
}

fn motion_without_slip_matches_the_spatial_model_and_converges_to_it(simulation: Simulation) {
    let params = Params::paper();
    for run in [regulated_run, toppling_run] {
        let exact = run(&mut SpatialMotion::new(&params, 1e-4));
        let errors = [2e-3, 1e-3, 5e-4].map(|dt| apart(&run(simulation.robot(&params, dt).as_mut()), &exact));
        println!("{errors:?}");
        let (distance, angle) = errors[1];
        let limit = (3e-4, 0.1_f64.to_radians());
        assert!(distance <= limit.0 && angle <= limit.1, "at 1 kHz: {distance} m, {angle} rad apart");
        assert!(errors[2].0 < 0.7 * errors[0].0, "no convergence in position: {errors:?}");
        assert!(errors[2].1 < 0.7 * errors[0].1, "no convergence in attitude: {errors:?}");
    }
}

fn wheels_turn_with_the_ball_and_the_ball_rolls_without_drift(simulation: Simulation) {
    let params = Params::paper();
    let mut robot = simulation.robot(&params, 1e-3);
    let mut lqr = Lqr::new(&params, 0.01).unwrap();
    let wheels = Omniwheels::new(&params);
    let (mut worst_slip, mut fastest, mut rolled, mut deepest) = (0.0_f64, 0.0_f64, Vector2::zeros(), 0.0_f64);
    for k in 0..400 {
        // A meter along a slanted line in two seconds, then at rest.
        let share = (f64::from(k) / 200.0).min(1.0);
        let position = Vector2::new(0.8, 0.6) * share * share * (3.0 - 2.0 * share);
        let torques = lqr.wheel_torques(&robot.state(), &Setpoint { position, ..Setpoint::default() });
        for _ in 0..10 {
            robot.step(torques);
            let state = robot.state();
            let ideal =
                wheels.wheel_speeds(&state.body_quaternion, &state.ball_angular_velocity, &state.body_angular_velocity);
            worst_slip = worst_slip.max((state.wheel_speeds - ideal).column().amax());
            fastest = fastest.max(ideal.column().amax());
            let rate = state.ball_angular_velocity;
            rolled += Vector2::new(rate.y, -rate.x) * params.ball_radius * robot.sim_dt();
            deepest = deepest.max((params.ball_radius - state.ball_position.z).abs());
            deepest = deepest.max((state.body_position - state.ball_position).norm());
        }
    }
    let position = robot.state().ball_position.xy();
    let drift = (rolled - position).norm();
    println!("slip {worst_slip:e} of {fastest}, drift {drift:e}, at {position}, penetration {deepest:e}");
    let (slip, drifted, depth) = simulation.pick((1e-3, 1e-3, 1e-4), (2e-5, 5e-7, 5e-8));
    assert!((position - Vector2::new(0.8, 0.6)).norm() < 0.02, "did not get there: {position}");
    assert!(worst_slip <= slip * fastest, "wheel speeds off by {worst_slip} rad/s of {fastest}");
    assert!(drift <= drifted, "rolled {rolled}, moved {position}");
    assert!(deepest <= depth, "penetration {deepest} m");
}

fn power_of_viscous_floor_friction_has_its_closed_form(simulation: Simulation) {
    let params = Params { ball_viscous_friction: 5.0, ..Params::paper() };
    let mut exact = SpatialMotion::new(&params, 1e-3);
    let mut simulated = simulation.robot(&params, 1e-3);
    let start = State::rolling(&params, Vector2::new(0.4, 0.1), 0.0, attitude(Vector2::zeros(), 0.0), Vector3::zeros());
    for robot in [&mut exact as &mut dyn Model, simulated.as_mut()] {
        robot.reset(&start).unwrap();
        run(robot, [0.0; 3], 200);
    }
    let off = (simulated.state().ball_velocity - exact.state().ball_velocity).norm();
    println!("{off:e} m/s apart");
    assert!(off < 3e-4, "{off} m/s apart after 0.2 s");
}

for_both!(
    motion_without_slip_matches_the_spatial_model_and_converges_to_it,
    wheels_turn_with_the_ball_and_the_ball_rolls_without_drift,
    power_of_viscous_floor_friction_has_its_closed_form,
);
