//! The layers of the crate, from the paths in its sources.
//!
//! Parameters, state, kinematics and lanes depend only on each other; models and simulations depend on them and never
//! on each other; controllers depend on the state, the linear model and the inverse dynamics, never on a simulation;
//! tasks depend only on the state; batches join robots, tasks, stages and controllers. No two files depend on each
//! other, re-exports aside. Each large dependency is named in one folder.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

const BOTTOM: [&str; 19] = [
    "error",
    "constants",
    "control_steps",
    "files",
    "interrupt",
    "memory",
    "fields",
    "params",
    "state",
    "setpoint",
    "kinematics",
    "energy",
    "model",
    "names",
    "snapshot",
    "lanes",
    "lane_state",
    "terrain",
    "thread_pool",
];

/// What each layer above the bottom may use in addition to the bottom and itself; a longer path means only that item.
const LAYERS: [(&str, &[&str]); 13] = [
    ("actuator", &[]),
    ("perception", &[]),
    ("sensor", &[]),
    ("models", &[]),
    ("sim", &["actuator"]),
    ("urdf", &["actuator"]),
    ("render", &["urdf"]),
    (
        "control",
        &[
            "models::BodyMotion",
            "models::InverseDynamics",
            "models::LeaningPlane",
            "models::LinearModel",
            "models::LoadMap",
            "models::WheelLoad",
            "models::linear",
            "models::traction_torque",
        ],
    ),
    ("planning", &["actuator", "control", "models::linear", "sim::contact::ContactLanes"]),
    ("robot", &["models", "sim"]),
    ("task", &["models::capture_impulse", "models::fastest_move"]),
    ("batch", &["actuator", "perception", "sensor", "sim", "control", "robot", "task"]),
    ("internals", &["perception", "render", "sim", "control"]),
];

/// Dependencies with the only folders that may name them.
const OWNERS: [(&str, &[&str]); 8] = [
    ("rapier3d", &["sim/rigid/"]),
    ("parry3d", &["render/"]),
    ("stl_io", &["render/"]),
    ("urdf_rs", &["urdf/"]),
    ("rayon", &["thread_pool.rs"]),
    ("rand", &["task/", "batch/"]),
    ("rand_chacha", &["lib.rs", "task/", "batch/"]),
    ("toml", &["params/", "batch/events/"]),
];

const MAX_LINES: usize = 500;

/// `source` without comments and string literals, line by line: a string over several lines is treated as code.
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

/// Words of the code, `::`, braces and commas; everything else is omitted.
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

/// All paths that start with `crate`, `super`, `self` or one of the module's `children`, from the crate's root, braces
/// resolved. `module` is where they occur.
fn paths(code: &str, module: &[&str], children: &BTreeSet<String>) -> Vec<Vec<String>> {
    let tokens = tokens(code);
    let mut found = Vec::new();
    let mut at = 0;
    while at < tokens.len() {
        let first = matches!(tokens[at], "crate" | "super" | "self") || children.contains(tokens[at]);
        if first && tokens.get(at + 1) == Some(&"::") && (at == 0 || tokens[at - 1] != "::") {
            let mut base: Vec<String> = module.iter().map(|&m| m.to_owned()).collect();
            if tokens[at] == "crate" {
                base.clear();
            }
            if matches!(tokens[at], "crate" | "self") {
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

/// Items that lib.rs re-exports, with their modules.
fn reexports(lib: &str) -> BTreeMap<String, String> {
    let rooted = code(lib).replace("pub use ", "pub use crate::");
    let named = |path: Vec<String>| Some((path.last()?.clone(), path.first()?.clone()));
    paths(&rooted, &[], &BTreeSet::new()).into_iter().filter_map(named).collect()
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

/// Violations of `file` (relative to src) with `source`.
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
    for mut path in paths(&code, &module, &BTreeSet::new()) {
        if let Some(origin) = path.first().and_then(|item| reexports.get(item)) {
            path.insert(0, origin.clone());
        }
        // A path to the root itself would allow everything.
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

/// Modules of the crate by their paths, with their sources.
struct Modules(BTreeMap<Vec<String>, String>);

impl Modules {
    fn new(files: &[(String, String)]) -> Self {
        let named = files.iter().map(|(file, source)| {
            let path = file.trim_end_matches(".rs").split('/').filter(|part| !matches!(*part, "mod" | "lib"));
            (path.map(str::to_owned).collect(), code(source))
        });
        Self(named.collect())
    }

    fn children(&self, module: &[String]) -> BTreeSet<String> {
        let below = self.0.keys().filter(|path| path.len() == module.len() + 1 && path.starts_with(module));
        below.filter_map(|path| path.last().cloned()).collect()
    }

    /// Code of a module: its re-exports, and the rest.
    fn split(&self, module: &[String]) -> [String; 2] {
        let mut rest = self.0[module].clone();
        let mut exports = String::new();
        for visibility in ["pub use ", "pub(crate) use ", "pub(super) use "] {
            while let Some(start) = rest.find(visibility) {
                let end = start + rest[start..].find(';').expect("a statement ends");
                exports.push_str(&rest[start..=end]);
                rest.replace_range(start..=end, "");
            }
        }
        [exports, rest]
    }

    /// Paths in the code of a module.
    fn paths(&self, module: &[String], code: &str) -> Vec<Vec<String>> {
        let names: Vec<&str> = module.iter().map(String::as_str).collect();
        paths(code, &names, &self.children(module))
    }

    /// The module that defines the item at `path`, following re-exports.
    fn origin(&self, path: &[String]) -> Option<Vec<String>> {
        let length = (0..=path.len()).rev().find(|length| self.0.contains_key(&path[..*length]))?;
        let (module, rest) = path.split_at(length);
        let Some(item) = rest.first() else { return Some(module.to_vec()) };
        let exports = self.paths(module, &self.split(module)[0]);
        match exports.iter().find(|export| export.last() == Some(item) && export.as_slice() != path) {
            Some(export) => self.origin(export),
            None => Some(module.to_vec()),
        }
    }

    /// The modules that each module uses.
    fn graph(&self) -> BTreeMap<Vec<String>, BTreeSet<Vec<String>>> {
        let targets = |module: &Vec<String>| {
            let [exports, rest] = self.split(module);
            // A module uses what it re-exports where it names it again.
            let words: BTreeSet<&str> = tokens(&rest).into_iter().collect();
            let named = |path: &Vec<String>| path.last().is_some_and(|item| words.contains(item.as_str()));
            let again = self.paths(module, &exports).into_iter().filter(named);
            let used: Vec<_> = self.paths(module, &rest).into_iter().chain(again).collect();
            let origins = used.iter().filter_map(|path| self.origin(path));
            origins.filter(|origin| origin != module && !origin.is_empty()).collect()
        };
        self.0.keys().filter(|module| !module.is_empty()).map(|module| (module.clone(), targets(module))).collect()
    }

    /// The cycles among modules, each as the modules that reach each other.
    fn cycles(&self) -> Vec<String> {
        let graph = self.graph();
        let reachable = |from: &Vec<String>| {
            let (mut seen, mut open) = (BTreeSet::new(), vec![from.clone()]);
            while let Some(module) = open.pop() {
                for next in graph.get(&module).into_iter().flatten() {
                    if seen.insert(next.clone()) {
                        open.push(next.clone());
                    }
                }
            }
            seen
        };
        let reached: BTreeMap<_, _> = graph.keys().map(|module| (module.clone(), reachable(module))).collect();
        let both = |a: &Vec<String>, b: &Vec<String>| reached[a].contains(b) && reached[b].contains(a);
        let in_cycle = graph.keys().filter(|module| both(module, module));
        let sets: BTreeSet<Vec<String>> = in_cycle
            .map(|module| graph.keys().filter(|other| both(module, other)).map(|other| other.join("/")).collect())
            .collect();
        sets.into_iter().map(|set| set.join(" <-> ")).collect()
    }
}

#[test]
fn no_files_depend_on_each_other() {
    let mut files = Vec::new();
    sources(&src(), &mut files);
    let modules = Modules::new(&files);
    let cycles = modules.cycles();
    for cycle in &cycles {
        for module in cycle.split(" <-> ") {
            let path: Vec<String> = module.split('/').map(str::to_owned).collect();
            println!("{module} uses {:?}", modules.graph()[&path].iter().map(|m| m.join("/")).collect::<Vec<_>>());
        }
    }
    assert!(cycles.is_empty(), "files depend on each other:\n{}", cycles.join("\n"));
}

#[test]
fn cycles_between_files_are_detected() {
    let file = |name: &str, source: &str| (name.to_owned(), source.to_owned());
    let cycles = |files: &[(String, String)]| Modules::new(files).cycles();
    let two = [file("a.rs", "use crate::b::B;"), file("b.rs", "fn f(_: crate::a::A) {}")];
    assert_eq!(cycles(&two), ["a <-> b"]);
    let three = [file("x/mod.rs", "mod a; mod b; mod c;"), file("x/a.rs", "use super::b::B;")];
    let three = [&three[..], &[file("x/b.rs", "use super::{c::C, d};"), file("x/c.rs", "use crate::x::a;")]].concat();
    assert_eq!(cycles(&three), ["x/a <-> x/b <-> x/c"]);
    // Through a re-export, and with an item of the parent itself.
    let exported = [
        file("x/mod.rs", "mod a;\nmod b;\npub use a::{A, Other};"),
        file("x/a.rs", "use super::b::B;"),
        file("x/b.rs", "use super::A;"),
    ];
    assert_eq!(cycles(&exported), ["x/a <-> x/b"]);
    let parent = [file("x/mod.rs", "mod a;\nuse a::A;\npub struct X;"), file("x/a.rs", "use super::X;")];
    assert_eq!(cycles(&parent), ["x <-> x/a"]);
    let fine = [
        file("x/mod.rs", "mod a;\nmod b;\npub use a::A;\npub use b::B;"),
        file("x/a.rs", "use super::B;"),
        file("x/b.rs", "/// See [`super::A`].\npub struct B;"),
        file("y.rs", "use crate::x::{A, B};"),
    ];
    assert!(cycles(&fine).is_empty(), "{:?}", cycles(&fine));
}

#[test]
fn layers_depend_only_on_lower_ones() {
    let mut files = Vec::new();
    sources(&src(), &mut files);
    assert!(files.len() > 30, "only {} sources found", files.len());
    let lib = &files.iter().find(|(file, _)| file == "lib.rs").expect("the crate has a lib.rs").1;
    let mut reexports = reexports(lib);
    assert_eq!(reexports["Ballbot"], "robot");
    // An exported macro is at the root, wherever it is defined.
    reexports.insert("cells".to_owned(), "lanes".to_owned());
    let broken: Vec<_> = files.iter().flat_map(|(file, source)| violations(file, source, &reexports)).collect();
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

#[test]
fn all_modules_belong_to_a_layer() {
    let lib = fs::read_to_string(src().join("lib.rs")).unwrap();
    for line in code(&lib).lines().filter_map(|l| l.trim_start_matches("pub ").strip_prefix("mod ")) {
        let name = line.trim_end_matches(';');
        assert!(BOTTOM.contains(&name) || LAYERS.iter().any(|(layer, _)| *layer == name), "{name} has no layer");
    }
}

#[test]
fn violations_are_detected() {
    let reexports = reexports("pub use robot::{Ballbot, ModelKind};\npub use error::Error;\npub use batch::Batch;");
    for (file, line, expected) in [
        ("models/spatial.rs", "use crate::sim::RigidMotion;", "models/spatial.rs uses crate::sim::RigidMotion"),
        ("models/mod.rs", "use super::robot::Ballbot;", "models/mod.rs uses crate::robot::Ballbot"),
        ("models/spatial.rs", "use crate::{error::Error, batch::{self, Batch}};", "uses crate::batch"),
        ("models/planar.rs", "fn f(_: crate::Ballbot) {}", "uses crate::robot::Ballbot"),
        ("sim/rigid/motion.rs", "use super::super::super::models::rk4;", "uses crate::models::rk4"),
        ("sim/rigid/world.rs", "let x = crate::control::Lqr::new();", "uses crate::control::Lqr::new"),
        ("control/lqr.rs", "use crate::models::{LinearModel, SpatialModel};", "uses crate::models::SpatialModel"),
        ("control/mod.rs", "use crate::Batch;", "uses crate::batch::Batch"),
        ("control/pid.rs", "use crate::{error::Result, sim as s};", "uses crate::sim"),
        ("task/balance.rs", "use crate::control::Setpoint;", "uses crate::control::Setpoint"),
        ("sim/contact/lanes.rs", "use crate::sensor::Sensor;", "uses crate::sensor::Sensor"),
        ("batch/batch.rs", "use crate::models::LinearModel;", "uses crate::models::LinearModel"),
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
fn allowed_uses_are_no_violations() {
    let reexports = reexports("pub use robot::{Ballbot, ModelKind};\npub use error::{Error, Result};");
    for (file, line) in [
        ("models/spatial.rs", "use crate::kinematics::Omniwheels; use super::{rk4::rk4, decode};"),
        ("control/lqr.rs", "use crate::models::LinearModel; use crate::models::linear::{INPUTS, STATES};"),
        ("sim/rigid/drive.rs", "use rapier3d_f64::prelude::*; use super::convert::{from_rapier as f, to_rapier};"),
        ("batch/batch.rs", "use crate::{Ballbot, Error, ModelKind}; use super::buffers::Outcome; use rand::Rng;"),
        ("batch/closed_loop.rs", "use crate::control::Controller; use crate::task::Task; use crate::sensor::Exact;"),
        ("sim/contact/lanes.rs", "use crate::actuator::Actuator; use crate::setpoint::Setpoint;"),
        ("robot.rs", "use crate::models::{PlanarMotion, SpatialMotion}; use crate::sim::RigidMotion;"),
        ("error.rs", "/// See [`crate::Ballbot`]. rapier3d\nfn f() -> crate::Result<()> { g(\"crate::batch\") }"),
        ("params.rs", "use crate::error::{Error, Result};"),
    ] {
        assert_eq!(violations(file, line, &reexports), [""; 0], "{file}: {line}");
    }
}
