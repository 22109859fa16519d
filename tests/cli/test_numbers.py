"""Numbers of the command line: each number out of range is rejected with its value and the limit."""

import argparse
import math
from pathlib import Path

import pytest

from ballbot_rs.cli import main, parser
from ballbot_rs.cli.commands.train import algorithm_name
from ballbot_rs.cli.options.arguments import task_name

#: (command, option, number of values, lowest or None, highest or None)
LIMITS = [
    ("evaluate", "--episodes", 1, 1, 100_000),
    ("evaluate", "--seed", 1, 0, 2**64 - 1),
    ("compare", "--seed", 1, 0, 2**64 - 1),
    ("train", "--episodes", 1, 0, 100_000),
    ("train", "--seed", 1, 0, 2**32 - 1),
    ("train", "--timesteps", 1, 1, 10**12),
    ("tune", "--seed", 1, 0, 2**32 - 1),
    ("tune", "--timesteps", 1, 1, 10**12),
    ("tune", "--trials", 1, 1, 1_000_000),
    ("tune", "--jobs", 1, 1, 1024),
    ("train", "--workers", 1, 1, 1024),
    ("report", "--episodes", 1, 0, 100_000),
    ("report", "--video-seconds", 1, 0, 3600),
    ("view", "--batch", 1, 1, 64),
    ("view", "--port", 1, 1, 65535),
    ("view", "--seed", 1, 0, 2**64 - 1),
    ("view", "--seconds", 1, None, 1e6),
    ("plot", "--seed", 1, 0, 2**64 - 1),
    ("plot", "--width", 1, 50.8, 1016),
    ("record-log", "--seconds", 1, None, 3600),
    ("record-log", "--excitation", 1, 0, 10),
    ("record-log", "--seed", 1, 0, 2**64 - 1),
    ("identify", "--sim-dt", 1, None, 0.05),
    ("identify", "--window", 1, 0.05, 2),
    ("identify", "--imu-position", 3, None, None),
    ("identify", "--threads", 1, 1, 256),
    ("replay", "--sim-dt", 1, None, 0.05),
    ("replay", "--window", 1, 0.05, 2),
    ("replay", "--imu-position", 3, None, None),
    ("replay", "--threads", 1, 1, 256),
    ("replay", "--begin", 1, None, None),
    ("replay", "--seconds", 1, None, 3600),
    ("replay", "--port", 1, 1, 65535),
    ("link", "--idle", 1, 0, 86_400),
    ("link", "--seed", 1, 0, 2**64 - 1),
    ("link", "--timeout", 1, 0, 3600),
    ("link", "--retries", 1, 0, 1_000_000),
    ("link", "--hold", 1, 0, 1_000_000),
    ("link", "--give-up", 1, 0, 3600),
    ("link", "--connect", 1, 0, 3600),
    *(("link", option, 1, 0, 1) for option in ("--drop", "--corrupt", "--duplicate", "--delay")),
    ("link", "--delay-time", 1, 0, 10),
    ("record", "--still", 1, 0, 3600),
    ("record", "--seed", 1, 0, 2**64 - 1),
    ("record", "--size", 2, 1, 8192),
    ("record", "--samples", 1, 1, 4),
    ("record", "--frame-rate", 1, 1, 240),
    ("record", "--camera", 2, -6.28319, 6.28319),
    ("record", "--distance", 1, 0.01, 1000),
    ("simulate", "--seed", 1, 0, 2**64 - 1),
    ("simulate", "--position", 2, None, None),
    *(
        (command, option, count, low, high)
        for command in ("record", "plot", "link", "simulate")
        for option, count, low, high in (
            ("--seconds", 1, None, 3600),
            ("--tilt", 2, -1.5708, 1.5708),
            ("--yaw", 1, -6.28319, 6.28319),
            ("--push", 3, None, None),
            ("--push-at", 1, 0, 3600),
        )
    ),
]


def options():
    """Every option of every command that takes what is neither text nor a path."""
    (commands,) = (action for action in parser()._actions if isinstance(action, argparse._SubParsersAction))
    for name, command in commands.choices.items():
        for action in command._actions:
            if action.option_strings and action.type not in (None, Path, task_name, algorithm_name):
                yield name, action.option_strings[-1]


def test_every_numeric_option_is_here():
    assert sorted(options()) == sorted((command, option) for command, option, *_ in LIMITS)


@pytest.mark.parametrize(("command", "option", "count", "low", "high"), LIMITS)
def test_a_number_out_of_range_is_rejected(capsys, tmp_path, monkeypatch, command, option, count, low, high):
    monkeypatch.chdir(tmp_path)
    wrong = ["nan", "inf", "-inf", "1e999", "many", ""]
    wrong += [] if low is None else [f"{low - 1:g}"]
    wrong += ["0"] if option == "--seconds" else []
    wrong += [] if high is None else [str(high + 1)]
    given = ["x"] if command in ("report", "identify", "replay", "link") else []
    for value in wrong:
        with pytest.raises(SystemExit) as ended:
            main([command, *given, *([f"{option}={value}"] if count == 1 else [option, *[value] * count])])
        assert ended.value.code == 2
        output = capsys.readouterr().err.splitlines()[-1]
        assert output.startswith(f"ballbot {command}: argument ")
        assert f"{value} is out of range: it must be " in output or f"'{value}' is not a " in output, output
        assert high is None or not value.endswith("1") or f"{high:g}" in output or str(high) in output
    assert list(tmp_path.iterdir()) == []


def test_a_negative_number_may_have_an_exponent():
    parsed = parser().parse_args(["record", "--tilt", "-1e-3", "-.5", "--push", "-1", "-2.5E+1", "-0"])
    assert (parsed.tilt, parsed.push) == ([-0.001, -0.5], [[-1.0, -25.0, 0.0]])


@pytest.mark.parametrize(
    "push", [["--push", "0.3", "-1", "0"], ["--push", "0.3,-1,0"], ["--push=0.3,-1,0"], ["--push", "-0.3,1,0"]]
)
def test_spaces_and_commas_separate_alike(push):
    parsed = parser().parse_args(["record", *push, "goal"])
    assert [abs(number) for number in parsed.push[0]] == [0.3, 1.0, 0.0]
    assert parsed.task == "goal"


def test_paths_are_not_split_at_commas():
    parsed = parser().parse_args(["view", "--urdf", "a,b.urdf", "c.urdf"])
    assert parsed.urdf == [Path("a,b.urdf"), Path("c.urdf")]


@pytest.mark.parametrize(
    ("arguments", "name", "expected"),
    [
        (["train", "--timesteps", "1e5"], "timesteps", 100_000),
        (["evaluate", "--seed", str(2**64 - 1)], "seed", 2**64 - 1),
        (["plot", "--width", "89mm"], "width", 89.0),
        (["plot", "--width", "8.9cm"], "width", 89.0),
        (["plot", "--width", "89"], "width", 89.0),
        (["record", "--distance", "250cm"], "distance", 2.5),
        (["record", "--seconds", "1min", "--push-at", "200ms"], "push_at", [0.2]),
        (["record", "--tilt", "90deg,-45°"], "tilt", [math.pi / 2, -math.pi / 4]),
    ],
)
def test_numbers_as_people_write_them(arguments, name, expected):
    assert getattr(parser().parse_args(arguments), name) == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["train", "--timesteps", "1.5"], "'1.5' is not a whole number"),
        (["record", "--tilt", "10", "0"], "10 rad are 573 deg: for 10 degrees write 10deg"),
        (["record", "--tilt", "100deg,0"], "at most 1.5708 rad"),
        (["plot", "--width", "89furlong"], "'89furlong' is not a number: a number, or one with m, cm, mm, in"),
        (["record", "--push", "0.3"], "expected 3 numbers, X Y Z, with spaces or commas between them"),
        (["record", "--push", "0.3,0"], "expected 3 numbers, X Y Z, with spaces or commas between them"),
    ],
)
def test_an_error_names_what_is_expected(capsys, arguments, message):
    with pytest.raises(SystemExit):
        main(arguments)
    assert message in capsys.readouterr().err.splitlines()[-1]
