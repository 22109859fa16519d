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
pub struct OnObstacles<L: Lane> {
    contacts: [Option<OnObstacle<L>>; NEAREST],
    /// Robots that are near more obstacles.
    crowded: L::Mask,
}

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
        let mut contacts = [const { None }; NEAREST];
        for ((contact, prism), distance) in contacts.iter_mut().zip(&near.nearest).zip(&near.distances) {
            if L::any(L::load(token, distance).lt(limit)) {
                *contact = Some(L::rarely(
                    token,
                    #[inline(always)]
                    || OnObstacle::new(c, start, &Obstacle { prism: &prism.load(token), relief }, limit),
                ));
            }
        }
        Some(Self { contacts, crowded: L::load(token, &near.distances[NEAREST]).lt(limit) })
    }

    /// Robots that are near more obstacles than they can touch.
    #[inline(always)]
    pub fn crowded(&self) -> L::Mask {
        self.crowded
    }

    /// Robots that reach an obstacle at these velocities.
    #[inline(always)]
    pub fn closes(&self, v: &Velocities<L>) -> L::Mask {
        let zero = v.ball.x.zero();
        let mut closing = zero.lt(zero);
        for contact in self.contacts.iter().flatten() {
            closing = closing | contact.closes(v);
        }
        closing
    }

    /// One Gauss-Seidel sweep for robots in `open`; the impulses of the others stay. Returns the sum of the squared changes.
    #[inline(always)]
    pub fn sweep<V: Value<L>>(&mut self, c: &Constants<V>, open: L::Mask, v: &mut Velocities<L>) -> L {
        let mut change = v.ball.x.zero();
        for contact in self.contacts.iter_mut().flatten() {
            change += contact.sweep(c, open, v);
        }
        change
    }

    /// Robots that touch an obstacle.
    #[inline(always)]
    pub fn touches(&self, zero: L) -> L::Mask {
        let mut touching = zero.lt(zero);
        for contact in self.contacts.iter().flatten() {
            touching = touching | contact.touches();
        }
        touching
    }

    /// Impulse on ball and bot, N·s.
    #[inline(always)]
    pub fn impulse(&self, zero: L) -> Vec3<L> {
        let mut impulse = Vec3::zero(zero);
        for contact in self.contacts.iter().flatten() {
            impulse += contact.impulse();
        }
        impulse
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
