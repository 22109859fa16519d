"""`ballbot info`, and what commands have in common."""

import json
import sys

import pytest

from ballbot_rs import __version__
from ballbot_rs._core import MODELS
from ballbot_rs.cli import main, progress


def test_info_is_the_same_as_json_and_as_text(capsys):
    assert main(["info", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["ballbot_rs"] == __version__
    assert found["python"].endswith(".".join(map(str, sys.version_info[:3])))
    assert found["models"] == MODELS
    assert 1 <= found["threads"] <= found["processors"]
    assert found["libraries"]["numpy"]
    assert main(["info"]) == 0
    text = capsys.readouterr().out
    assert len([line for line in text.splitlines() if line[0] != " "]) == len(found)
    assert f"numpy {found['libraries']['numpy']}" in text
    assert "planar, spatial, contact, rigid" in text


def test_info_contains_no_personal_data(capsys, monkeypatch):
    monkeypatch.setenv("HOME", "/home/someone-unusual")
    monkeypatch.setenv("USER", "someone-unusual")
    assert main(["info"]) == 0
    assert "someone-unusual" not in capsys.readouterr().out


def test_missing_libraries_are_reported(capsys, monkeypatch):
    monkeypatch.setattr("ballbot_rs.cli.commands.info.LIBRARIES", ("no-such-library",))
    assert main(["info"]) == 0
    assert "no-such-library not installed" in capsys.readouterr().out


def test_a_bar_is_shown_only_on_a_terminal(capsys, monkeypatch):
    pytest.importorskip("rich")
    with progress.bar("working") as advance:
        advance(1, 2)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    for quiet in (False, True):
        with progress.bar("working", quiet) as advance:
            advance(1, 2)
        assert ("working" in capsys.readouterr().err) is not quiet


def test_completions_include_every_command(capsys):
    pytest.importorskip("shtab")
    with pytest.raises(SystemExit) as ended:
        main(["--print-completion", "bash"])
    assert ended.value.code == 0
    script = capsys.readouterr().out
    for expected in ("evaluate", "record", "--push-at", "--no-report"):
        assert expected in script
