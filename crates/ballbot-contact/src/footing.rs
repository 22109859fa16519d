//! The ground under robots and the obstacles around them: a step on terrain is a step on a level floor in the frame of the
//! ground under the ball.

use super::constants::{Constants, at3};
use super::obstacles::NearObstacles;
use super::state::ContactState;
use super::types::Actions;
use ballbot_base::lanes::{Cell, Lane, Quat, Rotation, Value, Vec3};
use ballbot_base::terrain::{Frame, Ground, Patch};
use std::sync::Arc;

/// The ground of one robot or of eight, and the frame in which their step is computed. Everything except the ground
/// follows from the ball positions.
pub struct Footing<T> {
    pub ground: Arc<Ground>,
    /// Obstacles near the robots; `None` on ground without obstacles.
    obstacles: Option<Box<NearObstacles<T>>>,
    /// Whether robots need no transformation.
    is_level: bool,
    patch: Patch<T>,
    /// Normal of the ground under the ball, inertial frame.
    normal: [T; 3],
    /// Center of the ball at the start of the step, inertial frame.
    ball: [T; 3],
    /// Height of the ball's center above the ground's tangent plane at the start of the step, m.
    height: T,
}

impl<T: Cell> Footing<T> {
    pub fn new(ground: &Arc<Ground>) -> Self {
        let terrain = ground.terrain();
        let has_obstacles = !terrain.obstacles().is_empty();
        Self {
            ground: Arc::clone(ground),
            obstacles: has_obstacles.then(|| Box::new(NearObstacles::new())),
            // Level ground without obstacles keeps its bits.
            is_level: has_obstacles && terrain.is_level(),
            patch: Patch::default(),
            normal: [T::default(); 3],
            ball: [T::default(); 3],
            height: T::default(),
        }
    }

    /// Finds the obstacles near robots, and transforms robots to the frame of the step.
    #[inline(always)]
    pub fn begin<L: Lane<Cell = T>, V: Value<L>>(
        &mut self,
        c: &Constants<V>,
        token: L::Token,
        state: &mut ContactState<T>,
        actions: &mut Actions<T>,
    ) {
        if let Some(near) = &mut self.obstacles {
            L::rarely(
                token,
                #[inline(always)]
                || near.look(c, token, state, self.ground.terrain().obstacles()),
            );
        }
        if !self.is_level {
            self.enter(c, token, state, actions);
        }
    }

    /// The obstacles near the robots; `None` on ground without obstacles.
    pub fn near_obstacles(&self) -> Option<&NearObstacles<T>> {
        self.obstacles.as_deref()
    }

    /// Transforms robots back to the inertial frame after a step.
    #[inline(always)]
    pub fn end<L: Lane<Cell = T>>(&self, token: L::Token, state: &mut ContactState<T>) {
        if !self.is_level {
            self.leave::<L>(token, state);
        }
    }

    /// The frame of the step.
    #[inline(always)]
    fn frame<L: Lane<Cell = T>>(&self, token: L::Token) -> Frame<L> {
        let normal = Vec3::<L>::load(token, &self.normal);
        if !self.is_level {
            return Frame::of_normal(normal);
        }
        let zero = normal.x.zero();
        Frame::of_normal(Vec3::new(zero, zero, zero.splat(1.0)))
    }

    /// Transforms robots to the frame of the ground, whose origin is on the tangent plane below the ball, and gravity for
    /// `actions`.
    #[inline(always)]
    pub fn enter<L: Lane<Cell = T>, V: Value<L>>(
        &mut self,
        c: &Constants<V>,
        token: L::Token,
        state: &mut ContactState<T>,
        actions: &mut Actions<T>,
    ) {
        let ball = Vec3::<L>::load(token, &state.ball_position);
        let like = ball.x;
        let radius = c.ball_radius.at(like);
        let (gap, frame) = self.ground.under(token, [ball.x, ball.y, ball.z], radius, &mut self.patch);
        let height = gap + radius;
        frame.normal.store(&mut self.normal);
        ball.store(&mut self.ball);
        height.store(&mut self.height);

        let center = Vec3::new(like.zero(), like.zero(), height);
        let body = frame.rotation.apply(Vec3::load(token, &state.body_position) - ball);
        center.store(&mut state.ball_position);
        (body + center).store(&mut state.body_position);
        turn(token, state, &frame.quaternion(), &frame.rotation);
        frame.rotation.apply(Vec3::from(at3(c.gravity_dt, like))).store(&mut actions.gravity_dt);
        (actions.ball_fall, actions.body_fall) = (actions.gravity_dt, actions.gravity_dt);
        let [px, py, pz, ax, ay, az] = &mut state.push;
        for [x, y, z] in [[px, py, pz], [ax, ay, az]] {
            let pushed = frame.rotation.apply(Vec3::<L>::load_parts(token, [x, y, z]));
            pushed.x.store(x);
            pushed.y.store(y);
            pushed.z.store(z);
        }
    }

    /// Inverse of [`Footing::enter`].
    #[inline(always)]
    pub fn leave<L: Lane<Cell = T>>(&self, token: L::Token, state: &mut ContactState<T>) {
        let frame = self.frame::<L>(token);
        let back = frame.rotation.transposed();
        let center = Vec3::<L>::load(token, &state.ball_position);
        let moved = Vec3::new(center.x, center.y, center.z - L::load(token, &self.height));
        let ball = Vec3::load(token, &self.ball) + back.apply(moved);
        let body = ball + back.apply(Vec3::load(token, &state.body_position) - center);
        ball.store(&mut state.ball_position);
        body.store(&mut state.body_position);
        turn(token, state, &frame.quaternion().conjugated(), &back);
    }

    /// A vector of the inertial frame in the frame of the step.
    #[inline(always)]
    pub fn in_frame<L: Lane<Cell = T>>(&self, token: L::Token, vector: Vec3<L>) -> Vec3<L> {
        self.frame(token).rotation.apply(vector)
    }

    /// The ground near the robots, in the frame of the step.
    #[inline(always)]
    pub fn relief<L: Lane<Cell = T>>(&self, token: L::Token) -> Relief<'_, L> {
        Relief {
            ground: &self.ground,
            token,
            frame: self.frame(token),
            ball: Vec3::load(token, &self.ball),
            height: L::load(token, &self.height),
        }
    }
}

/// Rotates the vectors of a state other than positions.
#[inline(always)]
fn turn<L: Lane>(token: L::Token, state: &mut ContactState<L::Cell>, quaternion: &Quat<L>, rotation: &Rotation<L>) {
    for attitude in [&mut state.ball_quaternion, &mut state.body_quaternion] {
        quaternion.times(Quat::load(token, attitude)).store(attitude);
    }
    for vector in [&mut state.ball_velocity, &mut state.ball_rate, &mut state.body_velocity] {
        rotation.apply(Vec3::load(token, vector)).store(vector);
    }
    // Normal, x and y.
    let [z, x, y] = &mut state.floor_impulse;
    let impulse = rotation.apply(Vec3::load_parts(token, [x, y, z]));
    impulse.x.store(x);
    impulse.y.store(y);
    impulse.z.store(z);
}

/// The ground near robots whose state is in the frame of the ground under their balls.
pub struct Relief<'a, L: Lane> {
    ground: &'a Ground,
    token: L::Token,
    frame: Frame<L>,
    ball: Vec3<L>,
    height: L,
}

impl<L: Lane> Relief<'_, L> {
    /// A vector in the inertial frame.
    #[inline(always)]
    pub fn inertial(&self, vector: Vec3<L>) -> Vec3<L> {
        self.frame.rotation.transposed().apply(vector)
    }

    /// A vector of the inertial frame in the frame of the step.
    #[inline(always)]
    pub fn in_frame(&self, vector: Vec3<L>) -> Vec3<L> {
        self.frame.rotation.apply(vector)
    }

    /// A point in the inertial frame.
    #[inline(always)]
    pub fn place(&self, point: Vec3<L>) -> Vec3<L> {
        let center = Vec3::new(point.x.zero(), point.x.zero(), self.height);
        self.ball + self.frame.rotation.apply_transposed(point - center)
    }

    /// Distance of a point from the ground's tangent plane below it, m, and the plane's normal.
    #[inline(always)]
    pub fn below(&self, point: Vec3<L>) -> (L, Vec3<L>) {
        let there = self.place(point);
        let mut patch = Patch::default();
        let height = self.ground.terrain().surface().at(self.token, [there.x, there.y], &mut patch);
        let normal = Frame::of_gradient(height.gradient).normal;
        ((there.z - height.z) * normal.z, self.frame.rotation.apply(normal))
    }

    /// Largest possible rise of the ground above its tangent plane at the contact, m, at a point's distance along the
    /// plane and across it.
    #[inline(always)]
    pub fn rise(&self, along: L, across: L) -> L {
        let terrain = self.ground.terrain();
        // A step along the normal changes the horizontal position by its sine.
        let distance = across.abs().mul_add_all(terrain.slope().sin(), along);
        distance.squared() * (0.5 * terrain.bend())
    }
}
