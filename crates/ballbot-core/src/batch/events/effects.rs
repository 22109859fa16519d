//! Events that would change nothing, or that a model does not simulate.

use super::event::{Event, FORCE, invalid_event};
use crate::robot::ModelKind;
use ballbot_base::error::Result;
use ballbot_base::fields::Fields;
use ballbot_base::params::Params;

/// Parameters of slip.
const SLIP: [&str; 10] = [
    "wheel_preload",
    "wheel_static_friction",
    "wheel_dynamic_friction",
    "floor_static_friction",
    "floor_dynamic_friction",
    "friction_critical_velocity",
    "floor_friction_gradient",
    "floor_patch_size",
    "floor_patch_friction",
    "floor_patch_seed",
];

/// Checks that each event changes something of a robot with `params`, or is optional.
///
/// # Errors
/// [`crate::Error::Inconsistent`] with place and term of an event that does not.
pub fn check_effects(events: &[Event], model: ModelKind, params: &Params) -> Result<()> {
    let without_slip = matches!(model, ModelKind::Planar | ModelKind::Spatial);
    let acts = |name: &str, value: f64| value > 0.0 || events.iter().any(|event| event.term == name);
    let rollers =
        acts("roller_friction", params.roller_friction) || acts("roller_friction_slope", params.roller_friction_slope);
    let planar = |event: &&Event| model == ModelKind::Planar && event.term == FORCE;
    if let Some((place, event)) = events.iter().enumerate().find(|(_, event)| planar(event)) {
        let reason = "the model 'planar' has no force over time: use 'spatial', 'contact' or 'rigid'";
        return Err(invalid_event(place, &event.term, &reason));
    }
    for (place, event) in events.iter().enumerate().filter(|(_, event)| !event.optional) {
        let term = event.term.as_str();
        if without_slip
            && SLIP.contains(&term)
            && !(rollers && matches!(term, "wheel_dynamic_friction" | "wheel_preload"))
        {
            let reason = format!(
                "the model '{model}' has no slip, so it changes nothing; 'contact' and 'rigid' have slip, and optional = true \
                 accepts the event on every model"
            );
            return Err(invalid_event(place, term, &reason));
        }
        if matches!(term, "roller_count" | "roller_phases") && !acts("roller_ripple", params.roller_ripple) {
            let reason = "without roller_ripple it changes nothing: the wheels are round";
            return Err(invalid_event(place, term, &reason));
        }
        let missing = needs(term).iter().find(|(name, still)| {
            let index = Params::index_of(name).expect("the name of a parameter");
            let at_rest = params.values(index).iter().all(|value| value == still);
            at_rest && !events.iter().any(|event| event.term == *name)
        });
        if let Some((name, _)) = missing {
            return Err(invalid_event(place, term, &format!("without {name} it changes nothing")));
        }
    }
    Ok(())
}

/// Whether a term makes floor friction differ from place to place, which models without slip reject.
pub fn makes_friction_uneven(term: &str) -> bool {
    term == "floor_friction_gradient" || term.starts_with("floor_patch_")
}

/// Parameters of a perturbed floor or a payload that a term needs, with the values at which they have no effect.
fn needs(term: &str) -> &'static [(&'static str, f64)] {
    match term {
        "floor_patch_size" => &[("floor_patch_friction", 1.0)],
        "floor_patch_friction" => &[("floor_patch_size", 0.0)],
        "floor_patch_seed" => &[("floor_patch_size", 0.0), ("floor_patch_friction", 1.0)],
        "payload_position" | "payload_stiffness" | "payload_damping" | "payload_amplitude" => &[("payload_mass", 0.0)],
        "payload_period" | "payload_phases" => &[("payload_mass", 0.0), ("payload_amplitude", 0.0)],
        "second_payload_position"
        | "second_payload_stiffness"
        | "second_payload_damping"
        | "second_payload_amplitude" => &[("second_payload_mass", 0.0)],
        "second_payload_period" | "second_payload_phases" => {
            &[("second_payload_mass", 0.0), ("second_payload_amplitude", 0.0)]
        }
        "floor_tilt_period" | "floor_tilt_phases" => &[("floor_tilt_amplitude", 0.0)],
        "floor_acceleration_period" | "floor_acceleration_phase" | "floor_acceleration_rise" => {
            &[("floor_acceleration", 0.0)]
        }
        _ => &[],
    }
}
