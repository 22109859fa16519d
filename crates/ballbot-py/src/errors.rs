//! Core errors and panics as Python exceptions.

use ballbot_core::Error;
use pyo3::exceptions::{PyIsADirectoryError, PyMemoryError, PyOSError, PyRuntimeError, PyTypeError};
use pyo3::{PyErr, PyResult, import_exception};
use std::panic::{AssertUnwindSafe, catch_unwind};

import_exception!(ballbot_rs._errors, DivergedError);
import_exception!(ballbot_rs._errors, UrdfError);
import_exception!(ballbot_rs._errors, InvalidInputError);

/// A core error as the exception that Python users expect.
pub(crate) fn to_python(error: Error) -> PyErr {
    let message = error.to_string();
    match error {
        Error::Urdf { .. } => UrdfError::new_err(message),
        Error::Diverged { .. } => DivergedError::new_err(message),
        Error::Io { path, source } => match source.raw_os_error() {
            // With an errno, OSError becomes FileNotFoundError, PermissionError, ... by itself. Its text has the
            // number.
            Some(code) => {
                let (text, number) = (source.to_string(), format!(" (os error {code})"));
                let text = text.strip_suffix(&number).unwrap_or(&text).to_owned();
                PyOSError::new_err((code, text, path.display().to_string()))
            }
            None if source.kind() == std::io::ErrorKind::IsADirectory => PyIsADirectoryError::new_err(message),
            None => PyOSError::new_err(message),
        },
        Error::Memory { .. } => PyMemoryError::new_err(message),
        _ => InvalidInputError::new_err(message),
    }
}

/// The error for pickling or copying an object of a class that does not support it.
pub(crate) fn not_pickled(class: &str, instead: &str) -> PyResult<()> {
    Err(PyTypeError::new_err(format!("{class} objects cannot be pickled or copied: {instead}")))
}

/// Runs a call into the core; its error becomes an exception, and so does a panic, which would otherwise pass every
/// `except Exception`.
pub(crate) fn call<T>(f: impl FnOnce() -> ballbot_core::Result<T>) -> PyResult<T> {
    match catch_unwind(AssertUnwindSafe(f)) {
        Ok(result) => result.map_err(to_python),
        Err(panic) => {
            let reason = panic
                .downcast_ref::<&str>()
                .map(|s| (*s).to_owned())
                .or_else(|| panic.downcast_ref::<String>().cloned())
                .unwrap_or_else(|| "unknown reason".to_owned());
            Err(PyRuntimeError::new_err(format!("internal error of ballbot_rs, please report it: {reason}")))
        }
    }
}
