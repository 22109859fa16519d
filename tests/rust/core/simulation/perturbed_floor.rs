//! A floor that moves, and on which friction differs from place to place, against closed forms.

use super::{Motion, Simulation, close, for_both, run};
use crate::support::largest;
use ballbot_core::models::SpatialMotion;
use ballbot_core::{Ballbot, Model, ModelKind, Params, State};
use nalgebra::{UnitQuaternion, Vector2, Vector3};
use std::f64::consts::{FRAC_PI_2, TAU};

/// The paper's robot on a solid ball, with one coefficient of floor friction.
fn solid(friction: f64) -> Params {
    let params = Params::paper();
    Params {
        ball_inertia: 0.4 * params.ball_mass * params.ball_radius.powi(2),
        floor_static_friction: friction,
        floor_dynamic_friction: friction,
        ..params
    }
}

/// The ball at x with the velocity v along x, without spin, and the bot far above it.
fn alone(params: &Params, x: f64, v: f64) -> State {
    let mut state = State::rolling(params, Vector2::zeros(), 0.0, UnitQuaternion::identity(), Vector3::zeros());
    state.ball_position.x = x;
    state.ball_velocity.x = v;
    state.body_position.z += 200.0;
    state
}

/// A floor that accelerates with a constant acceleration: the plateau of a long trapezoid.
fn tram(params: &Params, acceleration: [f64; 2]) -> Params {
    Params {
        floor_acceleration: acceleration,
        floor_acceleration_period: 1e9,
        floor_acceleration_phase: FRAC_PI_2,
        floor_acceleration_rise: 0.5,
        ..params.clone()
    }
}

fn every_model(params: &Params, sim_dt: f64) -> [(ModelKind, Ballbot); 3] {
    [ModelKind::Contact, ModelKind::Rigid, ModelKind::Spatial]
        .map(|kind| (kind, Ballbot::new(params, kind, sim_dt).unwrap()))
}

fn apart(a: &State, b: &State) -> f64 {
    a.to_array().iter().zip(b.to_array()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// With x'' = -μ g (1 + c x) the place 1/c + x is a harmonic or hyperbolic function of time.
fn a_ball_slides_on_a_gradient_as_in_closed_form(simulation: Simulation) {
    let (friction, speed, time) = (0.3, 3.0, 0.2);
    for gradient in [0.5, -0.5] {
        let params = Params { floor_friction_gradient: [gradient, 0.0], ..solid(friction) };
        let rate = (friction * params.gravity * gradient.abs()).sqrt();
        let (sin, cos, slope) = if gradient > 0.0 {
            ((rate * time).sin(), (rate * time).cos(), -1.0)
        } else {
            ((rate * time).sinh(), (rate * time).cosh(), 1.0)
        };
        let place = (cos - 1.0) / gradient + speed / rate * sin;
        let expected = [place, slope * rate / gradient * sin + speed * cos];
        let off = |sim_dt: f64| {
            let mut robot = simulation.robot(&params, sim_dt);
            robot.reset(&alone(&params, 0.0, speed)).unwrap();
            run(robot.as_mut(), [0.0; 3], (time / sim_dt).round() as usize);
            let state = robot.state();
            assert!(robot.contacts().floor_slip_velocity.x > 0.1, "it still slides");
            [state.ball_position.x - expected[0], state.ball_velocity.x - expected[1]]
        };
        let (coarse, fine) = (off(1e-3), off(2.5e-4));
        for (what, (coarse, fine)) in ["place", "speed"].into_iter().zip(coarse.into_iter().zip(fine)) {
            println!("gradient {gradient}: {what} off by {coarse:e}, in a quarter of the step by {fine:e}");
            assert!(fine.abs() <= 0.3 * coarse.abs() + simulation.pick(1e-6, 1e-9) && coarse.abs() < 2e-3, "{what}");
        }
        // Without the gradient it is elsewhere by far more.
        assert!((place - (speed * time - 0.5 * friction * params.gravity * time * time)).abs() > 5e-3);
    }
}

/// Patches, the first of which grips and the next of which along x is slippery.
fn slippery_beyond_half_a_meter(friction: f64) -> Params {
    let patches = |seed: u32| Params {
        floor_patch_size: 1.0,
        floor_patch_friction: [0.0, 1.0],
        floor_patch_seed: f64::from(seed),
        ..solid(friction)
    };
    let found = (0..10_000)
        .map(patches)
        .find(|params| params.floor_friction_factor(0.0, 0.0) > 0.9 && params.floor_friction_factor(1.0, 0.0) < 0.05);
    found.expect("some seed has such patches")
}

/// Relative to a floor that accelerates with -a a ball rolls with a / (1 + γ) while its friction suffices, and slides with
/// a - μ g where it does not.
fn a_ball_slips_only_beyond_the_border_of_a_patch(simulation: Simulation) {
    let acceleration = 2.0;
    let params = tram(&slippery_beyond_half_a_meter(0.5), [-acceleration, 0.0]);
    let slippery = 0.5 * params.floor_friction_factor(1.0, 0.0);
    assert!(slippery * params.gravity < acceleration * 2.0 / 7.0);
    let mut robot = simulation.robot(&params, 1e-3);
    robot.reset(&alone(&params, 0.0, 0.0)).unwrap();
    robot.step([0.0; 3]);
    let (mut before, mut border, mut end) = (robot.state(), None, 0.0);
    let first = before.ball_velocity.x;
    for k in 1..1200 {
        robot.step([0.0; 3]);
        let (state, slip) = (robot.state(), robot.contacts().floor_slip_velocity.norm());
        if before.ball_position.x < 0.5 {
            assert!(slip < simulation.pick(1e-4, 1e-12), "slip {slip} at {}", before.ball_position.x);
            border = Some((k, state.ball_velocity.x));
        } else if before.ball_position.x < 1.5 {
            assert!(slip > 0.0);
            end = state.ball_velocity.x;
            let (k0, at) = border.unwrap();
            let gained = (end - at) / (f64::from(k - k0) * 1e-3);
            assert!(
                (gained - (acceleration - slippery * params.gravity)).abs() < simulation.pick(1e-3, 1e-9),
                "{gained}"
            );
        }
        before = state;
    }
    let (k, at) = border.unwrap();
    let gained = (at - first) / (f64::from(k) * 1e-3);
    close("acceleration where it rolls", gained, acceleration / 1.4, simulation.pick(1e-4, 1e-10));
    assert!(end > at, "it reached the slippery patch");
}

/// γ = J / (m r²): the speed relative to a floor with the acceleration A sin(2π t / T) is -A T / (2π (1 + γ)) (1 - cos).
fn a_ball_rolls_on_an_accelerating_floor_as_in_closed_form(simulation: Simulation) {
    let (amplitude, period) = (1.5, 0.8);
    let sine = Params { floor_acceleration: [amplitude, -0.5], floor_acceleration_period: period, ..solid(1.0) };
    // From 0 to A in 0.1 s, for 0.2 s at A, and down to 0 in 0.1 s.
    let trapezoid = Params { floor_acceleration_rise: 0.5, ..sine };
    for (params, gained) in [
        (&sine, amplitude * period / TAU * (1.0 - (TAU * 0.3 / period).cos())),
        (&trapezoid, amplitude * (0.5 * 0.1 + 0.2)),
    ] {
        let mut robot = simulation.robot(params, 1e-3);
        robot.reset(&alone(params, 0.0, 0.0)).unwrap();
        run(robot.as_mut(), [0.0; 3], 300);
        let state = robot.state();
        close("speed", state.ball_velocity.x, -gained / 1.4, simulation.pick(2e-4, 5e-6));
        close("across", state.ball_velocity.y, 0.5 / amplitude * gained / 1.4, simulation.pick(2e-4, 5e-6));
        assert!(robot.contacts().floor_slip_velocity.norm() < simulation.pick(1e-4, 1e-12));
    }
}

#[test]
fn a_constant_acceleration_is_a_slope_with_more_gravity() {
    let (paper, acceleration) = (Params::paper(), 1.2);
    let accelerated = tram(&paper, [-acceleration, 0.0]);
    let slope = Params {
        floor_tilt: [0.0, (acceleration / paper.gravity).atan()],
        gravity: paper.gravity.hypot(acceleration),
        ..paper
    };
    for (model, robots) in every_model(&accelerated, 1e-3)
        .into_iter()
        .zip(every_model(&slope, 1e-3))
        .map(|((kind, accelerated), (_, slope))| (kind, [accelerated, slope]))
    {
        let [a, b] = robots.map(|mut robot| {
            robot.reset(&State::tilted(&paper, Vector2::new(0.05, -0.1), 0.3)).unwrap();
            robot.step([0.1, -0.05, 0.02], 300).unwrap();
            (robot.state(), robot.contacts())
        });
        let off = apart(&a.0, &b.0);
        println!("{model}: {off:e}");
        assert!(off < if model == ModelKind::Rigid { 1e-7 } else { 1e-10 }, "{model}: {off:e}");
        let loads = (a.1.floor_force - b.1.floor_force).amax();
        assert!(loads < if model == ModelKind::Rigid { 1e-4 } else { 1e-7 }, "{model}: {loads:e}");
    }
}

#[test]
fn at_its_amplitude_a_slow_tilt_is_a_slope() {
    let paper = Params::paper();
    let turning = Params {
        floor_tilt: [0.02, 0.0],
        floor_tilt_amplitude: [0.05, -0.1],
        floor_tilt_period: 1e9,
        floor_tilt_phases: [FRAC_PI_2; 2],
        ..paper
    };
    let slope = Params { floor_tilt: [0.07, -0.1], ..paper };
    assert!((turning.gravity_at(0.3) - slope.gravity_vector()).amax() < 1e-11);
    for ((kind, mut a), (_, mut b)) in every_model(&turning, 1e-3).into_iter().zip(every_model(&slope, 1e-3)) {
        for robot in [&mut a, &mut b] {
            robot.reset(&State::tilted(&paper, Vector2::new(0.05, -0.1), 0.3)).unwrap();
            robot.step([0.1, -0.05, 0.02], 300).unwrap();
        }
        let off = apart(&a.state(), &b.state());
        println!("{kind}: {off:e}");
        assert!(off < if kind == ModelKind::Rigid { 1e-7 } else { 1e-10 }, "{kind}: {off:e}");
    }
}

/// Floors of a ship and of a tram at once.
fn moving() -> Params {
    Params {
        floor_tilt_amplitude: [0.08, 0.05],
        floor_tilt_period: 2.0,
        floor_tilt_phases: [0.3, 1.2],
        floor_acceleration: [0.8, -0.4],
        floor_acceleration_period: 0.5,
        floor_acceleration_phase: 0.4,
        ..Params::paper()
    }
}

fn robots_on_a_moving_floor_converge_to_the_spatial_model(simulation: Simulation) {
    let params = moving();
    let start = State::tilted(&params, Vector2::new(0.02, -0.03), 0.4);
    let after = |robot: &mut dyn Model, sim_dt: f64| {
        robot.reset(&start).unwrap();
        run(robot, [0.05, -0.1, 0.02], (0.3 / sim_dt).round() as usize);
        robot.state()
    };
    let exact = after(&mut SpatialMotion::new(&params, 1e-4), 1e-4);
    let off = |sim_dt: f64| apart(&after(simulation.robot(&params, sim_dt).as_mut(), sim_dt), &exact);
    let (coarse, fine) = (off(1e-3), off(2.5e-4));
    println!("off by {coarse:e}, in a quarter of the step by {fine:e}");
    assert!(fine < 0.35 * coarse && fine < 5e-3);
    let still = after(&mut SpatialMotion::new(&Params::paper(), 1e-4), 1e-4);
    assert!(apart(&still, &exact) > 0.05, "the floor matters");
}

for_both!(
    a_ball_slides_on_a_gradient_as_in_closed_form,
    a_ball_slips_only_beyond_the_border_of_a_patch,
    a_ball_rolls_on_an_accelerating_floor_as_in_closed_form,
    robots_on_a_moving_floor_converge_to_the_spatial_model,
);

/// In the model without slip the error of a step is of second order.
#[test]
fn gravity_of_a_step_is_of_second_order() {
    let params = moving();
    let start = State::tilted(&params, Vector2::new(0.02, -0.03), 0.4);
    let after = |sim_dt: f64| {
        let mut robot = SpatialMotion::new(&params, sim_dt);
        robot.reset(&start).unwrap();
        run(&mut robot, [0.05, -0.1, 0.02], (0.32 / sim_dt).round() as usize);
        robot.state()
    };
    let exact = after(1e-4);
    let (coarse, fine) = (apart(&after(8e-3), &exact), apart(&after(4e-3), &exact));
    println!("{coarse:e}, {fine:e}");
    assert!((3.3..5.0).contains(&(coarse / fine)));
}

#[test]
fn snapshots_restore_the_time_and_place_of_a_floor() {
    let params = Params { floor_patch_size: 0.05, floor_patch_friction: [0.0, 1.0], ..moving() };
    for kind in [ModelKind::Contact, ModelKind::Rigid, ModelKind::Spatial] {
        let params = if kind == ModelKind::Spatial { params.on_still_floor() } else { params.clone() };
        let params = Params { floor_acceleration: [0.8, -0.4], ..params };
        let new = || Ballbot::new(&params, kind, 1e-3).unwrap();
        let mut robot = new();
        robot.step([0.1, 0.0, -0.1], 150).unwrap();
        let saved = robot.save();
        robot.step([0.0, 0.1, 0.0], 100).unwrap();
        let mut other = new();
        other.load(&saved).unwrap();
        other.step([0.0, 0.1, 0.0], 100).unwrap();
        assert_eq!(robot.state(), other.state(), "{kind}");
        assert_eq!(robot.contacts(), other.contacts(), "{kind}");
        robot.reset(&State::upright(&params)).unwrap();
        robot.step([0.1, 0.0, -0.1], 150).unwrap();
        let mut fresh = new();
        fresh.step([0.1, 0.0, -0.1], 150).unwrap();
        assert_eq!(robot.state(), fresh.state(), "{kind}");
    }
}

/// Where nothing grips, a robot falls on its side, finite, and its ball keeps its place above the common center of mass.
#[test]
fn a_floor_without_friction_moves_no_center_of_mass() {
    let params = Params { floor_patch_size: 1e3, floor_patch_friction: [0.0; 2], ..Params::paper() };
    assert_eq!(params.floor_friction_factor(-3.0, 7.0), 0.0);
    for kind in [ModelKind::Contact, ModelKind::Rigid] {
        let mut robot = Ballbot::new(&params, kind, 1e-3).unwrap();
        robot.reset(&State::tilted(&params, Vector2::new(0.1, 0.05), 0.2)).unwrap();
        let center = |state: &State| {
            let body = state.body_position + state.body_quaternion * params.body_com();
            (body * params.body_mass + state.ball_position * params.ball_mass).xy()
                / (params.body_mass + params.ball_mass)
        };
        let first = center(&robot.state());
        robot.step([0.2, -0.1, 0.0], 300).unwrap();
        let moved = (center(&robot.state()) - first).norm();
        assert!(moved < if kind == ModelKind::Rigid { 1e-4 } else { 1e-10 }, "{kind}: {moved}");
        robot.step([0.2, -0.1, 0.0], 2000).unwrap();
        assert!(robot.bot_on_floor() && robot.diverged().is_none(), "{kind}");
    }
}

#[test]
fn perturbed_floors_reject_what_has_no_meaning() {
    let paper = Params::paper();
    let message = |params: Params| params.validate().unwrap_err().to_string();
    let fast = Params { floor_tilt_amplitude: [0.1, 0.0], floor_tilt_period: 0.5, ..paper };
    assert!(message(fast).contains("the models neglect this acceleration"));
    let steep = Params { floor_tilt: [0.3, 0.0], floor_tilt_amplitude: [-0.3, 0.0], ..paper };
    assert!(message(steep).contains("|floor_tilt| + |floor_tilt_amplitude|"));
    assert!(message(Params { floor_patch_friction: [1.0, 0.5], ..paper }).contains("floor_patch_friction[0]"));
    assert!(message(Params { floor_patch_seed: -1.0, ..paper }).contains("floor_patch_seed = -1"));
    assert!(message(Params { floor_patch_size: 1e-9, ..paper }).contains("floor_patch_size"));
    assert!(message(Params { floor_friction_gradient: [f64::NAN, 0.0], ..paper }).contains("gradient"));
    let refused = |params: &Params, kind| Ballbot::new(params, kind, 1e-3).err().expect("rejected").to_string();
    let sloped = Params { floor_friction_gradient: [0.1, 0.0], ..paper };
    let patched = Params { floor_patch_size: 0.5, floor_patch_friction: [0.5, 1.0], ..paper };
    for kind in [ModelKind::Planar, ModelKind::Spatial] {
        assert!(refused(&sloped, kind).contains("roll without slip"), "{kind}");
        assert!(refused(&patched, kind).contains("roll without slip"), "{kind}");
    }
    assert!(refused(&moving(), ModelKind::Planar).contains("level floor"));
    let jacobian = |params: &Params, kind| {
        let robot = Ballbot::new(params, kind, 1e-3).unwrap();
        robot.jacobian([0.0; 3], 1, &[]).expect_err("rejected").to_string()
    };
    assert!(jacobian(&moving(), ModelKind::Contact).contains("derivatives of motions"));
    assert!(jacobian(&moving(), ModelKind::Spatial).contains("derivatives of motions"));
    assert!(jacobian(&patched, ModelKind::Contact).contains("floor_patch_size = 0.5 m"));
}

/// Patches are equally likely to have any factor, and two seeds have different ones.
#[test]
fn patches_are_uniform_and_seeded() {
    let params = |seed| Params {
        floor_patch_size: 0.5,
        floor_patch_friction: [0.2, 0.8],
        floor_patch_seed: seed,
        ..Params::paper()
    };
    let factors = |params: &Params| -> Vec<f64> {
        (-20..20)
            .flat_map(|i| (-20..20).map(move |j| (i, j)))
            .map(|(i, j)| params.floor_friction_factor(0.5 * f64::from(i) + 0.1, 0.5 * f64::from(j) + 0.4))
            .collect()
    };
    let (first, again, other) = (factors(&params(3.0)), factors(&params(3.0)), factors(&params(4.0)));
    assert_eq!(first, again);
    assert!(first.iter().all(|factor| (0.2..=0.8).contains(factor)));
    let n = first.len() as f64;
    let mean = first.iter().sum::<f64>() / n;
    let variance = first.iter().map(|factor| (factor - mean).powi(2)).sum::<f64>() / n;
    close("mean", mean, 0.5, 5.0 * 0.6 / (12.0 * n).sqrt());
    close("variance", variance, 0.03, 0.003);
    let same = first.iter().zip(&other).filter(|(a, b)| a == b).count();
    assert_eq!(same, 0);
    // One factor within a patch, also at the other end of the world.
    let far = params(3.0);
    assert_eq!(far.floor_friction_factor(1e5 + 0.1, -0.2), far.floor_friction_factor(1e5 - 0.2, 0.1));
    assert!(largest(first.iter().copied()) <= 0.8);
}
