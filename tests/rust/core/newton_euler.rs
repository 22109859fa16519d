//! The spatial model against a second derivation that shares nothing with it: Newton's and Euler's equations of five
//! rigid bodies, held together by constraints whose forces are unknowns.
//!
//! Bodies are the ball, the body link (without wheels) and three wheels with a mass, an inertia about their axle and an
//! inertia across it. Each has its own velocity v of its CoM and angular velocity ω, in the inertial frame: 30
//! accelerations. Every constraint is a condition on velocities, J v = 0, with one multiplier, the force it takes:
//!
//! | rows | condition | multiplier |
//! |---|---|---|
//! | floor, 3 | v_k + ω_k × (−r_k e3) = 0 | force of the floor on the ball |
//! | pin, 0 or 1 | e3 · ω_k = 0 | torque that keeps the ball from spinning about the vertical |
//! | hinges, 3 × 3 | v_w − v_b − ω_b × r = 0, r from the body link's CoM to the wheel's | force at the bearing |
//! | hinges, 3 × 2 | t · (ω_w − ω_b) = 0 for two t across the axle | torque of the bearing |
//! | normals, 3 | p · (v_w − v_k) = 0, p from the ball's center to the wheel's | load N of the wheel |
//! | drives, 3 | d · (v_w − r_w ω_w × p − v_k − r_k ω_k × p) = 0, surface against surface | −f, f the traction on the ball |
//!
//! Here d is along the axis of the roller that touches the ball: the direction of the rim, turned about p by the angle of the
//! rollers. Nothing holds wheel and ball together across d: there the rollers turn. Since p, d, r and t turn
//! with the body, the derivative of a condition is J v' + J' v, and with the momenta
//!
//! ```text
//! [ M  −Jᵀ ] [ v' ]   [ forces, and torques less ω × I ω ]
//! [ J    0 ] [ λ  ] = [ −J' v                            ]
//! ```
//!
//! is one dense system. The paper counts a wheel's energy by its spin relative to the body. That is a wheel without inertia
//! about its axle whose inertia sits in the motor instead, as an armature: a torque −J_w ψ̈ at the joint.
//!
//! How wheels share mass and transverse inertia with the body link must not matter: [`Params`] describes them together.

mod bodies;

use crate::support::general::{any_general_robot, crooked, inclined};
use crate::support::{Start, any_floor_tilt, any_or_published_robot, any_start, torques, vector, without_losses};
use ballbot_core::models::SpatialModel;
use ballbot_core::{Params, Wheels};
use bodies::Robot;
use nalgebra::{Vector3, Vector6};
use proptest::prelude::*;

/// Largest difference from the spatial model, of the largest number of its kind.
const LIMIT: f64 = 1e-11;
/// The same for robots without symmetry; some have a wheel that carries a thousandth of the weight.
const GENERAL_LIMIT: f64 = 1e-10;

/// Largest difference relative to `scale`.
fn off(found: &[f64], expected: &[f64], scale: f64) -> f64 {
    crate::support::largest(found.iter().zip(expected).map(|(f, e)| (f - e).abs())) / scale
}

fn largest(values: &[f64]) -> f64 {
    crate::support::largest(values.iter().map(|v| v.abs()))
}

/// Largest differences between the two derivations: accelerations of the ball, of turning, loads, tractions, floor.
fn compare(
    params: &Params,
    start: &Start,
    motors: &[f64; 3],
    transverse: f64,
    pinned: bool,
    absolute_wheel_spin: bool,
) -> [f64; 5] {
    let start = if pinned { Start { spin: 0.0, ..start.clone() } } else { start.clone() };
    let state = start.of(params);
    let q = state.body_quaternion;
    let found = Robot::new(params, &state, transverse, pinned, absolute_wheel_spin).solve(&q, motors);

    let model = SpatialModel::new(params, absolute_wheel_spin, !pinned);
    let (v, rate) = (state.ball_velocity, state.body_angular_velocity);
    let velocity = Vector6::new(v.x, v.y, rate.x, rate.y, rate.z, state.ball_angular_velocity.z);
    let expected = model.accelerations(&q, &velocity, Wheels::of_column(Vector3::from(*motors)));
    let contacts = model.contacts(&q, &velocity, Wheels::of_column(Vector3::from(*motors)));
    let turning = &expected.as_slice()[2..];
    // Linear and angular accelerations are scaled by the robot's size, forces by the largest force.
    let acceleration = largest(&expected.as_slice()[..2]).max(largest(turning) * params.ball_radius);
    let force = largest(contacts.floor_force.as_slice()).max(largest(contacts.wheel_normal_forces.as_slice()));
    [
        off(&found.ball, &expected.as_slice()[..2], acceleration),
        off(&found.turning, turning, acceleration / params.ball_radius),
        off(&found.loads, contacts.wheel_normal_forces.as_slice(), force),
        off(&found.tractions, contacts.wheel_tractions.as_slice(), force),
        off(&found.floor, contacts.floor_force.as_slice(), force),
    ]
}

const NAMES: [&str; 5] = ["ball acceleration", "angular accelerations", "wheel loads", "tractions", "floor force"];

proptest! {
    #![proptest_config(ProptestConfig { cases: 1000, failure_persistence: None, ..ProptestConfig::default() })]

    /// Four models of each robot.
    #[test]
    fn five_rigid_bodies_and_their_constraints_move_like_the_spatial_model(
        params in any_or_published_robot(),
        start in any_start(1.5, 3.0),
        shares in vector(1.0),
        transverse in 0.0..1.0,
    ) {
        compare_all(&params, &start, &shares, transverse, LIMIT)?;
    }

    #[test]
    fn robots_without_symmetry_move_like_the_spatial_model(
        params in any_general_robot(),
        start in any_start(1.5, 3.0),
        shares in vector(1.0),
        transverse in 0.0..1.0,
    ) {
        compare_all(&params, &start, &shares, transverse, GENERAL_LIMIT)?;
    }

    #[test]
    fn robots_on_inclined_rollers_move_like_the_spatial_model(
        params in inclined(any_general_robot()),
        start in any_start(1.5, 3.0),
        shares in vector(1.0),
        transverse in 0.0..1.0,
    ) {
        compare_all(&params, &start, &shares, transverse, GENERAL_LIMIT)?;
    }

    #[test]
    fn robots_on_a_slope_move_like_the_spatial_model(
        params in any_general_robot(),
        floor_tilt in any_floor_tilt(0.5),
        start in any_start(1.5, 3.0),
        shares in vector(1.0),
        transverse in 0.0..1.0,
    ) {
        compare_all(&Params { floor_tilt, ..params }, &start, &shares, transverse, GENERAL_LIMIT)?;
    }
}

/// All four models of a robot.
fn compare_all(
    params: &Params,
    start: &Start,
    shares: &Vector3<f64>,
    transverse: f64,
    limit: f64,
) -> Result<(), TestCaseError> {
    // How dry friction builds up is a modeling choice, not mechanics.
    let params = Params { wheel_coulomb_friction: 0.0, ..params.clone() };
    let motors = torques(&params, shares);
    for (pinned, absolute) in [(false, true), (true, true), (false, false), (true, false)] {
        let off = compare(&params, start, &motors, transverse, pinned, absolute);
        for (name, off) in NAMES.iter().zip(off) {
            prop_assert!(off <= limit, "{name} off by {off:e}, spin pinned {pinned}, absolute {absolute}");
        }
    }
    Ok(())
}

/// The comparison is sensitive: each of these is a term that a derivation may lose.
#[test]
fn missing_terms_are_detected() {
    let params = Params {
        ball_viscous_friction: 1.0,
        wheel_viscous_friction: 1e-3,
        floor_tilt: [0.1, -0.2],
        roller_angle: 0.4,
        ..crooked()
    };
    let symmetric = Params::paper();
    let start = Start {
        tilt: [0.3, -0.2].into(),
        yaw: 0.7,
        velocity: [0.5, -0.3].into(),
        spin: 0.4,
        rate: Vector3::new(0.8, -0.5, 0.6),
    };
    let state = start.of(&params);
    let solve = |robot: &Robot| robot.solve(&state.body_quaternion, &[0.1, -0.05, 0.02]);
    let right = Robot::new(&params, &state, 0.5, false, true);
    let exact = solve(&right);
    let lighter = Params { wheel_inertia: 1e-9, ..params };
    let centered = Params { body_com_offset: symmetric.body_com_offset, ..params };
    let principal = Params { body_products_of_inertia: symmetric.body_products_of_inertia, ..params };
    let even = Params { wheel_azimuths: symmetric.wheel_azimuths, ..params };
    let level = Params { wheel_zenith_offsets: symmetric.wheel_zenith_offsets, ..params };
    let straight = Params { roller_angle: 0.0, ..params };
    for (name, robot) in [
        ("drag and joint friction", Robot::new(&without_losses(&params), &state, 0.5, false, true)),
        ("the wheels' absolute spin", Robot::new(&params, &state, 0.5, false, false)),
        ("the wheels' inertia", Robot::new(&lighter, &state, 0.5, false, true)),
        ("the CoM's offset", Robot::new(&centered, &state, 0.5, false, true)),
        ("the products of inertia", Robot::new(&principal, &state, 0.5, false, true)),
        ("the wheels' azimuths", Robot::new(&even, &state, 0.5, false, true)),
        ("the angle of the rollers", Robot::new(&straight, &state, 0.5, false, true)),
        ("the wheels' zeniths", Robot::new(&level, &state, 0.5, false, true)),
        ("the tilt of the floor", Robot::new(&params.on_level_floor(), &state, 0.5, false, true)),
    ] {
        let off = off(&solve(&robot).turning, &exact.turning, largest(&exact.turning));
        println!("without {name}: {off:e}");
        assert!(off > 1e-4, "without {name} nothing changes: {off:e}");
    }
    // And what should not matter does not.
    let other = Robot::new(&params, &state, 0.0, false, true);
    assert!(off(&solve(&other).turning, &exact.turning, largest(&exact.turning)) < 1e-12);
}
