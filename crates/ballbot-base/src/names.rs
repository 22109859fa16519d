//! Selection by name.

use crate::error::{Error, Result};

/// The element of `all` named `name`; `kind` describes the elements in the error.
///
/// # Errors
/// [`Error::UnknownName`] with the names of all elements.
pub fn find<T: Copy, const N: usize>(
    kind: &'static str,
    name: &str,
    all: [T; N],
    name_of: impl Fn(T) -> &'static str,
) -> Result<T> {
    let found = all.into_iter().find(|one| name_of(*one) == name);
    found.ok_or_else(|| Error::unknown(kind, name, &all.map(name_of)))
}
