//! Lift-off, flight and landing: `contact` against `rigid`, from the same start.

use super::{Motion, Simulation, close, com_velocity, leaning, lifted, run};
use ballbot_core::{Model, Params, State};
use nalgebra::Vector3;

/// When the wheels leave the ball and come back, how high the body gets above it, and how it moves just before that and
/// 30 ms after.
#[derive(Debug)]
struct Hop {
    left: f64,
    back: f64,
    height: f64,
    before: State,
    after: State,
}

fn hop(robot: &mut dyn Model, impulse: &Vector3<f64>) -> Hop {
    let params = robot.params().clone();
    robot.reset(&leaning(&params, 1.0)).unwrap();
    for _ in 0..50 {
        robot.step([0.0; 3]);
    }
    robot.push(impulse, &(Vector3::z() * params.body_com_height));
    let (mut left, mut height) = (None, 0.0_f64);
    let mut before = robot.state();
    for _ in 0..500 {
        robot.step([0.0; 3]);
        let loaded = robot.contacts().wheel_normal_forces.iter().any(|&load| load > 0.0);
        let state = robot.state();
        match left {
            None if !loaded => left = Some(robot.time()),
            Some(left) if loaded => {
                let back = robot.time();
                run(robot, [0.0; 3], 30);
                return Hop { left, back, height, before, after: robot.state() };
            }
            _ => (),
        }
        height = height.max((state.body_position - state.ball_position).norm());
        before = state;
    }
    panic!("no hop: {left:?}");
}

#[test]
fn bodies_that_hop_off_their_balls_agree() {
    let params = Params::paper();
    for impulse in [Vector3::new(0.0, 0.0, 2.0), Vector3::new(0.05, 0.1, 3.0)] {
        let [r, c] = [Simulation::Rigid, Simulation::Contact].map(|s| hop(s.paper().as_mut(), &impulse));
        let label = format!("{:?}", impulse.as_slice());
        close(&format!("{label}: leaves"), c.left, r.left, 1e-3 + 1e-9);
        close(&format!("{label}: is back"), c.back, r.back, 5e-3 + 1e-9);
        close(&format!("{label}: height"), c.height, r.height, 3e-4);
        // 30 ms after the landing.
        for (when, c, r, limits) in
            [("before", &c.before, &r.before, [0.02, 2e-3, 2e-3]), ("after", &c.after, &r.after, [2e-3, 1e-3, 0.02])]
        {
            let speed = com_velocity(&params, r).norm();
            let off = (com_velocity(&params, c) - com_velocity(&params, r)).norm();
            close(&format!("{label}: CoM velocity {when} (of {speed})"), off, 0.0, limits[0]);
            let off = (c.ball_velocity - r.ball_velocity).norm();
            close(&format!("{label}: ball velocity {when}"), off, 0.0, limits[1]);
            let off = (c.body_angular_velocity - r.body_angular_velocity).norm();
            close(&format!("{label}: rate {when} (of {})", r.body_angular_velocity.norm()), off, 0.0, limits[2]);
        }
    }
}

/// Thrown upwards as a whole: time until the floor carries it again, and the state just before.
fn thrown(robot: &mut dyn Model, speed: f64) -> (f64, State) {
    let mut start = leaning(robot.params(), 1.0);
    start.ball_velocity.z = speed;
    start.body_velocity.z = speed;
    robot.reset(&start).unwrap();
    let mut before = start;
    for _ in 0..500 {
        robot.step([0.0; 3]);
        if robot.contacts().floor_force.z > 0.0 {
            return (robot.time(), before);
        }
        before = robot.state();
    }
    panic!("does not land");
}

#[test]
fn thrown_robots_agree() {
    for speed in [0.5, 1.0] {
        let [(when, r), (found, c)] =
            [Simulation::Rigid, Simulation::Contact].map(|s| thrown(s.paper().as_mut(), speed));
        close("flight against 2 v / g", found, 2.0 * speed / 9.81, 2e-3);
        close("flight", found, when, 1e-3 + 1e-9);
        // Within a step of each other: rapier feels the floor 2 mm ahead.
        close("ball", (c.ball_position - r.ball_position).norm(), 0.0, 2e-3 * speed);
        close("ball velocity", (c.ball_velocity - r.ball_velocity).norm(), 0.0, 0.02);
        close("body", (c.body_position - r.body_position).norm(), 0.0, 2e-3 * speed);
        close("tilt", c.tilt(), r.tilt(), 1e-9);
    }
}

/// Dropped from 5 cm: the robot 0.35 s after its impact, the energy lost, and the largest rise in a step.
fn dropped(simulation: Simulation) -> (Box<dyn Model>, f64, f64) {
    let mut robot = simulation.paper();
    robot.reset(&lifted(&Params::paper(), 0.05)).unwrap();
    let start = robot.energy();
    let (mut rise, mut before) = (0.0_f64, start);
    for _ in 0..450 {
        robot.step([0.0; 3]);
        rise = rise.max(robot.energy() - before);
        before = robot.energy();
        assert!(before <= start, "{} J after {} s, {start} J at first", before, robot.time());
    }
    (robot, start - before, rise)
}

#[test]
fn landings_of_dropped_robots_agree() {
    let params = Params::paper();
    let [(rigid, rigid_lost, rigid_rise), (contact, lost, rise)] =
        [Simulation::Rigid, Simulation::Contact].map(dropped);
    let weight = (params.body_mass + params.ball_mass) * params.gravity;
    // Nothing bounces: all of the fall's energy is lost.
    close("energy lost, rigid", rigid_lost, weight * 0.05, 1e-6);
    close("energy lost, contact", lost, weight * 0.05, 1e-6);
    // The sweeps of one step do not complete an impact; the next steps remove the rest.
    close("rise, rigid", rigid_rise, 0.0, 1e-7);
    close("rise, contact", rise, 0.0, 0.02);
    let (r, c) = (rigid.contacts(), contact.contacts());
    close("floor", c.floor_force.z, weight, 1e-4);
    close("floor", c.floor_force.z, r.floor_force.z, 1e-4);
    for i in 0..3 {
        // The tilt that remains after the impact continues to grow.
        close("wheel", c.wheel_normal_forces[i], r.wheel_normal_forces[i], 0.03);
    }
    let (r, c) = (rigid.state(), contact.state());
    close("ball height", c.ball_position.z, r.ball_position.z, 5e-5);
    close("ball height", c.ball_position.z, params.ball_radius, 1e-8);
    close("ball", (c.ball_position - r.ball_position).norm(), 0.0, 3e-4);
    close("body on ball", (c.body_position - c.ball_position).norm(), 0.0, 1e-10);
    close("tilt", c.tilt(), r.tilt(), 5e-3);
}
