"""Every command with closed streams, with a terminal of few characters, with no reader, and with no room."""

import io
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from ballbot_rs.cli import main
from tests.support import commands
from tests.support.tiny_config import TINY_CONFIG

pytest.importorskip("matplotlib")
pytest.importorskip("moviepy")

#: Each command, as short as it can be.
COMMANDS = {
    "help": ["--help"],
    "info": ["info"],
    "info as JSON": ["info", "--json"],
    "evaluate": ["evaluate", "--model", "planar", "--episodes", "1"],
    "record": ["record", "--model", "planar", "--seconds", "0.1", "--push-at", "0.05", "--size", "64", "48", "--still"],
    "plot": ["plot", "--model", "planar", "--seconds", "0.1", "--push-at", "0.05", "--figure", "phase_portrait"],
    "report": ["report", "run", "--episodes", "1", "--video-seconds", "0.1", "-o", "report.html"],
    "export": ["export", "run", "-o", "policy.onnx"],
    "train": ["train", "--config", "tiny.toml", "--run", "new", "--episodes", "1", "--no-report", "--quiet"],
    "view": ["view", "--no-open", "--seconds", "0.1", "--port", "18890"],
}
NEEDS = {"export": "onnxscript", "view": "viser"}
#: Commands that import torch, which takes longer than the rest.
WITH_TORCH = [COMMANDS[name] for name in ("report", "export", "train")]


@pytest.fixture(params=COMMANDS)
def arguments(request, tiny_run, tmp_path):
    """A command to run in `tmp_path`."""
    (tmp_path / "tiny.toml").write_text(TINY_CONFIG, encoding="utf-8")
    if request.param in NEEDS:
        pytest.importorskip(NEEDS[request.param])
    if request.param in ("report", "export"):
        shutil.copytree(tiny_run, tmp_path / "run")
    return COMMANDS[request.param]


def in_folder(tmp_path, arguments, shell=None, **environment):
    """Runs a command, with redirections of a shell if there are any."""
    line = commands.command(*arguments)
    if shell is not None:
        line = ["sh", "-c", f'"$@" {shell}', "sh", *line]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(commands.IMPORT_PATH), **environment}
    return subprocess.run(line, capture_output=True, cwd=tmp_path, env=environment, timeout=120, check=False)


@pytest.mark.slow("a process per command")
def test_with_closed_streams(arguments, tmp_path):
    done = in_folder(tmp_path, arguments, "<&- >&- 2>&-")
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")


def here(tmp_path, arguments, monkeypatch):
    """Exit code and output of a command in this process, on streams of ASCII."""
    monkeypatch.chdir(tmp_path)
    streams = [io.TextIOWrapper(io.BytesIO(), encoding="ascii") for _ in range(2)]
    monkeypatch.setattr(sys, "stdout", streams[0])
    monkeypatch.setattr(sys, "stderr", streams[1])
    code = main(arguments)
    for stream in streams:
        stream.flush()
    return code, *(stream.buffer.getvalue() for stream in streams)


@pytest.mark.slow("a process per command")
def test_on_an_ascii_terminal(arguments, tmp_path, monkeypatch):
    if arguments in WITH_TORCH:
        code, out, err = here(tmp_path, arguments, monkeypatch)
    else:
        done = in_folder(tmp_path, arguments, PYTHONIOENCODING="ascii")
        code, out, err = done.returncode, done.stdout, done.stderr
    assert code == 0, err
    assert out.isascii()
    assert b"Traceback" not in err
    if "evaluate" in arguments:
        assert b"N*m" in out


BRIEF = [COMMANDS[name] for name in ("help", "info", "info as JSON", "evaluate")]


@pytest.mark.parametrize("arguments", BRIEF)
def test_without_a_reader(arguments):
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "wb") as nobody:
        line = commands.command(*arguments)
        done = subprocess.run(line, stdout=nobody, stderr=subprocess.PIPE, timeout=300, check=False)
    assert (done.returncode, done.stderr) == (141, b"")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
@pytest.mark.parametrize("arguments", BRIEF)
def test_without_room(arguments, tmp_path):
    done = in_folder(tmp_path, arguments, "> /dev/full")
    assert (done.returncode, done.stderr) == (1, b"ballbot: standard output: No space left on device\n")
