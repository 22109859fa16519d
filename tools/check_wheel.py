"""Installs a wheel into an empty environment, lists the data that it ships, and runs README's first example there.

`python tools/check_wheel.py WHEEL`.
"""

import os
import re
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

ROOT = Path(__file__).parents[1]

#: Runs where the wheel is installed, in an empty folder.
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
"""


def first_example() -> str:
    """README's first block of Python."""
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), flags=re.DOTALL)
    return blocks[0]


def check(python: Path, path: Path | None = None) -> str:
    """Runs the listing and the example with an interpreter, `path` before its own packages; returns what they print.

    Raises:
        RuntimeError: one of them failed; the message has its output.
    """
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    if path is not None:
        environment["PYTHONPATH"] = str(path)
    printed = ""
    with tempfile.TemporaryDirectory() as empty:
        for code in (LISTING, first_example()):
            command = [str(python), "-c", code, str(ROOT / "python")]
            run = subprocess.run(command, cwd=empty, env=environment, capture_output=True, text=True, check=False)
            if run.returncode != 0:
                raise RuntimeError(f"{python} failed:\n{run.stdout}{run.stderr}")
            printed += run.stdout
    return printed


def main(wheel: Path) -> None:
    """Prints what is found, and raises for a wheel that does not work."""
    with tempfile.TemporaryDirectory() as folder:
        venv.create(folder, with_pip=True)
        python = Path(folder) / "bin" / "python"
        subprocess.run([python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", wheel], check=True)
        print(check(python), end="")
    print(f"{wheel.name} works in an empty environment")


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
