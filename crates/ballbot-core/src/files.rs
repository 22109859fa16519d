//! Files that users name.

use crate::error::{Error, Result};
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;

/// Largest file that is read, bytes.
const MAX_BYTES: u64 = 256 << 20;

/// Opens a file to read it. A device or a pipe is refused: it may have no end.
///
/// # Errors
/// [`Error::Io`] naming the file.
pub(crate) fn open(path: &Path) -> Result<File> {
    let open = || {
        let found = fs::metadata(path)?;
        let refuse = |reason: String| Err(io::Error::new(io::ErrorKind::InvalidInput, reason));
        if !found.is_file() && !found.is_dir() {
            return refuse("it is not a regular file".into());
        }
        if found.len() > MAX_BYTES {
            return refuse(format!("it has {} bytes, the limit is {MAX_BYTES}", found.len()));
        }
        File::open(path)
    };
    open().map_err(|source| Error::Io { path: path.into(), source })
}

/// The text of a file.
///
/// # Errors
/// As [`open`].
pub(crate) fn read_text(path: &Path) -> Result<String> {
    let mut text = String::new();
    open(path)?.read_to_string(&mut text).map_err(|source| Error::Io { path: path.into(), source })?;
    Ok(text)
}

#[cfg(test)]
mod tests;
