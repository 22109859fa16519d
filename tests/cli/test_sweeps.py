"""`--sweep`: the same study as in Python, printed, and written as numbers or a figure."""

import csv
import json

import pytest

import ballbot_rs as bb
from ballbot_rs.cli.options.sweeps import read
from tests.support.in_process import parse_json, run

FEW = ["--episodes", "3", "--set", "max_episode_steps=30"]
SWEEP = ["--sweep", "body_mass=2,2.5", "--sweep", "actuators.delay=0,0.02"]


def study():
    sweep = {"body_mass": [2, 2.5], "actuators.delay": [0, 0.02]}
    return bb.compare(["lqr", "lqi"], episodes=3, max_episode_steps=30, sweep=sweep)


def test_the_command_prints_the_study(capsys):
    code, out, _ = run(
        capsys, "evaluate", *FEW, *SWEEP, "--controller", "lqr", "--controller", "lqi", "--value", "tilt_rms"
    )
    assert code == 0
    title, header, line, *rows = out.splitlines()
    assert title == "tilt rms:"
    assert set(line) == {"-", " "}
    assert [row.split() for row in (header, *rows)] == study().table("tilt_rms")


def test_its_files_have_the_numbers_or_the_figure(capsys, tmp_path):
    for name in ("a.csv", "a.svg"):
        arguments = ("evaluate", *FEW, *SWEEP, "--controller", "lqr", "--controller", "lqi", "--json")
        code, out, _ = run(capsys, *arguments, "--value", "tilt_rms", "-o", str(tmp_path / name))
        assert code == 0
        assert parse_json(out)["results"] == study().rows
    read_back = list(csv.DictReader((tmp_path / "a.csv").open()))
    assert [float(row["tilt_rms"]) for row in read_back] == study().column("tilt_rms")
    assert "(b) LQI" in (tmp_path / "a.svg").read_text()


def test_a_checkpoint_continues(capsys, tmp_path):
    arguments = ("evaluate", *FEW, *SWEEP, "--checkpoint", str(tmp_path / "a.json"))
    first = run(capsys, *arguments)
    assert first[0] == 0
    assert len(json.loads((tmp_path / "a.json").read_text())["rows"]) == 4
    assert run(capsys, *arguments) == first
    code, _, err = run(capsys, *arguments, "--seed", "1")
    assert code == 1
    assert "seed is 1000 there and 1 here" in err


def test_scenarios_are_swept(capsys):
    code, out, _ = run(capsys, "compare", "S13-6s", "--sweep", "robot=paper,kugle", "--json")
    assert code == 0
    assert [row["robot"] for row in parse_json(out)["results"]] == ["paper", "kugle"]


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("a=1,2.5", [1, 2.5]),
        ("a=paper, kugle", ["paper", "kugle"]),
        ("a=[1,2],[3,4]", [[1, 2], [3, 4]]),
        ("a=true,null", [True, None]),
        ("a=1e-3,.5", [1e-3, 0.5]),
    ],
)
def test_values_are_read_as_by_set(text, values):
    class Arguments:
        sweep, value, output = [text], None, None

    assert read(Arguments(), ()) == {"a": values}
