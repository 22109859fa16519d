//! The controllers: each is one file, and its lines here.

use crate::{ControllerKind, NamedLaw};

mod admittance;
mod cascade_pid;
mod fuzzy_mamdani;
mod hierarchical_sliding_mode;
mod lqi;
mod lqr;
mod lqr_pi;
mod mpc;
mod pd_inverse_dynamics;
mod pid;
mod sliding_mode;
mod takagi_sugeno;

pub use admittance::*;
pub use cascade_pid::*;
pub use fuzzy_mamdani::*;
pub use hierarchical_sliding_mode::*;
pub use lqi::*;
pub use lqr::*;
pub use lqr_pi::*;
pub use mpc::*;
pub use pd_inverse_dynamics::*;
pub use pid::*;
pub use sliding_mode::*;
pub use takagi_sugeno::*;

/// The controllers of this crate, in the order of public lists.
pub(crate) static CONTROLLERS: &[ControllerKind] = &[
    Lqr::KIND,
    Pid::KIND,
    Lqi::KIND,
    LqrPi::KIND,
    Mpc::KIND,
    CascadePid::KIND,
    HierarchicalSlidingMode::KIND,
    PdInverseDynamics::KIND,
    SlidingMode::KIND,
    FuzzyMamdani::KIND,
    TakagiSugeno::KIND,
    Admittance::KIND,
];
