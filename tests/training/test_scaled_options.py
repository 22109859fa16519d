"""Options of training configurations that fit the robot."""

import pytest

import ballbot_rs as bb
from ballbot_rs.training import config

TEXT = """
env_id = "ballbot/Push-v0"

[env]
robot = "rezero"

[scaled]
max_episode_steps = 300
push_seconds = [0.8, 1.6]
max_wheel_torque = 0.5
"""


def test_scaled_options_follow_the_robot():
    rezero = bb.Params.preset("rezero")
    env = config.parse(TEXT, "it").env
    assert env["max_episode_steps"] == round(300 * rezero.scale("s"))
    assert env["push_seconds"] == pytest.approx([0.8 * rezero.scale("s"), 1.6 * rezero.scale("s")])
    own, paper = (bb.Batch(1, "push", robot=robot).max_wheel_torque for robot in ("rezero", "paper"))
    assert env["max_wheel_torque"] == pytest.approx(0.5 * own / paper)
    weak = config.parse(TEXT.replace("max_wheel_torque = 0.5", "max_wheel_torque = 50"), "it").env
    assert weak["max_wheel_torque"] == rezero.max_wheel_torque
    bb.BallbotEnv("push", **env)


def test_the_papers_robot_keeps_them():
    env = config.parse(TEXT.replace("rezero", "paper"), "it").env
    assert env["max_episode_steps"] == 300
    assert env["push_seconds"] == [0.8, 1.6]
    assert env["max_wheel_torque"] == 0.5


def test_an_option_of_the_environment_comes_first():
    text = TEXT.replace('robot = "rezero"', 'robot = "rezero"\npush_seconds = [3, 4]')
    assert config.parse(text, "it").env["push_seconds"] == [3, 4]


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("color = 3", "scaled.color = 3 does not scale: expected one of push, "),
        ("push_seconds = 'long'", "scaled.push_seconds = 'long' must be a number or a list of numbers"),
    ],
)
def test_bad_scaled_options_are_rejected(line, words):
    with pytest.raises(ValueError, match=words):
        config.parse(f"env_id = 'ballbot/Push-v0'\n[scaled]\n{line}", "it")


@pytest.mark.parametrize("unit", ["", "s", "1/s", "m", "m/s", "m/s²", "m/s³", "rad", "rad/s", "N·m", "kg", "N"])
def test_the_papers_robot_has_the_scale_1(unit):
    assert bb.Params.paper().scale(unit) == 1.0


def test_a_unit_without_a_scale_is_rejected():
    with pytest.raises(ValueError, match="unit = 'A' has no scale: expected one of '', 's', "):
        bb.Params.paper().scale("A")


def test_none_is_the_default_of_the_robot():
    speed = 0.5 * bb.Params.preset("rezero").scale("m/s")
    assert bb.Batch(1, "velocity", robot="rezero", speed=None).options["speed"] == speed
    given = bb.Batch(1, "velocity", robot="rezero", speed=0.5)
    assert given.options["speed"] == 0.5
    assert bb.Controller("lqr", torque=None).constants().keys() == bb.Controller("lqr").constants().keys()
    with pytest.raises(TypeError, match="yaw must be an array of numbers"):
        bb.Controller("lqr", yaw=None)
