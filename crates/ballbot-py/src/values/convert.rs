//! Conversions from array-likes and to NumPy arrays.

use crate::errors::{InvalidInputError, to_python};
use ballbot_core::{Force, try_reserve};
use nalgebra::{DMatrix, Vector3};
use numpy::ndarray::Array2;
use numpy::{
    Element, PyArray1, PyArray2, PyArrayDescrMethods, PyArrayDyn, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyException, PyMemoryError, PyTypeError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyString;

/// Element types of array-likes.
pub(crate) trait Number: Element + Copy + for<'a, 'py> FromPyObject<'a, 'py> {
    /// Kinds of NumPy types that are accepted for it.
    const KINDS: &'static [u8];
    /// Name of these types in messages.
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

/// Length from which a sequence is rejected before NumPy sees it.
const LONG: usize = 1 << 16;

fn too_many(name: &str, found: usize, most: usize) -> PyErr {
    InvalidInputError::new_err(format!("{name} has {found} entries, expected at most {most}"))
}

/// An array-like as an array of the type that NumPy chooses.
fn untyped<'py, T: Number>(name: &str, value: &Bound<'py, PyAny>, most: usize) -> PyResult<Bound<'py, PyUntypedArray>> {
    let py = value.py();
    let wrong = |what: String| PyTypeError::new_err(format!("{name} must be an array of {}, not {what}", T::NAME));
    let kind = || value.get_type().name().map_or_else(|_| "this".to_owned(), |kind| kind.to_string());
    let array = match value.cast_exact::<PyUntypedArray>() {
        Ok(array) => array.clone(),
        Err(_) => {
            // NumPy would turn a whole range into objects.
            if let Ok(len) = value.len()
                && len > most.max(LONG)
            {
                return Err(too_many(name, len, most));
            }
            static MASKED: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
            static AS_ARRAY: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
            if value.is_instance(MASKED.import(py, "numpy.ma", "MaskedArray")?)? {
                return Err(wrong("a masked array: fill it first".to_owned()));
            }
            let array = AS_ARRAY.import(py, "numpy", "asarray")?.call1((value,)).map_err(|error| {
                // Rows of different lengths, and objects that raise as they are read.
                let passes = error.is_instance_of::<PyMemoryError>(py) || !error.is_instance_of::<PyException>(py);
                if passes { error } else { wrong(kind()) }
            })?;
            array.cast_into::<PyUntypedArray>().map_err(|_| wrong(kind()))?
        }
    };
    if !T::KINDS.contains(&array.dtype().kind()) {
        return Err(wrong(format!("{} of dtype {}", kind(), array.dtype())));
    }
    Ok(array)
}

/// Number of dimensions of an array-like, which [`read_elements`] then reads.
pub(crate) fn dimensions<T: Number>(name: &str, value: &Bound<'_, PyAny>, most: usize) -> PyResult<usize> {
    Ok(untyped::<T>(name, value, most)?.ndim())
}

/// Count of elements of an array that only memory limits.
pub(crate) const ANY_COUNT: usize = usize::MAX;

/// Maximum count of numbers of an option or of a motion: the core takes fewer, and reports how many.
pub(crate) const OPTION_COUNT: usize = 4096;

/// A shape in Python notation.
fn tuple(sizes: &[String]) -> String {
    match sizes {
        [one] => format!("({one},)"),
        _ => format!("({})", sizes.join(", ")),
    }
}

/// Checks the shape of an array, and that it has at most `most` elements.
fn check_shape<T: Number>(name: &str, found: &[usize], shape: &[Option<usize>], most: usize) -> PyResult<()> {
    let text = || tuple(&found.iter().map(ToString::to_string).collect::<Vec<_>>());
    let fits =
        found.len() == shape.len() && found.iter().zip(shape).all(|(n, expected)| expected.is_none_or(|w| w == *n));
    if !fits {
        let expected: Vec<_> = shape.iter().map(|d| d.map_or_else(|| "n".to_owned(), |d| d.to_string())).collect();
        return Err(InvalidInputError::new_err(format!("{name} has shape {}, expected {}", text(), tuple(&expected))));
    }
    let count = found.iter().fold(1_usize, |count, n| count.saturating_mul(*n));
    if count > most {
        let what = format!("{name} has shape {}, {count} {}, expected at most {most}", text(), T::NAME);
        return Err(InvalidInputError::new_err(what));
    }
    Ok(())
}

/// Reads the elements of an array-like in C order into `out` and returns them as an array: the only way for an array to
/// enter the core.
///
/// `name` is used in messages; `shape` is the required shape, with `None` for any length along an axis; `most` is the
/// largest count of elements. All real numeric types and memory layouts are accepted; text, times, objects, complex
/// numbers and masked arrays are not. Type, shape and count are checked before anything is copied, and memory is
/// reserved before it is used: a view of a few bytes can have any shape.
pub(crate) fn read_elements<'py, T: Number>(
    name: &str,
    value: &Bound<'py, PyAny>,
    shape: &[Option<usize>],
    most: usize,
    out: &mut Vec<T>,
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    let py = value.py();
    let array = untyped::<T>(name, value, most)?;
    check_shape::<T>(name, array.shape(), shape, most)?;
    out.clear();
    try_reserve(name, out, array.len()).map_err(to_python)?;
    let plain = array.cast::<PyArrayDyn<T>>().is_ok_and(|a| a.is_c_contiguous() && a.data().is_aligned());
    let array = if plain { array } else { array.call_method1("astype", (T::get_dtype(py), "C"))?.cast_into()? };
    let array = array.cast_into::<PyArrayDyn<T>>()?;
    out.extend_from_slice(array.try_readonly()?.as_slice()?);
    Ok(array)
}

/// Elements of an array-like, as [`read_elements`].
pub(crate) fn elements<T: Number>(
    name: &str,
    value: &Bound<'_, PyAny>,
    shape: &[Option<usize>],
    most: usize,
) -> PyResult<Vec<T>> {
    let mut out = Vec::new();
    read_elements(name, value, shape, most, &mut out)?;
    Ok(out)
}

/// Elements of an array-like of this shape, as [`read_elements`].
pub(crate) fn shaped<T: Number, const D: usize>(
    name: &str,
    value: &Bound<'_, PyAny>,
    shape: [usize; D],
) -> PyResult<Vec<T>> {
    elements(name, value, &shape.map(Some), shape.iter().product())
}

/// Finite elements of an array-like, as [`read_elements`].
pub(crate) fn finite_elements(
    name: &str,
    value: &Bound<'_, PyAny>,
    shape: &[Option<usize>],
    most: usize,
) -> PyResult<Vec<f64>> {
    let values: Vec<f64> = elements(name, value, shape, most)?;
    if let Some(at) = values.iter().position(|number| !number.is_finite()) {
        // Its place along each axis; only the first may have any length.
        let (mut place, mut left) = (String::new(), at);
        for length in shape.iter().skip(1).rev() {
            let length = length.unwrap_or(usize::MAX);
            place.insert_str(0, &format!("[{}]", left % length));
            left /= length;
        }
        let number = &values[at..=at];
        ballbot_core::check_finite(&format!("{name}[{left}]{place}"), number).map_err(to_python)?;
    }
    Ok(values)
}

/// The objects of a sequence of at most `most`.
pub(crate) fn objects<'py>(name: &str, value: &Bound<'py, PyAny>, most: usize) -> PyResult<Vec<Bound<'py, PyAny>>> {
    let found = value.len()?;
    if found > most {
        return Err(too_many(name, found, most));
    }
    value.try_iter()?.take(most.saturating_add(1)).collect()
}

/// The names of a sequence of at most `most`.
pub(crate) fn names(name: &str, value: &Bound<'_, PyAny>, most: usize) -> PyResult<Vec<String>> {
    if value.is_instance_of::<PyString>() {
        return Err(PyTypeError::new_err(format!("{name} must be a list of names, not one name")));
    }
    objects(name, value, most)?.iter().map(|one| one.extract()).collect()
}

/// `N` numbers of an array-like.
pub(crate) fn numbers<const N: usize>(name: &str, value: &Bound<'_, PyAny>) -> PyResult<[f64; N]> {
    let values = shaped(name, value, [N])?;
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

/// A vector of three components, or none.
pub(crate) fn optional_vector(name: &str, value: Option<&Bound<'_, PyAny>>) -> PyResult<Option<Vector3<f64>>> {
    value.map(|v| vector(name, v)).transpose()
}

/// The force that `apply_force` describes; without a duration it has no end.
pub(crate) fn outside_force(
    force: &Bound<'_, PyAny>,
    point: Option<&Bound<'_, PyAny>>,
    frequency: f64,
    phase: f64,
    delay: f64,
    duration: Option<f64>,
) -> PyResult<Force> {
    Ok(Force {
        force: vector("force", force)?,
        point: optional_vector("point", point)?,
        frequency,
        phase,
        delay,
        duration: duration.unwrap_or(f64::INFINITY),
    })
}

/// A new one-dimensional array.
pub(crate) fn array<'py>(py: Python<'py>, values: &[f64]) -> Bound<'py, PyArray1<f64>> {
    PyArray1::from_slice(py, values)
}

/// A new two-dimensional array, C order.
pub(crate) fn matrix<'py>(py: Python<'py>, values: &DMatrix<f64>) -> Bound<'py, PyArray2<f64>> {
    PyArray2::from_owned_array(py, Array2::from_shape_fn(values.shape(), |at| values[at]))
}
