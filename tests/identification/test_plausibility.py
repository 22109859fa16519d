"""Units, signs and order of columns: what a complaint names, and that a correct log has none."""

import numpy as np
import pytest

from ballbot_rs import Params, SensorLog, identify, record_log
from ballbot_rs.identification.log import COLUMNS
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
        r'^wheel_angles looks like turns, not rad: .*\[units\] wheel_angles = "turn"$',
    ),
    "ticks": (
        lambda log: {"wheel_angles": log.wheel_angles * 64.0 / (2.0 * np.pi)},
        r"^the unit of the encoders looks wrong: .* as encoders with [56]\d(\.\d)? ticks per turn",
    ),
    "mN·m": (
        lambda log: {"torques": 1e3 * log.torques},
        r'^torques looks like mN·m, not N·m: .*\[units\] torques = "mNm"$',
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
        r'in a column map gyro = \["gyro_z", "gyro_x", "gyro_y"\]$',
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


@pytest.mark.parametrize("name", ["gyro", "wheel_angles", "torques"])
def test_the_remedy_of_an_order_restores_the_log(log, tmp_path, name):
    """The order that the complaint prints, as columns of a map, gives the columns their meaning."""
    order = [1, 2, 0]
    wrong = changed(log, **{name: getattr(log, name)[:, order]})
    wrong.write(tmp_path / "log.csv")
    with pytest.raises(ValueError, match="in a column map") as caught:
        check_log(wrong, Params.paper())
    columns = {one: [f'"{title}"' for title in titles] for one, titles in COLUMNS.items() if one != "time"}
    lines = [f"{one} = [{', '.join(titles)}]" for one, titles in columns.items() if one != name]
    remedy = str(caught.value).partition("in a column map ")[2]
    (tmp_path / "map.toml").write_text("\n".join(["[columns]", 'time = "time"', *lines, remedy]))
    read = SensorLog.read(tmp_path / "log.csv", tmp_path / "map.toml")
    np.testing.assert_array_equal(getattr(read, name), getattr(log, name))
    check_log(read, Params.paper())


def test_identification_complains_before_it_fits(log):
    pytest.importorskip("scipy")
    with pytest.raises(ValueError, match="gyro looks like deg/s"):
        identify(changed(log, gyro=np.degrees(log.gyro)), "paper", progress=lambda *_: pytest.fail("it simulated"))
