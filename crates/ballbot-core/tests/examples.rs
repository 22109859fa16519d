//! The examples run and end well. `cargo test` builds them beside the tests.

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
        assert!(text.lines().count() > 5, "{model}: {text}");
    }
}

#[test]
fn push_and_recover_recovers() {
    let text = run("push_and_recover", &[]);
    assert!(text.contains("recover"), "{text}");
}
