//! Guides: a velocity that leads to a goal past obstacles.
//!
//! Both know only the outlines of the nearest obstacles. The potential field adds velocities away from them (Khatib,
//! "Real-time obstacle avoidance for manipulators and mobile robots", IJRR 5(1), 1986), which fade near the goal (Ge, Cui,
//! "New potential functions for mobile robot path planning", IEEE T-RA 16(5), 2000). The control barrier function
//! keeps the velocity nearest to the desired velocity with which no distance h falls faster than α h (Ames et al.,
//! "Control barrier functions: theory and applications", ECC 2019).

use crate::shared::limited;
use ballbot_base::lanes::{Lane, Vec3};
use ballbot_base::terrain::Obstacles;

/// Number of obstacles that a guide considers: the nearest.
pub const CONSIDERED: usize = 3;

/// Sweeps over the constraints of the barrier functions.
const SWEEPS: usize = 6;

/// Strength of the potential field: its velocity at half its range, as a fraction of the largest speed.
const STRENGTH: f64 = 0.25;

/// Nearest distance at which the potential field still grows, as a fraction of its range.
const NEAREST: f64 = 0.1;

/// An outline near a place: its distance, m, and the direction away from it.
#[derive(Clone, Copy)]
pub struct Near<L> {
    pub distance: L,
    pub away: [L; 2],
}

/// The outlines nearest to a place, the nearest first; `range`, m, is the distance of absent obstacles.
#[inline(always)]
pub fn nearest<L: Lane>(obstacles: Option<&Obstacles>, [x, y]: [L; 2], range: f64) -> [Near<L>; CONSIDERED] {
    let (zero, far) = (x.zero(), x.splat(range));
    let mut near = [Near { distance: far, away: [zero; 2] }; CONSIDERED];
    let Some(obstacles) = obstacles else { return near };
    let place = Vec3::new(x, y, zero);
    for (prism, reach) in obstacles.prisms().iter().zip(obstacles.reach()) {
        let (dx, dy) = (x - prism.center.x, y - prism.center.y);
        let within = reach + range;
        if !L::any(dx.mul_add(dx, dy.squared()).lt(zero.splat(within * within))) {
            continue;
        }
        let (distance, away) = prism.in_lanes(zero).outline(place);
        let mut found = Near { distance, away };
        for kept in &mut near {
            let nearer = found.distance.lt(kept.distance);
            let (first, second) = (select(nearer, found, *kept), select(nearer, *kept, found));
            (*kept, found) = (first, second);
        }
    }
    near
}

#[inline(always)]
fn select<L: Lane>(mask: L::Mask, yes: Near<L>, no: Near<L>) -> Near<L> {
    Near {
        distance: L::select(mask, yes.distance, no.distance),
        away: [L::select(mask, yes.away[0], no.away[0]), L::select(mask, yes.away[1], no.away[1])],
    }
}

/// The desired velocity plus velocities away from obstacles nearer than `range` times `fades`, at most `speed`. Distances
/// are of the robot from the outlines.
#[inline(always)]
pub fn potential_field<L: Lane>(
    desired: [L; 2],
    near: &[Near<L>; CONSIDERED],
    range: f64,
    speed: f64,
    fades: L,
) -> [L; 2] {
    let [mut x, mut y] = desired;
    for Near { distance, away } in near {
        let share = distance.splat(range) / distance.max(distance.splat(NEAREST * range));
        let closeness = (share - 1.0).max(distance.zero());
        let size = closeness.squared() * fades * (STRENGTH * speed);
        x = away[0].mul_add(size, x);
        y = away[1].mul_add(size, y);
    }
    limited([x, y], speed)
}

/// The velocity nearest to the desired velocity with which no distance h falls faster than `alpha` h. A desired velocity
/// towards an obstacle first gets the same speed around it, so that the robot does not stop in front of it.
#[inline(always)]
pub fn barrier<L: Lane>(desired: [L; 2], near: &[Near<L>; CONSIDERED], range: f64, speed: f64, alpha: f64) -> [L; 2] {
    let [mut x, mut y] = desired;
    for Near { distance, away: [ax, ay] } in near {
        let towards = -(ax.mul_add(x, *ay * y)).min(distance.zero());
        let along = ax.mul_add(y, -(*ay * x));
        let side = L::select(along.lt(along.zero()), along.splat(-1.0), along.splat(1.0));
        let closeness = (distance.splat(1.0) - *distance * (1.0 / range)).max(distance.zero()).min(distance.splat(1.0));
        let size = towards * closeness * side;
        x = (-*ay).mul_add(size, x);
        y = ax.mul_add(size, y);
    }
    [x, y] = limited([x, y], speed);
    for _ in 0..SWEEPS {
        for Near { distance, away: [ax, ay] } in near {
            let lacking = (-(*distance * alpha) - ax.mul_add(x, *ay * y)).max(distance.zero());
            x = ax.mul_add(lacking, x);
            y = ay.mul_add(lacking, y);
        }
    }
    limited([x, y], speed)
}
