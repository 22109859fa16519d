//! Terrains against closed forms: the surface, a single ball, and robots.

mod batches;
mod limits;
mod robots;
mod rolling;
mod surface;

use ballbot_core::terrain::Terrain;
use ballbot_core::{Ballbot, ModelKind, Params, State};
use nalgebra::{Vector2, Vector3};
use std::sync::Arc;

/// Height of the bot of a ball that rolls without it, m: it falls for ten seconds without touching anything.
const OUT_OF_REACH: f64 = 2000.0;

/// J / (M r²) of the ball.
fn inertia_ratio(params: &Params) -> f64 {
    params.ball_inertia / (params.ball_mass * params.ball_radius.powi(2))
}

/// A single ball on a terrain at x and y with horizontal velocity components, rolling without slip or spin.
fn ball(
    kind: ModelKind,
    params: &Params,
    terrain: &Arc<Terrain>,
    dt: f64,
    place: [f64; 2],
    velocity: [f64; 2],
) -> Ballbot {
    let mut robot = Ballbot::new(params, kind, dt).unwrap();
    robot.set_terrain(Some(terrain)).unwrap();
    robot.place_on_ground(place[0], place[1], 0.0, Some(Vector2::zeros())).unwrap();
    let at_rest = robot.state();
    let center = at_rest.ball_position;
    let normal = contact_normal(terrain, params, &center);
    let level = Vector3::new(velocity[0], velocity[1], 0.0);
    let moving = level - Vector3::z() * (normal.dot(&level) / normal.z);
    let start = State {
        ball_velocity: moving,
        ball_angular_velocity: normal.cross(&moving) / params.ball_radius,
        body_position: center + Vector3::z() * OUT_OF_REACH,
        ..at_rest
    };
    robot.reset(&start).unwrap();
    robot
}

/// The normal at the point where a ball touches the ground, from the surface only: Newton's method in the plane.
fn contact_normal(terrain: &Terrain, params: &Params, center: &Vector3<f64>) -> Vector3<f64> {
    let mut place = center.xy();
    for _ in 0..200 {
        let normal = terrain.normal(place.x, place.y);
        place = center.xy() - normal.xy() * params.ball_radius;
    }
    terrain.normal(place.x, place.y)
}

fn step(robot: &mut Ballbot, steps: usize) -> State {
    robot.step([0.0; 3], steps).unwrap();
    robot.state()
}

/// The paper's robot with a floor that holds any ball.
fn rough() -> Params {
    Params { floor_static_friction: 5.0, floor_dynamic_friction: 5.0, ..Params::paper() }
}
