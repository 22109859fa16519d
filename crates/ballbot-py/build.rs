//! Copies the data of the Python package from the repository's `assets/`, from where the wheel takes it.

use std::path::{Path, PathBuf};
use std::{env, fs, io};

/// What ships, from `assets/`: the URDFs, the meshes that they name, the policy of README and command line.
const SHIPPED: [&str; 4] = ["bot.urdf", "ball.urdf", "meshes", "policies/balance.onnx"];

fn main() -> io::Result<()> {
    let variable = |name: &str| env::var_os(name).ok_or_else(|| io::Error::other(format!("{name} is not set")));
    let assets = Path::new(&variable("CARGO_MANIFEST_DIR")?).join("../../assets");
    let out = PathBuf::from(variable("OUT_DIR")?).join("assets");
    if out.exists() {
        // What is no longer shipped must not stay.
        fs::remove_dir_all(&out)?;
    }
    for name in SHIPPED {
        println!("cargo::rerun-if-changed=../../assets/{name}");
        copy(&assets.join(name), &out.join(name))?;
    }
    Ok(())
}

/// Copies a file, or the files of a folder.
fn copy(from: &Path, to: &Path) -> io::Result<()> {
    if from.is_dir() {
        for entry in fs::read_dir(from)? {
            let entry = entry?;
            copy(&entry.path(), &to.join(entry.file_name()))?;
        }
        return Ok(());
    }
    if let Some(parent) = to.parent() {
        fs::create_dir_all(parent)?;
    }
    let copied = fs::copy(from, to);
    copied.map(drop).map_err(|e| io::Error::new(e.kind(), format!("cannot copy {}: {e}", from.display())))
}
