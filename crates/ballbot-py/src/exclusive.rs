//! Values behind Python objects that several threads may access.

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::sync::{RwLock, RwLockReadGuard, RwLockWriteGuard, TryLockError};

/// A value behind a Python object. Methods release the GIL while they compute, so another thread may call a method
/// meanwhile; it gets an error instead of waiting for what may take minutes.
pub(crate) struct Exclusive<T> {
    value: RwLock<T>,
    /// Name of the object for users.
    name: &'static str,
}

impl<T> Exclusive<T> {
    pub(crate) fn new(name: &'static str, value: T) -> Self {
        Self { value: RwLock::new(value), name }
    }

    /// The value to read, or RuntimeError while another call changes it.
    pub(crate) fn read(&self) -> PyResult<RwLockReadGuard<'_, T>> {
        match self.value.try_read() {
            Ok(value) => Ok(value),
            // The panic became an exception; the value is as valid as after any rejected call.
            Err(TryLockError::Poisoned(value)) => Ok(value.into_inner()),
            Err(TryLockError::WouldBlock) => Err(self.busy()),
        }
    }

    /// The value to change, or RuntimeError while another call uses it.
    pub(crate) fn write(&self) -> PyResult<RwLockWriteGuard<'_, T>> {
        match self.value.try_write() {
            Ok(value) => Ok(value),
            Err(TryLockError::Poisoned(value)) => Ok(value.into_inner()),
            Err(TryLockError::WouldBlock) => Err(self.busy()),
        }
    }

    fn busy(&self) -> PyErr {
        PyRuntimeError::new_err(format!(
            "this {} is being used by another thread: give each thread its own, or take turns with a lock",
            self.name
        ))
    }
}
