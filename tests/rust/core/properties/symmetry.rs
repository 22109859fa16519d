//! Three symmetric wheels on a round body: the robot is the same seen from each wheel, and its mirror image is also a
//! robot.

use super::{Drive, Run, any_drive, cases, most_apart, robot, run, run_with_grip, same_cases};
use crate::support::{Start, any_robot, any_round_robot, any_start};
use ballbot_core::{ModelKind, Params, State, Wheels};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use proptest::prelude::*;

const SIM_DT: f64 = 1e-3;

/// Wheel i becomes wheel i − 1.
fn passed_on([a, b, c]: [f64; 3]) -> [f64; 3] {
    [b, c, a]
}

/// The same motion with the body frame turned to the next wheel.
fn renumbered(params: &Params, state: &State) -> State {
    let step = params.wheel_azimuths[1] - params.wheel_azimuths[0];
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), step);
    State {
        body_quaternion: state.body_quaternion * turn,
        body_angular_velocity: turn.inverse() * state.body_angular_velocity,
        wheel_angles: Wheels(passed_on(state.wheel_angles.0)),
        wheel_speeds: Wheels(passed_on(state.wheel_speeds.0)),
        ..state.clone()
    }
}

/// The state behind a mirror in the xz-plane.
fn mirrored(state: &State) -> State {
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

/// The mirror image of a robot, whose wheels drive in the opposite direction.
fn mirror_image(params: &Params) -> Params {
    Params { wheel_azimuths: params.wheel_azimuths.map(|azimuth| -azimuth), ..params.clone() }
}

/// How far the motion of the robot with its wheels renumbered is from its own, renumbered.
fn off_by_number(kind: ModelKind, params: &Params, start: &Start, drive: &Drive) -> f64 {
    let start = start.of(params);
    let robots = robot(kind, params, &start, SIM_DT).zip(robot(kind, params, &renumbered(params, &start), SIM_DT));
    let Some((mut one, mut other)) = robots else { return 0.0 };
    let torques = drive.torques(params);
    let passed: Vec<_> = torques.iter().map(|t| passed_on(*t)).collect();
    let expected = run_with_grip(&mut one, &torques, drive.hold);
    let found = run_with_grip(&mut other, &passed, drive.hold);
    most_apart(params, &expected, &found, |state| renumbered(params, state))
}

/// How far the motion of the mirror image is from the mirrored motion.
fn off_in_mirror(kind: ModelKind, run: Run, params: &Params, start: &Start, drive: &Drive) -> f64 {
    let (start, image) = (start.of(params), mirror_image(params));
    let robots = robot(kind, params, &start, SIM_DT).zip(robot(kind, &image, &mirrored(&start), SIM_DT));
    let Some((mut one, mut other)) = robots else { return 0.0 };
    let torques = drive.torques(params);
    let opposite: Vec<_> = torques.iter().map(|t| t.map(|t| -t)).collect();
    let expected = run(&mut one, &torques, drive.hold);
    most_apart(params, &expected, &run(&mut other, &opposite, drive.hold), mirrored)
}

proptest! {
    #![proptest_config(cases(60))]

    #[test]
    fn exact_models_are_invariant_under_wheel_permutation(
        params in any_round_robot(), start in any_start(0.3, 0.5), drive in any_drive(0.5, 4, 50),
    ) {
        // Dry friction that builds up within 0.05 rad/s is stiff and amplifies rounding.
        let params = Params { wheel_coulomb_friction: 0.0, ..params };
        for kind in [ModelKind::Planar, ModelKind::Spatial] {
            let off = off_by_number(kind, &params, &start, &drive);
            prop_assert!(off <= 1e-9, "{kind}: off by {off:e}");
        }
    }

    /// With slip and falls: the mirror turns every number's sign at most, and the order of wheels and rows stays.
    #[test]
    fn motion_is_invariant_under_reflection(
        params in any_robot(), start in any_start(0.3, 0.5), drive in any_drive(1.5, 4, 50),
    ) {
        for kind in [ModelKind::Planar, ModelKind::Spatial, ModelKind::Contact] {
            let off = off_in_mirror(kind, run, &params, &start, &drive);
            prop_assert!(off <= 1e-12, "{kind}: off by {off:e}");
        }
    }

    /// Rapier rounds differently where it rotates frames, which slip may amplify.
    #[test]
    fn rigid_is_invariant_under_reflection_without_slip(
        params in any_robot(), start in any_start(0.1, 0.2), drive in any_drive(0.1, 20, 10),
    ) {
        let off = off_in_mirror(ModelKind::Rigid, run_with_grip, &params, &start, &drive);
        prop_assert!(off <= 1e-8, "off by {off:e}");
    }
}

proptest! {
    #![proptest_config(same_cases(60))]

    /// Sweeps go from wheel to wheel and end before the residual vanishes; with slip, it may decide which wheel breaks
    /// loose first, so this holds only while wheels grip.
    #[test]
    fn contact_is_nearly_invariant_under_wheel_permutation(
        params in any_round_robot(), start in any_start(0.1, 0.2), drive in any_drive(0.1, 20, 10),
    ) {
        for (kind, limit) in [(ModelKind::Contact, 5e-3), (ModelKind::Rigid, 2e-2)] {
            let off = off_by_number(kind, &params, &start, &drive);
            prop_assert!(off <= limit, "{kind}: off by {off:e}");
        }
    }
}
