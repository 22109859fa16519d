//! Lists the presets: each TOML file in `robots/` is one, named by its file stem, `paper` before all others.

use std::path::Path;
use std::{env, fs, io};

fn main() -> io::Result<()> {
    println!("cargo::rerun-if-changed=robots");
    let mut names = Vec::new();
    for entry in fs::read_dir("robots")? {
        let path = entry?.path();
        if path.extension().is_some_and(|extension| extension == "toml") {
            let stem = path.file_stem().and_then(|stem| stem.to_str());
            names.push(stem.ok_or_else(|| io::Error::other(format!("{path:?} is not a Unicode name")))?.to_owned());
        }
    }
    names.sort_by_key(|name| (name != "paper", name.clone()));
    let mut list = String::from("&[\n");
    for name in names {
        let file = format!("/robots/{name}.toml");
        list += &format!("    ({name:?}, include_str!(concat!(env!(\"CARGO_MANIFEST_DIR\"), {file:?}))),\n");
    }
    list += "]\n";
    let out = env::var_os("OUT_DIR").ok_or_else(|| io::Error::other("OUT_DIR is not set"))?;
    fs::write(Path::new(&out).join("presets.rs"), list)
}
