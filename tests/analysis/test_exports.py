"""Exported files equal the trajectory."""

import base64
import csv
import json
import re
import sys

import numpy as np
import pytest

import ballbot_rs as bb

EVENTS = [{"term": "body_mass", "mode": "reset", "range": [0.95, 1.05]}]


@pytest.fixture(scope="module")
def done():
    """Everything that a trajectory can have: a reference, estimates, random parameters."""
    return bb.simulate(
        "lqr",
        reference=bb.Reference.circle(0.3, 6.0),
        pushes=[bb.Push((0.1, 0.0, 0.0), 0.1)],
        sensors="kugle",
        observation="sensors",
        events=EVENTS,
        seconds=0.3,
    )


@pytest.fixture(scope="module")
def fallen():
    """Estimates end with the fall."""
    push = bb.Push((6.0, 0.0, 0.0), 0.1)
    return bb.simulate("lqr", pushes=[push], sensors="kugle", observation="sensors", seconds=1.0)


def test_columns_are_the_rows_of_the_trajectory(done):
    columns = done.columns()
    assert next(iter(columns)) == "time_s"
    assert all(values.shape == (31,) for values in columns.values())
    np.testing.assert_array_equal(columns["time_s"], done.times)
    states = done.to_array()
    # In the order of State.to_array.
    found = list(columns.values())[1:33]
    np.testing.assert_array_equal(np.array(found).T, states)
    for i, axis in enumerate("wxyz"):
        np.testing.assert_array_equal(columns[f"body_quaternion_{axis}"], [s.body_quaternion[i] for s in done.states])
    np.testing.assert_array_equal(columns["yaw_rad"], done.of_states("yaw"))
    np.testing.assert_array_equal(columns["wheel_torque_1_N_m"], done.torques[:, 1])
    np.testing.assert_array_equal(columns["setpoint_velocity_y_m_per_s"], done.setpoints["velocity"][:, 1])
    np.testing.assert_array_equal(columns["wheel_tractions_2_N"], done.of_contacts("wheel_tractions")[:, 2])
    np.testing.assert_array_equal(columns["estimated_tilt_rad"], done.of_estimates("tilt"))
    np.testing.assert_array_equal(columns["drawn_body_mass"], done.draws["body_mass"])


def test_payloads_and_obstacles_have_columns(tmp_path):
    assert not any("payload" in name or "obstacle" in name for name in bb.simulate("lqr", seconds=0.1).columns())
    robot = bb.Params.paper().with_payload(0.3, position=(0.0, 0.0, 0.3), stiffness=90.0)
    robot = robot.with_payload(0.1, position=(0.1, 0.0, 0.2), stiffness=20.0, payload=1)
    wall = bb.Terrain.plane(0.0).with_obstacles([{"kind": "wall", "x": 0.3, "yaw": np.pi}])
    done = bb.simulate("lqr", robot=robot, terrain=wall, pushes=bb.Push((6.0, 0.0, 0.0), 0.05), seconds=2.0)
    assert done.fell_at is not None
    assert done.payloads.shape == (len(done.times), 2, 6)
    columns = done.columns()
    np.testing.assert_array_equal(columns["payload_deflection_x_m"], done.payloads[:, 0, 0])
    np.testing.assert_array_equal(columns["second_payload_deflection_rate_z_m_per_s"], done.payloads[:, 1, 5])
    np.testing.assert_array_equal(columns["obstacle_force_x_N"], done.of_contacts("obstacle_force")[:, 0])
    for name in ("payload_deflection_x_m", "second_payload_deflection_x_m", "obstacle_force_x_N"):
        assert np.abs(columns[name]).max() > 1e-3, name
    reader = pytest.importorskip("mcap.reader", reason="needs 'ballbot-rs[mcap]'")
    done.write(tmp_path / "run.mcap")
    with (tmp_path / "run.mcap").open("rb") as file:
        topics = {channel.topic for _, channel, _ in reader.make_reader(file).iter_messages()}
    assert "/payload" in topics


@pytest.mark.parametrize("masses", [(0.0, 0.5), (0.5, 0.0)])
def test_a_payload_that_comes_or_goes_has_its_rows(masses, tmp_path):
    before, after = masses
    robot = bb.Params.paper().with_payload(before, position=(0.0, 0.0, 0.3), stiffness=120.0)
    event = {"term": "payload_mass", "mode": "at", "at": 0.5, "range": [after, after]}
    done = bb.simulate("lqr", robot=robot, tilt=(0.05, 0.0), seconds=1.0, events=[event])
    assert done.payloads.shape == (101, 2, 6)
    moved = np.abs(done.columns()["payload_deflection_y_m"]) > 1e-9
    # The event precedes the motion of the step.
    assert moved.argmax() == (51 if after else 1)
    assert moved[-1] == bool(after)
    assert moved[49] == bool(before)
    done.write(tmp_path / "run.csv")


def test_a_payload_keeps_its_deflection_in_a_fall():
    robot = bb.Params.paper().with_payload(0.3, position=(0.0, 0.0, 0.3), stiffness=90.0, damping=1.0)
    done = bb.simulate("lqr", robot=robot, pushes=bb.Push((4.0, 0.0, 0.0), 0.05), seconds=1.0)
    row = round(done.fell_at * 100)
    near = done.payloads[row - 3 : row + 4, 0]
    rates = 0.5 * (near[1:, 3] + near[:-1, 3])
    assert np.abs(rates).min() > 0.1
    np.testing.assert_allclose(np.diff(near[:, 0]), 0.01 * rates, rtol=0.05)


def test_estimates_after_a_fall_are_nan(fallen):
    column = fallen.columns()["estimated_tilt_rad"]
    known = len(fallen.estimates)
    assert 0 < known < len(fallen.times)
    assert np.isfinite(column[:known]).all()
    assert np.isnan(column[known:]).all()


@pytest.mark.parametrize("which", ["done", "fallen"])
def test_csv_and_npz_round_trip_exactly(which, request, tmp_path):
    trajectory = request.getfixturevalue(which)
    expected = trajectory.columns()
    trajectory.to_csv(tmp_path / "a.csv")
    with (tmp_path / "a.csv").open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    assert header == list(expected)
    np.testing.assert_array_equal(np.array(rows, dtype=float).T, list(expected.values()))
    trajectory.to_npz(str(tmp_path / "a.npz"))
    with np.load(tmp_path / "a.npz") as found:
        assert found.files == list(expected)
        for name, values in expected.items():
            np.testing.assert_array_equal(found[name], values)


@pytest.mark.parametrize("which", ["done", "fallen"])
def test_mcap_has_a_message_for_each_row_and_topic(which, request, tmp_path):
    reader = pytest.importorskip("mcap.reader", reason="needs 'ballbot-rs[mcap]'")
    trajectory = request.getfixturevalue(which)
    trajectory.to_mcap(tmp_path / "a.mcap")
    with (tmp_path / "a.mcap").open("rb") as file:
        log = reader.make_reader(file)
        rows = [(schema, channel, m.log_time, json.loads(m.data)) for schema, channel, m in log.iter_messages()]
        (metadata,) = log.iter_metadata()
    assert bb.Params.from_toml(metadata.metadata["params"]) == trajectory.params
    topics = {}
    for schema, channel, time, message in rows:
        topics.setdefault(channel.topic, []).append((time, message))
        fields = json.loads(schema.data)["properties"]
        assert message.keys() <= fields.keys()
    assert {"/state", "/torque", "/setpoint", "/contacts", "/estimate", "/tf"} <= topics.keys()
    assert [time for time, _ in topics["/state"]] == [round(t * 1e9) for t in trajectory.times]
    assert len(topics["/estimate"]) == len(trajectory.estimates)
    for (_, message), (_, transforms), state in zip(topics["/state"], topics["/tf"], trajectory.states, strict=True):
        assert list(message["ball_position"].values()) == state.ball_position.tolist()
        assert [message["body_quaternion"][axis] for axis in "wxyz"] == state.body_quaternion.tolist()
        assert message["tilt"] == state.tilt
        ball, body = transforms["transforms"]
        assert [ball["translation"][axis] for axis in "xyz"] == state.ball_position.tolist()
        assert [body["rotation"][axis] for axis in "wxyz"] == state.body_quaternion.tolist()
        assert (ball["parent_frame_id"], body["child_frame_id"]) == ("world", "body")
    units = json.loads(next(s.data for s, c, *_ in rows if c.topic == "/state"))["properties"]
    assert units["ball_velocity"]["description"].endswith(", m/s")


def test_a_data_frame_has_the_columns(done):
    pytest.importorskip("pandas", reason="needs 'ballbot-rs[pandas]'")
    frame = done.to_dataframe()
    assert list(frame.columns) == list(done.columns())
    np.testing.assert_array_equal(frame.to_numpy().T, list(done.columns().values()))


@pytest.mark.parametrize(("module", "extra"), [("pandas", "pandas"), ("mcap.writer", "mcap")])
def test_a_missing_package_is_named(done, module, extra, monkeypatch, tmp_path):
    class Missing:
        def find_spec(self, name, *_):
            if name.split(".")[0] == module.split(".")[0]:
                raise ModuleNotFoundError(f"No module named '{name}'", name=name)

    for name in [name for name in sys.modules if name.split(".")[0] == module.split(".")[0]]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "meta_path", [Missing(), *sys.meta_path])
    with pytest.raises(ModuleNotFoundError, match=rf"needs {extra}: install it with `pip install .*\[{extra}\]"):
        done.to_dataframe() if extra == "pandas" else done.to_mcap(tmp_path / "a.mcap")


def test_the_suffix_of_a_file_selects_its_format(done, tmp_path):
    for write, suffix in ((done.to_csv, ".csv"), (done.to_npz, ".npz"), (done.to_mcap, ".mcap")):
        with pytest.raises(ValueError, match=f"the name of the file must end in \\{suffix}"):
            write(tmp_path / "a.txt")
    assert not list(tmp_path.iterdir())


def test_a_figure_has_the_reference_and_is_written(done, tmp_path):
    pytest.importorskip("matplotlib", reason="needs 'ballbot-rs[plot]'")
    figure = done.plot(tmp_path / "a.svg")
    assert (tmp_path / "a.svg").read_bytes().startswith(b"<?xml")
    lines = {line.get_label(): line for line in figure.axes[1].get_lines()}
    np.testing.assert_array_equal(lines["x, setpoint"].get_ydata(), done.setpoints["position"][:, 0])
    with pytest.raises(ValueError, match=r"must end in \.svg, \.pdf or \.png"):
        done.plot(tmp_path / "a.gif")


def test_a_video_has_a_frame_for_each_moment(done, tmp_path):
    pytest.importorskip("moviepy", reason="needs 'ballbot-rs[video]'")
    assert done.record(tmp_path / "a.mp4", frame_rate=10.0) == 3
    assert (tmp_path / "a.mp4").stat().st_size > 1000


def test_a_notebook_shows_numbers_and_a_figure(done):
    pytest.importorskip("matplotlib", reason="needs 'ballbot-rs[plot]'")
    shown = done._repr_html_()
    assert "lqr on contact, 0.30 s, upright to the end" in shown
    assert f"{np.degrees(done.metrics().tilt_max):.4g} deg" in shown
    (data,) = re.findall(r'src="data:image/svg\+xml;base64,([^"]*)"', shown)
    assert b"ball position (m)" in base64.b64decode(data)
    assert repr(done) == "<Trajectory of lqr on contact: 0.3 s, 31 rows, upright, sim_dt 2 ms>"
