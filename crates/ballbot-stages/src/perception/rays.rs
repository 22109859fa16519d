//! What rays of an instrument hit: the ground, obstacles, and the robot's ball.

use ballbot_base::error::{Result, check};
use ballbot_base::params::Params;
use ballbot_base::terrain::{Rays, Terrain, each};
use nalgebra::Vector3;

/// Height above the ground at which a ray follows the tangent there, m.
const MET: f64 = 1e-4;

/// The first fractions of rays at which they hit the ground; infinite if there is none up to their limits.
#[inline(always)]
pub fn to_ground<const N: usize>(terrain: Option<&Terrain>, eye: &Vector3<f64>, rays: &Rays<N>) -> [f64; N] {
    match terrain {
        Some(terrain) => terrain.meet(eye, rays, MET),
        None => level(eye, rays),
    }
}

/// The fraction of `ray` at which it enters an obstacle, or `limit` if it enters none before.
pub fn to_obstacle(terrain: Option<&Terrain>, eye: &Vector3<f64>, ray: &Vector3<f64>, limit: f64) -> f64 {
    match terrain.map(Terrain::obstacles) {
        Some(obstacles) if !obstacles.is_empty() => {
            obstacles.cast((*eye).into(), (*ray).into(), limit).map_or(limit, |(share, _)| share)
        }
        _ => limit,
    }
}

/// Intersections of rays with level ground.
#[inline(always)]
fn level<const N: usize>(eye: &Vector3<f64>, rays: &Rays<N>) -> [f64; N] {
    each(
        #[inline(always)]
        |i| match rays.direction[2][i] {
            _ if eye.z < 0.0 => 0.0,
            z if z < 0.0 => -eye.z / z,
            _ => f64::INFINITY,
        },
    )
}

/// The parameter of `ray` at which it enters a sphere whose center is at −`arm` from its origin; `outside` is the
/// squared length of the arm minus the squared radius, positive.
#[inline(always)]
pub fn to_sphere(arm: &Vector3<f64>, ray: &Vector3<f64>, outside: f64) -> Option<f64> {
    let towards = -arm.dot(ray);
    let length = ray.norm_squared();
    let root = towards * towards - length * outside;
    if towards > 0.0 && outside > 0.0 && root >= 0.0 { Some((towards - root.sqrt()) / length) } else { None }
}

/// Checks that `position`, from the ball's center, is outside of the ball; `name` is the option's name.
///
/// # Errors
/// [`ballbot_base::Error::OutOfRange`] naming the distance and the radius.
pub fn require_outside_ball(name: &str, position: &[f64; 3], params: &Params) -> Result<()> {
    let distance = position.iter().map(|part| part * part).sum::<f64>().sqrt();
    let limit = format_args!("above ball_radius = {} m: outside of the ball", params.ball_radius);
    check(format_args!("distance of {name} from the ball's center"), distance, limit, |d| d > params.ball_radius)
        .map(drop)
}
