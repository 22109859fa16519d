//! Requests that do not fit are rejected.

use ballbot_core::{require_memory, try_zeros};

#[test]
fn requests_beyond_memory_are_rejected_with_need_and_limit() {
    let error = require_memory("a robot", 1 << 40, 1 << 20).unwrap_err().to_string();
    assert!(error.starts_with("a robot needs about 1152921504.6 GB of memory: "), "{error}");
    assert!(require_memory("a robot", usize::MAX, usize::MAX).is_err());
    assert!(require_memory("a robot", 1 << 20, 32).is_ok());
    assert_eq!(try_zeros::<u8>("a picture", &[2, 3]).unwrap(), [0; 6]);
    assert!(try_zeros::<u8>("a picture", &[usize::MAX, 2]).is_err());
}
