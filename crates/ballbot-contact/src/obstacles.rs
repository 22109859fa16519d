//! Obstacles near robots: when they may touch, and which.
//!
//! A robot keeps a lower bound of its distance from all obstacles. Its motion reduces it; only when it has run out are
//! obstacles looked at, and only near one does a step have their contacts.

use super::constants::{Constants, at3};
use super::state::ContactState;
use ballbot_base::lanes::{Cell, Lane, Value, Vec3};
use ballbot_base::terrain::{Obstacles, Prism};

/// Number of obstacles that a robot may touch at the same time: the nearest. Boxes of which a wall is built meet in a
/// corner with two each.
pub const NEAREST: usize = 4;

/// Distance in addition to the motion within a step at which a contact is considered, m.
const MARGIN: f64 = 2e-3;

/// Larger distances are taken for this, m: obstacles beyond it are skipped.
const FAR: f64 = 1.0;

/// Depth of what robots get that are near fewer obstacles, m.
const DEEP: f64 = 1e6;

/// The obstacles near one robot or eight.
pub struct NearObstacles<T> {
    /// Distance below which a contact is considered in the present step, m; negative for robots that are near none.
    pub limit: T,
    /// The nearest obstacles.
    pub nearest: [Prism<T>; NEAREST],
    /// Lower bounds of their distances, and of the distance of the next, m.
    pub distances: [T; NEAREST + 1],
}

impl<T: Cell> NearObstacles<T> {
    pub fn new() -> Self {
        Self { limit: T::default(), nearest: [Prism::default(); NEAREST], distances: [T::default(); NEAREST + 1] }
    }

    /// Finds robots that may touch an obstacle within the coming step, in the inertial frame, and marks all as touching none.
    #[inline(always)]
    pub fn look<L: Lane<Cell = T>, V: Value<L>>(
        &mut self,
        c: &Constants<V>,
        token: L::Token,
        state: &mut ContactState<T>,
        obstacles: &Obstacles,
    ) {
        let v = state.velocities::<L>(token);
        let like = v.ball.x;
        let zero = like.zero();
        zero.store(&mut state.on_obstacle);
        let dt = c.sim_dt.at(like);
        let [px, py, pz, ax, ay, az] = &state.push;
        let pushed = norm(Vec3::<L>::load_parts(token, [px, py, pz])).mul_add(
            c.body_mass_inverse.at(like),
            norm(Vec3::<L>::load_parts(token, [ax, ay, az])) * c.reach_inverse_inertia.at(like),
        );
        // The last step moved no part farther than this.
        let moved = norm(v.ball).max(norm(v.body_rate).mul_add(c.reach.at(like), norm(v.body))) * dt;
        let left = L::load(token, &state.clearance) - moved;
        let limit = pushed.mul_add(dt, moved * 2.0) + MARGIN;
        left.store(&mut state.clearance);
        let runs_out = left.lt(limit);
        let none = zero.splat(-1.0);
        if !L::any(runs_out) {
            none.store(&mut self.limit);
            return;
        }
        let (distances, nearest) = nearest::<L, V>(c, token, state, obstacles);
        let left = distances[0];
        left.store(&mut state.clearance);
        L::select(left.lt(limit), limit, none).store(&mut self.limit);
        for (cell, distance) in self.distances.iter_mut().zip(distances) {
            distance.store(cell);
        }
        for (cell, prism) in self.nearest.iter_mut().zip(&nearest) {
            cell.store(prism);
        }
    }
}

/// Lower bounds of the distances of robots from all obstacles, and the nearest obstacles by these bounds.
#[inline(always)]
fn nearest<L: Lane, V: Value<L>>(
    c: &Constants<V>,
    token: L::Token,
    state: &ContactState<L::Cell>,
    obstacles: &Obstacles,
) -> ([L; NEAREST + 1], [Prism<L>; NEAREST]) {
    let pose = state.pose::<L>(token);
    let like = pose.body.x;
    let rotation = pose.body_quaternion.rotation();
    let bottom = pose.body + rotation.apply(at3(c.body_ends[0], like).into());
    let top = pose.body + rotation.apply(at3(c.body_ends[1], like).into());
    let (dx, dy) = (top.x - bottom.x, top.y - bottom.y);
    let leaning = dx.mul_add(dx, dy.squared()).sqrt();
    let length = norm(top - bottom);
    let wide = c.body_radius.at(like) + c.wheel_radius.at(like);
    let (ball_radius, reach) = (c.ball_radius.at(like), c.reach.at(like));
    let far = like.splat(FAR);
    let mut distances = [far; NEAREST + 1];
    let deep = Vec3 { x: 0.0, y: 0.0, z: -DEEP };
    let nothing = Prism { center: deep, ..Prism::default() }.in_lanes(like);
    let mut nearest = [nothing; NEAREST];
    let farthest = far + reach.max(ball_radius);
    for (prism, circle) in obstacles.prisms().iter().zip(obstacles.reach()) {
        let within = (farthest + *circle).squared();
        let body = aside_squared(pose.body, prism);
        // The ball may have left the body.
        if !L::any(body.min(aside_squared(pose.ball, prism)).lt(within)) {
            continue;
        }
        let prism = prism.in_lanes(like);
        // The distance from a convex shape is a convex function with slopes of at most 1.
        let sideways = (prism.aside(bottom) + prism.aside(top) - leaning) * 0.5;
        let along = (prism.distance(bottom).0 + prism.distance(top).0 - length) * 0.5;
        let of_body = (sideways.max(along) - wide).max(prism.distance(pose.body).0 - reach);
        let mut found = (prism.distance(pose.ball).0 - ball_radius).min(of_body);
        let mut shape = prism;
        for (distance, kept) in distances.iter_mut().zip(&mut nearest) {
            let nearer = found.lt(*distance);
            let (first, second) = (L::select(nearer, found, *distance), L::select(nearer, *distance, found));
            let (one, other) = (Prism::select(nearer, &shape, kept), Prism::select(nearer, kept, &shape));
            (*distance, found, *kept, shape) = (first, second, one, other);
        }
        distances[NEAREST] = distances[NEAREST].min(found);
    }
    (distances, nearest)
}

/// Squared horizontal distance of a point from the center of a prism.
#[inline(always)]
fn aside_squared<L: Lane>(point: Vec3<L>, prism: &Prism<f64>) -> L {
    let (x, y) = (point.x - prism.center.x, point.y - prism.center.y);
    x.mul_add(x, y.squared())
}

#[inline(always)]
fn norm<L: Lane>(vector: Vec3<L>) -> L {
    vector.norm_squared().sqrt()
}
