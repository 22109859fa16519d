//! Saved simulations as bytes: magic number, format version, data, checksum. What another version wrote, and what was
//! damaged, is refused.

use crate::error::{Error, Result};
use serde::Serialize;
use serde::de::DeserializeOwned;

const MAGIC: [u8; 4] = *b"BBOT";

/// Changes with whatever changes the meaning of the bytes, so that nothing is read as what it is not.
const FORMAT_VERSION: u16 = 1;

const VERSION_LEN: usize = size_of_val(&FORMAT_VERSION);
const CHECKSUM_LEN: usize = 4;

/// A value as bytes for [`decode`].
pub(crate) fn encode<T: Serialize>(value: &T) -> Vec<u8> {
    let mut header = MAGIC.to_vec();
    header.extend(FORMAT_VERSION.to_le_bytes());
    let mut bytes = postcard::to_extend(value, header).expect("plain data in memory can be encoded");
    let checksum = crc32fast::hash(&bytes);
    bytes.extend(checksum.to_le_bytes());
    bytes
}

/// The value that [`encode`] encoded; `what` is what messages call it.
pub(crate) fn decode<T: DeserializeOwned>(what: &str, bytes: &[u8]) -> Result<T> {
    let refused = |reason: String| Error::Decode { what: what.to_owned(), reason };
    let too_few = || refused(format!("{} bytes are too few", bytes.len()));
    let (magic, rest) = bytes.split_first_chunk().ok_or_else(too_few)?;
    let (version, rest) = rest.split_first_chunk::<VERSION_LEN>().ok_or_else(too_few)?;
    let (data, checksum) = rest.split_last_chunk::<CHECKSUM_LEN>().ok_or_else(too_few)?;
    if *magic != MAGIC {
        return Err(refused(format!("it starts with {magic:?}, a snapshot with {MAGIC:?}")));
    }
    let version = u16::from_le_bytes(*version);
    if version != FORMAT_VERSION {
        return Err(refused(format!("it has format version {version}, this library reads version {FORMAT_VERSION}")));
    }
    if crc32fast::hash(&bytes[..bytes.len() - CHECKSUM_LEN]) != u32::from_le_bytes(*checksum) {
        return Err(refused("its checksum does not fit: it is damaged".into()));
    }
    match postcard::take_from_bytes(data) {
        Ok((value, [])) => Ok(value),
        Ok((_, rest)) => Err(refused(format!("{} bytes too many", rest.len()))),
        Err(error) => Err(refused(error.to_string())),
    }
}

#[cfg(test)]
mod tests;
