//! The examples run and end well. `cargo test` builds them together with the tests.

use std::path::PathBuf;
use std::process::Command;

fn run(name: &str, arguments: &[&str]) -> String {
    let mut path: PathBuf = std::env::current_exe().unwrap();
    path.pop();
    path.pop();
    let path = path.join("examples").join(format!("{name}{}", std::env::consts::EXE_SUFFIX));
    let output = Command::new(&path)
        .args(arguments)
        .output()
        .unwrap_or_else(|e| panic!("{}: {e}; `cargo build --examples` makes it", path.display()));
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{name} failed:\n{text}{}", String::from_utf8_lossy(&output.stderr));
    text
}

#[test]
fn balance_runs_on_every_model() {
    for model in ["planar", "spatial", "rigid"] {
        let text = run("balance", &[model]);
        let last = text.lines().last().unwrap_or_default();
        let tilt: f64 = last.split_whitespace().nth(1).and_then(|word| word.parse().ok()).expect("time, then tilt");
        assert!(tilt < 0.5, "{model} ends at {tilt} deg:\n{text}");
    }
}

#[test]
fn push_and_recover_recovers() {
    let text = run("push_and_recover", &[]);
    let value = |label: &str| -> f64 {
        let line = text.lines().find(|line| line.starts_with(label)).unwrap_or_else(|| panic!("no {label}:\n{text}"));
        line[label.len()..].split_whitespace().next().and_then(|word| word.parse().ok()).expect("a number")
    };
    assert!((1.0..4.0).contains(&value("largest tilt")), "{text}");
    assert!(value("excursion") < 60.0, "{text}");
    assert!(value("recovered after") < 3.0, "{text}");
}
