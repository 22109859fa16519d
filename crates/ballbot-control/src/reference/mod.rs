//! References: motions with the lean and the torques that they require.
//!
//! In each vertical plane z = y + ℓ θ is a flat output of the linear model (Shomin & Hollis, ICRA 2013): position,
//! lean and torque follow from z and its derivatives, y = z − (ℓ/g) z̈, θ = z̈ / g, u = z⁗ / g − λ² z̈ / g.
//! See `docs/references.md`.

mod jet;
mod motion;
mod spline;
mod traction;

pub use motion::Motion;

use crate::Setpoint;
use crate::parts::lean_planes::LeanPlanes;
use ballbot_base::error::{Error, Result, check};
use ballbot_base::params::Params;
use motion::{FlatOutput, ramped};
use nalgebra::Vector2;
use std::f64::consts::TAU;
use traction::Traction;

/// The heading during a motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turning {
    /// Heading at time 0, rad.
    pub yaw: f64,
    /// Final rate of the heading, rad/s.
    pub rate: f64,
    /// Time to reach that rate, s.
    pub start: f64,
}

impl Default for Turning {
    fn default() -> Self {
        Self { yaw: 0.0, rate: 0.0, start: 1.0 }
    }
}

/// A motion of one robot, as setpoints over time.
#[derive(Clone, Debug)]
pub struct Reference {
    motion: Motion,
    turning: Turning,
    flat: FlatOutput,
    planes: LeanPlanes,
    traction: Traction,
}

/// Largest slowdown in the search for a feasible motion.
const MAX_SLOWDOWN: f64 = 1e3;

impl Reference {
    /// The motion of the robot of `params`. `friction` is the fraction of the wheels' friction limit that it may use;
    /// `None` allows any motion.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] and [`Error::Length`] for numbers that do not define a motion; [`Error::Inconsistent`] for
    /// a motion that requires more traction or torque than available, with a sufficient time.
    pub fn new(params: &Params, motion: Motion, turning: Turning, friction: Option<f64>) -> Result<Self> {
        params.validate()?;
        for (name, value) in [("yaw", turning.yaw), ("yaw_rate", turning.rate)] {
            check(name, value, "within ±1e4", |v| v.abs() <= 1e4)?;
        }
        check("start of the turning", turning.start, "above 0 and at most 1e5 s", |t| t > 0.0 && t <= 1e5)?;
        let planes = LeanPlanes::new(params);
        let flat = flat_output(&motion, &planes)?;
        let reference = Self { motion, turning, flat, planes, traction: Traction::new(params) };
        if let Some(share) = friction {
            reference.check(check_share(share)?)?;
        }
        Ok(reference)
    }

    /// Setpoint at time `t` (s) from the beginning.
    pub fn at(&self, t: f64) -> Setpoint {
        let z = self.flat.at(t);
        let turned = ramped(t, self.turning.start);
        let yaw = self.turning.rate.mul_add(turned.value(), self.turning.yaw);
        // Within ±π for any number of turns.
        let yaw = yaw - TAU * (yaw / TAU).round();
        let derivative = |k: usize| Vector2::new(z[0].derivative(k), z[1].derivative(k));
        let lag = self.planes.lag();
        Setpoint {
            position: derivative(0) - derivative(2) * lag,
            velocity: derivative(1) - derivative(3) * lag,
            acceleration: derivative(2),
            jerk: derivative(3),
            snap: derivative(4),
            yaw,
            yaw_rate: self.turning.rate * turned.derivative(1),
            tilt: Vector2::zeros(),
        }
    }

    /// Whether its setpoints also apply to a robot with `params`: both require the same lean in the motion.
    pub fn suits(&self, params: &Params) -> bool {
        LeanPlanes::new(params).planes == self.planes.planes
    }

    /// The motion of the ball.
    pub fn motion(&self) -> &Motion {
        &self.motion
    }

    /// The heading during the motion.
    pub fn turning(&self) -> Turning {
        self.turning
    }

    /// When the motion ends, s; `None` if it does not.
    pub fn duration(&self) -> Option<f64> {
        self.motion.duration()
    }

    /// When the first turn at full speed of a circle or lemniscate ends, s; `None` for other motions.
    pub fn first_turn(&self) -> Option<f64> {
        self.motion.first_turn()
    }

    /// Largest fraction of an available quantity that the motion uses: the friction limit of a wheel, its load (which
    /// must stay above 0) or the motors' torque.
    pub fn demand(&self) -> f64 {
        /// Number of times at which the demand is computed, and the least number in each piece of the motion.
        const SAMPLES: usize = 1000;
        const LEAST: usize = 40;
        let mut pieces = self.motion.pieces();
        pieces.push([0.0, self.turning.start]);
        let count = (SAMPLES / pieces.len()).max(LEAST);
        let times = pieces
            .iter()
            .flat_map(|[first, last]| (0..=count).map(move |k| first + (last - first) * k as f64 / count as f64));
        times.map(|t| self.demand_at(t)).fold(0.0, f64::max)
    }

    fn demand_at(&self, t: f64) -> f64 {
        let turning = self.turning.rate * ramped(t, self.turning.start).derivative(2);
        self.traction.demand(&self.planes, &self.at(t), turning)
    }

    /// The least factor by which the motion must be slowed down to reduce its demand to `friction`; `None` if no factor
    /// below 1000 suffices.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a fraction outside 0.01 to 1.
    pub fn slowdown(&self, friction: f64) -> Result<Option<f64>> {
        check_share(friction).map(|share| self.least_slowdown(share))
    }

    fn least_slowdown(&self, share: f64) -> Option<f64> {
        let fits = |factor: f64| {
            let motion = self.motion.slowed(factor);
            let turning = Turning { rate: self.turning.rate / factor, ..self.turning };
            let flat = flat_output(&motion, &self.planes).ok()?;
            (Self { motion, turning, flat, ..self.clone() }.demand() <= share).then_some(())
        };
        if fits(1.0).is_some() {
            return Some(1.0);
        }
        let (mut low, mut high) = (1.0, 1.25);
        while fits(high).is_none() {
            (low, high) = (high, high * 1.25);
            if high > MAX_SLOWDOWN {
                return None;
            }
        }
        while high - low > 1e-4 * high {
            let middle = 0.5 * (low + high);
            if fits(middle).is_some() { high = middle } else { low = middle }
        }
        Some(high)
    }

    fn check(&self, share: f64) -> Result<()> {
        let demand = self.demand();
        if demand <= share {
            return Ok(());
        }
        let would_do = match (self.least_slowdown(share), self.duration()) {
            (None, _) => "no slower one does".to_owned(),
            (Some(factor), Some(seconds)) => format!("in {:.4} s it would do", seconds * factor),
            (Some(factor), None) => match self.motion {
                Motion::Circle { period, .. } | Motion::Lemniscate { period, .. } => {
                    format!("with a period of {:.4} s it would do", period * factor)
                }
                Motion::Attitude { lean, .. } => format!("a lean of {:.4} rad would do", lean / (factor * factor)),
                _ => format!("turned {factor:.4} times slower it would do"),
            },
        };
        if demand.is_infinite() {
            return Err(Error::Inconsistent(format!("the motion lifts a wheel off the ball: {would_do}")));
        }
        Err(Error::Inconsistent(format!(
            "the motion takes {demand:.3} of the robot's traction and torque, but {share} is allowed: {would_do}"
        )))
    }
}

fn check_share(friction: f64) -> Result<f64> {
    check("friction", friction, "from 0.01 to 1", |share| (0.01..=1.0).contains(&share))
}

fn flat_output(motion: &Motion, planes: &LeanPlanes) -> Result<FlatOutput> {
    let [x, y] = &planes.planes;
    motion.flat_output(planes.lag(), 0.5 * (x.acceleration + y.acceleration))
}
