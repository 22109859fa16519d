//! Slip at wheels and floor: `contact` against `rigid`, from the same start under the same torques.

use super::{Motion, Simulation, close, leaning, run};
use ballbot_core::kinematics::{Omniwheels, TorqueMap};
use ballbot_core::{Contacts, Model, Params};
use nalgebra::Vector3;

/// A robot after 40 ms, and its mean forces over the last 20 ms.
struct Slipped {
    robot: Box<dyn Model>,
    tractions: Vector3<f64>,
    floor: Vector3<f64>,
}

fn slip_both(params: &Params, sim_dt: f64, torques: [f64; 3]) -> [Slipped; 2] {
    [Simulation::Rigid, Simulation::Contact].map(|simulation| {
        let mut robot = simulation.robot(params, sim_dt);
        robot.reset(&leaning(params, 2.0)).unwrap();
        let steps = (0.02 / sim_dt).round() as usize;
        run(robot.as_mut(), torques, steps);
        let (mut tractions, mut floor) = (Vector3::zeros(), Vector3::zeros());
        for _ in 0..steps {
            robot.step(torques);
            tractions += robot.contacts().wheel_tractions.column() / steps as f64;
            floor += robot.contacts().floor_force / steps as f64;
        }
        Slipped { robot, tractions, floor }
    })
}

/// Relative differences of the velocities of both: wheels, ball, its rate, the body's rate; and
/// the means of tractions and floor force, N.
fn apart([rigid, contact]: &[Slipped; 2]) -> [f64; 6] {
    let (r, c) = (rigid.robot.state(), contact.robot.state());
    let share = |a: Vector3<f64>, b: Vector3<f64>| (a - b).norm() / b.norm();
    [
        share(c.wheel_speeds.column(), r.wheel_speeds.column()),
        share(c.ball_velocity, r.ball_velocity),
        share(c.ball_angular_velocity, r.ball_angular_velocity),
        share(c.body_angular_velocity, r.body_angular_velocity),
        (contact.tractions - rigid.tractions).amax(),
        (contact.floor - rigid.floor).amax(),
    ]
}

/// Asserts that the two agree within `usual` at 1 kHz and within `fine` at 10 kHz: the largest relative difference, and
/// force.
///
/// They differ by terms of first order in the step: `rigid` counts how the directions of its rows turn within a step.
#[track_caller]
fn agree(label: &str, params: &Params, torques: [f64; 3], usual: Option<[f64; 2]>, fine: [f64; 2]) {
    for (sim_dt, limits) in [(1e-3, usual), (1e-4, Some(fine))] {
        let Some([share, force]) = limits else { continue };
        let both = slip_both(params, sim_dt, torques);
        let off = apart(&both);
        println!("{label}, {sim_dt} s: {off:?}");
        let [shares, forces] = [&off[..4], &off[4..]].map(|off| off.iter().copied().fold(0.0, f64::max));
        close(&format!("{label}, {sim_dt} s: velocities"), shares, 0.0, share);
        close(&format!("{label}, {sim_dt} s: forces"), forces, 0.0, force);
        let [rigid, contact] = both.map(|slipped| slipped.robot.contacts());
        let slip = |c: &Contacts| c.wheel_slip_speeds.column().amax().max(c.floor_slip_velocity.norm());
        assert!(slip(&rigid) > 0.05 && slip(&contact) > 0.05, "{label}: nothing slips");
    }
}

#[test]
fn slipping_wheels_agree() {
    let params = Params { wheel_static_friction: 0.4, wheel_dynamic_friction: 0.4, ..Params::paper() };
    for torques in [[0.6, 0.6, 0.6], [0.7, -0.5, 0.1], [-0.6, 0.05, -0.02]] {
        agree(&format!("{torques:?}"), &params, torques, Some([2e-3, 0.015]), [2e-4, 1.5e-3]);
    }
}

#[test]
fn wheels_slipping_with_stribeck_friction_agree() {
    let params = Params { wheel_static_friction: 0.5, wheel_dynamic_friction: 0.3, ..Params::paper() };
    // Friction that decreases with slip lets small differences grow.
    for torques in [[0.6, 0.6, 0.6], [-0.6, 0.05, -0.02]] {
        agree(&format!("{torques:?}"), &params, torques, Some([4e-3, 1e-3]), [4e-4, 1e-4]);
    }
    // One wheel hardly touches here, and friction decreases with slip: which wheel breaks loose first depends on the
    // step.
    agree("a wheel almost off", &params, [0.7, -0.5, 0.1], None, [0.01, 0.03]);
}

#[test]
fn slipping_balls_agree() {
    for friction in [0.05, 0.1] {
        let params = Params { floor_static_friction: friction, floor_dynamic_friction: friction, ..Params::paper() };
        let wheels = Omniwheels::new(&params);
        for degrees in [0.0_f64, 50.0, 160.0] {
            let torque = Vector3::new(degrees.to_radians().cos(), degrees.to_radians().sin(), 0.0) * 0.8;
            let torques = wheels.wheel_torques(&torque, TorqueMap::Consistent).0;
            agree(&format!("floor {friction}, {degrees} deg"), &params, torques, Some([2e-3, 0.03]), [2e-4, 3e-3]);
        }
    }
}
