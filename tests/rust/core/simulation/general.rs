//! Robots without symmetry: against `spatial`, against closed forms, and against themselves, described in other body axes
//! or seen in a mirror.

use super::{Motion, Simulation, close, for_both};
use crate::support::general::{any_general_robot, crooked};
use crate::support::{Start, any_start, largest, natural_rate, torques, vector, without_losses};
use ballbot_core::models::SpatialMotion;
use ballbot_core::{Model, Params, State, Wheels, attitude};
use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::{RngSeed, TestRunner};

/// The same values in every run.
pub(super) fn sampled<S: Strategy>(strategy: &S, count: usize) -> Vec<S::Value> {
    let seed = ProptestConfig { rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default() };
    let mut runner = TestRunner::new(seed);
    (0..count).map(|_| strategy.new_tree(&mut runner).expect("most can exist").current()).collect()
}

/// A robot that grips, and whose wheels all carry a fair part of the load.
pub(super) fn any_gripping_robot() -> impl Strategy<Value = Params> {
    let fair = |params: &Params| {
        let loads = params.equilibrium_wheel_loads();
        loads.into_iter().fold(f64::INFINITY, f64::min) > 0.15 * params.body_mass * params.gravity
    };
    any_general_robot().prop_filter("a wheel carries next to nothing", fair).prop_map(|params| Params {
        wheel_coulomb_friction: 0.0,
        wheel_static_friction: 50.0,
        wheel_dynamic_friction: 50.0,
        floor_static_friction: 50.0,
        floor_dynamic_friction: 50.0,
        ..params
    })
}

/// [`Start::of`], about the equilibrium.
pub(super) fn about_equilibrium(params: &Params, start: &Start) -> State {
    let rolling = start.of(params);
    let speed = rolling.ball_velocity.xy();
    let spin = rolling.ball_angular_velocity.z;
    let body = attitude(start.tilt, start.yaw) * params.equilibrium_attitude(0.0);
    State::rolling(params, speed, spin, body, rolling.body_angular_velocity)
}

/// Differences of two robots: of positions and attitudes, and of velocities, in the robot's own units.
pub(super) fn apart(params: &Params, a: &State, b: &State) -> [f64; 2] {
    let (length, rate) = (params.body_com_height, natural_rate(params));
    [
        largest([
            (a.ball_position - b.ball_position).norm() / length,
            (a.body_position - b.body_position).norm() / length,
            a.body_quaternion.angle_to(&b.body_quaternion),
        ]),
        largest([
            (a.ball_velocity - b.ball_velocity).norm() / (length * rate),
            (a.body_velocity - b.body_velocity).norm() / (length * rate),
            (a.body_angular_velocity - b.body_angular_velocity).norm() / rate,
            (a.wheel_speeds.column() - b.wheel_speeds.column()).norm() / (rate * params.gear_ratio()),
        ]),
    ]
}

/// Runs `spatial` and the simulation for the time in which a robot falls, in that many steps. Differences of positions
/// and velocities at the end, and of the loads of wheels and floor relative to the weight; `None` if a wheel lifts off.
pub(super) fn off_spatial(
    simulation: Simulation,
    params: &Params,
    start: &State,
    motors: &[f64; 3],
    steps: usize,
) -> Option<[f64; 3]> {
    let dt = 1.0 / (natural_rate(params) * steps as f64);
    let mut exact = SpatialMotion::new(params, dt);
    let mut found = simulation.robot(params, dt);
    exact.reset(start).unwrap();
    found.reset(start).ok()?;
    for _ in 0..steps {
        exact.step(*motors);
        found.step(*motors);
        if exact.contacts().wheel_normal_forces.into_iter().any(|load| load <= 0.0) {
            return None;
        }
    }
    let (f, e) = (found.contacts(), exact.contacts());
    let weight = (params.body_mass + params.ball_mass) * params.gravity;
    let wheels = (f.wheel_normal_forces.column() - e.wheel_normal_forces.column()).amax();
    let loads = wheels.max((f.floor_force - e.floor_force).amax()) / weight;
    let [places, velocities] = apart(params, &found.state(), &exact.state());
    Some([places, velocities, loads])
}

fn gripping_robots_converge_to_the_spatial_model(simulation: Simulation) {
    let motions = (any_gripping_robot(), any_start(0.05, 0.1), vector(0.1));
    let (mut compared, mut worst) = (0, [0.0_f64; 3]);
    for (i, (params, start, shares)) in sampled(&motions, 40).into_iter().enumerate() {
        let (start, motors) = (about_equilibrium(&params, &start), torques(&params, &shares));
        let run = |steps| off_spatial(simulation, &params, &start, &motors, steps);
        let Some(((coarse, fine), finest)) = run(100).zip(run(200)).zip(run(2000)) else { continue };
        compared += 1;
        for (what, (coarse, fine)) in ["places", "velocities"].into_iter().zip(coarse.into_iter().zip(fine)) {
            assert!(fine <= 0.6 * coarse + 1e-6, "robot {i}: {what} off by {coarse:e}, in half the step by {fine:e}");
        }
        assert!(finest[2] <= 1e-3, "robot {i}: loads off by {:e} of the weight", finest[2]);
        worst = [0, 1, 2].map(|k| worst[k].max(finest[k]));
    }
    println!("{compared} robots: places, velocities and loads within {worst:?}");
    assert!(compared >= 30, "only {compared} robots keep their wheels on the ball");
    assert!(worst[0] <= 5e-4 && worst[1] <= 2e-3, "{worst:?}");
}

fn robots_rest_in_their_equilibrium(simulation: Simulation) {
    let mut worst = [0.0_f64; 2];
    for (params, yaw) in sampled(&(any_gripping_robot(), -3.0..3.0), 40) {
        let mut robot = simulation.robot(&params, 0.005 / natural_rate(&params));
        let start = State::at_equilibrium(&params, yaw);
        robot.reset(&start).unwrap();
        let weight = params.body_mass * params.gravity;
        for _ in 0..100 {
            robot.step([0.0; 3]);
            let loads = robot.contacts().wheel_normal_forces.column();
            let off = (loads - params.equilibrium_wheel_loads().column()).amax() / weight;
            let moved = largest(apart(&params, &robot.state(), &start));
            worst = [worst[0].max(off), worst[1].max(moved)];
        }
    }
    println!("loads off by {:e} of the weight, moved by {:e}", worst[0], worst[1]);
    let (loads, moved) = simulation.pick((1e-5, 1e-7), (1e-9, 1e-11));
    assert!(worst[0] <= loads && worst[1] <= moved, "loads, places: {worst:?}");
}

/// Parameters and states of a robot in other body axes.
struct Redescribed {
    rotation: UnitQuaternion<f64>,
}

impl Redescribed {
    /// Body axes turned about the mast.
    fn turned(angle: f64) -> Self {
        Self { rotation: UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle) }
    }

    fn params(&self, params: &Params) -> Params {
        let [x, y] = params.body_com_offset;
        let com = self.rotation.inverse() * Vector3::new(x, y, 0.0);
        let rotation: Rotation3<f64> = self.rotation.to_rotation_matrix();
        let inertia: Matrix3<f64> = rotation.transpose() * params.body_inertia_matrix() * rotation;
        let params = Params {
            body_com_offset: [com.x, com.y],
            body_inertia: inertia.diagonal().into(),
            body_products_of_inertia: [inertia[(0, 1)], inertia[(0, 2)], inertia[(1, 2)]],
            wheel_azimuths: params.wheel_azimuths.map(|azimuth| azimuth - self.rotation.angle()),
            ..params.clone()
        };
        params.validate().expect("the same robot");
        params
    }

    fn state(&self, state: &State) -> State {
        State {
            body_quaternion: state.body_quaternion * self.rotation,
            body_angular_velocity: self.rotation.inverse() * state.body_angular_velocity,
            ..state.clone()
        }
    }
}

fn motion_does_not_depend_on_the_body_axes(simulation: Simulation) {
    let motions = (any_gripping_robot(), any_start(0.05, 0.1), vector(0.1), 0.1..3.0);
    let mut worst = 0.0_f64;
    for (params, start, shares, angle) in sampled(&motions, 40) {
        let (start, motors) = (about_equilibrium(&params, &start), torques(&params, &shares));
        // One set of axes is principal in half of them.
        let straight = Params { body_products_of_inertia: [0.0; 3], ..params.clone() };
        for params in [&params, &straight] {
            if params.validate().is_err() {
                continue;
            }
            let axes = Redescribed::turned(angle);
            let dt = 0.005 / natural_rate(params);
            let mut one = simulation.robot(params, dt);
            let mut other = simulation.robot(&axes.params(params), dt);
            one.reset(&start).unwrap();
            other.reset(&axes.state(&start)).unwrap();
            for _ in 0..200 {
                one.step(motors);
                other.step(motors);
            }
            worst = worst.max(largest(apart(params, &axes.state(&one.state()), &other.state())));
        }
    }
    println!("{worst:e} apart");
    assert!(worst <= 1e-10, "{worst:e} apart");
}

/// Slipping, pushed off the ball, falling and lying: the same in other body axes, until rounding has grown.
#[test]
fn falls_do_not_depend_on_the_body_axes() {
    let crooked = Params { body_inertia: [0.0583, 0.04, 0.0237], ..crooked() };
    let straight = Params { body_products_of_inertia: [0.0; 3], ..crooked };
    for params in [straight, crooked] {
        let axes = Redescribed::turned(0.7);
        let mut one = Simulation::Contact.robot(&params, 1e-3);
        let mut other = Simulation::Contact.robot(&axes.params(&params), 1e-3);
        let start = State::tilted(&params, [0.05, 0.1].into(), 0.3);
        one.reset(&start).unwrap();
        other.reset(&axes.state(&start)).unwrap();
        let (mut landed, mut lifted) = (None, false);
        let mut worst = 0.0_f64;
        for step in 0..1200 {
            if step == 100 {
                let (impulse, point) = (Vector3::new(0.3, 0.1, 4.0), Vector3::new(0.05, -0.1, 0.2));
                one.push(&impulse, &point);
                other.push(&impulse, &(axes.rotation.inverse() * point));
            }
            let motors = if step < 100 { [0.6, -0.5, 0.1] } else { [0.0; 3] };
            one.step(motors);
            other.step(motors);
            let contacts = one.contacts();
            lifted |= contacts.wheel_normal_forces == Wheels::default();
            if landed.is_none() && contacts.bot_on_floor {
                landed = Some(step);
            }
            worst = worst.max(largest(apart(&params, &axes.state(&one.state()), &other.state())));
        }
        println!("{landed:?}, {lifted}: {worst:e} apart");
        assert!(lifted && landed.is_some(), "it neither lifted off nor fell: {landed:?}, {lifted}");
        assert!(worst <= 1e-8, "{worst:e} apart");
    }
}

/// The robot behind a mirror in the xz-plane.
pub(super) fn mirror_image(params: &Params) -> Params {
    let ([x, y], [xy, xz, yz]) = (params.body_com_offset, params.body_products_of_inertia);
    Params {
        wheel_azimuths: params.wheel_azimuths.map(|azimuth| -azimuth),
        roller_angle: -params.roller_angle,
        body_com_offset: [x, -y],
        body_products_of_inertia: [-xy, xz, -yz],
        ..params.clone()
    }
}

pub(super) fn mirrored(state: &State) -> State {
    let vector = |v: &Vector3<f64>| Vector3::new(v.x, -v.y, v.z);
    let turning = |v: &Vector3<f64>| Vector3::new(-v.x, v.y, -v.z);
    let attitude = |q: &UnitQuaternion<f64>| UnitQuaternion::new_unchecked(Quaternion::new(q.w, -q.i, q.j, -q.k));
    State {
        ball_position: vector(&state.ball_position),
        ball_quaternion: attitude(&state.ball_quaternion),
        ball_velocity: vector(&state.ball_velocity),
        ball_angular_velocity: turning(&state.ball_angular_velocity),
        body_position: vector(&state.body_position),
        body_quaternion: attitude(&state.body_quaternion),
        body_velocity: vector(&state.body_velocity),
        body_angular_velocity: turning(&state.body_angular_velocity),
        wheel_angles: state.wheel_angles.map(|angle| -angle),
        wheel_speeds: state.wheel_speeds.map(|speed| -speed),
    }
}

fn mirror_images_move_as_the_mirrored_motion(simulation: Simulation) {
    let motions = (any_gripping_robot(), any_start(0.05, 0.1), vector(0.1));
    let mut worst = 0.0_f64;
    for (params, start, shares) in sampled(&motions, 40) {
        let (start, motors) = (about_equilibrium(&params, &start), torques(&params, &shares));
        let dt = 0.005 / natural_rate(&params);
        let mut one = simulation.robot(&params, dt);
        let mut image = simulation.robot(&mirror_image(&params), dt);
        one.reset(&start).unwrap();
        image.reset(&mirrored(&start)).unwrap();
        for _ in 0..200 {
            one.step(motors);
            image.step(motors.map(|torque| -torque));
        }
        worst = worst.max(largest(apart(&params, &mirrored(&one.state()), &image.state())));
    }
    println!("{worst:e} apart");
    assert!(worst <= 1e-10, "{worst:e} apart");
}

/// A push at a point of the body turns it about its CoM, wherever that is.
fn pushes_act_at_their_point(simulation: Simulation) {
    for params in sampled(&any_general_robot(), 40) {
        let params = without_losses(&params);
        let mut robot = simulation.robot(&params, 1e-6);
        let mut start = State::tilted(&params, [0.3, -0.2].into(), 0.8);
        start.ball_position.z += 10.0;
        start.body_position.z += 20.0;
        robot.reset(&start).unwrap();
        let size = params.body_com_height;
        let impulse = Vector3::new(0.3, -0.2, 0.4) * (params.body_mass * size);
        let point = Vector3::new(0.5, -0.3, 0.8) * size;
        robot.push(&impulse, &point);
        robot.step([0.0; 3]);
        let after = robot.state();
        let com = params.body_com();
        let velocity = after.body_velocity + after.body_quaternion * after.body_angular_velocity.cross(&com);
        let expected = impulse / params.body_mass - Vector3::z() * (params.gravity * 1e-6);
        // In `rigid` the pose of the body is ahead of its velocities by the rotation of a step.
        let limit = simulation.pick(1e-5, 1e-10);
        close("CoM velocity", (velocity - expected).norm() / expected.norm(), 0.0, limit);
        // Free wheels keep their spin about their axles: only the inertia without that spin turns.
        let arm = start.body_quaternion.inverse_transform_vector(&impulse);
        let turned = params.body_inertia_matrix().lu().solve(&(point - com).cross(&arm)).expect("moments are positive");
        close("rate", (after.body_angular_velocity - turned).norm() / turned.norm(), 0.0, limit);
    }
}

/// Height of the lowest point of the bot: wheels as spheres, the body as the cylinder about its mast.
pub(super) fn lowest_point(params: &Params, state: &State) -> f64 {
    let reach = params.ball_radius + params.wheel_radius;
    let height = |point: Vector3<f64>| (state.body_position + state.body_quaternion * point).z;
    let (mut wheel, mut radius) = (f64::INFINITY, 0.0_f64);
    for (azimuth, offset) in params.wheel_azimuths.into_iter().zip(params.wheel_zenith_offsets) {
        let (sin, cos) = (params.wheel_zenith + offset).sin_cos();
        let center = Vector3::new(sin * azimuth.cos(), sin * azimuth.sin(), cos) * reach;
        wheel = wheel.min(height(center) - params.wheel_radius);
        radius = radius.max(sin * reach);
    }
    // The larger moment across the mast.
    let moment = params.body_inertia_matrix().fixed_view::<2, 2>(0, 0).into_owned().symmetric_eigenvalues().max();
    let top = params.body_com_height + (3.0 * moment / params.body_mass).sqrt();
    let rim = radius * state.tilt().sin();
    let ends = [1.05 * params.ball_radius, top].map(|end| height(Vector3::z() * end) - rim);
    wheel.min(ends[0]).min(ends[1])
}

fn fallen_robots_lie_on_the_floor(simulation: Simulation) {
    let off = Params { body_com_offset: [0.03, -0.02], ..crooked() };
    for params in [crooked(), off] {
        for tilt in [[0.2, 0.1], [-0.3, 0.05]] {
            let mut robot = simulation.robot(&params, 1e-3);
            robot.reset(&State::tilted(&params, tilt.into(), 0.4)).unwrap();
            let (mut deepest, mut rise, mut lowest) = (0.0_f64, 0.0_f64, robot.energy());
            for _ in 0..4000 {
                robot.step([0.0; 3]);
                lowest = lowest.min(robot.energy());
                rise = rise.max(robot.energy() - lowest);
                deepest = deepest.max(-lowest_point(&params, &robot.state()));
            }
            let height = lowest_point(&params, &robot.state());
            let turning = robot.state().body_angular_velocity.norm();
            println!("{tilt:?}: rises by {rise:e} J, {deepest:e} m deep, lies at {height:e} m, {turning:e} rad/s");
            assert!(robot.bot_on_floor(), "{tilt:?}: does not lie on the floor");
            assert!(rise <= simulation.pick(2e-3, 1e-5), "{tilt:?}: energy rises by {rise:e} J");
            assert!(deepest <= 5e-5, "{tilt:?}: {deepest:e} m into the floor");
            assert!(height.abs() <= 1e-7, "{tilt:?}: lies at {height:e} m");
            assert!(turning <= 1e-4, "{tilt:?}: still turns with {turning} rad/s");
        }
    }
}

for_both!(
    gripping_robots_converge_to_the_spatial_model,
    robots_rest_in_their_equilibrium,
    motion_does_not_depend_on_the_body_axes,
    mirror_images_move_as_the_mirrored_motion,
    pushes_act_at_their_point,
    fallen_robots_lie_on_the_floor,
);
