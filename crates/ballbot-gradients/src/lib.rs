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

pub use contact::differentiate;
pub use coordinates::force_names;
use coordinates::{coordinate_names, load_names};
pub use parameters::Parameter;

use ballbot_base::state::{Contacts, State};
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
    /// The state after the motion.
    pub next: State,
    /// The contacts of its last step.
    pub contacts: Contacts,
    /// Whether a contact changed its mode from one step to another.
    pub modes_changed: bool,
    /// Smallest distance of a step from other modes: see [`ballbot_contact::StepModes::margin`].
    pub margin: f64,
}

impl Jacobian {
    /// Names of the states, the rows of A and columns of A and C. Robots with losses
    /// ([`Params::has_losses`](ballbot_base::Params::has_losses)) have contact forces of the last step as further
    /// states, because the losses of a step depend on them.
    pub fn state_names(&self) -> Vec<String> {
        let mut names = coordinate_names();
        names.extend(load_names());
        names.truncate(self.a.ncols());
        names
    }

    /// Numbers of states, torques and parameters.
    fn columns(&self) -> [usize; 3] {
        [self.a.ncols(), self.b.ncols(), self.p.ncols()]
    }
}
