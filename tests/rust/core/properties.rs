//! Properties of any robot, from any start, under any torques: laws of mechanics or promises of the library, each
//! tested on every model that it applies to.
//!
//! Robots differ a hundredfold in mass and sixfold in size, so differences are in the robot's own units: lengths in
//! heights of its center of mass, rates in the rate at which it falls.

mod energy;
mod finite;
mod scaling;
mod snapshots;
mod symmetry;
mod yaw;

use crate::support::general::any_general_robot;
use crate::support::{any_robot, largest, natural_rate, torques, vector};
use ballbot_core::{Ballbot, ModelKind, Params, State, Wheels};
use nalgebra::Vector3;
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::{RngSeed, TestRunner};

/// `cases` random cases, not stored in a file: a bug that is found becomes a test with its own numbers.
fn cases(cases: u32) -> ProptestConfig {
    let cases = std::env::var("BALLBOT_CASES").map_or(cases, |text| text.parse().expect("a number of cases"));
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

/// The same cases in every run, where the tolerance is measured rather than rounding.
fn same_cases(cases: u32) -> ProptestConfig {
    ProptestConfig { rng_seed: RngSeed::Fixed(1), ..self::cases(cases) }
}

/// With symmetry or without.
fn any_shape() -> impl Strategy<Value = Params> {
    prop_oneof![any_robot(), any_general_robot()]
}

/// The models that accept the robot: `planar` accepts only symmetric robots.
fn models(params: &Params) -> impl Iterator<Item = ModelKind> {
    let symmetric = params.is_symmetric();
    ModelKind::ALL.into_iter().filter(move |kind| symmetric || *kind != ModelKind::Planar)
}

/// A robot from `start`; `None` where the model rejects the start, such as a low body in the floor.
fn robot(kind: ModelKind, params: &Params, start: &State, sim_dt: f64) -> Option<Ballbot> {
    let mut robot = Ballbot::new(params, kind, sim_dt).expect("robots are built of parts that exist");
    robot.reset(start).ok().map(|()| robot)
}

/// Torques of a run: one set after the other, each for `hold` steps, as fractions of the torque that makes a wheel
/// slip.
#[derive(Clone, Debug)]
struct Drive {
    shares: Vec<Vector3<f64>>,
    hold: usize,
}

impl Drive {
    fn torques(&self, params: &Params) -> Vec<[f64; 3]> {
        self.shares.iter().map(|shares| torques(params, shares)).collect()
    }
}

/// Up to `most` of the torque that makes a wheel slip, changed every `hold` steps.
fn any_drive(most: f64, changes: usize, hold: usize) -> impl Strategy<Value = Drive> {
    prop::collection::vec(vector(most), changes).prop_map(move |shares| Drive { shares, hold })
}

/// States of a robot under torques that each act for some steps, at each change of the torques, until it diverges.
type Run = fn(&mut Ballbot, &[[f64; 3]], usize) -> Vec<State>;

fn run(robot: &mut Ballbot, torques: &[[f64; 3]], hold: usize) -> Vec<State> {
    run_while(robot, torques, hold, |_, _| true)
}

/// As [`run`], up to the first state that leans so far that the bot might be near the floor.
fn run_upright(robot: &mut Ballbot, torques: &[[f64; 3]], hold: usize) -> Vec<State> {
    run_while(robot, torques, hold, |_, state| state.tilt() < 0.25)
}

/// As [`run`], up to the first state in which something slips, has lifted off or fallen.
fn run_with_grip(robot: &mut Ballbot, torques: &[[f64; 3]], hold: usize) -> Vec<State> {
    let slow = 1e-3 * robot.params().body_com_height * natural_rate(robot.params());
    run_while(robot, torques, hold, |robot, _| {
        let contacts = robot.contacts();
        let slip = contacts.wheel_slip_speeds.column().amax().max(contacts.floor_slip_velocity.norm());
        let lifted = contacts.wheel_normal_forces.into_iter().any(|load| load <= 0.0);
        slip < slow && !lifted && !contacts.bot_on_floor
    })
}

fn run_while(
    robot: &mut Ballbot,
    torques: &[[f64; 3]],
    hold: usize,
    holds: impl Fn(&Ballbot, &State) -> bool,
) -> Vec<State> {
    let step = |torques: &[f64; 3]| {
        robot.step(*torques, hold).ok()?;
        let state = robot.state();
        holds(robot, &state).then_some(state)
    };
    torques.iter().map_while(step).collect()
}

/// Otherwise comparisons that last only while robots grip would never happen.
#[test]
fn most_gentle_drives_keep_grip() {
    let mut runner = TestRunner::new(same_cases(50));
    let motions = (crate::support::any_robot(), crate::support::any_start(0.1, 0.2), any_drive(0.1, 20, 10));
    let mut kept = [0; 2];
    for _ in 0..50 {
        let (params, start, drive) = motions.new_tree(&mut runner).expect("nothing is filtered").current();
        for (kept, kind) in kept.iter_mut().zip([ModelKind::Contact, ModelKind::Rigid]) {
            let mut robot = robot(kind, &params, &start.of(&params), 1e-3).expect("hardly leaning");
            *kept += run_with_grip(&mut robot, &drive.torques(&params), drive.hold).len();
        }
    }
    println!("{kept:?} of 1000 states");
    // Dry friction in its joints makes rapier's wheels creep.
    assert!(kept[0] > 900 && kept[1] > 600, "{kept:?} of 1000 states");
}

/// The largest difference of two runs over their common length; `change` is applied to each state of the first run
/// before the comparison.
fn most_apart(params: &Params, one: &[State], other: &[State], change: impl Fn(&State) -> State) -> f64 {
    largest(one.iter().zip(other).map(|(a, b)| apart(params, &change(a), b)))
}

/// The largest difference of two states, in the robot's own units.
fn apart(params: &Params, a: &State, b: &State) -> f64 {
    let (length, rate) = (params.body_com_height, natural_rate(params));
    let speed = length * rate;
    let wheels = |a: Wheels<f64>, b: Wheels<f64>| (a - b).column().norm() * params.wheel_radius;
    largest([
        (a.ball_position - b.ball_position).norm() / length,
        (a.body_position - b.body_position).norm() / length,
        a.ball_quaternion.angle_to(&b.ball_quaternion) * params.ball_radius / length,
        a.body_quaternion.angle_to(&b.body_quaternion),
        (a.ball_velocity - b.ball_velocity).norm() / speed,
        (a.body_velocity - b.body_velocity).norm() / speed,
        (a.ball_angular_velocity - b.ball_angular_velocity).norm() * params.ball_radius / speed,
        (a.body_angular_velocity - b.body_angular_velocity).norm() / rate,
        wheels(a.wheel_angles, b.wheel_angles) / length,
        wheels(a.wheel_speeds, b.wheel_speeds) / speed,
    ])
}
