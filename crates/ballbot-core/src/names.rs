//! Choices by their names.

use crate::error::{Error, Result};

/// The one of `all` that `name` names; `kind` says what they are in the error.
///
/// # Errors
/// [`Error::UnknownName`] with the names of all.
pub fn find<T: Copy, const N: usize>(
    kind: &'static str,
    name: &str,
    all: [T; N],
    name_of: impl Fn(T) -> &'static str,
) -> Result<T> {
    let found = all.into_iter().find(|one| name_of(*one) == name);
    found.ok_or_else(|| Error::unknown(kind, name, &all.map(name_of)))
}
