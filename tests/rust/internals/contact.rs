//! Eight robots in lanes equal eight single robots, to the last bit, with every instruction set of this machine.

use ballbot_base::snapshot::encode;
use ballbot_contact::{Constants, ContactState, Delassus, Footing, LaneConstants, PrincipalAxes, Start, advance};
use ballbot_core::kinematics::Omniwheels;
use ballbot_core::lanes::{EIGHT, Eight, Scalar};
use ballbot_core::sim::ContactMotion;
use ballbot_core::terrain::{Ground, Terrain};
use ballbot_core::{Model, Params, State, Wheels};
use ballbot_lanes::advance_eight;
use fearless_simd::Level;
use nalgebra::{UnitQuaternion, Vector2, Vector3};
use std::sync::Arc;

const STEPS: usize = 500;
/// A lane with only zeros, whose signs are bits too, and a lane in the air.
const AT_REST: usize = 0;
const LIFTED: usize = 1;
/// The lanes whose robots do things that must not affect their neighbors.
const FRICTION: usize = 2;
const FALLING: usize = 3;
const DIVERGING: usize = 4;
const PUSHED: usize = 5;
const RESET: usize = 6;
const SLIPPING: usize = 7;

/// Static friction above dynamic friction, so that the run includes its law.
fn params() -> Params {
    Params {
        wheel_static_friction: 0.6,
        wheel_dynamic_friction: 0.4,
        floor_static_friction: 0.5,
        floor_dynamic_friction: 0.3,
        ..Params::paper()
    }
}

/// Behavior of a lane's robot.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// The same as the other calm robots; nothing happens to it.
    Calm,
    Eventful,
    /// Eventful, on wheels with a ripple and inclined rollers.
    Rippled,
}

/// The robot of a lane: calm robots are identical, the others have different masses, geometry or friction.
fn params_of(i: usize, kind: Kind) -> Params {
    let mut params = params();
    if kind == Kind::Calm {
        return params;
    }
    if kind == Kind::Rippled {
        params = rippled(&params);
        params.roller_angle = 0.2 * i as f64 - 0.5;
    }
    params.body_mass *= 1.0 + 0.02 * i as f64;
    match i {
        FRICTION => {
            (params.wheel_viscous_friction, params.wheel_coulomb_friction) = (1e-3, 5e-3);
            (params.floor_rolling_friction, params.floor_spinning_friction) = (1e-3, 2e-3);
            (params.roller_friction, params.roller_friction_slope) = (0.02, 0.1);
            params.wheel_preload = 15.0;
        }
        // Without the law of static friction, next to lanes with it.
        DIVERGING => params.wheel_static_friction = params.wheel_dynamic_friction,
        PUSHED => params.floor_static_friction = params.floor_dynamic_friction,
        LIFTED | SLIPPING => {
            params.ball_radius *= 1.1;
            params.wheel_radius *= 0.9;
            params.body_com_height *= 1.05;
        }
        // Without symmetry, between symmetric lanes.
        FALLING | RESET => {
            params.body_com_offset = [0.01, -0.02];
            params.body_products_of_inertia = [4e-3, -6e-3, 3e-3];
            params.wheel_azimuths[1] += 0.1;
            params.wheel_zenith_offsets = [0.05, -0.1, 0.02];
        }
        _ => (),
    }
    params.validate().expect("a robot that can exist");
    params
}

fn constants_of(i: usize, kind: Kind) -> Constants<f64> {
    Constants::new(&params_of(i, kind), 1e-3)
}

/// Start of a robot of its lane; a calm robot is not pushed, does not fall and equals the other calm robots.
fn start(i: usize, kind: Kind) -> ContactState<f64> {
    let params = params_of(i, kind);
    let mut robot = ContactMotion::new(&params, 1e-3);
    let angle = i as f64;
    let degrees: f64 = match i {
        AT_REST => 0.0,
        FALLING if kind != Kind::Calm => 40.0,
        _ => 0.3 + 0.2 * angle,
    };
    let tilt = Vector2::new(angle.cos(), angle.sin()) * degrees.to_radians();
    let mut start = State::tilted(&params, tilt, 0.5 * angle);
    if i == LIFTED {
        start.ball_position.z += 0.02;
        start.body_position.z += 0.02;
    }
    robot.accepts(&start).expect("above the floor");
    robot.place(&start);
    robot.memory().clone()
}

fn push(memory: &mut ContactState<f64>, impulse: f64) {
    memory.push = [impulse, -0.5 * impulse, 0.2 * impulse, 0.1 * impulse, 0.0, 0.05 * impulse];
}

/// Torques of a robot in a step: changing, and for some robots beyond the friction limit.
fn torques(i: usize, step: usize) -> [f64; 3] {
    let size = match i {
        AT_REST => return [0.0; 3],
        SLIPPING if step > 250 => 0.8,
        _ => 0.02,
    };
    [0, 1, 2].map(|k| size * ((i * 7 + k * 3 + step / 20) as f64).sin())
}

type Kinds = [Kind; EIGHT];

/// Events of a lane's robot before a step, other than its torques.
fn event(i: usize, step: usize, kind: Kind, memory: &mut ContactState<f64>) {
    match (i, step) {
        _ if kind == Kind::Calm => (),
        (DIVERGING, 100) => push(memory, 1e200),
        (PUSHED, 0) => push(memory, 0.05),
        (PUSHED, 200) => push(memory, 1.5),
        (RESET, 250) => *memory = start(RESET, kind),
        _ => (),
    }
}

fn alone(i: usize, kind: Kind, ground: Option<&Arc<Ground>>) -> Vec<ContactState<f64>> {
    let constants = constants_of(i, kind);
    let mut footing = ground.map(Footing::new);
    let mut memory = start(i, kind);
    let step = |k| {
        event(i, k, kind, &mut memory);
        advance(&constants, &mut memory, footing.as_mut(), Wheels(torques(i, k)), 1);
        memory.clone()
    };
    (0..STEPS).map(step).collect()
}

fn side_by_side(level: Level, kinds: Kinds, ground: Option<&Arc<Ground>>) -> Vec<ContactState<Eight>> {
    let mut footing = ground.map(Footing::new);
    let mut constants = LaneConstants::of_all(constants_of(0, Kind::Calm));
    let mut robots = ContactState::<Eight>::default();
    for (i, &kind) in kinds.iter().enumerate() {
        constants.set_lane(i, &constants_of(i, kind));
        robots.set_lane(i, &start(i, kind));
    }
    let mut out = Vec::new();
    for k in 0..STEPS {
        let mut all = Wheels::<Eight>::default();
        for (i, &kind) in kinds.iter().enumerate() {
            let mut one = robots.lane(i);
            event(i, k, kind, &mut one);
            robots.set_lane(i, &one);
            for (eight, torque) in all.iter_mut().zip(torques(i, k)) {
                eight.0[i] = torque;
            }
        }
        advance_eight(level, &constants, &mut robots, footing.as_mut(), &all, 1);
        out.push(robots.clone());
    }
    out
}

/// The run with every instruction set that this machine has.
fn runs(kinds: Kinds, ground: Option<&Arc<Ground>>) -> Vec<(&'static str, Vec<ContactState<Eight>>)> {
    let level = Level::new();
    let mut out = Vec::new();
    #[cfg(target_arch = "x86_64")]
    {
        if let Some(simd) = level.as_avx512() {
            out.push(("AVX-512", side_by_side(Level::Avx512(simd), kinds, ground)));
        }
        if let Some(simd) = level.as_avx2() {
            out.push(("AVX2", side_by_side(Level::Avx2(simd), kinds, ground)));
        }
    }
    #[cfg(target_arch = "aarch64")]
    if let Some(simd) = level.as_neon() {
        out.push(("NEON", side_by_side(Level::Neon(simd), kinds, ground)));
    }
    println!("{level:?}: {:?}", out.iter().map(|(name, _)| name).collect::<Vec<_>>());
    out
}

/// All its numbers, bit by bit.
fn bits(memory: &ContactState<f64>) -> Vec<u64> {
    encode(memory).chunks(8).map(|b| b.iter().fold(0, |bits, b| bits << 8 | u64::from(*b))).collect()
}

#[track_caller]
fn assert_same(label: &str, found: &ContactState<f64>, expected: &ContactState<f64>) {
    assert!(bits(found) == bits(expected), "{label}:\n{found:?}\n{expected:?}");
}

/// Runs with events, with and without a fall: near the floor all eight take a different kind of step.
fn assert_lanes_equal_robots(
    falling: bool,
    rippled: &[usize],
    ground: Option<&Arc<Ground>>,
) -> [Vec<ContactState<f64>>; EIGHT] {
    let mut kinds = [Kind::Eventful; EIGHT];
    rippled.iter().for_each(|&i| kinds[i] = Kind::Rippled);
    if !falling {
        kinds[FALLING] = Kind::Calm;
    }
    let expected = [0, 1, 2, 3, 4, 5, 6, 7].map(|i| alone(i, kinds[i], ground));
    for (name, run) in runs(kinds, ground) {
        for (k, robots) in run.iter().enumerate() {
            for (i, alone) in expected.iter().enumerate() {
                assert_same(&format!("{name}, lane {i}, step {k}"), &robots.lane(i), &alone[k]);
            }
        }
    }
    expected
}

#[test]
fn robots_in_lanes_equal_single_robots() {
    for falling in [true, false] {
        assert_eventful(&assert_lanes_equal_robots(falling, &[], None), falling);
    }
}

#[test]
fn robots_in_lanes_on_wheels_with_ripple_equal_single_robots() {
    for falling in [true, false] {
        // Some, next to robots on round wheels; then all.
        for rippled in [&[LIFTED, FRICTION, SLIPPING][..], &[0, 1, 2, 3, 4, 5, 6, 7]] {
            assert_eventful(&assert_lanes_equal_robots(falling, rippled, None), falling);
        }
    }
}

#[test]
fn robots_in_lanes_on_a_terrain_equal_single_robots() {
    let parameters = [("slope", 0.2), ("wavelength", 0.8), ("size_x", 3.0), ("size_y", 3.0), ("apron", 0.05)];
    let terrain = Arc::new(Terrain::generate("noise", 1, &parameters).unwrap());
    let ground = Arc::new(Ground::new(&terrain, params().ball_radius).unwrap());
    for falling in [true, false] {
        let robots = assert_lanes_equal_robots(falling, &[PUSHED, FALLING], Some(&ground));
        assert_eq!(robots[FALLING][STEPS - 1].bot_on_floor > 0.0, falling);
        assert!(robots[SLIPPING][STEPS - 1].ball_position[2] != robots[AT_REST][STEPS - 1].ball_position[2]);
    }
}

/// Checks that a run contains what it is meant to test.
fn assert_eventful(expected: &[Vec<ContactState<f64>>; EIGHT], falling: bool) {
    assert_eq!(expected[FALLING][STEPS - 1].bot_on_floor > 0.0, falling);
    for (i, alone) in expected.iter().enumerate() {
        assert_eq!(alone[STEPS - 1].diverged, if i == DIVERGING { 1.0 } else { 0.0 }, "lane {i}");
    }
    // A diverged robot stays where it was.
    let [before, after] = [99, 100].map(|step| &expected[DIVERGING][step]);
    assert_same("diverged", &ContactState { steps: after.steps, diverged: 1.0, ..before.clone() }, after);
    assert!(expected[FRICTION][10].joint_impulses != Wheels::default());
    assert_eq!(expected[RESET][STEPS - 1].steps, 250.0);
    let slip = |m: &ContactState<f64>| m.wheel_spins.column().amax();
    assert!(slip(&expected[SLIPPING][STEPS - 1]) > 20.0, "nothing slips");
}

/// A robot that falls, diverges, is pushed, reset or differs does not affect its neighbors, to the last bit.
#[test]
fn lanes_do_not_depend_on_their_neighbors() {
    let calm = runs([Kind::Calm; EIGHT], None);
    let on_round_wheels = [LIFTED, FRICTION, FALLING, DIVERGING, PUSHED, RESET, SLIPPING].map(|i| (i, Kind::Eventful));
    for (eventful, kind) in on_round_wheels.into_iter().chain([(FALLING, Kind::Rippled), (PUSHED, Kind::Rippled)]) {
        let mut only = [Kind::Calm; EIGHT];
        only[eventful] = kind;
        for ((name, found), (_, expected)) in runs(only, None).iter().zip(&calm) {
            for (k, (found, expected)) in found.iter().zip(expected).enumerate() {
                for i in (0..EIGHT).filter(|&i| i != eventful) {
                    let label = format!("{name}, lane {i} next to {eventful}, step {k}");
                    assert_same(&label, &found.lane(i), &expected.lane(i));
                }
            }
            let last = STEPS - 1;
            assert!(bits(&found[last].lane(eventful)) != bits(&expected[last].lane(eventful)), "{eventful} is calm");
        }
    }
}

#[test]
fn one_call_of_many_steps_equals_many_calls() {
    let constants = constants_of(1, Kind::Eventful);
    let (mut once, mut singly) = (start(1, Kind::Eventful), start(1, Kind::Eventful));
    advance(&constants, &mut once, None, Wheels([0.02, -0.01, 0.03]), 200);
    for _ in 0..200 {
        advance(&constants, &mut singly, None, Wheels([0.02, -0.01, 0.03]), 1);
    }
    assert_same("200 steps", &once, &singly);
}

/// Robots that spin, slip and have a ball 3 mm and a tenth of a radian out of place: with symmetry and without.
fn displaced() -> [ContactMotion; 2] {
    displaced_robots(Params::clone)
}

fn displaced_robots(change: fn(&Params) -> Params) -> [ContactMotion; 2] {
    [params(), general()].map(|params| displaced_robot(&change(&params)))
}

/// With a ripple of twelve and of seven rollers per turn.
fn rippled(params: &Params) -> Params {
    let roller_count = if params.is_symmetric() { 12.0 } else { 7.0 };
    Params { roller_ripple: 5e-4, roller_count, roller_phases: [0.5, -1.0, 2.5], ..params.clone() }
}

/// With inclined rollers, and a ripple.
fn inclined(params: &Params) -> Params {
    Params { roller_angle: if params.is_symmetric() { 0.7 } else { -0.4 }, ..rippled(params) }
}

fn general() -> Params {
    let params = Params {
        body_com_offset: [0.03, -0.02],
        body_products_of_inertia: [4e-3, -6e-3, 3e-3],
        wheel_azimuths: [0.2, 2.0, 4.3],
        wheel_zenith_offsets: [0.1, -0.05, 0.15],
        ..params()
    };
    params.validate().expect("a robot that can exist");
    params
}

fn displaced_robot(params: &Params) -> ContactMotion {
    let mut state = State::tilted(params, Vector2::new(0.3, -0.2), 0.8);
    state.ball_position += Vector3::new(2e-3, -1e-3, 3e-3);
    state.body_position.z += 5e-3;
    state.ball_velocity = Vector3::new(0.3, -0.2, 0.1);
    state.ball_angular_velocity = Vector3::new(2.0, 1.0, -3.0);
    state.body_velocity = Vector3::new(-0.1, 0.4, 0.2);
    state.body_angular_velocity = Vector3::new(1.5, -2.5, 4.0);
    state.wheel_speeds = Wheels([10.0, -20.0, 5.0]);
    let mut robot = ContactMotion::new(params, 1e-3);
    robot.place(&state);
    robot
}

#[test]
fn slip_of_the_rows_is_the_slip_of_the_surfaces() {
    let inclined = displaced_robots(inclined).into_iter().map(|robot| {
        let start = Start::<f64>::new::<true, f64>(robot.constants(), Scalar, robot.memory());
        (robot, start)
    });
    let others = displaced().into_iter().map(|robot| {
        let start = Start::<f64>::new::<false, f64>(robot.constants(), Scalar, robot.memory());
        (robot, start)
    });
    for (robot, start) in inclined.chain(others) {
        for (i, expected) in robot.contacts().wheel_slip_speeds.into_iter().enumerate() {
            let found = start.rows.slip_speed(robot.constants(), &start.velocities, i);
            println!("wheel {i}: {found}, expected {expected}");
            assert!((found - expected).abs() < 1e-13, "wheel {i}: {found} m/s, expected {expected}");
        }
    }
}

/// The Delassus matrix predicts the residuals of the rows after each impulse.
#[test]
fn delassus_matrix_is_the_effect_of_impulses_on_the_rows() {
    displaced().iter().for_each(check_delassus_matrix::<false>);
    displaced_robots(rippled).iter().for_each(check_delassus_matrix::<true>);
    displaced_robots(inclined).iter().for_each(check_delassus_matrix::<true>);
}

fn check_delassus_matrix<const RIPPLE: bool>(robot: &ContactMotion) {
    let c = robot.constants();
    let start = Start::<f64>::new::<RIPPLE, f64>(c, Scalar, robot.memory());
    let before = start.rows.residuals::<RIPPLE, f64>(c, &start.velocities);
    let delassus = Delassus::new::<true, RIPPLE>(c, &start.rows);
    for row in 0..12 {
        let mut impulse = before;
        let rows = [&mut impulse.floor, &mut impulse.normals.0, &mut impulse.drives.0, &mut impulse.joints.0];
        for (k, cell) in rows.into_iter().flatten().enumerate() {
            *cell = if k == row { 1.0 } else { 0.0 };
        }
        let mut velocities = start.velocities;
        start.rows.apply::<true, RIPPLE, f64>(c, &impulse, &mut velocities);
        let after = start.rows.residuals::<RIPPLE, f64>(c, &velocities);
        let mut expected = before;
        delassus.add_effect::<true>(&impulse, &mut expected);
        let blocks = [
            (after.floor, expected.floor),
            (after.normals.0, expected.normals.0),
            (after.drives.0, expected.drives.0),
            (after.joints.0, expected.joints.0),
        ];
        for (after, expected) in blocks {
            for (a, e) in after.into_iter().zip(expected) {
                // Wheels are light: a unit impulse on a joint changes its rate by 7000 rad/s.
                assert!((a - e).abs() < 1e-11, "impulse {row}: {after:?}, expected {expected:?}");
            }
        }
    }
}

/// A body with equal moments has any axes as principal axes: its motion does not depend on the axes that the solver
/// takes.
#[test]
fn motion_does_not_depend_on_the_principal_axes() {
    let moment = 0.05;
    let even = Params { body_inertia: [moment; 3], body_products_of_inertia: [0.0; 3], ..general() };
    let wheels = Omniwheels::new(&even);
    // The robot's torques, its tilt, and an impulse in step 100. It leans, slips and falls, loses its ball and lands on
    // it, tumbles and lands on its side.
    let runs = [
        (Wheels([0.02, -0.01, 0.03]), 0.05, Vector3::zeros()),
        (Wheels([0.8, -0.6, 0.7]), 0.1, Vector3::zeros()),
        (Wheels::default(), 0.02, Vector3::new(0.1, 0.2, 3.0)),
        (Wheels::default(), 0.6, Vector3::new(2.0, -1.0, 6.0)),
    ];
    for rotation in [[0.3, -0.5, 0.8], [2.0, 1.0, -0.5], [-1.0, 0.4, 2.5]] {
        let rotation = Some(UnitQuaternion::from_scaled_axis(rotation.into()));
        let axes = [None, rotation].map(|rotation| PrincipalAxes { rotation, moments: [moment; 3] });
        for (k, (torques, tilt, blow)) in runs.iter().enumerate() {
            let mut start = State::tilted(&even, Vector2::new(*tilt, 0.5 * tilt), 0.4);
            start.body_angular_velocity = Vector3::new(0.2, -0.1, 0.3);
            let [one, other] = [0, 1].map(|which| {
                let c = Constants::in_axes(&even, 1e-3, &axes[which]);
                let mut robot = ContactState::at(&c, &wheels, None, &start);
                let step = |step| {
                    if step == 100 {
                        robot.push(&c, blow, &Vector3::new(0.05, -0.1, 0.2));
                    }
                    advance(&c, &mut robot, None, *torques, 1);
                    (State::from(robot.read(&c)), robot.contacts(&c, None))
                };
                (0..1500).map(step).collect::<Vec<_>>()
            });
            let mut worst = 0.0_f64;
            for ((one, _), (other, _)) in one.iter().zip(&other) {
                let apart = [
                    (one.ball_position - other.ball_position).norm(),
                    (one.body_position - other.body_position).norm(),
                    one.body_quaternion.angle_to(&other.body_quaternion),
                ];
                worst = apart.into_iter().fold(worst, f64::max);
            }
            let on_floor = one.iter().filter(|(_, contacts)| contacts.bot_on_floor).count();
            let off_ball = one.iter().filter(|(_, contacts)| contacts.wheel_normal_forces == Wheels::default()).count();
            println!("run {k}: {on_floor} steps on the floor, {off_ball} off the ball, {worst:e} apart");
            assert!(worst <= 1e-9, "run {k}: {worst:e} apart");
            assert!(k != 2 || off_ball > 0, "it does not hop");
            assert!(k != 3 || on_floor > 0, "it does not fall");
        }
    }
}
