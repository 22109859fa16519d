//! Obstacles near robots: when they may touch, and which.
//!
//! A robot keeps a lower bound of its distance from all obstacles. Its motion reduces it; only when it has run out are
//! obstacles looked at, and only near one does a step have their contacts.

use super::constants::{Constants, at3};
use super::state::ContactState;
use ballbot_base::lanes::{Cell, Lane, Value, Vec3};
use ballbot_base::terrain::{Obstacles, Prism};

/// Number of obstacles that a robot may touch at the same time: the two nearest, as in a corner.
pub const NEAREST: usize = 2;

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
}

impl<T: Cell> NearObstacles<T> {
    pub fn new() -> Self {
        Self { limit: T::default(), nearest: [Prism::default(); NEAREST] }
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
        let (left, nearest) = nearest::<L, V>(c, token, state, obstacles);
        left.store(&mut state.clearance);
        L::select(left.lt(limit), limit, none).store(&mut self.limit);
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
) -> (L, [Prism<L>; NEAREST]) {
    let pose = state.pose::<L>(token);
    let like = pose.body.x;
    let rotation = pose.body_quaternion.rotation();
    let bottom = pose.body + rotation.apply(at3(c.body_ends[0], like).into());
    let top = pose.body + rotation.apply(at3(c.body_ends[1], like).into());
    let (dx, dy) = (top.x - bottom.x, top.y - bottom.y);
    let leaning = dx.mul_add(dx, dy.squared()).sqrt();
    let wide = c.body_radius.at(like) + c.wheel_radius.at(like);
    let (ball_radius, reach) = (c.ball_radius.at(like), c.reach.at(like));
    let far = like.splat(FAR);
    let mut distances = [far; NEAREST];
    let deep = Vec3 { x: 0.0, y: 0.0, z: -DEEP };
    let nothing = prism_of(like, &Prism { center: deep, ..Prism::default() });
    let mut nearest = [nothing; NEAREST];
    let farthest = far + reach.max(ball_radius);
    for (prism, circle) in obstacles.prisms().iter().zip(obstacles.reach()) {
        let (x, y) = (pose.body.x - prism.center.x, pose.body.y - prism.center.y);
        let within = farthest + *circle;
        if !L::any(x.mul_add(x, y.squared()).lt(within.squared())) {
            continue;
        }
        let prism = prism_of(like, prism);
        // The distance from a convex outline is a convex function with slopes of at most 1.
        let of_segment = (prism.aside(bottom) + prism.aside(top) - leaning) * 0.5 - wide;
        let of_body = of_segment.max(prism.aside(pose.body) - reach);
        let distance = (prism.aside(pose.ball) - ball_radius).min(of_body);
        let (is_first, is_second) = (distance.lt(distances[0]), distance.lt(distances[1]));
        let second = L::select(is_second, distance, distances[1]);
        distances = [L::select(is_first, distance, distances[0]), L::select(is_first, distances[0], second)];
        let second = Prism::select(is_second, &prism, &nearest[1]);
        nearest = [Prism::select(is_first, &prism, &nearest[0]), Prism::select(is_first, &nearest[0], &second)];
    }
    (distances[0], nearest)
}

#[inline(always)]
fn norm<L: Lane>(vector: Vec3<L>) -> L {
    vector.norm_squared().sqrt()
}

/// The same obstacle in all lanes.
#[inline(always)]
fn prism_of<L: Lane>(like: L, prism: &Prism<f64>) -> Prism<L> {
    prism.map(
        #[inline(always)]
        |number| like.splat(*number),
    )
}
