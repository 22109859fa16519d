//! Checks of the contents of a file, and their errors.

use ballbot_base::error::{Error, Result};
use ballbot_base::files;
use std::path::Path;

/// A value, or the reason why its file is rejected; [`invalid_file`] adds the file name.
pub(super) type Checked<T> = std::result::Result<T, String>;

/// Largest position error, m, and largest direction error that count as rounding in a file.
pub(super) const TOLERANCE: f64 = 1e-6;

/// Largest URDF, bytes. URDFs of robots have some ten thousand.
const MAX_SIZE: u64 = 16 << 20;

pub(super) fn read_file(path: &Path) -> Result<String> {
    files::read_text(path, MAX_SIZE)
}

/// Why the file named `label` is rejected.
pub(super) fn invalid_file(label: &str) -> impl Fn(String) -> Error {
    let file = label.to_owned();
    move |reason| Error::Urdf { file: file.clone(), reason }
}
