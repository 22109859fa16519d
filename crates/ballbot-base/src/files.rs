//! Reading of files named by a user or by a user's file.

use crate::error::{Error, Result};
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;

/// The contents of a regular file of at most `limit` bytes. A device or a pipe may block, or never end.
///
/// # Errors
/// [`Error::Io`] for a file that cannot be read, is not a regular file, or is too large.
pub fn read(path: &Path, limit: u64) -> Result<Vec<u8>> {
    let error = |source| Error::Io { path: path.into(), source };
    let other = |reason: String| error(io::Error::other(reason));
    // Before opening: opening a pipe waits for a writer.
    let found = fs::metadata(path).map_err(error)?;
    if !found.is_file() {
        let kind = if found.is_dir() { io::ErrorKind::IsADirectory } else { io::ErrorKind::Other };
        return Err(error(io::Error::new(kind, "not a regular file")));
    }
    let mut contents = Vec::new();
    File::open(path).and_then(|file| file.take(limit + 1).read_to_end(&mut contents)).map_err(error)?;
    if contents.len() as u64 > limit {
        return Err(other(format!("more than {limit} bytes")));
    }
    Ok(contents)
}

/// [`read`] as text.
///
/// # Errors
/// As [`read`]; [`Error::Io`] for text that is not UTF-8.
pub fn read_text(path: &Path, limit: u64) -> Result<String> {
    let invalid = |e| Error::Io { path: path.into(), source: io::Error::new(io::ErrorKind::InvalidData, e) };
    String::from_utf8(read(path, limit)?).map_err(|e| invalid(e.utf8_error()))
}
