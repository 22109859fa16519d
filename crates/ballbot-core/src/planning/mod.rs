//! Controllers that simulate: they plan motions of the contact model itself.
//!
//! They are known by name only after [`register`] has been called: the laws of [`crate::control`] do not depend on a
//! simulation.

mod descent;
mod horizon;
mod mppi;
mod nmpc;
mod rollouts;

pub use mppi::{Mppi, MppiOptions};
pub use nmpc::{Nmpc, NmpcOptions};

use crate::control::{ControllerKind, LimitOptions, MOTION_PARTS, controller_kinds, fields_with, register_controller};
use ballbot_base::error::Result;
use ballbot_base::fields::describe_options;

/// The controllers of this module.
const KINDS: [ControllerKind; 2] = [
    ControllerKind {
        name: "mppi",
        summary: "Model predictive path integral control: the best of motions sampled in the contact model.",
        label: "MPPI",
        control_dt: Some(Mppi::CONTROL_DT),
        parts: MOTION_PARTS,
        limits: LimitOptions::TRACTION,
        options: describe_options::<MppiOptions>,
        make: |params, control_dt, limits, options| {
            Ok(Box::new(Mppi::with_options(params, control_dt, &fields_with(options)?, limits)?))
        },
    },
    ControllerKind {
        name: "nmpc",
        summary: "Nonlinear model predictive control: a motion in the contact model, improved along its derivatives.",
        label: "NMPC",
        control_dt: Some(Nmpc::CONTROL_DT),
        parts: MOTION_PARTS,
        limits: LimitOptions::TRACTION,
        options: describe_options::<NmpcOptions>,
        make: |params, control_dt, limits, options| {
            Ok(Box::new(Nmpc::with_options(params, control_dt, &fields_with(options)?, limits)?))
        },
    },
];

/// Registers the controllers of this module by name; does nothing if they are registered.
///
/// # Errors
/// [`crate::Error::Inconsistent`] if another controller has already taken a name.
pub fn register() -> Result<()> {
    let known = controller_kinds();
    let fresh = KINDS.into_iter().filter(|kind| !known.iter().any(|other| other.name == kind.name));
    fresh.into_iter().try_for_each(register_controller)
}
