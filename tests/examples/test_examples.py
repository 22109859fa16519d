"""The programs of `examples/` run, print what they do, and need only the dependencies of the package."""

import ast
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.commands import IMPORT_PATH
from tests.support.paths import ROOT

EXAMPLES = ROOT / "examples"
PROGRAMS = sorted(EXAMPLES.glob("*.py"))

#: Arguments that make each small, what it prints, and what it writes.
RUNS = {
    "push_and_plot": (
        ["0.5"],
        r"4 s, 401 rows, upright, sim_dt 2 ms>\n(.*\n)*tilt_max +0\.0[5-9]",
        ["push.svg", "push.csv"],
    ),
    "circle": (["6", "2"], r"\n +6 +23%  0\.\d\d.*\n +2  the motion .* would do", []),
    "crowd": (["1"], r"paper hits kugle with \d+ N\n(.*\n)*rezero +tilt 0\.\d deg", ["crowd.png"]),
    "noise_and_delay": (["0", "100"], r"delay   0 ms  exact: upright.*\ndelay 100 ms  exact: fell", []),
    "backpropagation": (["20"], r"trained for .*, cost \d+\.\d+\n.*success \d+%", []),
    "joystick": (["20"], r"driving at http.*\nat x = 0\.\d\d m after \d", []),
    "live_curve": (["2"], r"a curve at http.*\nlargest power \d\.\d\d W", []),
    "own_controller": (["5"], r"mylqr +success 100%.*\nlqr +success 100%.*\npid +success [1-4]?0%", []),
    "own_robot": ([], r"tilt up to 4\.\d deg", ["robot.toml"]),
    "own_task": (["8192"], r"spin\.zip: upright \d+%.*\nzero: upright 0%", ["spin.zip"]),
    "tune": (["6"], r"cost (1\.000|0\.\d+) of.*\n(.*\n)*S18-circle +lqr \(tuned\)", []),
    "train_sac": (["2500"], r"sac\.zip: success \d+%.*\nlqr: success 100%", ["sac.zip"]),
    "dataset": (
        ["8"],
        r"8 episodes, \d+ steps>\nobservations +\(\d+, 16\) float32.*\nactions +\(\d+, 3\)",
        ["dataset.npz"],
    ),
    "randomization": (["10"], r"\nnone +lqr upright 100%(.*\n)*friction +lqr upright +([1-9]?\d)%", []),
    "transfer": (
        ["4"],
        r"contact +policy 100%  lqr 100%\n(.*\n)*friction x 0\.2 .*lqr +25%\n(.*\n)*delay 30 ms +policy 100%  lqr 100%",
        [],
    ),
    "sweep": (["5"], r"21 points(.*\n)*.*0\.5 +0 +1 +1", ["sweep.svg", "sweep.csv", "sweep-5.json"]),
    "terrain": (["4"], r"slope 0\.20 +lqr upright 100%(.*\n)*<Trajectory of lqi on contact: 5 s", ["hills.svg"]),
}
NEEDS = {
    "crowd": "matplotlib",
    "joystick": "viser",
    "live_curve": "viser",
    "backpropagation": "torch",
    "own_task": "stable_baselines3",
    "push_and_plot": "matplotlib",
    "sweep": "matplotlib",
    "terrain": "matplotlib",
    "train_sac": "stable_baselines3",
    "transfer": "onnxruntime",
    "tune": "cmaes",
}


def test_every_program_has_its_run():
    assert [path.stem for path in PROGRAMS] == sorted(RUNS)


@pytest.mark.slow("a process per example")
@pytest.mark.parametrize("name", sorted(RUNS))
def test_it_runs(name, tmp_path):
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    arguments, printed, written = RUNS[name]
    done = subprocess.run(
        [sys.executable, EXAMPLES / f"{name}.py", *arguments],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(IMPORT_PATH), "MPLBACKEND": "agg"},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert re.search(printed, done.stdout), done.stdout
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(written)


@pytest.mark.parametrize("path", PROGRAMS, ids=lambda path: path.stem)
def test_it_is_short_and_uses_the_public_interface(path: Path):
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 40
    tree = ast.parse(text)
    first = (ast.get_docstring(tree) or "").splitlines()[0]
    assert first.endswith(".")
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            assert not any(alias.name.startswith("ballbot_rs.") for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert not (node.module or "").startswith("ballbot_rs")
        elif isinstance(node, ast.Attribute):
            assert not node.attr.startswith("_"), f"{node.attr} is private"
    assert f"[{path.name}]({path.name})" in (EXAMPLES / "README.md").read_text(encoding="utf-8")
