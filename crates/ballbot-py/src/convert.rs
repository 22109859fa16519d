//! Conversions from array-likes and to NumPy arrays.

use nalgebra::{DMatrix, Vector3};
use numpy::ndarray::Array2;
use numpy::{
    AllowTypeChange, Element, PyArray1, PyArray2, PyArrayDescrMethods, PyArrayLikeDyn, PyUntypedArray,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyException, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;

/// Element types of array-likes.
pub(crate) trait Number: Element + Copy + for<'a, 'py> FromPyObject<'a, 'py> {
    /// Kinds of NumPy's types that are taken for it.
    const KINDS: &'static [u8];
    /// What they are, in words.
    const NAME: &'static str;
}

impl Number for f64 {
    const KINDS: &'static [u8] = b"biuf";
    const NAME: &'static str = "numbers";
}

impl Number for f32 {
    const KINDS: &'static [u8] = b"biuf";
    const NAME: &'static str = "numbers";
}

impl Number for bool {
    const KINDS: &'static [u8] = b"b";
    const NAME: &'static str = "bools";
}

/// An array-like as an array of the type that NumPy gives it.
fn untyped<'py, T: Number>(name: &str, value: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyUntypedArray>> {
    let py = value.py();
    let wrong = |what: String| PyTypeError::new_err(format!("{name} must be an array of {}, not {what}", T::NAME));
    let kind = || value.get_type().name().map_or_else(|_| "this".to_owned(), |kind| kind.to_string());
    let array = match value.cast_exact::<PyUntypedArray>() {
        Ok(array) => array.clone(),
        Err(_) => {
            static MASKED: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
            static AS_ARRAY: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
            if value.is_instance(MASKED.import(py, "numpy.ma", "MaskedArray")?)? {
                return Err(wrong("a masked one: fill it first".to_owned()));
            }
            let array = AS_ARRAY.import(py, "numpy", "asarray")?.call1((value,)).map_err(|error| {
                // Rows of different lengths, and objects that raise as they are read.
                if error.is_instance_of::<PyException>(py) { wrong(kind()) } else { error }
            })?;
            array.cast_into::<PyUntypedArray>().map_err(|_| wrong(kind()))?
        }
    };
    if !T::KINDS.contains(&array.dtype().kind()) {
        return Err(wrong(format!("{} of dtype {}", kind(), array.dtype())));
    }
    Ok(array)
}

/// Reads the elements of an array-like in C order into `out`. `name` is its name in messages; `shape` is the required
/// shape, with `None` for any length along an axis. All real numeric types and memory orders are accepted; text, times,
/// objects, complex numbers and masked arrays are not.
pub(crate) fn read_elements<T: Number>(
    name: &str,
    value: &Bound<'_, PyAny>,
    shape: &[Option<usize>],
    out: &mut Vec<T>,
) -> PyResult<()> {
    let array: PyArrayLikeDyn<'_, T, AllowTypeChange> = untyped::<T>(name, value)?.extract()?;
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
