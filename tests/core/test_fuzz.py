"""Everything that can be called is called with anything: see tests/support/fuzz.py."""

import os
import subprocess
import sys

import pytest

import ballbot_rs as bb
from tests.support import surface
from tests.support.paths import ROOT


@pytest.mark.slow("fuzzes all functions")
def test_calls_with_arbitrary_arguments_do_not_panic_hang_or_return_nan():
    pytest.importorskip("hypothesis", reason="it is a development dependency")
    # In a separate process, which a call could end.
    command = [sys.executable, "-m", "tests.support.fuzz", os.environ.get("BALLBOT_FUZZ_CALLS", "5")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_whole_surface_is_called():
    called = {target.name for target in surface.targets()}
    assert surface.stub_names() <= called | set(surface.LEFT_OUT)
    for name in bb.__all__:
        assert name in called or name in surface.LEFT_OUT or not callable(getattr(bb, name)) or name == "Contacts"


def test_a_mistake_would_be_found():
    hypothesis = pytest.importorskip("hypothesis", reason="it is a development dependency")
    from tests.support.fuzz import fuzz

    def wrong(state):  # noqa: ARG001
        return float("nan")

    def panicking(state):
        raise RuntimeError("internal error of ballbot_rs, please report it: " + str(state)[:0])

    def silent(state):  # noqa: ARG001
        raise ValueError

    for function in (wrong, panicking, silent):
        with pytest.raises((AssertionError, hypothesis.errors.Flaky)):
            fuzz(surface.Target("function", function, (("state", True),)), 5)
