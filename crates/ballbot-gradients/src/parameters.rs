//! Derivatives of the constants of the solver with respect to the parameters of the robot.

use ballbot_base::error::{Error, Result};
use ballbot_base::fields::Fields;
use ballbot_base::params::Params;
use ballbot_contact::{Constants, PrincipalAxes};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use std::fmt;

/// Weights of a central difference of eighth order at one to four steps.
const WEIGHTS: [f64; 4] = [4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0];

/// Step of a difference, relative to the scale of its parameter. With it the error of truncation of functions such as
/// 1 / p is below the error of rounding, 1e-13 of the derivative.
const STEP: f64 = 0.01;

/// Step for parameters in which the constants are linear, so that only rounding matters.
const LINEAR_STEP: f64 = 0.25;

/// Smallest relative difference of principal moments whose axes have a derivative.
const DISTINCT: f64 = 1e-6;

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
    /// [`Error::UnknownName`]; [`Error::Inconsistent`] for `roller_count`, a whole number.
    pub fn named(name: &str) -> Result<Vec<Self>> {
        let (field_name, index) = match name.split_once('[') {
            Some((field, rest)) => (field, rest.strip_suffix(']').and_then(|index| index.parse::<usize>().ok())),
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
        let elements = index.map_or(0..Params::FIELDS[field].len, |index| index..index + 1);
        Ok(elements.map(|element| Self { field, element }).collect())
    }

    /// Derivatives of the solver's constants.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] where the principal axes of the body have no derivative.
    pub(crate) fn slopes(&self, params: &Params, sim_dt: f64) -> Result<Constants<f64>> {
        let axes = PrincipalAxes::new(params);
        self.check_axes(params, &axes)?;
        let step = self.step(params);
        let mut slopes = Constants::<f64>::default();
        for (k, weight) in WEIGHTS.iter().enumerate() {
            for sign in [1.0, -1.0] {
                let mut changed = params.clone();
                changed.values_mut(self.field)[self.element] += sign * (k + 1) as f64 * step;
                let there = Constants::in_axes(&changed, sim_dt, &aligned(&changed, &axes));
                slopes.zip_mut(&there, |slope, value| *slope += sign * weight * value);
            }
        }
        slopes.zip_mut(&slopes.clone(), |slope, sum| *slope = sum / step);
        // What a parameter turns on or off.
        for switch in [&mut slopes.general, &mut slopes.loss_share, &mut slopes.has_losses_or_ripple] {
            *switch = 0.0;
        }
        Ok(slopes)
    }

    fn step(&self, params: &Params) -> f64 {
        let field = &Params::FIELDS[self.field];
        let value = params.values(self.field)[self.element];
        let inertia = params.body_inertia.iter().copied().fold(f64::INFINITY, f64::min);
        match field.name {
            name if field.required || ["gravity", "friction_critical_velocity"].contains(&name) => STEP * value,
            "body_com_offset" => STEP * params.body_com_height,
            "body_products_of_inertia" => STEP * inertia,
            _ if field.unit == "rad" => STEP,
            _ => LINEAR_STEP * value.max(1.0),
        }
    }

    /// Checks that the principal axes of the body have a derivative, if they depend on the parameter.
    fn check_axes(&self, params: &Params, axes: &PrincipalAxes) -> Result<()> {
        let name = Params::FIELDS[self.field].name;
        if name != "body_products_of_inertia" && !(name == "body_inertia" && axes.turned()) {
            return Ok(());
        }
        let mut moments = axes.moments;
        moments.sort_by(f64::total_cmp);
        let [least, middle, most] = moments;
        if (middle - least).min(most - middle) > DISTINCT * most {
            return Ok(());
        }
        Err(Error::Inconsistent(format!(
            "two principal moments of inertia of the body are equal within {DISTINCT} ({:?} kg·m²), so its principal axes \
             have no derivative with respect to {name}",
            params.body_inertia
        )))
    }
}

impl fmt::Display for Parameter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let field = &Params::FIELDS[self.field];
        if field.len == 1 { f.write_str(field.name) } else { write!(f, "{}[{}]", field.name, self.element) }
    }
}

/// The principal axes of `params` in the order and with the signs of nearby `axes`.
fn aligned(params: &Params, axes: &PrincipalAxes) -> PrincipalAxes {
    if !axes.turned() && params.body_products_of_inertia == [0.0; 3] {
        return PrincipalAxes { rotation: None, moments: params.body_inertia };
    }
    let inertia = params.body_inertia_matrix();
    let found = inertia.symmetric_eigen().eigenvectors;
    let near = axes.rotation().to_rotation_matrix().into_inner();
    let columns = [0, 1, 2].map(|i| {
        let wanted = near.column(i);
        let cosine = |column: usize| found.column(column).dot(&wanted);
        let best = [0, 1, 2].into_iter().max_by(|a, b| cosine(*a).abs().total_cmp(&cosine(*b).abs())).unwrap_or(i);
        found.column(best) * cosine(best).signum()
    });
    let matrix = Matrix3::from_columns(&columns);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix));
    // A quaternion and its negative are the same rotation.
    let before = axes.rotation();
    let rotation = if rotation.coords.dot(&before.coords) < 0.0 {
        UnitQuaternion::new_unchecked(-rotation.into_inner())
    } else {
        rotation
    };
    let moments = [0, 1, 2].map(|i| columns[i].dot(&(inertia * columns[i])));
    PrincipalAxes { rotation: Some(rotation), moments }
}
