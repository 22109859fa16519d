"""What a command writes is there whole, or the file that was there before is untouched and the error names it.

A limit of the size of files simulates a full disk.
"""

import os
import shutil

import pytest

from ballbot_rs import _files
from tests.support import commands

pytest.importorskip("resource")
pytest.importorskip("stable_baselines3")
pytest.importorskip("moviepy")

LIMIT = 1000
SHORT = ["--model", "planar", "--seconds", "0.5", "--push-at", "0.05"]

#: (command, the file that it writes)
WRITERS = {
    "record": (["record", *SHORT, "-o", "out/a.mp4"], "out/a.mp4"),
    "still": (["record", *SHORT, "--no-video", "--still", "-o", "out/a.mp4"], "out/a.png"),
    "plot": (["plot", *SHORT, "--figure", "trajectories", "-o", "out"], "out/trajectories.svg"),
    "report": (["report", "run", "--episodes", "0", "--video-seconds", "0", "-o", "out/r.html"], "out/r.html"),
    "export": (["export", "run", "-o", "out/p.onnx"], "out/p.onnx"),
}


@pytest.mark.slow("a process per command")
@pytest.mark.parametrize("name", WRITERS)
def test_the_old_file_stays(name, tiny_run, tmp_path, monkeypatch):
    if name == "export":
        pytest.importorskip("onnxscript")
    arguments, target = WRITERS[name]
    path = tmp_path / target
    path.parent.mkdir()
    path.write_bytes(b"what was there before")
    if "run" in arguments:
        shutil.copytree(tiny_run, tmp_path / "run")
    monkeypatch.setenv("PYTHONPATH", ":".join(commands.IMPORT_PATH))
    done = commands.run(*arguments, largest_file=LIMIT, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith(f"ballbot: {target}: not written: ")
    assert done.stderr.count("\n") == 1
    if name != "record":
        assert "File too large" in done.stderr
    assert path.read_bytes() == b"what was there before"
    assert list(path.parent.iterdir()) == [path]


def test_a_file_appears_whole(tmp_path):
    path = tmp_path / "folder" / "file.txt"
    with _files.replacing(path) as temporary:
        temporary.write_text("new")
        assert temporary.parent == path.parent
        assert temporary.suffix == path.suffix
        assert not path.exists()
    assert path.read_text() == "new"
    assert list(path.parent.iterdir()) == [path]


def interrupted_write(path):
    with _files.replacing(path) as temporary:
        temporary.write_text("half of the n")
        raise KeyboardInterrupt


def test_after_an_error_the_old_file_is_there(tmp_path):
    path = tmp_path / "file.txt"
    path.write_text("old")
    with pytest.raises(KeyboardInterrupt):
        interrupted_write(path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_targets_that_are_not_files_are_not_replaced(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for path in (pipe, tmp_path):
        with pytest.raises(OSError, match="not written: it already exists and is not a regular file") as caught:
            _files.write(path, "x")
        assert caught.value.filename == str(path)
    with pytest.raises(OSError, match="not written: ") as caught:
        _files.write(pipe / "below" / "file.txt", "x")
    assert caught.value.filename == str(pipe / "below" / "file.txt")
    assert list(tmp_path.iterdir()) == [pipe]


def test_a_link_stays_a_link(tmp_path):
    target, link = tmp_path / "target.txt", tmp_path / "link.txt"
    target.write_text("old")
    link.symlink_to(target)
    _files.write(link, "new")
    assert link.is_symlink()
    assert target.read_text() == "new"
