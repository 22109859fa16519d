"""`help()` of what is public opens with one sentence and an example that runs; a signature fits a screen."""

import contextlib
import inspect
import io
import re

import numpy as np
import pytest

import ballbot_rs as bb
from tests.support.paths import ASSETS

BLOCK = re.compile(r"^```python\n(.*?)^```", flags=re.DOTALL | re.MULTILINE)
#: Signatures in Jupyter's `?` are about ten lines.
LONGEST = 600
#: A table of thirty numbers, as in a TOML file.
LONGER = {"Scenario": 940, "Trajectory": 650}
#: Exceptions.
WITHOUT = {"BallbotError", "ControllerError", "DivergedError", "InvalidInputError", "UrdfError"}
PUBLIC = [name for name in bb.__all__ if callable(getattr(bb, name))]
#: Examples that take seconds: an optimization, a training, a compilation, a browser, a process or a large terrain.
SLOW = {
    *("OptimizedTrajectory", "TimeVaryingLqr", "optimize_trajectory", "save", "DifferentiableJaxBatch"),
    *(
        "Page",
        "show",
        "CrowdPage",
        "show_crowd",
        "Link",
        "LinkPeer",
        "NativeLaw",
        "Supervised",
        "identify",
        "IdentifiedParams",
        "tune",
        "Tuned",
    ),
    *("TerrainEnv", "TerrainVectorEnv", "OpenBallBotEnv", "OpenBallBotVectorEnv"),
}


EXAMPLES = [
    pytest.param(name, marks=[pytest.mark.slow("examples that take seconds")] if name in SLOW else [])
    for name in PUBLIC
    if name not in WITHOUT
]


@pytest.mark.parametrize("name", PUBLIC)
def test_help_opens_with_one_sentence(name):
    first, _, rest = inspect.getdoc(getattr(bb, name)).partition("\n")
    assert first.endswith(".")
    assert ". " not in first
    assert rest[:1] in ("", "\n"), "the sentence is one line"


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_example_of_help_runs(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "assets").symlink_to(ASSETS)
    blocks = BLOCK.findall(inspect.getdoc(getattr(bb, name)))
    assert blocks
    with contextlib.redirect_stdout(io.StringIO()):
        exec(compile(blocks[0], f"the example of {name}", "exec"), {"bb": bb, "np": np})


def test_signatures_fit_a_screen():
    lengths = {}
    for name in PUBLIC:
        # Exceptions of the interpreter have none.
        with contextlib.suppress(ValueError):
            lengths[name] = len(str(inspect.signature(getattr(bb, name))))
    assert {name: size for name, size in lengths.items() if size > LONGER.get(name, LONGEST)} == {}
    assert len(lengths) > 80
