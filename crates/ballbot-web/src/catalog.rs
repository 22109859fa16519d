//! What the page offers: lines of names and numbers.

use crate::scene::ROW;
use crate::target::CURVES;
use ballbot_core::control::controller_kinds;
use ballbot_core::terrain::TerrainKind;
use ballbot_core::{Params, Result};
use std::fmt::Write;

/// Lines of columns separated by tabs. The first column is the kind of the line:
///
/// - `row`: name and length of a part of a robot's row;
/// - `controller`: name, label, summary;
/// - `terrain`: name, description;
/// - `curve`: name, along which the target moves;
/// - `robot`: name; then its parameters as `name=numbers`, separated by spaces.
///
/// # Errors
/// A preset that is not valid.
pub fn catalog() -> Result<String> {
    let mut lines = String::new();
    let mut line = |columns: &[&str]| {
        let one_line = |text: &&str| text.split_whitespace().collect::<Vec<_>>().join(" ");
        let columns: Vec<_> = columns.iter().map(one_line).collect();
        // Writing to a string does not fail.
        let _ = writeln!(lines, "{}", columns.join("\t"));
    };
    for (name, len) in ROW {
        line(&["row", name, &len.to_string()]);
    }
    for kind in controller_kinds() {
        line(&["controller", kind.name, kind.label, kind.summary]);
    }
    for kind in TerrainKind::ALL {
        line(&["terrain", kind.name, kind.doc]);
    }
    for name in CURVES {
        line(&["curve", name]);
    }
    for name in Params::preset_names() {
        let params = Params::preset(name)?;
        let mut values = String::new();
        for (name, numbers) in params.fields() {
            let numbers: Vec<_> = numbers.iter().map(f64::to_string).collect();
            let _ = write!(values, " {name}={}", numbers.join(","));
        }
        line(&["robot", name, values.trim()]);
    }
    Ok(lines)
}
