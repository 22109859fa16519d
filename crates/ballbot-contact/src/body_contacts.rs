//! Rare contacts: bot on the floor, ball against the body, and both against obstacles.
//!
//! They are not part of the rows. A step is solved without them first. Robots that would close such a contact get their
//! impulses from Gauss-Seidel sweeps over these contacts and the rows together. The others keep the exact solution, and
//! so do robots that are marked near but touch nothing: their motion keeps every bit.

mod ball_on_body;
mod ball_on_obstacle;
mod bot_point;
mod mast;
mod on_obstacles;
mod plane;

use super::constants::{Constants, at3};
use super::delassus::Delassus;
use super::footing::{Footing, Relief};
use super::friction::{Friction, JointFriction};
use super::phases::{Start, finish, free_velocities};
use super::state::ContactState;
use super::types::{Actions, PerRow, Pose, Velocities, with_positive_zero};
use ball_on_body::BallOnBody;
use ballbot_base::lanes::{Lane, Own, Value, Vec3};
use ballbot_base::wheels::Wheels;
use bot_point::{BotPoint, POINTS, floor_points};
use mast::MastFrame;
use on_obstacles::OnObstacles;

/// Smallest number of sweeps. Chosen by experiment.
const SWEEPS: usize = 3;

/// Largest number of sweeps. Chosen by experiment.
const MOST_SWEEPS: usize = 20;

/// Root of the squared changes of the impulses in a sweep above which the sweeps continue, as a fraction of the impulse
/// of a wheel's static load. Chosen by experiment.
const SETTLED_SHARE: f64 = 1e-4;

/// The same two of robots near obstacles: an impact on a wall passes through ball and wheels. Chosen by experiment.
const MOST_SWEEPS_AT_OBSTACLES: usize = 60;
const SETTLED_SHARE_AT_OBSTACLES: f64 = 1e-5;

/// Distance in addition to the motion within a step at which a contact of bot and floor is considered, m.
const FLOOR_MARGIN: f64 = 2e-3;

/// Distance in addition to the motion within a step at which a contact of ball and body is considered, in ball radii.
const BALL_MARGIN: f64 = 5e-3;

/// Offset of the ball's center from the origin of the body frame, in ball radii, above which the distance of ball and
/// cylinder is computed. The distance at rest is more than twice this.
const MAX_CENTER_OFFSET: f64 = 0.02;

/// Distances at which the contacts of this module are considered in a step.
pub struct Near<'a, L: Lane> {
    /// Robots that need the contacts of this module.
    pub mask: L::Mask,
    /// Robots of `mask` whose ball may touch wheels or body, so that all contacts are solved together.
    pub coupled: L::Mask,
    /// Robots of `mask` whose ball may touch the body's cylinder.
    ball_on_body: L::Mask,
    /// Height below which a point of the bot may touch the floor, m.
    floor_limit: L,
    /// The ground, unless it is level.
    footing: Option<&'a Footing<L::Cell>>,
    token: L::Token,
}

impl<'a, L: Lane> Near<'a, L> {
    #[inline(always)]
    pub fn new<V: Value<L>>(
        c: &Constants<V>,
        start: &Start<L>,
        token: L::Token,
        state: &ContactState<L::Cell>,
        footing: Option<&'a Footing<L::Cell>>,
    ) -> Self {
        let (pose, v) = (&start.pose, &start.velocities);
        let zero = pose.ball.x.zero();
        let dt = c.sim_dt.at(zero);
        let [px, py, pz, ax, ay, az] = &state.push;
        let impulse = Vec3::<L>::load_parts(token, [px, py, pz]);
        let angular_impulse = Vec3::<L>::load_parts(token, [ax, ay, az]);
        let pushed = sum_of_sizes(impulse)
            .mul_add(c.body_mass_inverse.at(zero), sum_of_sizes(angular_impulse) * c.reach_inverse_inertia.at(zero));

        let up = start.rotation.rows[2];
        let wheels =
            up.dot(c.wheel_center(0, zero)).min(up.dot(c.wheel_center(1, zero))).min(up.dot(c.wheel_center(2, zero)));
        let upright = up.dot(at3(c.mast, zero).into());
        let rim = upright.neg_mul_add(upright, zero.splat(1.0)).max(zero).sqrt() * c.body_radius.at(zero);
        let [bottom, top] = [at3(c.body_ends[0], zero), at3(c.body_ends[1], zero)];
        let cylinder = up.dot(bottom.into()).min(up.dot(top.into())) - rim;
        let lowest = match footing {
            None => pose.body.z + (wheels - c.wheel_radius.at(zero)).min(cylinder),
            // Only references to memory, so that the step on level ground keeps its numbers in registers.
            Some(footing) => L::rarely(
                token,
                #[inline(always)]
                move || lowest_over(c, token, state, footing),
            ),
        };
        let falling = sum_of_sizes(v.body_rate).mul_add(c.reach.at(zero), v.body.z.abs()) + pushed;
        let floor_limit = falling.mul_add(dt, zero.splat(FLOOR_MARGIN));

        // The ball under the wheels is far from the cylinder.
        let ball = start.rows.ball_in_body;
        let offset = ball + c.com(zero);
        let displaced = (c.ball_radius.at(zero) * MAX_CENTER_OFFSET).squared().lt(offset.norm_squared());
        let (mut ball_near, mut wheels_near) = (displaced, !displaced);
        if L::any(displaced) {
            // Motion of the ball's center in body axes, along the mast and across it.
            let frame = MastFrame::new(c, zero);
            let drift = frame.vector(start.rotation.apply_transposed(v.ball - v.body) - v.body_rate.cross(ball));
            let ball = frame.point(ball);
            let margin = pushed.mul_add(dt, c.ball_radius.at(zero) * BALL_MARGIN);
            let along = drift.z.abs().mul_add(dt, margin);
            let across = (drift.x.abs() + drift.y.abs()).mul_add(dt, margin);
            let above = (c.body_bottom.at(zero) - ball.z).max(ball.z - c.body_top.at(zero)) - along;
            let radial = ball.x.mul_add(ball.x, ball.y.squared()).sqrt();
            let (above, lateral) = (above.max(zero), (radial - c.body_radius.at(zero) - across).max(zero));
            let distance = lateral.mul_add(lateral, above.squared());
            ball_near = displaced & distance.lt(c.ball_radius.at(zero).squared());
            let Wheels([a, b, d]) = start.rows.gaps;
            wheels_near = wheels_near | a.min(b).min(d).lt(along + across);
        }
        let mask = lowest.lt(floor_limit) | ball_near;
        Self { mask, coupled: mask & (wheels_near | ball_near), ball_on_body: ball_near, floor_limit, footing, token }
    }
}

/// Robots that may touch an obstacle.
#[inline(always)]
fn near_obstacles<L: Lane>(token: L::Token, footing: Option<&Footing<L::Cell>>, zero: L) -> L::Mask {
    match footing.and_then(Footing::near_obstacles) {
        Some(near) => zero.le(L::load(token, &near.limit)),
        None => zero.lt(zero),
    }
}

/// Finishes a step of robots, some of which are near rare contacts. `without` has the velocities and impulses of a step
/// without these contacts. They are exact for robots that close none of them.
#[inline(never)]
pub fn finish_near<L: Lane>(
    constants: &Constants<L::Cell>,
    token: L::Token,
    state: &mut ContactState<L::Cell>,
    without: &ContactState<L::Cell>,
    footing: Option<&Footing<L::Cell>>,
    actions: &Actions<L::Cell>,
) {
    L::rarely(
        token,
        #[inline(always)]
        || {
            let c = &constants.owned::<L>(token);
            let start = Start::new::<true, Own<L>>(c, token, state);
            let mut near = Near::new(c, &start, token, state, footing);
            // At an obstacle all contacts are solved together.
            near.coupled = near.coupled | near_obstacles(token, footing, start.pose.ball.x.zero());
            let (velocities, impulses) = (without.velocities(token), without.impulses(token));
            let mut contacts = Contacts::new(c, &start, &near, (impulses, velocities));
            let closing = contacts.closing(c, &near);
            if L::any(closing) {
                let closing = &Near { mask: closing, coupled: near.coupled & closing, ..near };
                L::rarely(
                    token,
                    #[inline(always)]
                    || contacts.solve(c, token, state, actions, &start, closing),
                );
            }
            for (cell, counted) in [
                (&mut state.searched_steps, &without.searched_steps),
                (&mut state.unsolved_steps, &without.unsolved_steps),
            ] {
                L::select(closing, L::load(token, cell), L::load(token, counted)).store(cell);
            }
            contacts.store_obstacles(token, state, &near);
            let touches = contacts.bot_touches(near.mask);
            let zero = start.pose.body.x.zero();
            let on_floor = L::select(touches, zero.splat(1.0), zero);
            finish(c, token, state, &start, (&contacts.velocities, &contacts.impulses), on_floor);
            let mut impulse = contacts.bot_impulse();
            if let Some(footing) = near.footing {
                impulse = footing.relief(token).inertial(impulse);
            }
            let is_finite = L::load(token, &state.diverged).le(zero);
            let before = Vec3::load(token, &state.bot_floor_impulse);
            Vec3::select(touches & is_finite, impulse, before).store(&mut state.bot_floor_impulse);
        },
    );
}

/// Lower bound of the height of a part of the bot above the highest possible ground below it; of robots near an obstacle,
/// which need the contacts of this module as well, none.
#[inline(always)]
fn lowest_over<L: Lane, V: Value<L>>(
    c: &Constants<V>,
    token: L::Token,
    state: &ContactState<L::Cell>,
    footing: &Footing<L::Cell>,
) -> L {
    let Pose { body, body_quaternion, .. } = state.pose::<L>(token);
    let like = body.z;
    let (rotation, relief) = (body_quaternion.rotation(), footing.relief(token));
    let upright = rotation.rows[2].dot(at3(c.mast, like).into());
    let sine = upright.neg_mul_add(upright, like.splat(1.0)).max(like.zero()).sqrt();
    let (wheel, radius) = (c.wheel_radius.at(like), c.body_radius.at(like));
    let [bottom, top] = [at3(c.body_ends[0], like), at3(c.body_ends[1], like)];
    let mut lowest = clearance(&relief, body + rotation.apply(c.wheel_center(0, like)), [wheel, wheel]);
    lowest = lowest.min(clearance(&relief, body + rotation.apply(c.wheel_center(1, like)), [wheel, wheel]));
    lowest = lowest.min(clearance(&relief, body + rotation.apply(c.wheel_center(2, like)), [wheel, wheel]));
    lowest = lowest.min(clearance(&relief, body + rotation.apply(bottom.into()), [radius, sine * radius]));
    lowest = lowest.min(clearance(&relief, body + rotation.apply(top.into()), [radius, sine * radius]));
    L::select(near_obstacles(token, Some(footing), like.zero()), like.splat(f64::NEG_INFINITY), lowest)
}

/// Lower bound of the height of a part that extends `lateral` and `below` its center.
#[inline(always)]
fn clearance<L: Lane>(relief: &Relief<'_, L>, center: Vec3<L>, [lateral, below]: [L; 2]) -> L {
    let along = center.x.mul_add(center.x, center.y.squared()).sqrt() + lateral;
    center.z - below - relief.rise(along, center.z.abs() + below)
}

/// Sum of the absolute components, an upper bound of the length.
#[inline(always)]
fn sum_of_sizes<L: Lane>(v: Vec3<L>) -> L {
    v.x.abs() + v.y.abs() + v.z.abs()
}

/// Inputs of the sweeps over the rows.
struct System<L, V> {
    delassus: Delassus<L, V>,
    friction: Friction<L>,
    joint_friction: JointFriction<L>,
}

/// The rare contacts of robots, and the impulses of the rows and the velocities with all contacts.
struct Contacts<L: Lane> {
    points: [BotPoint<L>; POINTS],
    /// Whether any robot may touch the floor with the point.
    used: [bool; POINTS],
    ball: BallOnBody<L>,
    obstacles: Option<OnObstacles<L>>,
    impulses: PerRow<L>,
    normal_estimate: Wheels<L>,
    velocities: Velocities<L>,
}

impl<L: Lane> Contacts<L> {
    #[inline(always)]
    fn new<V: Value<L>>(
        c: &Constants<V>,
        start: &Start<L>,
        near: &Near<'_, L>,
        (impulses, velocities): (PerRow<L>, Velocities<L>),
    ) -> Self {
        // Compiled apart, as is the solution: the compiler's memory grows faster than a function.
        let points = match near.footing {
            None => L::rarely(
                near.token,
                #[inline(always)]
                || floor_points(c, start, near.floor_limit, None),
            ),
            Some(footing) => L::rarely(
                near.token,
                #[inline(always)]
                || floor_points(c, start, near.floor_limit, Some(&footing.relief(near.token))),
            ),
        };
        let mut used = [false; POINTS];
        for (used, point) in used.iter_mut().zip(&points) {
            *used = point.may_touch(near.mask);
        }
        let ball = BallOnBody::new(c, start);
        let obstacles = near.footing.and_then(
            #[inline(always)]
            |footing| OnObstacles::new(c, start, near.token, footing),
        );
        Self { points, used, ball, obstacles, normal_estimate: impulses.normals, impulses, velocities }
    }

    /// Robots near rare contacts that close a rare contact at the present velocities.
    #[inline(always)]
    fn closing<V: Value<L>>(&self, c: &Constants<V>, near: &Near<'_, L>) -> L::Mask {
        let mut closing = near.ball_on_body & self.ball.closes(c, &self.velocities);
        for (point, used) in self.points.iter().zip(self.used) {
            if used {
                closing = closing | point.closes(&self.velocities);
            }
        }
        if let Some(obstacles) = &self.obstacles {
            closing = closing | obstacles.closes(&self.velocities);
        }
        closing & near.mask
    }

    /// Solves for the impulses of the robots in the mask of `near`, from the impulses of the last step. Includes the
    /// impulses of the rows where the ball may touch wheels or body.
    #[inline(always)]
    fn solve<V: Value<L>>(
        &mut self,
        c: &Constants<V>,
        token: L::Token,
        state: &ContactState<L::Cell>,
        actions: &Actions<L::Cell>,
        start: &Start<L>,
        near: &Near<'_, L>,
    ) {
        let last = state.impulses(token);
        let mut velocities = free_velocities(c, token, state, start, actions);
        start.rows.apply::<true, true, V>(c, &last, &mut velocities);
        self.velocities = Velocities::select(near.coupled, &velocities, &self.velocities);
        self.impulses = PerRow::select(near.coupled, &last, &self.impulses);
        self.normal_estimate = self.impulses.normals;

        let zero = velocities.ball.x.zero();
        let system = System {
            delassus: Delassus::new::<true, true>(c, &start.rows),
            friction: Friction::new(c, &start.rows, &start.velocities),
            joint_friction: JointFriction::new(c, zero),
        };
        let at_obstacle = near_obstacles(token, near.footing, zero);
        let share = L::select(at_obstacle, zero.splat(SETTLED_SHARE_AT_OBSTACLES), zero.splat(SETTLED_SHARE));
        let threshold = (c.static_wheel_load.at(zero) * c.sim_dt.at(zero) * share).squared();
        let mut open = near.mask;
        for sweep in 1..=MOST_SWEEPS_AT_OBSTACLES {
            let change = self.sweep(c, start, &system, near, open);
            if sweep >= MOST_SWEEPS {
                open = open & at_obstacle;
            }
            if sweep >= SWEEPS {
                open = open & threshold.lt(change);
                if !L::any(open) {
                    break;
                }
            }
        }
        // A skipped contact adds nothing; a contact used only by a neighbor adds zero, which changes only the sign of
        // −0.
        self.impulses = PerRow::select(near.mask, &self.impulses.map(with_positive_zero), &self.impulses);
        self.velocities = Velocities::select(near.mask, &self.velocities.map(with_positive_zero), &self.velocities);
    }

    /// One sweep over all contacts of the robots in `open`. Returns the sum of the squared changes of the impulses, which
    /// does not depend on the directions of the axes.
    #[inline(always)]
    fn sweep<V: Value<L>>(
        &mut self,
        c: &Constants<V>,
        start: &Start<L>,
        system: &System<L, V>,
        near: &Near<'_, L>,
        open: L::Mask,
    ) -> L {
        let mut v = self.velocities;
        let zero = v.ball.x.zero();
        let mut change = zero;
        for (point, used) in self.points.iter_mut().zip(self.used) {
            if used {
                change += point.sweep_open(c, system.friction.floor, open, &mut v);
            }
        }
        if let Some(obstacles) = &mut self.obstacles {
            change += obstacles.sweep(c, open, &mut v);
        }
        let coupled = open & near.coupled;
        if L::any(open & near.ball_on_body) {
            let before = self.ball.impulse;
            change += self.ball.sweep(c, near.ball_on_body, &mut v).squared();
            self.ball.impulse = L::select(open, self.ball.impulse, before);
        }
        if L::any(coupled) {
            let mut residuals = start.rows.residuals::<true, V>(c, &v);
            let (mut impulses, mut estimate) = (self.impulses, self.normal_estimate);
            let System { delassus, friction, joint_friction } = system;
            delassus.sweep::<true>(friction, joint_friction, &mut estimate, &mut impulses, &mut residuals);
            let step = impulses.minus(&self.impulses);
            let mut moved = v;
            start.rows.apply::<true, true, V>(c, &step, &mut moved);
            v = Velocities::select(coupled, &moved, &v);
            let size = |row: Wheels<L>| row.dot(row);
            let floor = Vec3::from(step.floor).norm_squared();
            change += L::select(coupled, floor + size(step.normals) + size(step.drives), zero);
            self.impulses = PerRow::select(coupled, &impulses, &self.impulses);
            self.normal_estimate = Wheels::select(coupled, estimate, self.normal_estimate);
        }
        self.velocities = Velocities::select(open, &v, &self.velocities);
        change
    }

    /// Stores what obstacles do, for robots that have not diverged; steps near more obstacles than contacts count as
    /// unsolved.
    #[inline(always)]
    fn store_obstacles(&self, token: L::Token, state: &mut ContactState<L::Cell>, near: &Near<'_, L>) {
        let (Some(obstacles), Some(footing)) = (&self.obstacles, near.footing) else { return };
        let zero = self.ball.impulse.zero();
        let is_finite = state.stays_finite(token, &self.velocities);
        let touches = obstacles.touches(zero) & near.mask & is_finite;
        L::select(touches, zero.splat(1.0), zero).store(&mut state.on_obstacle);
        let impulse = footing.relief(token).inertial(obstacles.impulse(zero));
        let before = Vec3::load(token, &state.obstacle_impulse);
        Vec3::select(touches, impulse, before).store(&mut state.obstacle_impulse);
        let unsolved = L::select(obstacles.crowded() & near.mask & is_finite, zero.splat(1.0), zero);
        (L::load(token, &state.unsolved_steps) + unsolved).store(&mut state.unsolved_steps);
    }

    /// Robots of the mask whose bot touches the floor.
    #[inline(always)]
    fn bot_touches(&self, mask: L::Mask) -> L::Mask {
        let zero = self.ball.impulse.zero();
        let mut touches = zero.lt(zero);
        for (point, used) in self.points.iter().zip(self.used) {
            if used {
                touches = touches | point.touches();
            }
        }
        touches & mask
    }

    /// Impulse of the floor on the bot.
    #[inline(always)]
    fn bot_impulse(&self) -> Vec3<L> {
        let mut impulse = Vec3::zero(self.ball.impulse);
        for (point, used) in self.points.iter().zip(self.used) {
            if used {
                impulse += point.impulse();
            }
        }
        impulse
    }
}
