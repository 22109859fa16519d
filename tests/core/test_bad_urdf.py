"""URDFs that do not describe a ballbot are rejected, and the message states why."""

import os

import pytest

from ballbot_rs import Params, UrdfError

#: (the file, what is replaced in it, by what, what the message must have)
URDF_EDITS = {
    "not XML": ("bot", None, "hello", "not a readable URDF"),
    "empty file": ("bot", None, "", "not a readable URDF"),
    "another root": ("bot", None, "<html></html>", "no links"),
    "no links": ("bot", None, '<robot name="x"></robot>', "no links"),
    "cut off": ("bot", "</robot>", "", "not a readable URDF"),
    "text for a number": ("bot", 'mass value="1.8704"', 'mass value="heavy"', "not a readable URDF"),
    "negative mass": ("bot", 'mass value="1.8704"', 'mass value="-1"', "'body': mass = -1 kg .* >= 0"),
    "negative ball": ("ball", 'mass value="1.437"', 'mass value="-1"', "'ball': mass = -1 kg"),
    "massless body": ("bot", 'mass value="1.8704"', 'mass value="0"', "mass = 0 kg"),
    "NaN mass": ("bot", 'mass value="1.8704"', 'mass value="nan"', "mass = NaN kg"),
    "inertia": ("bot", 'izz="0.0088958228"', 'izz="-0.1"', "positive definite"),
    "triangle": ("bot", 'izz="0.0088958228"', 'izz="5"', "triangle inequality"),
    "tilted inertia": (
        "bot",
        'ixx="0.05546522290637172" ixy="0"',
        'ixx="0.0554652" ixy="0.03"',
        r"principal moments .*\[2\] = 0.088.*triangle inequality",
    ),
    "zero ball radius": (
        "ball",
        '<collision>\n      <geometry><sphere radius="0.112"/>',
        '<collision>\n      <geometry><sphere radius="0"/>',
        "radius = 0 m .* > 0",
    ),
    "zero wheel radius": (
        "bot",
        '<collision>\n      <geometry><sphere radius="0.05"/>',
        '<collision>\n      <geometry><sphere radius="0"/>',
        "radius = 0 m",
    ),
    "one wheel larger": (
        "bot",
        '<collision>\n      <geometry><sphere radius="0.05"/>',
        '<collision>\n      <geometry><sphere radius="0.06"/>',
        "the wheels differ: radius",
    ),
    "no such link": (
        "bot",
        '<child link="wheel_1"/>',
        '<child link="wheel_9"/>',
        "link 'wheel_9', which does not exist",
    ),
    "a loop": ("bot", '<child link="wheel_1"/>', '<child link="body"/>', "loop|root|hang"),
    "two parents": ("bot", '<child link="wheel_1"/>', '<child link="wheel_0"/>', "two joints"),
    "missing joint": (
        "bot",
        'name="wheel_joint_2" type="continuous"',
        'name="wheel_joint_2" type="fixed"',
        "2 joints .* expected exactly 3",
    ),
    "sliding wheel": (
        "bot",
        'name="wheel_joint_2" type="continuous"',
        'name="wheel_joint_2" type="prismatic"',
        "'wheel_joint_2' is prismatic",
    ),
    "flipped axis": ("bot", '<axis xyz="0 0 1"/>', '<axis xyz="0 0 -1"/>', "points the wrong way"),
    "zero axis": ("bot", '<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>', "axis has length 0"),
    "wheel off the ball": (
        "bot",
        'xyz="0.1145512985522207 0 0.1145512985522207"',
        'xyz="0.12 0 0.12"',
        "one ball centered on the mast",
    ),
    "body next to the wheels": (
        "bot",
        'xyz="0 0 0.14724789116644882"',
        'xyz="-0.12 0 0.147"',
        "load of wheel 0 in equilibrium = -.* pass between the wheels",
    ),
    "negative damping": (
        "bot",
        '<dynamics damping="0" friction="0"/>',
        '<dynamics damping="-1" friction="0"/>',
        "damping = -1 .* >= 0",
    ),
    "no ball": ("ball", "<inertial>", "<!-- <inertial>", "not a readable URDF|0 links"),
}


@pytest.mark.parametrize("name", URDF_EDITS)
def test_a_urdf_that_is_not_a_ballbot_is_rejected(name, assets, tmp_path):
    edited, old, new, message = URDF_EDITS[name]
    for kind in ("bot", "ball"):
        text = (assets / f"{kind}.urdf").read_text(encoding="utf-8")
        if kind == edited:
            assert old is None or old in text, "the test edits nothing"
            text = new if old is None else text.replace(old, new, 1)
        (tmp_path / f"{kind}.urdf").write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=message) as caught:
        Params.from_urdf(tmp_path / "bot.urdf", tmp_path / "ball.urdf")
    if caught.type is UrdfError:
        assert f"{edited}.urdf" in str(caught.value), "the message does not name the file"


def test_unreadable_urdf_files(assets, tmp_path):
    ball = assets / "ball.urdf"
    with pytest.raises(FileNotFoundError, match="nowhere"):
        Params.from_urdf(tmp_path / "nowhere.urdf", ball)
    with pytest.raises(IsADirectoryError, match="not a regular file"):
        Params.from_urdf(tmp_path, ball)
    (tmp_path / "binary.urdf").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(OSError, match=r"binary\.urdf"):
        Params.from_urdf(tmp_path / "binary.urdf", ball)
    with pytest.raises(TypeError):
        Params.from_urdf(3, ball)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_urdf_without_permission(assets, tmp_path):
    path = tmp_path / "secret.urdf"
    path.write_text("x")
    path.chmod(0)
    with pytest.raises(PermissionError):
        Params.from_urdf(path, assets / "ball.urdf")
