"""Units, signs and order of columns: what a complaint names, and that a correct log has none."""

import copy
import json
import re

import numpy as np
import pytest

from ballbot_rs import Params, SensorLog, identify, record_log
from ballbot_rs.identification.logs.column_map import ColumnMap
from ballbot_rs.identification.logs.log import COLUMNS
from ballbot_rs.identification.logs.merge import merged
from ballbot_rs.identification.logs.recording import from_table
from ballbot_rs.identification.plausibility import check_log, responses_of

ROBOTS = ("paper", "kugle", "rezero", "asroballet")


@pytest.fixture(scope="module")
def log():
    # Slow enough that deg/s are within the range of a gyroscope.
    return record_log("paper", 5.0, actuators={"delay": 0.012}, excitation=0.25, seed=1)


def changed(log, **changes):
    return SensorLog(**{name: changes.get(name, getattr(log, name)) for name in COLUMNS})


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_correct_log_has_no_complaint(robot):
    params = Params.preset(robot)
    check_log(record_log(params, 4.0, actuators={"delay": 0.01}, seed=3), params)
    check_log(record_log(params, 2.0, excitation=0.0, seed=3), params)


def test_a_robot_with_other_parameters_has_no_complaint(log):
    paper = Params.paper()
    heavier = {"body_mass": 2.0 * paper.body_mass, "body_inertia": tuple(2.0 * np.array(paper.body_inertia))}
    for changes in (heavier, {"body_com_height": 0.5 * paper.body_com_height}, {"wheel_radius": 0.05}):
        check_log(log, paper.replace(**changes))


def test_responses_have_the_symmetry_of_the_robot():
    rates, speeds = responses_of(Params.paper())
    together, apart = np.ones(3), np.array([1.0, -1.0, 0.0])
    # Equal torques only turn the body about the mast, torques of sum zero only tilt it.
    np.testing.assert_allclose((rates @ together)[:2], 0.0, atol=1e-9)
    np.testing.assert_allclose(speeds @ together, (speeds @ together)[0])
    np.testing.assert_allclose((rates @ apart)[2], 0.0, atol=1e-9)
    # A turn by 120 deg maps wheel 0 on wheel 1.
    turn = np.array([[-0.5, -np.sqrt(0.75)], [np.sqrt(0.75), -0.5]])
    np.testing.assert_allclose(turn @ rates[:2, 0], rates[:2, 1], rtol=1e-6, atol=1e-6)


COMPLAINTS = {
    "deg/s": (
        lambda log: {"gyro": np.degrees(log.gyro)},
        r"^gyro looks like deg/s, not rad/s: gyro_x, gyro_y, gyro_z show \d+(\.\d)? times the expected changes "
        r'\(the torques explain \d\d % of .*\); in a column map, \[units\] gyro = "deg/s"$',
    ),
    "deg": (
        lambda log: {"wheel_angles": np.degrees(log.wheel_angles)},
        r'^wheel_angles looks like deg, not rad: .*\[units\] wheel_angles = "deg"$',
    ),
    "turns": (
        lambda log: {"wheel_angles": log.wheel_angles / (2.0 * np.pi)},
        r'^wheel_angles looks like turn, not rad: .*\[units\] wheel_angles = "turn"$',
    ),
    "ticks": (
        lambda log: {"wheel_angles": log.wheel_angles * 64.0 / (2.0 * np.pi)},
        r"^the unit of the encoders looks wrong, as encoders with about [56]\d(\.\d)? ticks per turn",
    ),
    "mN·m": (
        lambda log: {"torques": 1e3 * log.torques},
        r'^torques looks like mNm, not Nm: .*\[units\] torques = "mNm"$',
    ),
    "sign of the gyro": (
        lambda log: {"gyro": log.gyro * [1, -1, 1]},
        r"^the sign of gyro_y looks wrong .*\[scale\] gyro = \[1, -1, 1\]$",
    ),
    "sign of a wheel": (
        lambda log: {"wheel_angles": log.wheel_angles * [-1, 1, 1]},
        r"^the sign of wheel_angle_0 looks wrong .*\[scale\] wheel_angles = \[-1, 1, 1\]$",
    ),
    "sign of the torques": (
        lambda log: {"torques": -log.torques},
        r"^the sign of torque_0, torque_1, torque_2 looks wrong \(gyroscope and encoders agree .*\[-1, -1, -1\]$",
    ),
    "sign of one torque": (
        lambda log: {"torques": log.torques * [1, 1, -1]},
        r"^the sign of torque_2 looks wrong .*\[scale\] torques = \[1, 1, -1\]$",
    ),
    "axes of the gyro": (
        lambda log: {"gyro": log.gyro[:, [1, 2, 0]]},
        "^the order of the gyroscope looks wrong: gyro_x is gyro_y, gyro_y is gyro_z, gyro_z is gyro_x .*"
        r'in a column map, \[columns\] gyro = \["gyro_z", "gyro_x", "gyro_y"\]$',
    ),
    "order of the encoders": (
        lambda log: {"wheel_angles": log.wheel_angles[:, [0, 2, 1]]},
        "^the order of the encoders looks wrong: wheel_angle_1 is wheel_angle_2, wheel_angle_2 is wheel_angle_1 ",
    ),
    "order of the torques": (
        lambda log: {"torques": log.torques[:, [1, 2, 0]]},
        "^the order of the torques looks wrong: torque_0 is torque_1, torque_1 is torque_2, torque_2 is torque_0 ",
    ),
    "axes of the accelerometer": (
        lambda log: {"accelerations": log.accelerations[:, [2, 0, 1]]},
        r"^the axes of the accelerometer look wrong: the mean of .* is \(9.8\d*, .*: z looks like acc_x$",
    ),
    "upside down": (
        lambda log: {"accelerations": -log.accelerations},
        "z looks like minus acc_z$",
    ),
    "g": (
        lambda log: {"accelerations": log.accelerations / 9.81},
        r"^the mean magnitude of .* is .* m/s², expected 5 to 20 m/s²; it looks like g: give the specific force",
    ),
}


@pytest.mark.parametrize(("wrong", "message"), COMPLAINTS.values(), ids=COMPLAINTS)
def test_a_complaint_names_columns_evidence_and_remedy(log, wrong, message):
    with pytest.raises(ValueError, match=message):
        check_log(changed(log, **wrong(log)), Params.paper())


def followed(table, remedy):
    """The table of a column map after the lines of a complaint."""
    lines = re.findall(r"(?:\[(\w+)\] )?(\w+) = (\[[^]]*\]|\"[^\"]*\"|[\d.e+]+)", remedy)
    assert lines
    for part, key, value in lines:
        (table.setdefault(part, {}) if part else table)[key] = json.loads(value)
    if "without ticks_per_turn" in remedy:
        del table["ticks_per_turn"]


WRONG = {
    "order of the gyro": {"columns": {"gyro": ["gyro_y", "gyro_z", "gyro_x"]}},
    "order of the encoders": {"columns": {"wheel_angles": ["wheel_angle_2", "wheel_angle_0", "wheel_angle_1"]}},
    "order of the torques": {"columns": {"torques": ["torque_1", "torque_2", "torque_0"]}},
    "order and scales": {
        "columns": {"wheel_angles": ["wheel_angle_1", "wheel_angle_2", "wheel_angle_0"]},
        "scale": {"wheel_angles": [1, -1, 1]},
    },
    "unit": {"units": {"gyro": "deg/s"}},
    "unit and sign": {"units": {"torques": "mNm"}, "scale": {"torques": [1, 1, -1]}},
    "signs that were right": {"scale": {"gyro": -1}},
    "one scale of three": {"scale": {"wheel_angles": [1, 0.01745, 1]}},
    "one scale of the gyro": {"scale": {"gyro": [1, 1, 20]}},
    "ticks": {"units": {"wheel_angles": "ticks"}, "ticks_per_turn": 64},
}


@pytest.mark.parametrize("wrong", WRONG.values(), ids=WRONG)
def test_a_map_that_follows_the_remedy_is_right(log, tmp_path, wrong):
    """The remedy is relative to what the map already has, so that one change is enough."""
    log.write(tmp_path / "log.npz")
    columns = {name: list(titles) for name, titles in COLUMNS.items() if getattr(log, name) is not None}
    (columns["time"],) = columns["time"]
    table = {**copy.deepcopy(wrong), "columns": {**columns, **wrong.get("columns", {})}}
    stored = dict(np.load(tmp_path / "log.npz"))

    def read():
        found = ColumnMap.of(table)
        fields, report = merged(from_table(stored, found), found)
        return SensorLog(**fields, report=report)

    with pytest.raises(ValueError, match=r"in a column map, ") as caught:
        check_log(read(), Params.paper())
    followed(table, str(caught.value).partition("in a column map, ")[2])
    check_log(read(), Params.paper())
    (name,) = {key for part in wrong.values() if isinstance(part, dict) for key in part}
    factor = getattr(read(), name) / getattr(log, name)
    assert (np.abs(np.log(np.nanmedian(factor, axis=0))) < 0.7).all()


@pytest.mark.parametrize("name", ["wheel_angles", "gyro", "torques"])
@pytest.mark.parametrize("column", [0, 1, 2])
def test_a_wrong_scale_of_one_column_is_named(log, name, column):
    factors = np.ones(3)
    factors[column] = 0.02
    message = rf"{COLUMNS[name][column]} shows 0.0\d+ times the changes that fit the other columns .*\[scale\] {name}"
    with pytest.raises(ValueError, match=message):
        check_log(changed(log, **{name: getattr(log, name) * factors}), Params.paper())


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("wheel", [0, 1, 2])
def test_a_wrong_sign_is_found_on_every_robot(robot, wheel):
    """Also on asroballet, whose dry friction is half of its torques."""
    log = record_log(robot, 6.0, actuators={"delay": 0.01}, seed=1)
    signs = np.ones(3)
    signs[wheel] = -1.0
    with pytest.raises(ValueError, match=f"the sign of wheel_angle_{wheel} looks wrong"):
        check_log(changed(log, wheel_angles=log.wheel_angles * signs), Params.preset(robot))


def test_identification_complains_before_it_fits(log):
    pytest.importorskip("scipy")
    with pytest.raises(ValueError, match="gyro looks like deg/s"):
        identify(changed(log, gyro=np.degrees(log.gyro)), "paper", progress=lambda *_: pytest.fail("it simulated"))
