//! Conversions from array-likes and to NumPy arrays.

use nalgebra::{DMatrix, Vector3};
use numpy::ndarray::Array2;
use numpy::{
    AllowTypeChange, Element, PyArray1, PyArray2, PyArrayDescrMethods, PyArrayLikeDyn, PyUntypedArray,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

/// Element types of array-likes.
pub(crate) trait Number: Element + Copy + for<'a, 'py> FromPyObject<'a, 'py> {}
impl<T: Element + Copy + for<'a, 'py> FromPyObject<'a, 'py>> Number for T {}

/// Reads the elements of an array-like in C order into `out`. `name` is its name in messages; `shape` is the required
/// shape, with `None` for any length along an axis. All real numeric types and memory orders are accepted.
pub(crate) fn read_elements<T: Number>(
    name: &str,
    value: &Bound<'_, PyAny>,
    shape: &[Option<usize>],
    out: &mut Vec<T>,
) -> PyResult<()> {
    let not_numbers = |kind: String| PyTypeError::new_err(format!("{name} must be an array of numbers, not {kind}"));
    if let Ok(untyped) = value.cast::<PyUntypedArray>()
        && untyped.dtype().kind() == b'c'
    {
        return Err(not_numbers("of complex ones".to_owned()));
    }
    let array: PyArrayLikeDyn<'_, T, AllowTypeChange> = value
        .extract()
        .map_err(|_| not_numbers(value.get_type().name().map_or_else(|_| "this".to_owned(), |n| n.to_string())))?;
    let fits = array.shape().len() == shape.len()
        && array.shape().iter().zip(shape).all(|(found, wanted)| wanted.is_none_or(|w| w == *found));
    if !fits {
        let tuple = |sizes: Vec<String>| match sizes.as_slice() {
            [one] => format!("({one},)"),
            _ => format!("({})", sizes.join(", ")),
        };
        let found = tuple(array.shape().iter().map(ToString::to_string).collect());
        let wanted = tuple(shape.iter().map(|d| d.map_or_else(|| "n".to_owned(), |d| d.to_string())).collect());
        return Err(PyValueError::new_err(format!("{name} has shape {found}, expected {wanted}")));
    }
    out.clear();
    // `as_slice` of an array in Fortran order is in that order.
    match array.as_slice() {
        Ok(contiguous) if array.is_c_contiguous() => out.extend_from_slice(contiguous),
        _ => out.extend(array.as_array().iter().copied()),
    }
    Ok(())
}

/// Elements of an array-like, as [`read_elements`].
pub(crate) fn elements<T: Number>(name: &str, value: &Bound<'_, PyAny>, shape: &[Option<usize>]) -> PyResult<Vec<T>> {
    let mut out = Vec::new();
    read_elements(name, value, shape, &mut out)?;
    Ok(out)
}

/// Finite elements of an array-like, as [`read_elements`].
pub(crate) fn finite_elements(name: &str, value: &Bound<'_, PyAny>, shape: &[Option<usize>]) -> PyResult<Vec<f64>> {
    let values = elements(name, value, shape)?;
    ballbot_core::check_finite(name, &values).map_err(crate::errors::to_python)?;
    Ok(values)
}

/// `N` numbers of an array-like.
pub(crate) fn numbers<const N: usize>(name: &str, value: &Bound<'_, PyAny>) -> PyResult<[f64; N]> {
    let values = elements(name, value, &[Some(N)])?;
    Ok(values.try_into().expect("the shape was checked"))
}

/// A vector of three components.
pub(crate) fn vector(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Vector3<f64>> {
    Ok(numbers::<3>(name, value)?.into())
}

/// A vector of three components, or a default.
pub(crate) fn vector_or(name: &str, value: Option<&Bound<'_, PyAny>>, default: Vector3<f64>) -> PyResult<Vector3<f64>> {
    value.map_or(Ok(default), |v| vector(name, v))
}

/// A new one-dimensional array.
pub(crate) fn array<'py>(py: Python<'py>, values: &[f64]) -> Bound<'py, PyArray1<f64>> {
    PyArray1::from_slice(py, values)
}

/// A new two-dimensional array, C order.
pub(crate) fn matrix<'py>(py: Python<'py>, values: &DMatrix<f64>) -> Bound<'py, PyArray2<f64>> {
    PyArray2::from_owned_array(py, Array2::from_shape_fn(values.shape(), |at| values[at]))
}
