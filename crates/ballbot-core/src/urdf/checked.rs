//! Checks of the contents of a file, and their errors.

use crate::error::Error;

/// A value, or the reason why the file it comes from is refused; [`refuse`] adds which file that is.
pub(super) type Checked<T> = std::result::Result<T, String>;

/// Largest position error, m, and largest error of a direction, that count as rounding in a file.
pub(super) const TOLERANCE: f64 = 1e-6;

/// Why the file named `label` is refused.
pub(super) fn refuse(label: &str) -> impl Fn(String) -> Error {
    let file = label.to_owned();
    move |reason| Error::Urdf { file: file.clone(), reason }
}
