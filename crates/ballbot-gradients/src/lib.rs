//! Derivatives of the motion of a ballbot, through contact and slip.
//!
//! With the modes of its contacts fixed a step is smooth, and its impulses solve linear equations, so its derivatives are
//! exact. They are computed by forward differentiation of the code of the step itself ([`Dual`]).
//!
//! [`Dual`]: ballbot_base::lanes::Dual

#![warn(clippy::print_stdout, clippy::print_stderr, clippy::unwrap_used)]

mod contact;
mod coordinates;
mod parameters;
mod rolling;

pub use contact::Differentiated;
use coordinates::{COORDINATES, LOADS, coordinate_names, states};
pub use coordinates::{FORCES, force_names};
pub use parameters::Parameter;
pub use rolling::{ROLLING, RollingJacobian, along_rolling, rolling_change};

use ballbot_base::state::{Contacts, State};
use ballbot_base::wheels::WHEELS;
use ballbot_contact::Kinds;
use nalgebra::DMatrix;

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
    /// Smallest distance of a step from other modes: see [`ballbot_contact::SolvedStep::margin`].
    pub margin: f64,
    /// Modes of the contacts in the first and the last step.
    kinds: [Kinds; 2],
}

/// Names of the states, the rows of A and columns of A and C. Robots with losses
/// ([`Params::has_losses`](ballbot_base::Params::has_losses)) have contact forces of the last step as further states,
/// because the losses of a step depend on them.
pub fn state_names(with_loads: bool) -> Vec<String> {
    let mut names = coordinate_names();
    if with_loads {
        let forces = force_names();
        names.extend(LOADS.map(|force| forces[force].clone()));
    }
    names
}

/// Memory of a [`Jacobian`] with respect to a number of parameters, bytes; of a robot with or without losses.
pub fn bytes_of(parameters: usize, with_loads: bool) -> usize {
    let states = states(with_loads);
    size_of::<Jacobian>() + (states + FORCES) * (states + WHEELS + parameters) * size_of::<f64>()
}

impl Jacobian {
    /// The derivatives of this motion and the next, under the same torques.
    fn followed_by(&self, next: Self) -> Self {
        Self {
            a: &next.a * &self.a,
            b: &next.a * &self.b + next.b,
            p: &next.a * &self.p + next.p,
            c: &next.c * &self.a,
            d: &next.c * &self.b + next.d,
            q: &next.c * &self.p + next.q,
            modes_changed: self.modes_changed || next.modes_changed || self.kinds[1] != next.kinds[0],
            margin: self.margin.min(next.margin),
            kinds: [self.kinds[0], next.kinds[1]],
            level: self.level,
            start: self.start.clone(),
            next: next.next,
            contacts: next.contacts,
        }
    }

    fn is_finite(&self) -> bool {
        let Self { a, b, p, c, d, q, .. } = self;
        [a, b, p, c, d, q].into_iter().flatten().all(|number| number.is_finite())
    }

    /// Whether contact forces of the last step are states.
    pub fn with_loads(&self) -> bool {
        self.a.ncols() > COORDINATES
    }

    /// Numbers of states, torques and parameters.
    pub fn columns(&self) -> [usize; 3] {
        [self.a.ncols(), self.b.ncols(), self.p.ncols()]
    }
}
