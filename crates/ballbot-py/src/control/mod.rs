//! Controllers, estimators and references.

pub(crate) mod controllers;
pub(crate) mod estimator;
pub(crate) mod reference;
