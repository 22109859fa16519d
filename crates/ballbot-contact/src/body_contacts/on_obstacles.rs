//! Contacts of ball and bot with the nearest obstacles.

use super::ball_on_obstacle::BallOnObstacle;
use super::bot_point::{BotPoint, POINTS, obstacle_points};
use super::plane::Obstacle;
use crate::constants::Constants;
use crate::footing::Footing;
use crate::obstacles::NEAREST;
use crate::phases::Start;
use crate::types::Velocities;
use ballbot_base::lanes::{Lane, Value, Vec3};

/// The contacts with all near obstacles.
pub struct OnObstacles<L: Lane>([OnObstacle<L>; NEAREST]);

/// The contacts with one obstacle.
struct OnObstacle<L: Lane> {
    friction: L,
    ball: BallOnObstacle<L>,
    points: [BotPoint<L>; POINTS],
    /// Whether any robot may touch the obstacle with its ball, and with each point.
    used: (bool, [bool; POINTS]),
}

impl<L: Lane> OnObstacles<L> {
    /// The contacts; `None` if no robot is near an obstacle.
    #[inline(always)]
    pub fn new<V: Value<L>>(
        c: &Constants<V>,
        start: &Start<L>,
        token: L::Token,
        footing: &Footing<L::Cell>,
    ) -> Option<Self> {
        let near = footing.near_obstacles()?;
        let limit = L::load(token, &near.limit);
        if !L::any(limit.zero().le(limit)) {
            return None;
        }
        let limit = L::select(limit.zero().le(limit), limit, limit.splat(f64::NEG_INFINITY));
        let relief = &footing.relief(token);
        let [first, second] = &near.nearest;
        Some(Self([
            L::rarely(
                token,
                #[inline(always)]
                || OnObstacle::new(c, start, &Obstacle { prism: &first.load(token), relief }, limit),
            ),
            L::rarely(
                token,
                #[inline(always)]
                || OnObstacle::new(c, start, &Obstacle { prism: &second.load(token), relief }, limit),
            ),
        ]))
    }

    /// Robots that reach an obstacle at these velocities.
    #[inline(always)]
    pub fn closes(&self, v: &Velocities<L>) -> L::Mask {
        let [first, second] = &self.0;
        first.closes(v) | second.closes(v)
    }

    /// One Gauss-Seidel sweep for robots in `open`; the impulses of the others stay. Returns the sum of the squared changes.
    #[inline(always)]
    pub fn sweep<V: Value<L>>(&mut self, c: &Constants<V>, open: L::Mask, v: &mut Velocities<L>) -> L {
        let [first, second] = &mut self.0;
        first.sweep(c, open, v) + second.sweep(c, open, v)
    }

    /// Robots that touch an obstacle.
    #[inline(always)]
    pub fn touches(&self) -> L::Mask {
        let [first, second] = &self.0;
        first.touches() | second.touches()
    }

    /// Impulse on ball and bot, N·s.
    #[inline(always)]
    pub fn impulse(&self) -> Vec3<L> {
        let [first, second] = &self.0;
        first.impulse() + second.impulse()
    }
}

impl<L: Lane> OnObstacle<L> {
    #[inline(always)]
    fn new<V: Value<L>>(c: &Constants<V>, start: &Start<L>, obstacle: &Obstacle<'_, '_, L>, limit: L) -> Self {
        let plane = obstacle.near(start, start.pose.ball);
        let ball = BallOnObstacle::new(c, start, &plane, obstacle.prism.restitution, limit);
        let points = obstacle_points(c, start, limit, obstacle);
        let all = limit.le(limit);
        let mut used = [false; POINTS];
        for (used, point) in used.iter_mut().zip(&points) {
            *used = point.may_touch(all);
        }
        Self { friction: obstacle.prism.friction, used: (ball.may_touch(), used), ball, points }
    }

    #[inline(always)]
    fn closes(&self, v: &Velocities<L>) -> L::Mask {
        let mut closing = self.ball.closes(v);
        for point in &self.points {
            closing = closing | point.closes(v);
        }
        closing
    }

    #[inline(always)]
    fn sweep<V: Value<L>>(&mut self, c: &Constants<V>, open: L::Mask, v: &mut Velocities<L>) -> L {
        let mut change = self.friction.zero();
        if self.used.0 {
            change += self.ball.sweep_open(c, self.friction, open, v);
        }
        for (point, used) in self.points.iter_mut().zip(self.used.1) {
            if used {
                change += point.sweep_open(c, self.friction, open, v);
            }
        }
        change
    }

    #[inline(always)]
    fn touches(&self) -> L::Mask {
        let mut touching = self.ball.touches();
        for point in &self.points {
            touching = touching | point.touches();
        }
        touching
    }

    #[inline(always)]
    fn impulse(&self) -> Vec3<L> {
        let mut impulse = self.ball.impulse();
        for point in &self.points {
            impulse += point.impulse();
        }
        impulse
    }
}
