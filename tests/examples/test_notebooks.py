"""The notebooks of `examples/` run from the first cell to the last, and have the output of such a run."""

import importlib.util
import os

import pytest

from tests.support.commands import IMPORT_PATH
from tests.support.paths import ROOT

nbformat = pytest.importorskip("nbformat")
pytest.importorskip("nbclient")
pytest.importorskip("ipykernel")

#: What makes them small, and what a cell shows.
RUNS = {
    "first_steps": ({"episodes=50": "episodes=4"}, "lqr on contact, 4.00 s, upright to the end"),
    "learning": ({"STEPS = 400_000": "STEPS = 8192", "episodes=50": "episodes=4"}, "lqr: success 100%"),
}


def shown(notebook):
    """All that the cells show, as text."""
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    return "".join(output.get("text", "") + "".join(output.get("data", {}).values()) for output in outputs)


def tool():
    spec = importlib.util.spec_from_file_location("run_notebooks", ROOT / "tools" / "run_notebooks.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_notebook_has_its_run():
    assert {path.stem for path in (ROOT / "examples").glob("*.ipynb")} == set(RUNS)


@pytest.mark.slow("runs notebooks")
@pytest.mark.parametrize("name", RUNS)
def test_it_runs(name, monkeypatch):
    if name == "learning":
        pytest.importorskip("stable_baselines3")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(IMPORT_PATH))
    path = ROOT / "examples" / f"{name}.ipynb"
    changes, text = RUNS[name]
    done = tool().executed(path, changes)
    assert text in shown(done)
    kept = nbformat.read(path, as_version=4)
    assert text in shown(kept), "the kept output does not match such a run: run tools/run_notebooks.py"
    for one in (kept, done):
        counts = [cell.execution_count for cell in one.cells if cell.cell_type == "code"]
        assert counts == list(range(1, len(counts) + 1))
