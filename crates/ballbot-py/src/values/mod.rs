//! Values from and to Python: numbers, arrays, tables.

pub(crate) mod convert;
pub(crate) mod fields;
pub(crate) mod keywords;
pub(crate) mod numbers;
pub(crate) mod short;
pub(crate) mod toml_table;
