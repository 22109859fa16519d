//! Who may know whom: the layers of the crate, read off the paths in its sources.
//!
//! Parameters, state and kinematics know only each other; the closed-form models and the engine stand on them and never
//! see one another; controllers see a state and the linear model, never a simulation; environments drive robots and know
//! no controller. Each dependency with weight has one owner.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

const BOTTOM: [&str; 10] =
    ["error", "params", "state", "kinematics", "energy", "model", "snapshot", "lanes", "lane_state", "workers"];

/// What each layer above the bottom may use besides the bottom and itself; a longer path is that item alone.
const LAYERS: [(&str, &[&str]); 7] = [
    ("models", &[]),
    ("sim", &[]),
    ("urdf", &[]),
    ("render", &["urdf"]),
    ("control", &["models::LinearModel", "models::linear", "models::traction_torque"]),
    ("robot", &["models", "sim"]),
    ("env", &["robot", "sim"]),
];

/// Dependencies with the only folders that may name them.
const OWNERS: [(&str, &[&str]); 8] = [
    ("rapier3d", &["sim/rigid/"]),
    ("parry3d", &["render/"]),
    ("stl_io", &["render/"]),
    ("urdf_rs", &["urdf/"]),
    ("rayon", &["workers.rs"]),
    ("rand", &["env/"]),
    ("rand_chacha", &["env/"]),
    ("toml", &["params/"]),
];

const MAX_LINES: usize = 500;

/// `source` without comments and string literals, line by line: a string over several lines is taken for code.
fn code(source: &str) -> String {
    let mut out = String::with_capacity(source.len());
    for line in source.lines() {
        let mut in_string = false;
        let mut chars = line.chars().peekable();
        while let Some(c) = chars.next() {
            match c {
                '"' => in_string = !in_string,
                '\\' if in_string => drop(chars.next()),
                '/' if !in_string && chars.peek() == Some(&'/') => break,
                _ if !in_string => out.push(c),
                _ => (),
            }
        }
        out.push('\n');
    }
    out
}

fn is_name(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// Words of the code, `::`, braces and commas; everything else is left out.
fn tokens(code: &str) -> Vec<&str> {
    let mut out = Vec::new();
    let mut rest = code;
    while let Some(c) = rest.chars().next() {
        let length = match c {
            _ if is_name(c) => rest.find(|c| !is_name(c)).unwrap_or(rest.len()),
            ':' if rest.starts_with("::") => 2,
            _ => c.len_utf8(),
        };
        if !c.is_whitespace() {
            out.push(&rest[..length]);
        }
        rest = &rest[length..];
    }
    out
}

/// All paths that start with `crate` or `super`, from the crate's root, braces resolved. `module` is where they stand.
fn paths(code: &str, module: &[&str]) -> Vec<Vec<String>> {
    let tokens = tokens(code);
    let mut found = Vec::new();
    let mut at = 0;
    while at < tokens.len() {
        let start = matches!(tokens[at], "crate" | "super") && tokens.get(at + 1) == Some(&"::");
        if start && (at == 0 || tokens[at - 1] != "::") {
            let mut base: Vec<String> = module.iter().map(|&m| m.to_owned()).collect();
            if tokens[at] == "crate" {
                base.clear();
                at += 2;
            }
            while tokens.get(at) == Some(&"super") {
                base.pop();
                at += 2;
            }
            at = path(&tokens, at, base, &mut found);
        } else {
            at += 1;
        }
    }
    found
}

/// Reads the rest of a path, or of a braced list of paths, that starts at `at`; returns where it ends.
fn path(tokens: &[&str], mut at: usize, mut base: Vec<String>, found: &mut Vec<Vec<String>>) -> usize {
    if tokens.get(at) == Some(&"{") {
        at += 1;
        while at < tokens.len() && tokens[at] != "}" {
            at = if tokens[at] == "," { at + 1 } else { path(tokens, at, base.clone(), found) };
        }
        return at + 1;
    }
    if tokens.get(at) != Some(&"self") {
        base.extend(tokens.get(at).map(|&t| t.to_owned()));
    }
    if tokens.get(at + 1) == Some(&"::") {
        return path(tokens, at + 2, base, found);
    }
    found.push(base);
    // A renamed import ends after its new name.
    if tokens.get(at + 1) == Some(&"as") { at + 3 } else { at + 1 }
}

/// Items that lib.rs re-exports, with the module that they come from.
fn reexports(lib: &str) -> BTreeMap<String, String> {
    let rooted = code(lib).replace("pub use ", "pub use crate::");
    let named = |path: Vec<String>| Some((path.last()?.clone(), path.first()?.clone()));
    paths(&rooted, &[]).into_iter().filter_map(named).collect()
}

/// Whether `layer` may use the item at `path` (from the root, re-exports resolved).
fn allowed(layer: &str, path: &[String]) -> bool {
    let target = path[0].as_str();
    if target == layer || BOTTOM.contains(&target) {
        return true;
    }
    let granted = LAYERS.iter().find(|(name, _)| *name == layer).map_or(&[][..], |(_, granted)| granted);
    granted.iter().any(|grant| grant.split("::").zip(path).filter(|(g, p)| g == p).count() == grant.split("::").count())
}

/// What `file` (relative to src) breaks with `source`.
fn violations(file: &str, source: &str, reexports: &BTreeMap<String, String>) -> Vec<String> {
    let mut out = Vec::new();
    if source.lines().count() > MAX_LINES {
        out.push(format!("{file} has {} lines, limit {MAX_LINES}", source.lines().count()));
    }
    let code = code(source);
    for (dependency, owners) in OWNERS {
        let named = tokens(&code).iter().any(|t| t.strip_suffix("_f64").unwrap_or(t) == dependency);
        if named && !owners.iter().any(|owner| file.starts_with(owner)) {
            out.push(format!("{file} names {dependency}, which is for {} alone", owners.join(" and ")));
        }
    }
    let module: Vec<&str> = file.trim_end_matches(".rs").split('/').filter(|part| *part != "mod").collect();
    if module == ["lib"] {
        return out;
    }
    for mut path in paths(&code, &module) {
        if let Some(origin) = path.first().and_then(|item| reexports.get(item)) {
            path.insert(0, origin.clone());
        }
        // A path to the root itself would let everything in.
        if path.is_empty() || path[0] == "*" || !allowed(module[0], &path) {
            out.push(format!("{file} uses crate::{}", path.join("::")));
        }
    }
    out
}

fn src() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

fn sources(folder: &Path, found: &mut Vec<(String, String)>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            let parts: Vec<_> = path.strip_prefix(src()).unwrap().iter().map(|p| p.to_string_lossy()).collect();
            found.push((parts.join("/"), fs::read_to_string(&path).unwrap()));
        }
    }
}

#[test]
fn layers_see_only_what_is_below_them() {
    let mut files = Vec::new();
    sources(&src(), &mut files);
    assert!(files.len() > 30, "only {} sources found", files.len());
    let lib = &files.iter().find(|(file, _)| file == "lib.rs").expect("the crate has a lib.rs").1;
    let reexports = reexports(lib);
    assert_eq!(reexports["Ballbot"], "robot");
    let broken: Vec<_> = files.iter().flat_map(|(file, source)| violations(file, source, &reexports)).collect();
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

#[test]
fn every_module_of_the_crate_has_its_layer() {
    let lib = fs::read_to_string(src().join("lib.rs")).unwrap();
    for line in code(&lib).lines().filter_map(|l| l.trim_start_matches("pub ").strip_prefix("mod ")) {
        let name = line.trim_end_matches(';');
        assert!(BOTTOM.contains(&name) || LAYERS.iter().any(|(layer, _)| *layer == name), "{name} has no layer");
    }
}

#[test]
fn the_checker_finds_what_it_is_there_for() {
    let reexports = reexports("pub use robot::{Ballbot, ModelKind};\npub use error::Error;\npub use env::Batch;");
    for (file, line, expected) in [
        ("models/spatial.rs", "use crate::sim::RigidMotion;", "models/spatial.rs uses crate::sim::RigidMotion"),
        ("models/mod.rs", "use super::robot::Ballbot;", "models/mod.rs uses crate::robot::Ballbot"),
        ("models/spatial.rs", "use crate::{error::Error, env::{self, Batch}};", "uses crate::env"),
        ("models/planar.rs", "fn f(_: crate::Ballbot) {}", "uses crate::robot::Ballbot"),
        ("sim/rigid/motion.rs", "use super::super::super::models::rk4;", "uses crate::models::rk4"),
        ("sim/rigid/world.rs", "let x = crate::control::Lqr::new();", "uses crate::control::Lqr::new"),
        ("control/lqr.rs", "use crate::models::{LinearModel, SpatialModel};", "uses crate::models::SpatialModel"),
        ("control/mod.rs", "use crate::Batch;", "uses crate::env::Batch"),
        ("control/pid.rs", "use crate::{error::Result, sim as s};", "uses crate::sim"),
        ("env/reward.rs", "use crate::control::Lqr;", "uses crate::control::Lqr"),
        ("error.rs", "use crate::robot::Ballbot;", "error.rs uses crate::robot::Ballbot"),
        ("params.rs", "use super::urdf;", "params.rs uses crate::urdf"),
        ("urdf/mod.rs", "use crate::*;", "urdf/mod.rs uses crate::*"),
        ("models/rk4.rs", "use rapier3d_f64::prelude::*;", "names rapier3d"),
        ("params.rs", "fn f(_: &urdf_rs::Robot) {}", "names urdf_rs"),
        ("models/rk4.rs", &"\n".repeat(MAX_LINES + 1), "models/rk4.rs has 501 lines, limit 500"),
    ] {
        let found = violations(file, line, &reexports);
        assert!(found.iter().any(|f| f.contains(expected)), "{file}: {line}: found {found:?}, expected {expected}");
    }
}

#[test]
fn the_checker_lets_pass_what_is_allowed() {
    let reexports = reexports("pub use robot::{Ballbot, ModelKind};\npub use error::{Error, Result};");
    for (file, line) in [
        ("models/spatial.rs", "use crate::kinematics::Omniwheels; use super::{rk4::rk4, decode};"),
        ("control/lqr.rs", "use crate::models::LinearModel; use crate::models::linear::{INPUTS, STATES};"),
        ("sim/rigid/drive.rs", "use rapier3d_f64::prelude::*; use super::convert::{from_rapier as f, to_rapier};"),
        ("env/batch.rs", "use crate::{Ballbot, Error, ModelKind}; use super::environment::Outcome; use rand::Rng;"),
        ("robot.rs", "use crate::models::{PlanarMotion, SpatialMotion}; use crate::sim::RigidMotion;"),
        ("error.rs", "/// See [`crate::Ballbot`]. rapier3d\nfn f() -> crate::Result<()> { g(\"crate::env\") }"),
        ("params.rs", "use crate::error::{Error, Result};"),
    ] {
        assert_eq!(violations(file, line, &reexports), [""; 0], "{file}: {line}");
    }
}
