//! A payload that moves on the body.

use super::Params;
use crate::error::{Error, Result, check};
use crate::payload::Deflection;
use nalgebra::{Matrix3, Vector3};
use std::fmt::Display;

/// Least eigenvalue of the inertia of the body without its payload, as a fraction of the inertia with it.
const LEAST_INERTIA: f64 = 1e-6;

/// Offsets and products of inertia below this fraction of the lengths and of the inertia are rounding.
const ROUNDING: f64 = 1e-14;

/// Largest stiffness and damping of a payload for a time step: k dt² / m and c dt / m with the reduced mass m. The integration
/// gains energy above 4 and 2.
const MOST_PER_STEP: f64 = 1.0;

/// Largest deflection and offset of the rest, m, and rate of a deflection, m/s, along an axis.
const MAX_DEFLECTION: f64 = 1000.0;

impl Params {
    /// Whether a payload moves on the body.
    pub fn has_payload(&self) -> bool {
        self.payload_mass > 0.0
    }

    /// Place of the payload at rest, body frame, m.
    fn payload_place(&self) -> Vector3<f64> {
        self.payload_position.into()
    }

    /// The same robot with its payload fixed to the body at its place.
    #[must_use]
    pub fn with_payload_fixed(&self) -> Self {
        Self { payload_mass: 0.0, ..self.clone() }
    }

    /// The body alone, without its payload: the rigid body of the models. The robot itself if it has none.
    #[must_use]
    pub fn without_payload(&self) -> Self {
        if !self.has_payload() {
            return self.clone();
        }
        self.loaded(-self.payload_mass, &self.payload_place())
    }

    /// The robot with a payload of `mass` kg at `position` (body frame, m) in place of its present payload: the body alone
    /// stays the same, and `body_*` change. The result may be invalid.
    #[must_use]
    pub fn with_payload(&self, mass: f64, position: [f64; 3]) -> Self {
        let loaded = self.without_payload().loaded(mass, &position.into());
        Self { payload_mass: mass, payload_position: position, ..loaded }
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
            payload_mass: 0.0,
            ..self.clone()
        }
    }

    /// Checks that the payload can have a deflection, `name` in messages.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] for a robot without payload, unless all numbers are zero; [`Error::OutOfRange`] for a number that
    /// is not finite or beyond 1000 m or 1000 m/s.
    pub fn validate_deflection(&self, name: &dyn Display, deflection: &Deflection<f64>) -> Result<()> {
        let numbers = deflection.to_array();
        if !self.has_payload() && numbers.iter().any(|&number| number != 0.0) {
            let text = format!("{name} must be zero: the robot has no payload, payload_mass is 0 kg");
            return Err(Error::Inconsistent(text));
        }
        for (i, number) in numbers.into_iter().enumerate() {
            let words = format_args!("within ±{MAX_DEFLECTION}");
            check(format_args!("{name}[{i}]"), number, words, |x| x.abs() <= MAX_DEFLECTION)?;
        }
        Ok(())
    }

    /// Checks an offset of the rest of the payload, body axes, m.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] without a payload; [`Error::OutOfRange`] for a number beyond ±1000 m.
    pub fn validate_offset(&self, offset: [f64; 3]) -> Result<()> {
        if !self.has_payload() {
            return Err(Error::Inconsistent("a payload moves: payload_mass = 0 kg, the robot has none".into()));
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

    /// Checks that time steps of `sim_dt` seconds are short enough for the springs and dampers of the payload.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] naming what is too stiff.
    pub fn validate_payload_step(&self, sim_dt: f64) -> Result<()> {
        if !self.has_payload() {
            return Ok(());
        }
        let alone = self.without_payload();
        let arm = self.payload_place() - alone.body_com();
        // An upper bound of the mobility of the body at the payload, without contacts.
        let least = smallest_moment(&alone);
        let compliance = self.payload_mass.recip() + alone.body_mass.recip() + arm.norm_squared() / least;
        for (name, values, per) in [
            ("payload_stiffness", self.payload_stiffness, sim_dt * sim_dt),
            ("payload_damping", self.payload_damping, sim_dt),
        ] {
            let most = MOST_PER_STEP / (compliance * per);
            for (i, value) in values.into_iter().enumerate() {
                let words = format_args!("at most {most} for time steps of {sim_dt} s: sim_dt must be smaller");
                check(format_args!("{name}[{i}]"), value, words, |v| v <= most)?;
            }
        }
        Ok(())
    }

    pub(super) fn validate_payload(&self) -> Result<()> {
        if !self.has_payload() {
            return Ok(());
        }
        let rest = self.body_mass - 3.0 * self.wheel_mass;
        let words = format_args!("below {rest} kg, body_mass without the wheels: it is part of body_mass");
        check("payload_mass", self.payload_mass, words, |mass| mass < rest)?;
        let alone = self.without_payload();
        let whole = smallest_moment(self);
        let least = LEAST_INERTIA * whole;
        let moment = smallest_moment(&alone);
        check(
            "the smallest moment of inertia of the body without payload_mass at payload_position",
            moment,
            format_args!("at least {least} kg·m²: body_inertia is of the body with its payload"),
            |moment| moment >= least,
        )?;
        alone.validate_masses()?;
        for (i, stiffness) in self.payload_stiffness.into_iter().enumerate() {
            let words = "above 0 with a payload: nothing else holds it";
            check(format_args!("payload_stiffness[{i}]"), stiffness, words, |k| k > 0.0)?;
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
