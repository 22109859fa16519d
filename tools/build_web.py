"""Builds the simulator in the browser: WebAssembly, the looks of the robots and the page, in target/web/page."""

import base64
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ballbot_rs import OnnxPolicy, Params
from ballbot_rs.control import network_file
from ballbot_rs.control.onnx_policy import ACTING, FOLLOWING
from ballbot_rs.viewer.scene import look, urdf

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "crates" / "ballbot-web" / "page"
WORK = ROOT / "target" / "web"
PAGE = WORK / "page"
TARGET = "wasm32-unknown-unknown"

POLICIES = ROOT / "assets" / "policies"

#: Debian's packages with which the standard library is compiled for WebAssembly.
PACKAGES = "rustc-web cargo-web rust-web-src lld-22"


def main() -> None:
    """Builds the page.

    Raises:
        SystemExit: a part of the toolchain is missing, or a command fails.
    """
    # A page of an earlier state of the code is worse than no page.
    shutil.rmtree(PAGE, ignore_errors=True)
    PAGE.mkdir(parents=True)
    module = compiled()
    shutil.copyfile(module, PAGE / "ballbot.wasm")
    (PAGE / "looks.json").write_text(json.dumps(looks(), separators=(",", ":")))
    (PAGE / "policies.json").write_text(json.dumps(policies(), separators=(",", ":")))
    bundle()
    for path in sorted(PAGE.iterdir()):
        print(f"{path.relative_to(ROOT)}: {path.stat().st_size / 1000:.0f} kB")


def compiled() -> Path:
    """The WebAssembly module, compiled by rustup's target if it is installed, else by Debian's compiler."""
    arguments = ["rustc", "--locked", "--release", "--package", "ballbot-web", "--target", TARGET]
    rest = ["--crate-type", "cdylib"]
    environment = {**os.environ, "CARGO_TARGET_DIR": str(WORK / "cargo")}
    if has_target():
        run(["cargo", *arguments, *rest], environment)
    elif has_sources():
        environment |= {
            "RUSTC": "/usr/bin/rustc",
            # Debian's compiler has the standard library's sources, whose build Cargo still calls unstable.
            "RUSTC_BOOTSTRAP": "1",
            "CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_LINKER": "wasm-ld-22",
        }
        run(["/usr/bin/cargo", *arguments, "-Zbuild-std=std,panic_abort", *rest], environment)
    else:
        sys.exit(f"a compiler for {TARGET} is missing: rustup target add {TARGET}, or apt-get install {PACKAGES}")
    return WORK / "cargo" / TARGET / "release" / "ballbot_web.wasm"


def has_target() -> bool:
    """Whether rustup's compiler has the standard library for WebAssembly."""
    if shutil.which("rustc") is None:
        return False
    root = subprocess.run(["rustc", "--print", "sysroot"], capture_output=True, text=True, check=False).stdout.strip()
    return (Path(root) / "lib" / "rustlib" / TARGET).is_dir()


def has_sources() -> bool:
    """Whether Debian's compiler, the library's sources and a linker are installed."""
    parts = ("bin/rustc", "bin/cargo", "bin/wasm-ld-22", "lib/rustlib/src/rust/library/std")
    return all(Path("/usr", part).exists() for part in parts)


def run(command: list[str], environment: dict[str, str] | None = None) -> None:
    """Runs a command of the build in the root of the repository."""
    print(" ".join(command), flush=True)
    if subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode:
        sys.exit(f"failed: {' '.join(command)}")


def bundle() -> None:
    """The page's files; three.js and esbuild come from npm."""
    if shutil.which("npm") is None:
        sys.exit("npm is missing: apt-get install npm")
    front = WORK / "front"
    shutil.copytree(SOURCE, front, dirs_exist_ok=True)
    run(["npm", "install", "--prefix", str(front), "--no-package-lock", "--no-audit", "--no-fund", "--silent"])
    esbuild = str(front / "node_modules" / ".bin" / "esbuild")
    options = ["--bundle", "--minify", "--format=esm", "--target=es2022", "--log-level=warning"]
    run([esbuild, str(front / "page.js"), *options, f"--outfile={PAGE / 'page.js'}"])
    for name in ("index.html", "page.css"):
        shutil.copyfile(SOURCE / name, PAGE / name)


def policies() -> dict[str, object]:
    """The shipped policies that follow setpoints, by name, as settings of a scene."""
    found = {}
    for path in sorted(POLICIES.glob("*.onnx")):
        policy = OnnxPolicy(path)
        if policy.task not in FOLLOWING:
            continue
        options = policy.env_options
        history = options["history"]
        cells, layers = network_file.read_parts(path)
        # Four gates of each unit.
        units = [len(biases) // 4 for _, biases in cells]
        inputs = cells[0][0].shape[1] - units[0] if cells else layers[0][0].shape[1]
        found[path.stem] = {
            "task": policy.task,
            **{name: float(options[name]) for name in ACTING if options.get(name) is not None},
            "history": list(history) if isinstance(history, (list, tuple)) else list(range(int(history))),
            "widths": [inputs, *units, *(len(biases) for _, biases in layers)],
            **({"cells": len(cells)} if cells else {}),
            # The shortest decimals that are these numbers in single precision.
            "numbers": [float(str(x)) for layer in (*cells, *layers) for part in layer for x in part.ravel()],
        }
    return found


def looks() -> dict[str, object]:
    """Triangles of the presets as `ballbot view` shows them; numbers as base64 of float32 and uint32."""
    return {name: described(of(name)) for name in Params.preset_names()}


def of(name: str) -> look.Look:
    """The look of a preset."""
    params = Params.preset(name)
    return urdf.from_urdf(params, *urdf.URDFS[name]) if name in urdf.URDFS else look.from_params(params)


def described(robot: look.Look) -> dict[str, object]:
    """A look; the wheels of a robot are alike."""
    wheel = robot.wheels[0]
    return {
        "ball": [piece(one) for one in robot.ball],
        "body": [piece(one) for one in robot.body],
        "wheel": [piece(one) for one in wheel.pieces],
        "axle": np.asarray(wheel.axle).tolist(),
        "mounts": [np.asarray(one.mount).ravel().round(9).tolist() for one in robot.wheels],
    }


def piece(one: look.Piece) -> dict[str, object]:
    """Triangles of one color."""
    return {"color": list(one.color), "vertices": text(one.vertices, "<f4"), "faces": text(one.faces, "<u4")}


def text(numbers: npt.ArrayLike, kind: str) -> str:
    """Numbers in base64."""
    return base64.b64encode(np.asarray(numbers).astype(kind).tobytes()).decode("ascii")


if __name__ == "__main__":
    main()
