//! Controllers that simulate: they sample motions of the contact model itself.
//!
//! They are known by name only after [`register`] has been called: the laws of [`crate::control`] do not depend on a
//! simulation.

mod mppi;
mod rollouts;

pub use mppi::{Mppi, MppiOptions};

use crate::control::{ControllerKind, LimitOptions, MOTION_PARTS, controller_kinds, fields_with, register_controller};
use ballbot_base::error::Result;
use ballbot_base::fields::describe_options;

/// Registers the controllers of this module by name; does nothing if they are registered.
///
/// # Errors
/// [`crate::Error::Inconsistent`] if another controller has already taken the name.
pub fn register() -> Result<()> {
    if controller_kinds().iter().any(|kind| kind.name == "mppi") {
        return Ok(());
    }
    register_controller(ControllerKind {
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
    })
}
