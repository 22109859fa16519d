"""A log and its simulation: residuals of the true robot are noise, residuals of another robot are not."""

import dataclasses
import json

import numpy as np
import pytest

from ballbot_rs import Params, SensorLog, record_log
from ballbot_rs.cli import main
from ballbot_rs.identification.excitation import NOISE
from ballbot_rs.identification.logs.log import COLUMNS
from ballbot_rs.identification.replay import replay

PAPER = Params.paper()
MOTORS = {"delay": 0.006}


@pytest.fixture(scope="module")
def noisy():
    return record_log(PAPER, 6.0, actuators=MOTORS, seed=1)


def changed(log, rows=slice(None), **changes):
    fields = {name: changes.get(name, getattr(log, name)) for name in COLUMNS}
    return SensorLog(**{name: value[rows] for name, value in fields.items() if value is not None})


def test_residuals_of_the_robot_that_recorded_the_log_are_its_noise(noisy):
    done = []
    found = replay(noisy, PAPER, actuators=MOTORS, num_threads=1, progress=lambda *counts: done.append(counts))
    assert found.fallen == 0
    assert len(found.residuals) == 9
    for one in found.residuals:
        kind = {"whe": "wheel_angle", "gyr": "gyro", "acc": "acceleration"}[one.column[:3]]
        # A fit of 8 + 3 numbers to 50 rows of 9 columns takes some of the noise.
        assert 0.8 * NOISE[kind] < one.rms < 1.05 * NOISE[kind], one
    assert all(one.explained > 0.98 for one in found.residuals[:6])
    assert done[-1][0] == done[-1][1]


def test_residuals_of_another_robot_exceed_the_noise(noisy):
    found = replay(noisy, PAPER.replace(wheel_viscous_friction=5e-3), actuators=MOTORS, num_threads=1)
    true = replay(noisy, PAPER, actuators=MOTORS, num_threads=1)
    for name in ("wheel_angle", "gyro"):
        assert np.nanmedian(found.of_windows[name]) > 2.0 * np.nanmedian(true.of_windows[name])
    assert found.residuals[0].rms > 3.0 * found.residuals[0].noise


def test_exact_measurements_are_simulated_exactly():
    log = record_log(PAPER, 3.0, noise=None, seed=1)
    found = replay(log, PAPER, num_threads=1)
    np.testing.assert_allclose(found.simulated[:, :6], found.measured[:, :6], atol=2e-4)
    np.testing.assert_allclose(found.simulated[:, 6:], found.measured[:, 6:], atol=1e-3)
    np.testing.assert_allclose(found.simulated_tilt, found.measured_tilt, atol=1e-5)
    np.testing.assert_allclose(found.simulated_speeds, found.measured_speeds, atol=1e-3)
    # Of windows that follow each other, the tilts at the end and at the begin are an interval of one row apart.
    ends, begins = found.windows.bounds[1:-1] - 1, found.windows.bounds[1:-1]
    rates = 0.5 * (found.measured[ends, 3:5] + found.measured[begins, 3:5])
    turned = found.measured_tilt[ends] + 0.01 * rates
    np.testing.assert_allclose(found.measured_tilt[begins], turned, atol=2e-3)
    assert np.isnan(found.measured[begins, 6:]).all()


def test_a_log_without_an_accelerometer_and_with_a_gap(noisy):
    kept = (noisy.time < 2.0) | (noisy.time > 2.2)
    log = SensorLog(noisy.time[kept], noisy.torques[kept], noisy.wheel_angles[kept], noisy.gyro[kept])
    found = replay(log, PAPER, actuators=MOTORS, num_threads=1)
    assert [one.column for one in found.residuals] == [*COLUMNS["wheel_angles"], *COLUMNS["gyro"]]
    assert all(np.diff(found.time[found.windows.rows_of(index)]).max() < 0.011 for index in range(len(found.windows)))
    assert "acceleration" not in found.table()
    assert repr(found) == f"<Replay of {len(found.windows)} windows with the model contact>"
    assert found._repr_html_() == f"<pre>{found.table()}</pre>"


def test_the_rms_of_the_table_is_the_rms_of_the_rows(noisy):
    found = replay(noisy, PAPER, num_threads=1)
    rest = found.measured - found.simulated
    np.testing.assert_allclose([one.rms for one in found.residuals], np.sqrt(np.nanmean(rest**2, axis=0)))
    for place, name in ((slice(0, 3), "wheel_angle"), (slice(6, 9), "acceleration")):
        own = rest[found.windows.rows_of(2), place]
        ratio = found.of_windows[name][2] / np.sqrt(np.nanmean(own**2))
        other = found.of_windows[name][3] / np.sqrt(np.nanmean(rest[found.windows.rows_of(3), place] ** 2))
        assert ratio == pytest.approx(other)


def test_windows_in_groups_give_the_same(noisy, monkeypatch):
    """Long logs are simulated in groups of windows."""
    together = replay(noisy, PAPER, num_threads=1)
    monkeypatch.setattr("ballbot_rs.identification.replay.GROUP", 4)
    apart = replay(noisy, PAPER, num_threads=1)
    np.testing.assert_array_equal(apart.simulated, together.simulated)
    np.testing.assert_array_equal(apart.simulated_tilt, together.simulated_tilt)
    assert apart.to_dict() == together.to_dict()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"robot": "r2d2"}, "r2d2"),
        ({"model": "planar"}, "model = 'planar': expected spatial, contact, rigid"),
        ({"window": 9.0}, "window = 9.0 s is out of range"),
        ({"sim_dt": 0.1}, "sim_dt = 0.1 s is out of range"),
        ({"imu_position": (0, 0)}, r"imu_position is \(0, 0\)"),
        ({"actuators": {"delay": 0.5}}, "delay = 0.5 is out of range"),
        ({"robot": PAPER.replace(floor_tilt=(0.1, 0.0))}, "the floor must be level"),
    ],
)
def test_bad_arguments_are_rejected(noisy, arguments, message):
    with pytest.raises(ValueError, match=message):
        replay(noisy, **arguments)
    for name in ("window", "sim_dt"):
        with pytest.raises(TypeError, match=f"{name} = '0.1' is not a number"):
            replay(noisy, **{name: "0.1"})


def test_a_wrong_unit_is_named_instead_of_simulated(noisy):
    with pytest.raises(ValueError, match="the sign of gyro_x looks wrong"):
        replay(changed(noisy, gyro=noisy.gyro * [-1, 1, 1]), PAPER)


def test_poses_are_the_poses_of_the_robot():
    """Without logged poses they follow from rates and wheel angles, up to the place and heading of the begin."""
    log = record_log(PAPER, 4.0, noise=None, pose=True, seed=1)
    bare = dataclasses.replace(log, attitude=None, position=None)
    found, rows = replay(bare, PAPER, num_threads=1), slice(0, 400)
    assert len(found.time) == 400
    for poses in (found.measured_poses, found.simulated_poses):
        np.testing.assert_allclose(poses.position, (log.position - log.position[0])[rows, :2], atol=1e-4)
        assert np.abs((poses.attitude * log.attitude[rows]).sum(axis=1)).min() > 1.0 - 1e-6
    with_poses = replay(log, PAPER, num_threads=1)
    assert [one.column for one in with_poses.residuals[9:]] == ["tilt_x", "tilt_y", "position_x", "position_y"]
    assert all(one.rms < 0.02 * one.measured for one in with_poses.residuals[9:])
    assert len(found.residuals) == 9
    # Another heading of the frame of positions changes nothing.
    turned = dataclasses.replace(log, position=log.position @ [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    rms = [one.rms for one in replay(turned, PAPER, num_threads=1).residuals[11:]]
    np.testing.assert_allclose(rms[::-1], [one.rms for one in with_poses.residuals[11:]], rtol=0.05)


def test_trajectories_have_the_measured_and_the_simulated_motion(noisy):
    found = replay(noisy, PAPER.replace(body_mass=3.0), actuators=MOTORS, num_threads=1)
    measured, simulated = found.trajectories(1.0, 2.0)
    assert measured.times[0] == 0.0
    assert measured.times[-1] == pytest.approx(2.0)
    np.testing.assert_array_equal(measured.of_states("body_angular_velocity"), noisy.gyro[100:301])
    apart = np.abs(simulated.of_states("tilt") - measured.of_states("tilt"))
    assert 1e-4 < apart.max() < 0.2
    with pytest.raises(ValueError, match="0 rows from 9 to 10 s, at least 2 are needed"):
        found.trajectories(9.0, 1.0)


def test_a_session_shows_the_simulation_over_the_log(noisy):
    pytest.importorskip("viser")
    from ballbot_rs.viewer.session.logged import session_of

    found = replay(noisy, PAPER, actuators=MOTORS, num_threads=1)
    session = session_of(found, "mine")
    measured, simulated = found.trajectories()
    frame = session.frame()
    assert session.recording.duration == pytest.approx(found.time[-1] - found.time[0])
    session.replay(3.0)
    frame = session.frame()
    np.testing.assert_array_equal(frame.states[0], measured.states[300].to_array())
    np.testing.assert_array_equal(frame.ghost.state, simulated.states[300].to_array())


def test_the_command_shows_a_page(noisy, capsys, tmp_path, monkeypatch):
    pytest.importorskip("viser")
    pytest.importorskip("matplotlib")
    shown = []

    class Page:
        """A page whose runner has ended."""

        running, error, url = False, None, "http://page"

        def __init__(self, session, port):
            shown.append((session.frame().ghost is not None, port))
            self.runner = self

        def report(self):
            return "the end"

        def stop(self):
            shown.append("stopped")

    monkeypatch.setattr("ballbot_rs.viewer.view.View", Page)
    noisy.write(tmp_path / "log.csv")
    arguments = ["replay", str(tmp_path / "log.csv"), "-o", str(tmp_path / "a.svg"), "--no-open", "--port", "8123"]
    assert main([*arguments, "--page"]) == 0
    assert shown == [(True, 8123), "stopped"]
    assert capsys.readouterr().out.endswith("http://page shows the robot; Ctrl-C ends it\nthe end\n")


def test_the_command_writes_a_video(noisy, capsys, tmp_path):
    pytest.importorskip("moviepy")
    pytest.importorskip("matplotlib")
    noisy.write(tmp_path / "log.csv")
    video, figure = tmp_path / "replay.webp", tmp_path / "replay.svg"
    assert main([
        "replay", str(tmp_path / "log.csv"), "--seconds", "0.1", "--video", str(video), "-o", str(figure), "--json"
    ]) == 0  # fmt: skip
    assert json.loads(capsys.readouterr().out)["video"] == str(video)
    from PIL import Image

    with Image.open(video) as shown:
        assert shown.size == (1280, 480)
        assert shown.n_frames == 5


def test_the_command_writes_a_figure_and_prints_the_table(noisy, capsys, tmp_path):
    pytest.importorskip("matplotlib")
    noisy.write(tmp_path / "log.csv")
    common = [
        "replay", str(tmp_path / "log.csv"), "--set", "robot.body_mass=2.3", "--set", "actuators.delay=0.006",
        "--threads", "1", "-o", str(tmp_path / "replay.svg"),
    ]  # fmt: skip
    assert main(common) == 0
    out = capsys.readouterr().out
    assert out.splitlines()[0].split() == ["column", "unit", "measured", "rms", "residual", "rms", "noise", "explained"]
    assert f"wrote {tmp_path / 'replay.svg'}" in out
    drawn = (tmp_path / "replay.svg").read_text()
    assert all(text in drawn for text in ("tilt (deg)", "body rates (deg/s)", "wheel speeds (rad/s)", "simulated"))
    assert main([*common, "--json", "--begin", "1", "--seconds", "2"]) == 0
    found = json.loads(capsys.readouterr().out)
    other = replay(noisy, PAPER.replace(body_mass=2.3), actuators=MOTORS, num_threads=1)
    assert found["residuals"] == other.to_dict()["residuals"]
    assert found["file"] == str(tmp_path / "replay.svg")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--set", "control_dt=0.01"), "--set control_dt: a replay has robot.NAME, actuators.NAME"),
        (("--set", "robot.body_mas=1"), "body_mas"),
        (("-o", "replay.gif"), "replay.gif: the name of a figure must end in .svg, .pdf, .png"),
        (("--video", "replay.avi"), "replay.avi: a video ends in .mp4"),
        (("--begin", "99"), "--begin 99 is outside the log, which has 6.00 s, from 0.00 to 6.00 s"),
        (("--columns", "nowhere.toml"), "nowhere.toml: No such file or directory"),
    ],
)
def test_an_error_of_the_command_is_one_line(noisy, capsys, tmp_path, monkeypatch, arguments, message):
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    noisy.write(tmp_path / "log.csv")
    assert main(["replay", "log.csv", "--threads", "1", *arguments]) == 1
    err = capsys.readouterr().err
    assert message in err
    assert err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["log.csv"]
