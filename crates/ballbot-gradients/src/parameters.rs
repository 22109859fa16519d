//! Derivatives of the constants of the solver with respect to the parameters of the robot.

use ballbot_base::error::{Error, Result};
use ballbot_base::fields::Fields;
use ballbot_base::params::Params;
use ballbot_contact::{Constants, PrincipalAxes};
use nalgebra::{UnitQuaternion, Vector3};
use std::fmt;

/// Weights of a central difference of eighth order at one to four steps.
pub(crate) const WEIGHTS: [f64; 4] = [4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0];

/// Step of a difference, relative to the scale of its parameter. With it the error of truncation of functions such as
/// 1 / p is below the error of rounding, 1e-13 of the derivative.
const STEP: f64 = 0.01;

/// Step for parameters in which the constants are linear, so that only rounding matters.
const LINEAR_STEP: f64 = 0.25;

/// Smallest relative difference of principal moments whose axes have a derivative: it loses as many digits as they
/// share.
const DISTINCT: f64 = 1e-4;

/// Beginnings of the names of parameters of a payload, and of a floor that moves or has uneven friction.
const WITHOUT: [&str; 6] =
    ["floor_friction_gradient", "floor_patch_", "floor_tilt_", "floor_acceleration", "payload_", "second_payload_"];

/// A parameter, or an element of a parameter.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Parameter {
    field: usize,
    element: usize,
}

impl Parameter {
    /// The parameter `name`, each of its elements, or its element `name[i]`.
    ///
    /// # Errors
    /// [`Error::UnknownName`]; [`Error::Inconsistent`] for `roller_count`, a whole number, and for parameters of a payload
    /// and of a floor that moves or has uneven friction.
    pub fn named(name: &str) -> Result<Vec<Self>> {
        let (field_name, index) = match name.split_once('[') {
            Some((field, rest)) => {
                let index = rest.strip_suffix(']').and_then(|index| index.parse::<usize>().ok());
                (field, index.filter(|index| format!("{field}[{index}]") == name))
            }
            None => (name, None),
        };
        let field = Params::index_of(field_name).filter(|_| index.is_some() == name.contains('['));
        let Some(field) = field.filter(|field| index.is_none_or(|index| index < Params::FIELDS[*field].len)) else {
            let known: Vec<_> = Params::FIELDS.iter().map(|field| field.name).collect();
            return Err(Error::unknown("parameter", name, &known));
        };
        if Params::FIELDS[field].name == "roller_count" {
            return Err(Error::Inconsistent("roller_count is a whole number, so it has no derivative".into()));
        }
        if WITHOUT.iter().any(|prefix| Params::FIELDS[field].name.starts_with(prefix)) {
            return Err(Error::Inconsistent(format!("derivatives with respect to {field_name} are not computed")));
        }
        let elements = index.map_or(0..Params::FIELDS[field].len, |index| index..index + 1);
        Ok(elements.map(|element| Self { field, element }).collect())
    }

    /// Derivatives of the solver's constants.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] where the principal axes of the body have no derivative.
    pub(crate) fn slopes(&self, params: &Params, sim_dt: f64) -> Result<Constants<f64>> {
        if self.name() == "roller_ripple" && params.roller_ripple == 0.0 {
            return Err(Error::Inconsistent(
                "roller_ripple = 0: round wheels have no derivative with respect to it; give them a small ripple"
                    .into(),
            ));
        }
        let axes = PrincipalAxes::new(params);
        let mut slopes = if ["body_inertia", "body_products_of_inertia"].contains(&self.name()) {
            let turning = self.turning(params, &axes)?;
            difference(turning.step(&axes), |amount| Constants::in_axes(params, sim_dt, &turning.axes(&axes, amount)))
        } else {
            let step = self.step(params, LINEAR_STEP);
            difference(step, |amount| Constants::in_axes(&self.changed(params, amount), sim_dt, &axes))
        };
        // What a parameter turns on or off.
        let Constants { general, loss_share, has_losses_or_rollers, has_preload, inclined, .. } = &mut slopes;
        for switch in [general, loss_share, has_losses_or_rollers, has_preload, inclined] {
            *switch = 0.0;
        }
        Ok(slopes)
    }

    /// Parameters of which this is changed.
    pub(crate) fn changed(&self, params: &Params, amount: f64) -> Params {
        let mut changed = params.clone();
        changed.values_mut(self.field)[self.element] += amount;
        changed
    }

    /// Whether it is a loss, which may be zero.
    pub(crate) fn is_loss(&self) -> bool {
        Params::LOSSES.contains(&self.name())
    }

    pub(crate) fn name(&self) -> &'static str {
        Params::FIELDS[self.field].name
    }

    /// Change of the principal axes per change of a moment or product of inertia.
    fn turning(&self, params: &Params, axes: &PrincipalAxes) -> Result<Turning> {
        let mut change = Params { body_inertia: [0.0; 3], body_products_of_inertia: [0.0; 3], ..params.clone() };
        change.values_mut(self.field)[self.element] = 1.0;
        let rotation = axes.rotation().to_rotation_matrix();
        let change = rotation.transpose() * change.body_inertia_matrix() * rotation;
        let moments = axes.moments;
        let largest = moments.into_iter().fold(0.0, f64::max);
        let mut rate = Vector3::zeros();
        for (axis, i, j) in [(0, 1, 2), (1, 2, 0), (2, 0, 1)] {
            let apart = moments[i] - moments[j];
            if change[(i, j)].abs() <= f64::EPSILON {
                continue;
            }
            if apart.abs() < DISTINCT * largest {
                return Err(Error::Inconsistent(format!(
                    "two principal moments of inertia of the body, {} and {} kg·m², are within {DISTINCT} of each other, \
                     so its principal axes have no accurate derivative with respect to {self}",
                    moments[i], moments[j]
                )));
            }
            rate[axis] = change[(i, j)] / apart;
        }
        Ok(Turning { rate, moments: change.diagonal() })
    }

    /// Step of a difference along the parameter; `linear` of the size of friction and losses, at least 1.
    pub(crate) fn step(&self, params: &Params, linear: f64) -> f64 {
        let field = &Params::FIELDS[self.field];
        let value = params.values(self.field)[self.element];
        match field.name {
            name if field.required || ["gravity", "friction_critical_velocity"].contains(&name) => STEP * value,
            "body_com_offset" => STEP * params.body_com_height,
            "body_products_of_inertia" => STEP * params.body_inertia.into_iter().fold(f64::INFINITY, f64::min),
            _ if field.unit == "rad" => STEP,
            _ => linear * value.max(1.0),
        }
    }
}

/// Change of the principal axes of a body, per unit of a parameter.
struct Turning {
    /// Rotation vector, principal frame.
    rate: Vector3<f64>,
    moments: Vector3<f64>,
}

impl Turning {
    fn step(&self, axes: &PrincipalAxes) -> f64 {
        let growth = self.moments.iter().zip(axes.moments).map(|(change, moment)| (change / moment).abs());
        STEP / growth.fold(self.rate.norm(), f64::max)
    }

    fn axes(&self, axes: &PrincipalAxes, amount: f64) -> PrincipalAxes {
        let rotation = axes.rotation() * UnitQuaternion::from_scaled_axis(self.rate * amount);
        let moments = [0, 1, 2].map(|i| self.moments[i].mul_add(amount, axes.moments[i]));
        PrincipalAxes { rotation: Some(rotation), moments }
    }
}

/// Derivative of constants at zero; exactly zero for those that do not change.
fn difference(step: f64, constants: impl Fn(f64) -> Constants<f64>) -> Constants<f64> {
    let mut sum = Constants::<f64>::default();
    for (k, weight) in WEIGHTS.iter().enumerate() {
        let offset = (k + 1) as f64 * step;
        let mut change = constants(offset);
        change.zip_mut(&constants(-offset), |change, value| *change -= value);
        sum.zip_mut(&change, |sum, change| *sum = weight.mul_add(*change, *sum));
    }
    sum.map(|sum| sum / step)
}

impl fmt::Display for Parameter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let field = &Params::FIELDS[self.field];
        if field.len == 1 { f.write_str(field.name) } else { write!(f, "{}[{}]", field.name, self.element) }
    }
}
