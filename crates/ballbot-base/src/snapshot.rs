//! Snapshots as bytes: magic number, format version, data, checksum. Damaged and foreign bytes are rejected.

use crate::error::{Error, Result};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// First bytes of all snapshots.
pub const MAGIC: [u8; 4] = *b"BBOT";

/// Version of the layout of all snapshots; incremented whenever a layout changes.
pub const VERSION: u16 = 11;

const HEADER_LEN: usize = MAGIC.len() + size_of::<u16>();
const CHECKSUM_LEN: usize = size_of::<u32>();

/// A value as bytes for [`unpack`], to be part of another snapshot.
pub fn pack<T: Serialize>(value: &T) -> Vec<u8> {
    postcard::to_stdvec(value).expect("plain data in memory can be encoded")
}

/// Decodes the value from [`pack`]; `what` names it in messages.
pub fn unpack<T: DeserializeOwned>(what: &str, bytes: &[u8]) -> Result<T> {
    let invalid = |reason: String| Error::Decode { what: what.to_owned(), reason };
    match postcard::take_from_bytes(bytes) {
        Ok((value, [])) => Ok(value),
        Ok((_, rest)) => Err(invalid(format!("{} bytes too many", rest.len()))),
        Err(error) => Err(invalid(error.to_string())),
    }
}

/// A value as bytes for [`decode`], with header and checksum.
pub fn encode<T: Serialize>(value: &T) -> Vec<u8> {
    let mut bytes = MAGIC.to_vec();
    bytes.extend(VERSION.to_le_bytes());
    bytes.extend(pack(value));
    let checksum = crc32fast::hash(&bytes);
    bytes.extend(checksum.to_le_bytes());
    bytes
}

/// Decodes the value from [`encode`]; `what` names it in messages.
pub fn decode<T: DeserializeOwned>(what: &str, bytes: &[u8]) -> Result<T> {
    let invalid = |reason: String| Error::Decode { what: what.to_owned(), reason };
    if bytes.len() < HEADER_LEN + CHECKSUM_LEN {
        return Err(invalid(format!("{} bytes are too few", bytes.len())));
    }
    let (data, checksum) = bytes.split_at(bytes.len() - CHECKSUM_LEN);
    let (header, data_only) = data.split_at(HEADER_LEN);
    if !header.starts_with(&MAGIC) {
        return Err(invalid("it is not a snapshot of ballbot 0.2 or newer".into()));
    }
    let version = u16::from_le_bytes([header[4], header[5]]);
    if version != VERSION {
        return Err(invalid(format!("its format has version {version}, this library reads version {VERSION}")));
    }
    if crc32fast::hash(data).to_le_bytes() != *checksum {
        return Err(invalid("its checksum does not match: it is damaged".into()));
    }
    unpack(what, data_only)
}
