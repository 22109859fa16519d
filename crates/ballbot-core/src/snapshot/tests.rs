//! What is refused, and in which words.

use super::{FORMAT_VERSION, MAGIC, decode, encode};
use crate::error::Result;

type Value = (u64, f64);

const VALUE: Value = (7, 0.25);

fn refusal(bytes: &[u8]) -> String {
    let result: Result<Value> = decode("snapshot", bytes);
    result.expect_err("accepted").to_string()
}

#[test]
fn a_value_comes_back() {
    assert_eq!(decode::<Value>("snapshot", &encode(&VALUE)).unwrap(), VALUE);
}

#[test]
fn another_version_is_refused_with_both_versions() {
    let mut bytes = encode(&VALUE);
    bytes[MAGIC.len()..][..2].copy_from_slice(&(FORMAT_VERSION + 1).to_le_bytes());
    assert_eq!(
        refusal(&bytes),
        format!(
            "cannot decode snapshot: it has format version {}, this library reads version {FORMAT_VERSION}",
            FORMAT_VERSION + 1
        )
    );
}

#[test]
fn whatever_is_damaged_or_cut_off_is_refused() {
    let bytes = encode(&VALUE);
    for at in 0..bytes.len() {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0x10;
        refusal(&damaged);
        assert!(at >= 10 || refusal(&bytes[..at]).contains("too few"));
    }
    let longer = [&bytes[..], &[0]].concat();
    assert!(refusal(&longer).contains("checksum"));
}

#[test]
fn a_value_of_another_type_is_refused() {
    assert!(refusal(&encode(&(7_u64, 0.25, 1_u8))).contains("1 bytes too many"));
    assert!(decode::<(u64, f64, f64)>("snapshot", &encode(&VALUE)).is_err());
}
