"""docs/link.md: its tables are the layout, its controller in C compiles and balances the robot."""

import re
import subprocess

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.deployment import controller_header, estimator_header, link_header
from ballbot_rs.link.frames import Frame, decode, encode
from ballbot_rs.link.layout import CHECKSUM, HEADER, PAYLOADS, Kind, Status, wire_size_of
from tests.support.c_code import STRICT
from tests.support.paths import ROOT

PAGE = (ROOT / "docs" / "link.md").read_text(encoding="utf-8")

TYPES = {"B": "u8", "H": "u16", "I": "u32", "d": "f64"}


def table(fields, offset):
    """A table of fields from a byte on."""
    lines = ["| byte | field | type | unit | what |", "|--:|---|---|---|---|"]
    for field in fields:
        kind = TYPES[field.type] + (f"[{field.length}]" if field.length > 1 else "")
        lines.append(f"| {offset} | `{field.name}` | {kind} | {field.unit} | {field.doc} |")
        offset += field.size
    return "\n".join(lines)


def test_tables_of_the_page_are_the_layout():
    head = sum(field.size for field in HEADER)
    assert table(HEADER, 0) in PAGE
    for kind, fields in PAYLOADS.items():
        assert table((*fields, CHECKSUM), head) in PAGE
        assert f"{kind.name}, from the {'simulation' if kind == Kind.READINGS else 'controller'}, " in PAGE
        assert f"{wire_size_of(kind)} bytes on the wire" in PAGE
    for status in Status:
        assert f"| {status.value} | `{status.name.lower()}` |" in PAGE


@pytest.fixture
def board(tmp_path):
    """The controller of the page, compiled with the headers that the page exports."""
    (code,) = re.findall(r"```c\n(.*?)```", PAGE, flags=re.DOTALL)
    (tmp_path / "board.c").write_text(code, encoding="utf-8")
    headers = {
        "link.h": link_header(),
        "gains.h": controller_header("lqr", "kugle"),
        "estimator.h": estimator_header("kugle", "kugle"),
    }
    for name, text in headers.items():
        (tmp_path / name).write_text(text, encoding="ascii")
    program = tmp_path / "board"
    command = ["cc", *STRICT, "-O2", "-o", program, tmp_path / "board.c", "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return program


@pytest.mark.slow("repeats lost frames")
def test_controller_of_the_page_is_the_controller_of_the_package(board):
    """The controller in C differs from the core's by rounding; lost frames change nothing."""
    robot = {"robot": "kugle", "sensors": "kugle", "tilt": (0.03, -0.02), "seconds": 1.0}
    robot["reference"] = {"position": (0.1, 0.0), "yaw": 0.2}
    ours = bb.simulate(bb.EstimatedController("lqr", "kugle", "kugle"), **robot)
    for faults in (None, bb.LinkFaults(drop=0.2, corrupt=0.1, duplicate=0.2, seed=5)):
        with bb.Link(f"exec:{board}", faults=faults, timeout=0.02, retries=100) as link:
            linked = bb.simulate(link, **robot)
        assert link.statistics.statuses == {"running": 100}
        assert linked.fell_at is None
        assert np.abs(linked.torques - ours.torques).max() < 1e-6
        assert max(abs(a.tilt - b.tilt) for a, b in zip(linked.states, ours.states, strict=True)) < 1e-9


@pytest.mark.parametrize("force", [0.0, -9.8])
def test_controller_of_the_page_does_not_begin_without_an_attitude(board, force):
    """Nor is it still in the episode before."""
    numbers = [0.0] * 21
    frames = []
    for sequence, z in enumerate((9.8, force, 9.8)):
        numbers[5] = z
        frames.append(encode(Frame(Kind.READINGS, int(sequence < 2), sequence, 0, tuple(numbers))))
    done = subprocess.run([board], input=b"".join(frames), capture_output=True, timeout=10, check=False)
    answers = [decode(stuffed) for stuffed in done.stdout.split(b"\0")[:-1]]
    assert [answer.flags for answer in answers] == [Status.RUNNING, Status.STARTING, Status.STARTING]
    assert answers[1].numbers == answers[2].numbers == (0.0, 0.0, 0.0)


def test_controller_of_the_page_leaves_at_the_end_of_its_input(board):
    done = subprocess.run([board], input=b"noise\0\0\1", capture_output=True, timeout=10, check=False)
    assert (done.returncode, done.stdout) == (0, b"")
