"""Ctrl-C, SIGTERM and SIGHUP: one line, the exit code of a shell, and no unfinished files."""

import os
import signal
import subprocess
import sys
import time

import pytest

from ballbot_rs import _files, _interrupts
from tests.support import commands

ENDINGS = [
    (signal.SIGINT, 130, "interrupted\n"),
    (signal.SIGTERM, 143, "terminated\n"),
    (signal.SIGHUP, 129, "hung up\n"),
]


@pytest.mark.parametrize(("number", "code", "line"), ENDINGS)
def test_a_video_that_is_interrupted_leaves_nothing(tmp_path, number, code, line):
    pytest.importorskip("moviepy")
    out = tmp_path / "a.mp4"
    out.write_bytes(b"what was there before")
    process = commands.start("record", "--model", "planar", "--seconds", "100", "-o", out)
    ends = time.monotonic() + 60
    while not list(tmp_path.glob(".a.*.mp4")):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < ends
        time.sleep(0.02)
    process.send_signal(number)
    printed, output = process.communicate(timeout=300)
    assert (process.returncode, printed, output) == (code, "", line)
    # The encoder may be through with a file that has lost its name.
    assert [path.name for path in tmp_path.iterdir()] == ["a.mp4"]
    assert out.read_bytes() == b"what was there before"


#: A command that is within a long call of C when the signal comes.
IN_A_LONG_CALL = """
import ctypes, sys
from ballbot_rs import _interrupts
_interrupts.install()
print("ready", flush=True)
{}
"""


@pytest.mark.parametrize(("number", "code", "line"), ENDINGS)
@pytest.mark.parametrize("call", ["ctypes.CDLL(None).sleep(600)", "while True: pass"])
def test_a_signal_ends_a_long_call(number, code, line, call):

    process = subprocess.Popen(
        [sys.executable, "-c", IN_A_LONG_CALL.format(call)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "ready\n"
    process.send_signal(number)
    _, output = process.communicate(timeout=300)
    assert (process.returncode, output) == (code, line)


def test_a_signal_that_is_ignored_stays_ignored():

    code = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)" + IN_A_LONG_CALL.format("sys.stdin.read()")
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == "ready\n"
    process.send_signal(signal.SIGINT)
    assert process.communicate(timeout=300) == ("", "")
    assert process.returncode == 0


def test_signals_unwind_patient_code():
    with pytest.raises(KeyboardInterrupt), _interrupts.patient():
        _interrupts._on_signal(signal.SIGINT, None)
    with pytest.raises(_interrupts.Terminated), _interrupts.patient():
        _interrupts._on_signal(signal.SIGTERM, None)


def test_critical_sections_are_finished_before_an_interrupt():
    done = []
    with pytest.raises(_interrupts.Terminated), _interrupts.patient():  # noqa: PT012
        with _interrupts.held_back():
            _interrupts._on_signal(signal.SIGTERM, None)
            done.append("first")
        done.append("second")
    assert done == ["first"]
    with _interrupts.held_back():
        pass


def test_unfinished_files_and_scratch_folders_are_deleted(tmp_path):
    with _files.scratch_folder() as scratch, _files.replacing(tmp_path / "a.txt") as temporary:
        (scratch / "x").write_text("x")
        temporary.write_text("half")
        _files.delete_unfinished()
        assert not scratch.exists()
        assert list(tmp_path.iterdir()) == []
        # The file is needed again only because this test continues.
        temporary.write_text("whole")
        scratch.mkdir()
    assert (tmp_path / "a.txt").read_text() == "whole"


def test_the_command_is_known_before_anything_is_imported(tmp_path):
    # Run as the command would be, but its first import after `_start` waits for the signal.
    (tmp_path / "numpy.py").write_text("print('ready', flush=True)\nimport time\ntime.sleep(600)\n", encoding="utf-8")
    (tmp_path / "ballbot").write_text("from ballbot_rs.cli import run\nrun()\n", encoding="utf-8")
    path = os.pathsep.join([str(tmp_path), *commands.IMPORT_PATH])
    as_module = [sys.executable, "-m", "ballbot_rs", "info"]
    for line in ([sys.executable, str(tmp_path / "ballbot"), "info"], commands.command("info"), as_module):
        process = subprocess.Popen(
            line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ, "PYTHONPATH": path}
        )
        assert process.stdout.readline() == "ready\n"
        process.send_signal(signal.SIGINT)
        _, output = process.communicate(timeout=300)
        assert (process.returncode, output) == (130, "interrupted\n")


def test_a_library_does_not_change_signals():
    code = "import signal, ballbot_rs; print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "True\n"


def test_a_second_signal_while_the_first_one_ends_the_process_ends_it():
    """The thread that was ending the process waited for itself, forever."""
    code = """
import os, signal, time
from ballbot_rs import _files, _interrupts

def delete_unfinished():
    if not sent:
        sent.append(True)
        os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(0.01)

sent = []
_files.delete_unfinished = delete_unfinished
_interrupts.install()
os.kill(os.getpid(), signal.SIGINT)
time.sleep(60.0)
"""
    ended = subprocess.run([sys.executable, "-c", code], timeout=60.0, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (143, "terminated\n")
