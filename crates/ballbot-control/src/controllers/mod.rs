//! The controllers: each is one file and one line of the list below.

use crate::{ControllerKind, NamedLaw};

/// Declares the file of each controller, re-exports its items and registers it, in the order of public lists.
macro_rules! controllers {
    ($($file:ident::$Law:ident,)+) => {
        $(mod $file;)+
        $(pub use $file::*;)+

        /// The controllers of this crate.
        pub(crate) static CONTROLLERS: &[ControllerKind] = &[$(<$Law as NamedLaw>::KIND),+];
    };
}

controllers! {
    lqr::Lqr,
    pid::Pid,
    lqi::Lqi,
    lqr_pi::LqrPi,
    mpc::Mpc,
    cascade_pid::CascadePid,
    hierarchical_sliding_mode::HierarchicalSlidingMode,
    pd_inverse_dynamics::PdInverseDynamics,
    sliding_mode::SlidingMode,
    fuzzy_mamdani::FuzzyMamdani,
    takagi_sugeno::TakagiSugeno,
}
