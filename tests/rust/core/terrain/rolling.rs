//! A single ball on the ground, in both models with contacts, against mechanics.

use super::{ball, inertia_ratio, rough, step};
use ballbot_core::terrain::Terrain;
use ballbot_core::{Ballbot, ModelKind, Params};
use std::f64::consts::PI;
use std::sync::Arc;

const MODELS: [ModelKind; 2] = [ModelKind::Contact, ModelKind::Rigid];

/// Speed of the ball's center.
fn speed(robot: &Ballbot) -> f64 {
    robot.state().ball_velocity.norm()
}

fn within(found: f64, expected: f64, tolerance: f64, what: &str) {
    assert!((found - expected).abs() <= tolerance, "{what}: {found}, expected {expected} within {tolerance}");
}

#[test]
fn a_ball_rolls_down_an_incline_and_slides_down_a_slippery_one() {
    let (slope, direction, time) = (0.3_f64, 0.8_f64, 0.5);
    let terrain = Arc::new(Terrain::plane(slope, direction).unwrap());
    for kind in MODELS {
        let params = rough();
        let mut robot = ball(kind, &params, &terrain, 1e-3, [0.3, -0.2], [0.0; 2]);
        step(&mut robot, 500);
        let expected = params.gravity * slope.sin() / (1.0 + inertia_ratio(&params)) * time;
        within(speed(&robot), expected, 1e-9, &format!("{kind}: rolling"));
        let state = robot.state();
        // Straight down the slope.
        within(state.ball_velocity.y.atan2(state.ball_velocity.x), direction - PI, 1e-9, "direction");

        let slip = 0.05;
        let params = Params { floor_static_friction: slip, floor_dynamic_friction: slip, ..Params::paper() };
        let mut robot = ball(kind, &params, &terrain, 1e-3, [0.3, -0.2], [0.0; 2]);
        step(&mut robot, 500);
        let expected = params.gravity * (slope.sin() - slip * slope.cos()) * time;
        within(speed(&robot), expected, 2e-3 * expected, &format!("{kind}: sliding"));
        let spin = slip * params.gravity * slope.cos() / (inertia_ratio(&params) * params.ball_radius) * time;
        within(robot.state().ball_angular_velocity.norm(), spin, 2e-3 * spin, &format!("{kind}: spin"));
        let slipping = expected - spin * params.ball_radius;
        let found = robot.contacts().floor_slip_velocity.norm();
        within(found, slipping * slope.cos(), 2e-2 * slipping, &format!("{kind}: slip along the slope, from above"));
    }
}

/// Period of an oscillation along x from rest, s, from the time of the second passage through the origin.
fn period(robot: &mut Ballbot, dt: f64) -> f64 {
    let mut passages = Vec::new();
    let mut before = robot.state().ball_position.x;
    for k in 1..20_000 {
        let x = step(robot, 1).ball_position.x;
        if before.signum() != x.signum() {
            passages.push((f64::from(k) - x / (x - before)) * dt);
            if passages.len() == 3 {
                return passages[2] - passages[0];
            }
        }
        before = x;
    }
    panic!("the ball does not oscillate")
}

#[test]
fn a_ball_oscillates_in_a_bowl() {
    let radius = 1.0_f64;
    let bowl = |x: f64, y: f64| radius - (radius * radius - x * x - y * y).sqrt();
    let terrain = Arc::new(Terrain::from_function(bowl, [1.0, 1.0], 0.01).unwrap());
    let params = rough();
    let expected = 2.0 * PI * ((radius - params.ball_radius) * (1.0 + inertia_ratio(&params)) / params.gravity).sqrt();
    for kind in MODELS {
        let mut robot = ball(kind, &params, &terrain, 1e-3, [0.02, 0.0], [0.0; 2]);
        within(period(&mut robot, 1e-3), expected, 2e-3 * expected, &format!("{kind}: period"));
    }
}

/// The ground under a ball whose center moves on the cycloid x = a (θ + sin θ), z = a (1 - cos θ).
fn below_cycloid(a: f64, r: f64, x: f64) -> f64 {
    let place = |t: f64| a * (t + t.sin()) + r * (0.5 * t).sin();
    let (mut low, mut high) = (-PI, PI);
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if place(middle) < x { low = middle } else { high = middle }
    }
    a * (1.0 - low.cos()) - r * (0.5 * low).cos() + r
}

#[test]
fn a_cycloid_valley_has_one_period() {
    let (a, params) = (0.3, rough());
    let r = params.ball_radius;
    let terrain = Arc::new(Terrain::from_function(|x, _| below_cycloid(a, r, x), [1.7, 0.5], 0.01).unwrap());
    let expected = 4.0 * PI * (a * (1.0 + inertia_ratio(&params)) / params.gravity).sqrt();
    for kind in MODELS {
        for amplitude in [0.1_f64, 0.4, 0.65] {
            let mut robot = ball(kind, &params, &terrain, 1e-3, [amplitude, 0.0], [0.0; 2]);
            within(period(&mut robot, 1e-3), expected, 2e-3 * expected, &format!("{kind}: from {amplitude} m"));
        }
    }
}

#[test]
fn a_ball_loses_height_energy_on_a_bump_and_has_it_again_behind() {
    let bump = |x: f64, _: f64| 0.03 * (1.0 - (x / 0.5).powi(2)).max(0.0).powi(3);
    let terrain = Arc::new(Terrain::from_function(bump, [4.0, 0.5], 0.01).unwrap());
    let params = rough();
    for kind in MODELS {
        let mut robot = ball(kind, &params, &terrain, 1e-3, [-1.0, 0.0], [1.0, 0.0]);
        let mut slowest = f64::INFINITY;
        while robot.state().ball_position.x < 1.0 {
            step(&mut robot, 1);
            slowest = slowest.min(speed(&robot));
        }
        let on_top = (1.0 - 2.0 * params.gravity * 0.03 / (1.0 + inertia_ratio(&params))).sqrt();
        within(slowest, on_top, 2e-3, &format!("{kind}: on top"));
        within(speed(&robot), 1.0, 1e-4, &format!("{kind}: behind"));
    }
}

#[test]
fn a_ball_leaves_a_cylinder_where_it_should() {
    let (radius, edge) = (0.5_f64, 1.03_f64);
    // A cylinder that continues as a plane where it is steeper than needed.
    let dome = |x: f64, _: f64| {
        let beyond = (x.abs() - radius * edge.sin()).max(0.0);
        (radius * radius - (x.abs() - beyond).powi(2)).sqrt() - radius - beyond * edge.tan()
    };
    let terrain = Arc::new(Terrain::from_function(dome, [1.2, 0.05], 0.0025).unwrap());
    let params = Params { floor_static_friction: 1000.0, floor_dynamic_friction: 1000.0, ..Params::paper() };
    let start = 0.1_f64;
    let expected = (2.0 * start.cos() / (3.0 + inertia_ratio(&params))).acos().to_degrees();
    for kind in MODELS {
        let mut errors = Vec::new();
        for dt in [1e-3, 0.5e-3] {
            let place = (radius + params.ball_radius) * start.sin();
            let mut robot = ball(kind, &params, &terrain, dt, [place, 0.0], [0.0; 2]);
            step(&mut robot, 5);
            while robot.contacts().floor_force.norm() > 0.0 {
                step(&mut robot, 1);
            }
            let x = robot.state().ball_position.x;
            errors.push((x / (radius + params.ball_radius)).asin().to_degrees() - expected);
        }
        assert!(errors[0].abs() < 0.4 && errors[1].abs() < 0.2, "{kind}: {errors:?} deg from {expected}");
    }
}

#[test]
fn a_ball_lifts_off_a_crest_above_its_critical_speed_only() {
    let (amplitude, length) = (0.03, 0.86);
    let crest = |x: f64, _: f64| amplitude * (2.0 * PI * x / length).cos();
    let terrain = Arc::new(Terrain::from_function(crest, [2.0, 0.5], 0.01).unwrap());
    let params = rough();
    let curvature = terrain.curvature()[1];
    let of_centers = curvature / (1.0 + curvature * params.ball_radius);
    let critical = (params.gravity / of_centers).sqrt();
    for kind in MODELS {
        for (share, holds) in [(0.9, true), (1.1, false)] {
            let dt = 0.25e-3;
            let mut robot = ball(kind, &params, &terrain, dt, [0.0, 0.0], [share * critical, 0.0]);
            step(&mut robot, 3);
            let pressed = (0..40).filter(|_| {
                step(&mut robot, 1);
                robot.contacts().floor_force.norm() > 0.0
            });
            let pressed = pressed.count();
            assert!(if holds { pressed > 10 } else { pressed == 0 }, "{kind} at {share}: {pressed} of 40 steps");
        }
    }
}

/// Wrong friction frames, wrong spin axes and tangents along fixed axes pass on planes and fail here.
#[test]
fn a_ball_in_a_gutter_turns_back() {
    let radius = 0.5_f64;
    let gutter = |x: f64, _: f64| radius - (radius * radius - x * x).sqrt();
    let terrain = Arc::new(Terrain::from_function(gutter, [0.82, 4.0], 0.005).unwrap());
    let params = rough();
    let ratio = inertia_ratio(&params);
    let (around, along) = (1.05, 0.3);
    for kind in MODELS {
        let mut errors = Vec::new();
        for dt in [1e-3, 0.5e-3] {
            let mut robot = ball(kind, &params, &terrain, dt, [0.0, 0.0], [around, along]);
            let (mut worst, mut largest) = (0.0_f64, 0.0_f64);
            for _ in 0..(1.5 / dt) as usize {
                let state = step(&mut robot, 1);
                let angle = (state.ball_position.x / (radius - params.ball_radius)).asin();
                let expected = along * ((ratio / (1.0 + ratio)).sqrt() * angle).cos();
                worst = worst.max((state.ball_velocity.y - expected).abs());
                largest = largest.max(angle.abs());
            }
            assert!(largest > 0.6, "the ball goes up to {largest} rad");
            errors.push(worst);
        }
        assert!(errors[0] < 4e-3 && errors[1] < 0.6 * errors[0], "{kind}: {errors:?} m/s of {along}");
    }
}

#[test]
fn ten_meters_of_waves_do_not_reduce_the_speed() {
    let terrain =
        Arc::new(Terrain::generate("wave", 0, &[("slope", 0.15), ("size_x", 14.0), ("size_y", 1.0)]).unwrap());
    let params = rough();
    for kind in MODELS {
        let mut robot = ball(kind, &params, &terrain, 1e-3, [-5.0, 0.0], [1.5, 0.0]);
        let before = robot.energy();
        let start = robot.state();
        while robot.state().ball_position.x < 5.0 {
            step(&mut robot, 1);
        }
        let (end, _) = (robot.state(), before);
        let rise =
            2.0 * params.gravity * (end.ball_position.z - start.ball_position.z) / (1.0 + inertia_ratio(&params));
        let speed = (end.ball_velocity.norm_squared() + rise).sqrt();
        within(speed, start.ball_velocity.norm(), 1e-4 * speed, &format!("{kind}: speed after 10 m"));
    }
}

#[test]
fn a_motion_does_not_depend_on_the_mesh() {
    let hills = |x: f64, y: f64| 0.04 * (3.0 * x).sin() * (2.0 * y).cos() + 0.02 * (4.0 * x - 3.0 * y).cos();
    let params = rough();
    let ends: Vec<_> = [0.064, 0.032, 0.016]
        .into_iter()
        .map(|cell| {
            let terrain = Arc::new(Terrain::from_function(hills, [6.4, 6.4], cell).unwrap());
            let mut robot = ball(ModelKind::Contact, &params, &terrain, 1e-3, [-0.8, 0.3], [0.5, -0.2]);
            step(&mut robot, 1000).ball_position
        })
        .collect();
    let apart: Vec<_> = ends.windows(2).map(|pair| (pair[0] - pair[1]).norm()).collect();
    assert!(apart[1] < apart[0] / 12.0 && apart[1] < 1e-7, "{apart:?} m");
}

#[test]
fn both_models_roll_alike() {
    let params = Params::paper();
    let terrain = Arc::new(Terrain::generate("noise", 4, &[("slope", 0.2), ("wavelength", 1.5)]).unwrap());
    let [contact, rigid] = MODELS.map(|kind| {
        let mut robot = ball(kind, &params, &terrain, 0.5e-3, [0.2, -0.4], [0.6, 0.3]);
        step(&mut robot, 2000).ball_position
    });
    assert!((contact - rigid).norm() < 1e-3, "{contact} {rigid}");
}
