//! Short texts of objects, for prompts and notebooks; their attributes have all digits.

use std::fmt::Write;

/// Numbers with four digits, in parentheses.
pub(crate) fn numbers(values: &[f64]) -> String {
    let texts: Vec<_> = values.iter().map(|value| number(*value)).collect();
    format!("({})", texts.join(", "))
}

/// A number with four digits.
pub(crate) fn number(value: f64) -> String {
    let size = value.abs();
    if size != 0.0 && !(1e-3..1e5).contains(&size) {
        return format!("{value:.3e}");
    }
    // Four digits: those not before the decimal point follow it.
    let before = if size < 1.0 { 1 } else { size.log10().floor() as usize + 1 };
    let text = format!("{value:.*}", 4_usize.saturating_sub(before));
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if text == "-0" { "0".into() } else { text.into() }
}

/// An HTML table whose rows have a name, numbers and a unit.
pub(crate) fn table<'a>(rows: impl IntoIterator<Item = (&'a str, Vec<f64>, &'a str)>) -> String {
    let mut text = String::from("<table>");
    for (name, values, unit) in rows {
        let numbers: Vec<_> = values.iter().map(|value| number(*value)).collect();
        let _ = write!(text, "<tr><td>{name}</td><td>{}</td><td>{unit}</td></tr>", numbers.join(", "));
    }
    text + "</table>"
}
