//! The payloads that move on the body.

use super::Params;
use crate::error::{Error, Result, check};
use crate::payload::{Deflection, PAYLOADS};
use nalgebra::{Matrix3, Vector3};
use std::fmt::Display;

/// Least eigenvalue of the inertia of the body without its payloads, as a fraction of the inertia with it.
const LEAST_INERTIA: f64 = 1e-6;

/// Offsets and products of inertia below this fraction of the lengths and of the inertia are rounding.
const ROUNDING: f64 = 1e-14;

/// Largest stiffness and damping of all payloads for a time step: k dt² / m and c dt / m with the reduced mass m. The
/// integration gains energy above 4 and 2.
const MOST_PER_STEP: f64 = 1.0;

/// Largest deflection and offset of the rest, m, and rate of a deflection, m/s, along an axis.
const MAX_DEFLECTION: f64 = 1000.0;

/// The parameters of one payload.
#[derive(Clone, Copy, Debug)]
pub struct PayloadParams {
    /// What the names of its parameters begin with.
    pub name: &'static str,
    /// kg; 0 for none.
    pub mass: f64,
    /// Body frame, m.
    pub position: [f64; 3],
    /// N/m.
    pub stiffness: [f64; 3],
    /// N/(m/s).
    pub damping: [f64; 3],
    /// m.
    pub amplitude: [f64; 3],
    /// s.
    pub period: f64,
    /// rad.
    pub phases: [f64; 3],
}

impl Params {
    /// Whether a payload moves on the body.
    pub fn has_payload(&self) -> bool {
        self.payload_mass > 0.0
    }

    /// The first and the second payload.
    pub fn payloads(&self) -> [PayloadParams; PAYLOADS] {
        [
            PayloadParams {
                name: "payload",
                mass: self.payload_mass,
                position: self.payload_position,
                stiffness: self.payload_stiffness,
                damping: self.payload_damping,
                amplitude: self.payload_amplitude,
                period: self.payload_period,
                phases: self.payload_phases,
            },
            PayloadParams {
                name: "second_payload",
                mass: self.second_payload_mass,
                position: self.second_payload_position,
                stiffness: self.second_payload_stiffness,
                damping: self.second_payload_damping,
                amplitude: self.second_payload_amplitude,
                period: self.second_payload_period,
                phases: self.second_payload_phases,
            },
        ]
    }

    /// Mass of all payloads, kg.
    pub fn mass_of_payloads(&self) -> f64 {
        self.payload_mass + self.second_payload_mass
    }

    /// The same robot with its payloads fixed to the body at their places.
    #[must_use]
    pub fn with_payloads_fixed(&self) -> Self {
        Self { payload_mass: 0.0, second_payload_mass: 0.0, ..self.clone() }
    }

    /// The body alone, without its payloads: the rigid body of the models. The robot itself if it has none.
    #[must_use]
    pub fn without_payloads(&self) -> Self {
        (0..PAYLOADS).fold(self.clone(), |robot, index| robot.without_payload(index))
    }

    /// The robot without one of its payloads.
    fn without_payload(&self, index: usize) -> Self {
        let payload = self.payloads()[index];
        if payload.mass == 0.0 {
            return self.clone();
        }
        self.loaded(-payload.mass, &payload.position.into()).set_payload(index, 0.0, payload.position)
    }

    /// The robot with a payload of `mass` kg at `position` (body frame, m) in place of its present payload `index`: the body
    /// alone stays the same, and `body_*` change. The result may be invalid.
    #[must_use]
    pub fn with_payload(&self, index: usize, mass: f64, position: [f64; 3]) -> Self {
        self.without_payload(index).loaded(mass, &position.into()).set_payload(index, mass, position)
    }

    fn set_payload(self, index: usize, mass: f64, position: [f64; 3]) -> Self {
        if index == 0 {
            Self { payload_mass: mass, payload_position: position, ..self }
        } else {
            Self { second_payload_mass: mass, second_payload_position: position, ..self }
        }
    }

    /// The robot with a point mass, which can be negative, fixed to its body at `place`.
    fn loaded(&self, mass: f64, place: &Vector3<f64>) -> Self {
        let com = self.body_com();
        let whole_mass = self.body_mass + mass;
        let whole_com = (com * self.body_mass + place * mass) / whole_mass;
        let inertia = self.body_inertia_matrix()
            + steiner(self.body_mass, &(com - whole_com))
            + steiner(mass, &(place - whole_com));
        // A payload that is taken off leaves no offsets by rounding.
        let far = com.norm().max(place.norm());
        let whole_com = whole_com.map(|x| if x.abs() < ROUNDING * far { 0.0 } else { x });
        let largest = inertia.amax();
        let inertia = inertia.map(|x| if x.abs() < ROUNDING * largest { 0.0 } else { x });
        Self {
            body_mass: whole_mass,
            body_com_height: whole_com.z,
            body_com_offset: [whole_com.x, whole_com.y],
            body_inertia: [inertia[(0, 0)], inertia[(1, 1)], inertia[(2, 2)]],
            body_products_of_inertia: [inertia[(0, 1)], inertia[(0, 2)], inertia[(1, 2)]],
            ..self.clone()
        }
    }

    /// Checks that the payloads can have deflections, `name` in messages.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] for a payload that the robot does not have, unless all numbers are zero; [`Error::OutOfRange`] for
    /// a number that is not finite or beyond 1000 m or 1000 m/s.
    pub fn validate_deflections(&self, name: &dyn Display, deflections: &[Deflection<f64>; PAYLOADS]) -> Result<()> {
        for (at, (payload, deflection)) in self.payloads().iter().zip(deflections).enumerate() {
            let numbers = deflection.to_array();
            if payload.mass == 0.0 && numbers.iter().any(|&number| number != 0.0) {
                let of = payload.name;
                let text = format!("{name}[{at}] must be zero: the robot has no such payload, {of}_mass is 0 kg");
                return Err(Error::Inconsistent(text));
            }
            for (i, number) in numbers.into_iter().enumerate() {
                let words = format_args!("within ±{MAX_DEFLECTION}");
                check(format_args!("{name}[{at}][{i}]"), number, words, |x| x.abs() <= MAX_DEFLECTION)?;
            }
        }
        Ok(())
    }

    /// Checks an offset of the rest of payload `index`, body axes, m.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] without such a payload; [`Error::OutOfRange`] for a number beyond ±1000 m.
    pub fn validate_offset(&self, index: usize, offset: [f64; 3]) -> Result<()> {
        let Some(payload) = self.payloads().get(index).copied() else {
            return Err(Error::Inconsistent(format!("payload = {index}: a robot has at most {PAYLOADS}, 0 and 1")));
        };
        if payload.mass == 0.0 {
            let name = payload.name;
            return Err(Error::Inconsistent(format!("a payload moves: {name}_mass = 0 kg, the robot has none")));
        }
        for (i, value) in offset.into_iter().enumerate() {
            let words = format_args!("within ±{MAX_DEFLECTION} m");
            check(format_args!("offset[{i}]"), value, words, |v| v.abs() <= MAX_DEFLECTION)?;
        }
        Ok(())
    }

    /// Checks that no payload moves on the body, as `what` requires.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] naming the payload.
    pub fn require_no_payload(&self, what: &str) -> Result<()> {
        if self.has_payload() {
            let mass = self.payload_mass;
            return Err(Error::Inconsistent(format!("{what}: payload_mass = {mass} kg, but it requires 0")));
        }
        Ok(())
    }

    /// Checks that time steps of `sim_dt` seconds are short enough for the springs and dampers of the payloads.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] naming what is too stiff.
    pub fn validate_payload_step(&self, sim_dt: f64) -> Result<()> {
        if !self.has_payload() {
            return Ok(());
        }
        let alone = self.without_payloads();
        let least = smallest_moment(&alone);
        let moving = || self.payloads().into_iter().filter(|payload| payload.mass > 0.0);
        let share = MOST_PER_STEP / moving().count() as f64;
        for payload in moving() {
            // An upper bound of the mobility of the body at the payload, without contacts.
            let arm = Vector3::from(payload.position) - alone.body_com();
            let compliance = payload.mass.recip() + alone.body_mass.recip() + arm.norm_squared() / least;
            for (name, values, per) in
                [("stiffness", payload.stiffness, sim_dt * sim_dt), ("damping", payload.damping, sim_dt)]
            {
                let most = share / (compliance * per);
                for (i, value) in values.into_iter().enumerate() {
                    let words = format_args!("at most {most} for time steps of {sim_dt} s: sim_dt must be smaller");
                    check(format_args!("{}_{name}[{i}]", payload.name), value, words, |v| v <= most)?;
                }
            }
        }
        Ok(())
    }

    pub(super) fn validate_payloads(&self) -> Result<()> {
        if self.second_payload_mass > 0.0 && !self.has_payload() {
            let mass = self.second_payload_mass;
            let text = format!("second_payload_mass = {mass} kg, but payload_mass = 0: there must be a first payload");
            return Err(Error::Inconsistent(text));
        }
        if !self.has_payload() {
            return Ok(());
        }
        let has_two = self.second_payload_mass > 0.0;
        let name = if has_two { "payload_mass + second_payload_mass" } else { "payload_mass" };
        let rest = self.body_mass - 3.0 * self.wheel_mass;
        let words = format_args!("below {rest} kg, body_mass without the wheels: it is part of body_mass");
        check(name, self.mass_of_payloads(), words, |mass| mass < rest)?;
        let alone = self.without_payloads();
        let whole = smallest_moment(self);
        let least = LEAST_INERTIA * whole;
        let moment = smallest_moment(&alone);
        let others = if has_two { " and second_payload_mass at second_payload_position" } else { "" };
        check(
            format_args!("the smallest moment of inertia of the body without payload_mass at payload_position{others}"),
            moment,
            format_args!("at least {least} kg·m²: body_inertia is of the body with its payload"),
            |moment| moment >= least,
        )?;
        alone.validate_masses()?;
        for payload in self.payloads().into_iter().filter(|payload| payload.mass > 0.0) {
            for (i, stiffness) in payload.stiffness.into_iter().enumerate() {
                let words = "above 0 with a payload: nothing else holds it";
                check(format_args!("{}_stiffness[{i}]", payload.name), stiffness, words, |k| k > 0.0)?;
            }
        }
        Ok(())
    }
}

/// Smallest principal moment of inertia of the body, kg·m².
fn smallest_moment(params: &Params) -> f64 {
    params.body_inertia_matrix().symmetric_eigenvalues().min()
}

/// Inertia of a point mass at an offset.
fn steiner(mass: f64, offset: &Vector3<f64>) -> Matrix3<f64> {
    (Matrix3::identity() * offset.norm_squared() - offset * offset.transpose()) * mass
}
