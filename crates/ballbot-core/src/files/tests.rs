//! Files that have no end.

use super::read_text;
use std::path::Path;

#[test]
#[cfg(unix)]
fn a_file_without_an_end_is_refused() {
    let error = read_text(Path::new("/dev/zero")).unwrap_err().to_string();
    assert_eq!(error, "cannot read /dev/zero: it is not a regular file");
}
