//! Where the robots are to be: a point that is driven, or moves to a goal, no faster than robots can follow.

use ballbot_core::Params;
use ballbot_core::control::Setpoint;
use ballbot_core::models::Scale;
use ballbot_core::nalgebra::{Rotation2, Vector2};

/// Speed, m/s, rates of change, m/s² and rad/s², yaw rate, rad/s, and distance ahead of the robot, m, for the robot of the
/// paper; others are scaled by their size.
const SPEED: f64 = 0.5;
const ACCELERATION: f64 = 0.6;
const YAW_ACCELERATION: f64 = 2.0;
const YAW_RATE: f64 = 1.0;
const AHEAD: f64 = 0.6;

/// A point that moves, with a heading.
pub(crate) struct Target {
    pub(crate) setpoint: Setpoint,
    /// Velocity in the heading frame and yaw rate, as fractions of the largest; `None` while it moves to the goal.
    drive: Option<[f64; 3]>,
    goal: Vector2<f64>,
    speed: f64,
    acceleration: f64,
    ahead: f64,
    /// Largest coordinates, m.
    bounds: [f64; 2],
}

impl Target {
    /// For robots of a kind; `bounds` are the largest coordinates, m.
    pub(crate) fn new(params: &Params, bounds: [f64; 2]) -> Self {
        let scale = Scale::of(params);
        let factor = |unit| scale.factor(unit).unwrap_or(1.0);
        Self {
            setpoint: Setpoint::default(),
            drive: None,
            goal: Vector2::zeros(),
            speed: SPEED * factor("m/s"),
            acceleration: ACCELERATION * factor("m/s²"),
            ahead: AHEAD * factor("m"),
            bounds,
        }
    }

    /// Drives by fractions of the largest velocity, heading frame, and of the largest yaw rate, within ±1.
    pub(crate) fn drive(&mut self, fractions: [f64; 3]) {
        let [forward, left, turn] = fractions;
        // On the diagonal two keys command no more than one.
        let share = forward.hypot(left).max(1.0).recip();
        self.drive = Some([forward * share, left * share, turn]);
    }

    /// Moves to a goal, or to the nearest place within the bounds.
    pub(crate) fn go_to(&mut self, goal: Vector2<f64>) {
        self.drive = None;
        self.goal = self.within(goal);
    }

    fn within(&self, place: Vector2<f64>) -> Vector2<f64> {
        let [x, y] = self.bounds;
        Vector2::new(place.x.clamp(-x, x), place.y.clamp(-y, y))
    }

    /// A control step later; `ball` is the place of the ball of the first robot, which is never left far behind.
    pub(crate) fn advance(&mut self, dt: f64, ball: Vector2<f64>) {
        let Setpoint { position, velocity, yaw, yaw_rate, .. } = self.setpoint;
        let to_goal = self.goal - position;
        let (wanted, turn) = match self.drive {
            Some([forward, left, turn]) => {
                (Rotation2::new(yaw) * (Vector2::new(forward, left) * self.speed), turn * YAW_RATE)
            }
            // The largest speed from which it stops at the goal.
            None => {
                let distance = to_goal.norm();
                let stopping = (self.acceleration * distance).sqrt().min(distance / (4.0 * dt));
                (to_goal * (stopping.min(self.speed) / distance.max(1e-12)), 0.0)
            }
        };
        let change = wanted - velocity;
        let velocity = velocity + change * (self.acceleration * dt / change.norm().max(1e-12)).min(1.0);
        let yaw_rate = yaw_rate + (turn - yaw_rate).clamp(-YAW_ACCELERATION * dt, YAW_ACCELERATION * dt);
        let next = position + velocity * dt;
        let lead = next - ball;
        let held = (lead.norm() > self.ahead && lead.dot(&velocity) > 0.0) || self.within(next) != next;
        self.setpoint.velocity = if held { Vector2::zeros() } else { velocity };
        self.setpoint.position = if held { position } else { next };
        self.setpoint.yaw_rate = yaw_rate;
        self.setpoint.yaw = yaw + yaw_rate * dt;
    }

    /// Rests at a place.
    pub(crate) fn rest_at(&mut self, place: Vector2<f64>) {
        self.setpoint = Setpoint { position: place, ..Setpoint::default() };
        self.drive = None;
        self.goal = place;
    }
}
