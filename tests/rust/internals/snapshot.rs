//! Round trips, and the errors for bytes that are not a snapshot.

use ballbot_base::snapshot::{MAGIC, VERSION, decode, encode};
use ballbot_core::Result;

type Value = (u64, f64);

const VALUE: Value = (7, 0.25);

fn rejection(bytes: &[u8]) -> String {
    let result: Result<Value> = decode("snapshot", bytes);
    result.expect_err("accepted").to_string()
}

#[test]
fn encoded_values_round_trip() {
    assert_eq!(decode::<Value>("snapshot", &encode(&VALUE)).unwrap(), VALUE);
}

#[test]
fn error_of_another_format_version_names_both() {
    let mut bytes = encode(&VALUE);
    bytes[MAGIC.len()..][..2].copy_from_slice(&(VERSION + 1).to_le_bytes());
    assert_eq!(
        rejection(&bytes),
        format!("cannot decode snapshot: its format has version {}, this library reads version {VERSION}", VERSION + 1)
    );
}

#[test]
fn damaged_and_truncated_bytes_are_rejected() {
    let bytes = encode(&VALUE);
    for at in 0..bytes.len() {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0x10;
        rejection(&damaged);
        assert!(at >= 10 || rejection(&bytes[..at]).contains("too few"));
    }
    let longer = [&bytes[..], &[0]].concat();
    assert!(rejection(&longer).contains("checksum"));
}

#[test]
fn values_of_another_type_are_rejected() {
    assert!(rejection(&encode(&(7_u64, 0.25, 1_u8))).contains("1 bytes too many"));
    assert!(decode::<(u64, f64, f64)>("snapshot", &encode(&VALUE)).is_err());
}
