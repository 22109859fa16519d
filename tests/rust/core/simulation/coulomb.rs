//! Coulomb's law at the wheels of `rigid`, in every step, for any torques, and convergence under slip.

use super::{Motion, Simulation};
use ballbot_core::models::SpatialModel;
use ballbot_core::{Model, Params, State, Wheels, attitude};
use nalgebra::{Vector2, Vector3, Vector6};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Seconds between changes of torques.
const HOLD: f64 = 0.01;

/// Torques held for [`HOLD`] each.
fn switched(k: usize) -> [f64; 3] {
    let sign = if k.is_multiple_of(2) { 1.0 } else { -1.0 };
    [0.5 * sign, -0.3 * sign, 0.1 * sign]
}

fn random(seed: u64, largest: f64) -> impl FnMut(usize) -> [f64; 3] {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    move |_| std::array::from_fn(|_| rng.random_range(-largest..=largest))
}

/// Stribeck's friction coefficient of a wheel that slips by `slip` m/s.
fn friction(params: &Params, slip: f64) -> f64 {
    let (fixed, moving) = (params.wheel_static_friction, params.wheel_dynamic_friction);
    moving + (fixed - moving) * (-(slip / params.friction_critical_velocity).powi(2)).exp()
}

/// Largest |f| / (μ N) − 1 over all steps and wheels; and the fraction of steps with slip.
fn excess(robot: &mut dyn Model, mut torques: impl FnMut(usize) -> [f64; 3], seconds: f64) -> (f64, f64) {
    let params = robot.params().clone();
    let steps = (HOLD / robot.sim_dt()).round() as usize;
    let (mut worst, mut slipping) = (-1.0_f64, 0);
    let holds = (seconds / HOLD).round() as usize;
    for k in 0..holds {
        let torques = torques(k);
        for _ in 0..steps {
            let slips = robot.contacts().wheel_slip_speeds;
            robot.step(torques);
            let contacts = robot.contacts();
            assert!(robot.healthy());
            for (i, slip) in slips.into_iter().enumerate() {
                let (load, traction) = (contacts.wheel_normal_forces[i], contacts.wheel_tractions[i]);
                assert!(load >= 0.0, "wheel {i} pulls with {load} N at {} s", robot.time());
                let limit = friction(&params, slip) * load;
                worst = worst.max(traction.abs() / limit.max(1e-9) - 1.0);
            }
            slipping += usize::from(contacts.wheel_slip_speeds.iter().any(|slip| slip.abs() > 1e-3));
        }
    }
    (worst, slipping as f64 / (holds * steps) as f64)
}

#[test]
fn tractions_are_within_the_friction_of_the_load_of_the_same_step() {
    let params = Params::paper();
    for sim_dt in [2e-3, 1e-3, 5e-4] {
        let mut robot = Simulation::Rigid.robot(&params, sim_dt);
        let (worst, slipping) = excess(robot.as_mut(), switched, 1.0);
        println!("switched, {sim_dt} s: {worst:e} over the limit, slips in {slipping} of the steps");
        assert!(slipping > 0.3, "does not slip");
        assert!(worst <= 1e-2, "switched torques, {sim_dt} s: {worst:e} over the limit");
        for seed in 0..8 {
            let mut robot = Simulation::Rigid.robot(&params, sim_dt);
            // Into the fall and over the floor.
            let (worst, slipping) = excess(robot.as_mut(), random(seed, 1.0), 3.0);
            println!("random, seed {seed}, {sim_dt} s: {worst:e} over the limit, slips in {slipping}");
            assert!(slipping > 0.3, "does not slip");
            assert!(worst <= 1e-2, "random torques, seed {seed}, {sim_dt} s: {worst:e} over the limit");
        }
    }
}

/// Ball position and lean after the switched torques.
fn after_slips(params: &Params, sim_dt: f64, seconds: f64) -> [Vector3<f64>; 2] {
    let mut robot = Simulation::Rigid.robot(params, sim_dt);
    let (_, slipping) = excess(robot.as_mut(), switched, seconds);
    assert!(slipping > 0.3, "does not slip");
    let state = robot.state();
    [state.ball_position, state.body_quaternion * Vector3::z()].map(|v| v.xy().push(0.0))
}

#[test]
fn motion_under_slip_converges_to_first_order() {
    let paper = Params::paper();
    // Less grip, and a longer run: the paper's wheels, with more friction than load, jam and hop from 0.05 s on.
    let slippery = Params { wheel_static_friction: 0.6, wheel_dynamic_friction: 0.6, ..Params::paper() };
    for (params, seconds, limit) in [(paper, 0.05, 0.06), (slippery, 0.2, 0.012)] {
        let exact = after_slips(&params, 1e-3 / 64.0, seconds);
        for k in 0..5 {
            let share = 0.5_f64.powi(k);
            let found = after_slips(&params, 2e-3 * share, seconds);
            for (what, found, exact) in [("ball", found[0], exact[0]), ("lean", found[1], exact[1])] {
                let error = (found - exact).norm() / exact.norm();
                println!("{seconds} s, {} ms: {what} {error:e} off", 2.0 * share);
                assert!(error <= limit * share, "{what} after {seconds} s at {} ms: {error:e}", 2.0 * share);
            }
        }
    }
}

/// Loads, tractions and floor force of the first step agree with the closed form at the start.
#[test]
fn first_step_after_a_reset_carries_the_loads_of_the_spatial_model() {
    let params = Params::paper();
    let model = SpatialModel::new(&params, true, true);
    let static_load = params.static_wheel_load();
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let mut worst = 0.0_f64;
    let mut sampled = 0;
    for _ in 0..60 {
        let mut draw = |largest: f64| rng.random_range(-largest..largest);
        let body = attitude(Vector2::new(draw(0.12), draw(0.12)), draw(3.0));
        let (velocity, spin) = (Vector2::new(draw(0.3), draw(0.3)), draw(1.0));
        let rate = Vector3::new(draw(1.0), draw(1.0), draw(1.0));
        let torques = Vector3::new(draw(0.1), draw(0.1), draw(0.1));
        let nu = Vector6::new(velocity.x, velocity.y, rate.x, rate.y, rate.z, spin);
        let expected = model.contacts(&body, &nu, Wheels::of_column(torques));
        if expected.friction_utilization(&params).into_iter().any(|share| share > 0.9) {
            continue;
        }
        sampled += 1;
        let start = State::rolling(&params, velocity, spin, body, rate);
        for sim_dt in [2e-3, 1e-3, 1e-4] {
            let mut robot = Simulation::Rigid.robot(&params, sim_dt);
            robot.reset(&start).unwrap();
            robot.step(Wheels::of_column(torques));
            let found = robot.contacts();
            for i in 0..3 {
                for (f, e) in [
                    (found.wheel_normal_forces[i], expected.wheel_normal_forces[i]),
                    (found.wheel_tractions[i], expected.wheel_tractions[i]),
                ] {
                    worst = worst.max((f - e).abs() / static_load);
                }
            }
            let off = (found.floor_force - expected.floor_force).norm() / expected.floor_force.z;
            worst = worst.max(off);
            assert!(worst <= 1e-3, "{sim_dt} s: {found:?}, expected {expected:?}");
        }
    }
    println!("{sampled} starts: off by {worst:e} of the static load");
    assert!(sampled >= 30);
}

/// A robot at rest has its loads from the first step, and keeps them.
#[test]
fn loads_at_rest_do_not_settle() {
    let params = Params::paper();
    for sim_dt in [2e-3, 1e-3, 5e-4] {
        let mut robot = Simulation::Rigid.robot(&params, sim_dt);
        for step in 0..100 {
            robot.step([0.0; 3]);
            for load in robot.contacts().wheel_normal_forces {
                let off = load / params.static_wheel_load() - 1.0;
                assert!(off.abs() <= 1e-3, "{sim_dt} s, step {step}: {load} N, off by {off:e}");
            }
        }
    }
}
