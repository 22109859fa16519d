"""Installs a wheel into an empty environment, lists its data, and runs README's first example there.

The digests of the observations are the same on all processors.

`python tools/check_wheel.py WHEEL [--python "qemu-aarch64 -L ROOT ROOT/usr/bin/python3"]`.
"""

import argparse
import json
import os
import re
import shlex
import subprocess
import sys
import tempfile
import venv
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]

#: Runs in an empty folder where the wheel is installed.
LISTING = """
import sys
from pathlib import Path
import ballbot_rs
from ballbot_rs import Params, _assets

package = Path(ballbot_rs.__file__).parent
assert not package.is_relative_to(sys.argv[1]), f"{package} is the clone's, not the wheel's"
for name in ("bot.urdf", "ball.urdf", "policies/balance.onnx"):
    assert _assets.path(name).is_relative_to(package), _assets.path(name)
from ballbot_rs import load_scenarios
from ballbot_rs.deployment import controller_header
assert load_scenarios() and controller_header("lqr")
for file in sorted((package / "assets").rglob("*")):
    if file.is_file():
        print(file.relative_to(package / "assets").as_posix(), file.stat().st_size)
ballbot_rs.Renderer(urdf=(_assets.path("bot.urdf"), _assets.path("ball.urdf")), width=64, height=64)
for name in Params.preset_names():
    print("preset", name, Params.preset(name).body_mass)
import hashlib
import numpy as np
for model in ("contact", "rigid", "spatial", "planar"):
    env = ballbot_rs.BallbotVectorEnv(8, model=model, seed=0)
    bits, actions = hashlib.sha256(env.reset(seed=0)[0].tobytes()), np.random.default_rng(0)
    for _ in range(100):
        bits.update(env.step(actions.uniform(-1.0, 1.0, (8, 3)).astype(np.float32))[0].tobytes())
    print("digest of 100 steps,", model, bits.hexdigest()[:16])
"""

#: Facts on an interpreter that pip needs to install for it without running in it.
DESCRIPTION = """
import json, platform, sys
print(json.dumps([platform.machine(), *sys.version_info[:2]]))
"""

#: Wheel tags for Linux with glibc 2.28, newest first.
GLIBC = ("manylinux_2_28", "manylinux_2_27", "manylinux_2_17", "manylinux2014")


def first_example() -> str:
    """README's first Python block."""
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), flags=re.DOTALL)
    return blocks[0]


def check(python: Sequence[str], path: Path | None = None) -> str:
    """Runs the listing and the example with an interpreter, `path` before its own packages; returns their output.

    Args:
        python: the command of the interpreter, possibly an emulator with its arguments.
        path: a folder of packages.

    Raises:
        RuntimeError: one of them failed; the message has its output.
    """
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    if path is not None:
        environment["PYTHONPATH"] = str(path)
    printed = ""
    with tempfile.TemporaryDirectory() as empty:
        for code in (LISTING, first_example()):
            command = [*python, "-c", code, str(ROOT / "python")]
            run = subprocess.run(command, cwd=empty, env=environment, capture_output=True, text=True, check=False)
            if run.returncode != 0:
                raise RuntimeError(f"{shlex.join(python)} failed:\n{run.stdout}{run.stderr}")
            printed += run.stdout
    return printed


def install_for(python: Sequence[str], wheel: Path, folder: Path) -> None:
    """Installs a wheel and its dependencies for an interpreter of another processor, without running pip there."""
    described = subprocess.run([*python, "-c", DESCRIPTION], check=True, capture_output=True, text=True).stdout
    machine, major, minor = json.loads(described)
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", str(wheel)]
    command += ["--target", str(folder), "--only-binary", ":all:", "--python-version", f"{major}.{minor}"]
    for tag in GLIBC:
        command += ["--platform", f"{tag}_{machine}"]
    subprocess.run(command, check=True)


def main() -> None:
    """Prints the results, and raises for a wheel that does not work."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("wheel", type=Path)
    parser.add_argument("--python", type=shlex.split, default=[], help="the command of an emulated interpreter")
    arguments = parser.parse_args()
    wheel, python = arguments.wheel.resolve(), arguments.python
    with tempfile.TemporaryDirectory() as folder:
        if python:
            install_for(python, wheel, Path(folder))
            print(check(python, Path(folder)), end="")
        else:
            venv.create(folder, with_pip=True)
            own = str(Path(folder) / "bin" / "python")
            subprocess.run([own, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", wheel], check=True)
            print(check([own]), end="")
    print(f"{wheel.name} works in an empty environment")


if __name__ == "__main__":
    main()
