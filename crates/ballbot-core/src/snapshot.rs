//! Saved simulations as bytes with a checksum: what was damaged is refused, not simulated.

use crate::error::{Error, Result};
use serde::Serialize;
use serde::de::DeserializeOwned;

const CHECKSUM_LEN: usize = 4;

/// A value as bytes for [`decode`].
pub(crate) fn encode<T: Serialize>(value: &T) -> Vec<u8> {
    let mut bytes = postcard::to_stdvec(value).expect("plain data in memory can be encoded");
    let checksum = crc32fast::hash(&bytes);
    bytes.extend(checksum.to_le_bytes());
    bytes
}

/// The value that [`encode`] encoded; `what` is what messages call it.
pub(crate) fn decode<T: DeserializeOwned>(what: &str, bytes: &[u8]) -> Result<T> {
    let refused = |reason: String| Error::Decode { what: what.to_owned(), reason };
    let (data, checksum) = bytes
        .split_last_chunk::<CHECKSUM_LEN>()
        .ok_or_else(|| refused(format!("{} bytes are too few", bytes.len())))?;
    if crc32fast::hash(data) != u32::from_le_bytes(*checksum) {
        return Err(refused("its checksum does not fit: it is damaged, or something else".into()));
    }
    match postcard::take_from_bytes(data) {
        Ok((value, [])) => Ok(value),
        Ok((_, rest)) => Err(refused(format!("{} bytes too many", rest.len()))),
        Err(error) => Err(refused(error.to_string())),
    }
}
