//! Derivatives of the motion of a ballbot, through contact and slip.
//!
//! With the modes of its contacts fixed a step is smooth, and its impulses solve linear equations, so its derivatives are
//! exact. They are computed by forward differentiation of the code of the step itself ([`Dual`]).
//!
//! [`Dual`]: ballbot_base::lanes::Dual

#![warn(clippy::print_stdout, clippy::print_stderr, clippy::unwrap_used)]

mod closed_form;
mod contact;
mod coordinates;
mod parameters;
mod rolling;

pub use closed_form::WithoutSlip;
pub use contact::Differentiated;
pub use coordinates::{Coordinates, FORCES, force_names};
pub use parameters::Parameter;
pub use rolling::{ROLLING, RollingJacobian, along_rolling, rolling_change};

use ballbot_base::error::{Error, Result};
use ballbot_base::interrupt::Watch;
use ballbot_base::state::{Contacts, State};
use ballbot_base::wheels::{WHEELS, Wheels};
use ballbot_contact::Kinds;
use nalgebra::DMatrix;

/// Steps that are differentiated at once; longer motions are joined by the chain rule.
const MOST_STEPS: usize = 64;

/// A moving robot, whose motion is differentiated.
pub trait Differentiable {
    /// Advances the robot by a few time steps, under constant motor torques, N·m.
    ///
    /// # Errors
    /// As [`Differentiable::advance`].
    fn advance_some(&mut self, torques: Wheels<f64>, steps: usize) -> Result<Jacobian>;

    /// Largest number of steps that [`Differentiable::advance_some`] takes.
    fn most_steps(&self) -> usize {
        MOST_STEPS
    }

    /// Advances the robot by `steps` time steps, at least one, under constant motor torques, N·m.
    ///
    /// # Errors
    /// [`Error::Diverged`] if the robot diverges; [`Error::Inconsistent`] if its bot touches the floor or its ball the
    /// body, or a derivative is not finite; [`Error::Interrupted`] in [`ballbot_base::stoppable`].
    fn advance(&mut self, torques: Wheels<f64>, steps: usize) -> Result<Jacobian> {
        let mut watch = Watch::new();
        let mut whole: Option<Jacobian> = None;
        let mut left = steps;
        while left > 0 {
            watch.check()?;
            let some = left.min(self.most_steps());
            let part = self.advance_some(torques, some)?;
            whole = Some(match whole {
                Some(before) => before.followed_by(part),
                None => part,
            });
            left -= some;
        }
        let whole =
            whole.ok_or_else(|| Error::OutOfRange { name: "steps".into(), value: 0.0, limit: "at least 1".into() })?;
        if whole.is_finite() {
            return Ok(whole);
        }
        Err(too_sensitive(steps))
    }

    /// Advances the robot by `steps` time steps under each of some torques, at least one, N·m. B and D have three columns
    /// for each.
    ///
    /// # Errors
    /// As [`Differentiable::advance`].
    fn advance_under(&mut self, torques: &[Wheels<f64>], steps: usize) -> Result<Jacobian> {
        let parts = torques.iter().map(|torques| self.advance(*torques, steps)).collect::<Result<Vec<_>>>()?;
        let whole = Jacobian::joined(parts).ok_or_else(|| Error::OutOfRange {
            name: "wheel_torques of a robot".into(),
            value: 0.0,
            limit: "at least 1".into(),
        })?;
        if whole.is_finite() {
            return Ok(whole);
        }
        Err(too_sensitive(steps * torques.len()))
    }
}

fn too_sensitive(steps: usize) -> Error {
    Error::Inconsistent(format!("a derivative over {steps} steps is not finite: the motion is too sensitive"))
}

/// Derivatives of a motion under constant torques.
///
/// With the state x, the torques u, the parameters p, and the contact forces y of the last step:
/// dx' = A dx + B du + P dp and dy = C dx + D du + Q dp.
#[derive(Clone, Debug)]
pub struct Jacobian {
    /// A: the state after the motion by the state before.
    pub a: DMatrix<f64>,
    /// B: the state by the torques, per N·m.
    pub b: DMatrix<f64>,
    /// P: the state by the parameters.
    pub p: DMatrix<f64>,
    /// C: the contact forces by the state before.
    pub c: DMatrix<f64>,
    /// D: the contact forces by the torques.
    pub d: DMatrix<f64>,
    /// Q: the contact forces by the parameters.
    pub q: DMatrix<f64>,
    /// The states.
    pub coordinates: Coordinates,
    /// Whether the ground is level, apart from a tilt of the floor.
    pub level: bool,
    /// The state before the motion.
    pub start: State,
    /// The state after the motion.
    pub next: State,
    /// The contacts of its last step.
    pub contacts: Contacts,
    /// Whether a contact changed its mode from one step to another.
    pub modes_changed: bool,
    /// Smallest distance of a step from other modes: see [`ballbot_contact::SolvedStep::margin`]; infinite without modes.
    pub margin: f64,
    /// Modes of the contacts in the first and the last step, of `contact`.
    kinds: Option<[Kinds; 2]>,
}

/// Memory of a [`Jacobian`] of these states with respect to some torques of the wheels and parameters, bytes.
pub fn bytes_of(coordinates: Coordinates, torques: usize, parameters: usize) -> usize {
    let states = coordinates.count();
    size_of::<Jacobian>() + (states + FORCES) * (states + WHEELS * torques + parameters) * size_of::<f64>()
}

impl Jacobian {
    /// The derivatives of this motion and the next, under the same torques.
    fn followed_by(&self, next: Self) -> Self {
        Self {
            a: &next.a * &self.a,
            b: &next.a * &self.b + &next.b,
            p: &next.a * &self.p + &next.p,
            c: &next.c * &self.a,
            d: &next.c * &self.b + &next.d,
            q: &next.c * &self.p + &next.q,
            ..next.ends(self)
        }
    }

    /// The derivatives of successive motions, each under other torques; B and D have three columns for each motion.
    fn joined(mut parts: Vec<Self>) -> Option<Self> {
        let last = parts.pop()?;
        let columns = WHEELS * parts.len();
        let mut b = last.b.clone().resize_horizontally(columns + WHEELS, 0.0);
        let mut d = last.d.clone().resize_horizontally(columns + WHEELS, 0.0);
        b.columns_mut(columns, WHEELS).copy_from(&last.b);
        d.columns_mut(columns, WHEELS).copy_from(&last.d);
        // The state before the last motion, by the state before the motions from `part` on.
        let mut later = DMatrix::identity(last.a.nrows(), last.a.nrows());
        let mut p = DMatrix::zeros(last.p.nrows(), last.p.ncols());
        for (k, part) in parts.iter().enumerate().rev() {
            let by_torques = &later * &part.b;
            b.columns_mut(WHEELS * k, WHEELS).copy_from(&(&last.a * &by_torques));
            d.columns_mut(WHEELS * k, WHEELS).copy_from(&(&last.c * &by_torques));
            p += &later * &part.p;
            later *= &part.a;
        }
        let (a, c) = (&last.a * &later, &last.c * later);
        let (p, q) = (&last.p + &last.a * &p, &last.q + &last.c * &p);
        let ends = parts.iter().rev().fold(last, |whole, part| whole.ends(part));
        Some(Self { a, b, p, c, d, q, ..ends })
    }

    /// The end of this motion, with the modes of a motion `before` and of this motion.
    fn ends(self, before: &Self) -> Self {
        Self {
            modes_changed: before.modes_changed
                || self.modes_changed
                || before.kinds.map(|kinds| kinds[1]) != self.kinds.map(|kinds| kinds[0]),
            margin: before.margin.min(self.margin),
            kinds: before.kinds.zip(self.kinds).map(|([first, _], [_, last])| [first, last]),
            start: before.start.clone(),
            ..self
        }
    }

    fn is_finite(&self) -> bool {
        let Self { a, b, p, c, d, q, .. } = self;
        [a, b, p, c, d, q].into_iter().flatten().all(|number| number.is_finite())
    }

    /// Numbers of states, torques and parameters.
    pub fn columns(&self) -> [usize; 3] {
        [self.a.ncols(), self.b.ncols(), self.p.ncols()]
    }
}
