//! Where the robots are to be: a point that is driven, or moves to a goal, no faster than robots can follow.

use ballbot_core::control::{Motion, Reference, Setpoint, Turning};
use ballbot_core::models::Scale;
use ballbot_core::nalgebra::{Rotation2, Vector2};
use ballbot_core::{Error, Params, Result};
use std::f64::consts::{SQRT_2, TAU};

/// Speed, m/s, rates of change, m/s² and rad/s², yaw rate, rad/s, and distance ahead of the robot, m, for the robot of the
/// paper; others are scaled by their size.
const SPEED: f64 = 0.5;
const ACCELERATION: f64 = 0.6;
const YAW_ACCELERATION: f64 = 2.0;
const YAW_RATE: f64 = 1.0;
const AHEAD: f64 = 0.6;

/// Radius of a circle, and half the length of an eight, m; fraction of the largest speed on them, time to reach it, s, and
/// largest fraction of the traction, likewise for the robot of the paper.
const RADIUS: f64 = 0.5;
const HALF_LENGTH: f64 = 0.7;
const CURVE_SPEED: f64 = 0.7;
const CURVE_START: f64 = 3.0;
const CURVE_TRACTION: f64 = 0.5;

/// The curves.
pub(crate) const CURVES: [&str; 2] = ["circle", "eight"];

/// How the point moves.
#[derive(Clone)]
enum Course {
    /// To the goal.
    Goal(Vector2<f64>),
    /// At a velocity in the heading frame and a yaw rate, as fractions of the largest.
    Drive([f64; 3]),
    /// Along a curve from where it rests, with the time on it, s; before that it comes to rest.
    Curve(Box<Reference>, Option<(Vector2<f64>, f64)>),
}

/// A point that moves, with a heading.
pub(crate) struct Target {
    pub(crate) setpoint: Setpoint,
    course: Course,
    params: Params,
    size: f64,
    time: f64,
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
            course: Course::Goal(Vector2::zeros()),
            params: params.clone(),
            size: factor("m"),
            time: factor("s"),
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
        self.course = Course::Drive([forward * share, left * share, turn]);
    }

    /// Moves to a goal, or to the nearest place within the bounds.
    pub(crate) fn go_to(&mut self, goal: Vector2<f64>) {
        self.course = Course::Goal(self.within(goal));
    }

    /// Moves along a curve of [`CURVES`], from where it comes to rest.
    ///
    /// # Errors
    /// [`Error::UnknownName`] for another curve; [`Error::Inconsistent`] for a robot that no slow motion suits, or a curve
    /// beyond the bounds.
    pub(crate) fn follow(&mut self, curve: &str) -> Result<()> {
        if !CURVES.contains(&curve) {
            return Err(Error::unknown("curve", curve, &CURVES));
        }
        let (radius, size) = (RADIUS * self.size, HALF_LENGTH * self.size);
        let (speed, start) = (CURVE_SPEED * self.speed, CURVE_START * self.time);
        let motion = |slow: f64| match curve {
            "circle" => Motion::Circle { radius, period: slow * TAU * radius / speed, start: slow * start },
            // It is fastest at its crossing.
            _ => Motion::Lemniscate { size, period: slow * TAU * SQRT_2 * size / speed, start: slow * start },
        };
        let reference = |slow| Reference::new(&self.params, motion(slow), Turning::default(), None);
        let slow = reference(1.0)?.slowdown(CURVE_TRACTION)?;
        let unsuitable = || Error::Inconsistent(format!("no {curve}, however slow, suits this robot"));
        let reference = reference(slow.ok_or_else(unsuitable)?)?;
        // It stops within the time in which it speeds up.
        let reach = 2.0 * (radius.max(size) + self.speed * self.speed / self.acceleration);
        let corner = self.setpoint.position.abs().add_scalar(reach);
        if self.within(corner) != corner {
            let [x, y] = self.bounds;
            let reason =
                format!("the {curve} may take {reach:.1} m on each side of the target, within {x:.1}, {y:.1} m");
            return Err(Error::Inconsistent(format!("{reason}: it would leave the ground")));
        }
        self.course = Course::Curve(Box::new(reference), None);
        Ok(())
    }

    fn within(&self, place: Vector2<f64>) -> Vector2<f64> {
        let [x, y] = self.bounds;
        Vector2::new(place.x.clamp(-x, x), place.y.clamp(-y, y))
    }

    /// A control step later; `ball` is the place of the ball of the first robot, which is never left far behind.
    pub(crate) fn advance(&mut self, dt: f64, ball: Vector2<f64>) {
        let Setpoint { position, velocity, yaw, yaw_rate, .. } = self.setpoint;
        if let Course::Curve(reference, began) = &mut self.course {
            let rests = velocity == Vector2::zeros() && yaw_rate == 0.0;
            if began.is_none() && rests {
                *began = Some((position, 0.0));
            }
            if let Some((begin, time)) = began {
                *time += dt;
                let on_curve = reference.at(*time);
                self.setpoint = Setpoint { position: *begin + on_curve.position, yaw, yaw_rate: 0.0, ..on_curve };
                return;
            }
        }
        let (wanted, turn) = match self.course {
            Course::Drive([forward, left, turn]) => {
                (Rotation2::new(yaw) * (Vector2::new(forward, left) * self.speed), turn * YAW_RATE)
            }
            // The largest speed from which it stops at the goal.
            Course::Goal(goal) => {
                let to_goal = goal - position;
                let distance = to_goal.norm();
                let stopping = (self.acceleration * distance).sqrt().min(distance / (4.0 * dt));
                (to_goal * (stopping.min(self.speed) / distance.max(1e-12)), 0.0)
            }
            Course::Curve(..) => (Vector2::zeros(), 0.0),
        };
        let change = wanted - velocity;
        let velocity = velocity + change * (self.acceleration * dt / change.norm().max(1e-12)).min(1.0);
        let yaw_rate = yaw_rate + (turn - yaw_rate).clamp(-YAW_ACCELERATION * dt, YAW_ACCELERATION * dt);
        let next = position + velocity * dt;
        let lead = next - ball;
        let held = (lead.norm() > self.ahead && lead.dot(&velocity) > 0.0) || self.within(next) != next;
        self.setpoint = Setpoint {
            position: if held { position } else { next },
            velocity: if held { Vector2::zeros() } else { velocity },
            yaw: yaw + yaw_rate * dt,
            yaw_rate,
            ..Setpoint::default()
        };
    }

    /// Has the heading of the robot, for a controller that follows no heading: it drives in the robot's directions.
    pub(crate) fn head(&mut self, yaw: f64) {
        self.setpoint.yaw = yaw;
    }

    /// Is where the ball is, without a goal, for a controller that follows no position.
    pub(crate) fn stay_with(&mut self, ball: Vector2<f64>) {
        if matches!(self.course, Course::Goal(_)) {
            self.course = Course::Drive([0.0; 3]);
        }
        self.setpoint.position = ball;
    }

    /// Rests at a place.
    pub(crate) fn rest_at(&mut self, place: Vector2<f64>) {
        self.setpoint = Setpoint { position: place, ..Setpoint::default() };
        self.course = Course::Goal(place);
    }
}
