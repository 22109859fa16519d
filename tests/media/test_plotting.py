"""Figures: that they show the numbers that were collected, and that files are written as requested."""

import dataclasses
import json
import xml.etree.ElementTree as ET

import matplotlib.figure
import numpy as np
import pytest
from PIL import Image

import ballbot_rs as bb
from ballbot_rs._state_rows import tilt_components_of, tilt_rates_of
from ballbot_rs.analysis import recovery_map as recovery
from ballbot_rs.cli import main
from ballbot_rs.media.figures import (
    data,
    estimates,
    learning_curve,
    phase_portrait,
    recovery_map,
    trajectories,
)
from ballbot_rs.media.figures.style import figure, save
from ballbot_rs.training import curve

CONTACT = {"model": "contact"}


@pytest.fixture(scope="module")
def moving():
    push = bb.Push((0.3, 0.0, 0.0), 0.5)
    return [bb.simulate(name, seconds=1.0, pushes=push, **CONTACT, tilt=(0.05, 0.0)) for name in ("lqr", "zero")]


@pytest.fixture(scope="module")
def maps():
    return [
        recovery.collect(name, max_tilt=0.6, rings=4, sectors=6, seconds=4.0, env_options=CONTACT)
        for name in ("lqr", "zero")
    ]


@pytest.fixture
def two_runs(tiny_run, tmp_path):
    for seed in (5, 6):
        folder = tmp_path / f"seed-{seed}"
        folder.mkdir()
        for name in ("config.toml", "evaluations.npz"):
            (folder / name).write_bytes((tiny_run / name).read_bytes())
        (folder / "run.json").write_text(json.dumps({"seed": seed}), encoding="utf-8")
    return [curve.read(tmp_path / f"seed-{seed}") for seed in (5, 6)]


def labels_of(fig):
    return [text for ax in fig.axes for text in (ax.get_xlabel(), ax.get_ylabel()) if text]


def test_trajectories_show_every_quantity_with_its_unit(moving):
    fig = trajectories.draw(moving)
    assert sorted(labels_of(fig)) == sorted([*trajectories.QUANTITIES, "time (s)", "time (s)"])
    tilt = fig.axes[0].lines[1]
    np.testing.assert_allclose(tilt.get_ydata(), np.degrees(moving[0].of_states("tilt_components")[:, 1]))
    torque = fig.axes[4].lines[2]
    np.testing.assert_allclose(torque.get_ydata(), moving[0].torques[:, 2])
    # At rest each wheel carries the same; the loads of the pushed robot end near that.
    loads = [line.get_ydata()[-1] for line in fig.axes[6].lines[:3]]
    assert np.mean(loads) == pytest.approx(10.3, abs=0.5)


def test_pushes_falls_and_limits_are_marked(moving):
    fig = trajectories.draw(moving)
    (fell_at,) = (one.fell_at for one in moving if one.fell_at is not None)
    for row in range(len(trajectories.QUANTITIES)):
        for ax, expected in zip(fig.axes[2 * row : 2 * row + 2], ([0.5], [0.5, fell_at]), strict=True):
            marked = [line.get_xdata()[0] for line in ax.lines if line.get_linestyle() == ":"]
            assert marked == pytest.approx(expected)
    assert [text.get_text() for text in fig.axes[1].texts] == ["push 0.3 N·s", "motors off", "(b)"]
    # The friction of each axis is as large as its limit at most, and that is a line.
    limit = fig.axes[8].lines[-1]
    assert list(limit.get_ydata()) == [100.0, 100.0]
    (lowest, highest) = fig.axes[8].get_ylim()
    assert lowest == 0.0
    assert fig.axes[8].lines[3].get_ydata().max() > 0.0
    # The limit of the torques is far beyond LQR's torques, and does not flatten its curves.
    assert moving[0].max_wheel_torque == 5.0
    assert "limit 5 N·m (not shown)" in [text.get_text() for text in fig.axes[4].texts]
    assert not any("limit" in text.get_text() for text in fig.axes[5].get_legend().get_texts())
    assert fig.axes[4].get_ylim()[1] < 1.0 < highest


def test_a_limit_that_curves_come_near_is_in_the_picture():
    from ballbot_rs.media.figures.marks import mark_limit

    ax = figure().subplots()
    ax.plot([0, 1], [0.0, 3.0])
    mark_limit(ax, 4.0, "limit")
    low, high = ax.get_ylim()
    assert low < -4.0
    assert high > 4.0


def drawn_boxes(fig, tmp_path):
    """Boxes of legends, titles and axes in pixels, once the figure is laid out."""
    fig.savefig(tmp_path / "f.png")
    legends = [ax.get_legend() for ax in fig.axes if ax.get_legend()] + fig.legends
    titles = [ax.title for ax in fig.axes if ax.title.get_text()]
    return (
        [legend.get_window_extent() for legend in legends],
        [title.get_window_extent() for title in titles],
        [ax.get_window_extent() for ax in fig.axes],
        fig.bbox,
    )


@pytest.mark.parametrize("width", [None, 3.5, 7.0])
def test_legends_are_next_to_the_curves_and_nothing_is_cut(width, moving, maps, two_runs, tmp_path):
    named = [dataclasses.replace(moving[0], controller="runs/lance-seed-0-20261121-104046/best_model.zip")]
    measured = [dataclasses.replace(named[0], estimates=named[0].states)]
    far = [dataclasses.replace(maps[0], controller=named[0].controller)]
    figures = [
        trajectories.draw(named, width),
        estimates.draw(measured, width),
        phase_portrait.draw(named, width),
        recovery_map.draw(far, width),
        learning_curve.draw(two_runs, width),
    ]
    for fig in figures:
        if width is not None:
            assert fig.get_figwidth() == width
        legends, titles, axes, page = drawn_boxes(fig, tmp_path)
        assert legends
        for legend in legends:
            assert not any(legend.overlaps(ax) for ax in axes)
        for box in (*legends, *titles):
            assert box.x0 >= page.x0 - 1
            assert box.x1 <= page.x1 + 1
            assert box.y1 <= page.y1 + 1
            assert box.y0 >= page.y0 - 1


@pytest.mark.parametrize(
    ("width", "count", "message"),
    [(1.0, 1, "25.4 mm is out of range: it must be from 51 to 1016 mm"), (3.5, 3, "88.9 mm is too narrow for 3")],
)
def test_an_invalid_width_is_rejected(width, count, message, moving):
    with pytest.raises(ValueError, match="too narrow" if count == 1 else message):
        trajectories.draw(moving[:1] * count, width)
    if count == 1:
        with pytest.raises(ValueError, match=message):
            phase_portrait.draw(moving[:1], width)


def test_estimates_are_plotted_over_the_true_states():
    options = {**CONTACT, "sensors": "kugle", "observation": "sensors"}
    standing, fallen = (bb.simulate(name, seconds=1.0, **options, tilt=(0.05, 0.0)) for name in ("lqr", "zero"))
    assert len(standing.estimates) == len(standing.times)
    # After the fall nothing is estimated.
    assert fallen.times[len(fallen.estimates) - 1] == pytest.approx(fallen.fell_at)
    assert 0.0 < estimates.errors(standing, "tilt_components").max() < np.radians(0.3)
    assert 0.0 < estimates.errors(standing, "ball_position").max() < 1e-3
    fig = estimates.draw([standing, fallen])
    labels = [label for label, _, _ in (*estimates.QUANTITIES, *estimates.ERRORS)]
    assert sorted(labels_of(fig)) == sorted([*labels, "time (s)", "time (s)"])
    true, estimated = fig.axes[0].lines[:2]
    np.testing.assert_allclose(true.get_ydata(), np.degrees(standing.of_states("tilt_components")[:, 0]))
    np.testing.assert_allclose(estimated.get_ydata(), np.degrees(standing.of_estimates("tilt_components")[:, 0]))


def test_estimates_need_sensors(moving, capsys):
    with pytest.raises(ValueError, match="the trajectory of lqr has no estimates"):
        estimates.draw(moving)
    assert main(["plot", "balance", "--figure", "estimates"]) == 1
    assert "add --set observation=sensors" in capsys.readouterr().err


def test_the_phase_portrait_ends_where_the_robot_fell(moving):
    standing, fallen = moving
    tilts, rates = phase_portrait.tilts_and_rates(standing, 0)
    assert len(tilts) == len(standing.times)
    # The integral of the rate is the tilt, but for the step that begins with the push.
    after = slice(51, None)
    moved = np.trapezoid(rates[after], standing.times[after])
    assert moved == pytest.approx(tilts[-1] - tilts[51], abs=2e-4)
    tilts, _ = phase_portrait.tilts_and_rates(fallen, 0)
    assert standing.times[len(tilts)] == pytest.approx(fallen.fell_at)
    fig = phase_portrait.draw(moving)
    assert labels_of(fig) == ["tilt about x (deg)", "tilt rate (deg/s)", "tilt about y (deg)"]


def test_a_start_at_rest_has_no_tilt_rate_in_the_phase_portrait():
    started = bb.simulate("lqr", seconds=0.2, tilt=(0.1, -0.05), pushes=bb.Push((0.3, 0.1, 0.0), 0.1), **CONTACT)
    for axis in range(2):
        _, rates = phase_portrait.tilts_and_rates(started, axis)
        assert rates[0] == 0.0
        # The row of the push is the state before it: no part of the jump.
        assert abs(rates[10] - rates[9]) < 0.3 * abs(rates[11] - rates[10])


def test_tilt_rates_are_the_derivative_of_the_tilt():
    state = bb.State.at_rest(bb.Params.paper(), (0.4, -0.7), 0.9)
    rows, step = np.tile(state.to_array(), (3, 1)), 1e-5
    rate = np.array([0.7, -1.1, 2.0])
    for row, time in zip(rows, (-step, 0.0, step), strict=True):
        # q(t) = q(0) exp(Ω t / 2), body frame.
        angle = np.linalg.norm(rate) * time / 2.0
        w, x, y, z = np.cos(angle), *(np.sin(angle) * rate / np.linalg.norm(rate))
        a, b, c, d = state.body_quaternion
        row[16:20] = [
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        ]
        row[23:26] = rate
    tilts = tilt_components_of(rows, (0.0, 0.0, 1.0))
    np.testing.assert_allclose(tilt_rates_of(rows)[1], (tilts[2] - tilts[0]) / (2 * step), rtol=1e-8)
    upright = np.zeros(32)
    upright[[16, 23, 24]] = 1.0, 0.3, -0.2
    np.testing.assert_allclose(tilt_rates_of(upright), [0.3, -0.2])


def test_recovery_detects_who_rights_the_robot(maps):
    regulated, alone = maps
    assert regulated.recovered[0].all()
    assert not regulated.recovered[-1].any()
    assert not alone.stood.any()
    assert np.isnan(alone.recovery_times).all()
    times = regulated.recovery_times[regulated.recovered]
    assert ((times >= 0) & (times <= 4.0)).all()
    # From farther out it takes longer.
    assert np.nanmean(regulated.recovery_times[1]) > np.nanmean(regulated.recovery_times[0])


def test_recovery_leans_in_the_stated_direction():
    # Wheels are 120 deg apart, so the map of a law without a sense of direction repeats itself as often.
    found = recovery.collect("lqr", rings=3, sectors=12, max_tilt=0.3, seconds=3.0, env_options=CONTACT)
    np.testing.assert_allclose(found.recovery_times, np.roll(found.recovery_times, 4, axis=1), atol=0.021)
    (rim,) = found.recovered[2:]
    assert rim.tolist() == np.roll(rim, 4).tolist()


@pytest.mark.parametrize(
    ("arguments", "message"), [({"max_tilt": 1.5}, "max_tilt = 1.5"), ({"sectors": 2}, "4 rings and 2 sectors")]
)
def test_empty_maps_are_rejected(arguments, message):
    with pytest.raises(ValueError, match=message):
        recovery.collect("lqr", **{"rings": 4, **arguments})


def test_a_map_does_not_depend_on_its_duration():
    """A robot that brakes is not lost: with 5 s the map had fewer starts."""
    at = {"max_tilt": 0.48, "rings": 8, "sectors": 4, "env_options": CONTACT}
    usual, long = recovery.collect("lqr", **at), recovery.collect("lqr", seconds=20.0, **at)
    np.testing.assert_array_equal(usual.recovered, usual.stood)
    np.testing.assert_array_equal(usual.recovered, long.recovered)
    np.testing.assert_array_equal(usual.recovery_times, long.recovery_times)
    with pytest.raises(ValueError, match=r"seconds = 0\.5 is out of range"):
        recovery.collect("lqr", seconds=0.5)


def test_the_title_of_a_map_has_the_limit_of_the_torques(maps):
    limited = recovery.collect("lqr", rings=1, sectors=3, env_options={**CONTACT, "max_wheel_torque": 0.2})
    for found, limit in ((maps[0], "5"), (limited, "0.2")):
        assert f"with up to {limit} N·m a wheel" in recovery_map.draw([found]).axes[0].get_title()
    legend = recovery_map.draw(maps).legends[0]
    assert "rings: initial tilt" in [text.get_text() for text in legend.get_texts()]


def test_the_map_colors_each_start(maps):
    fig = recovery_map.draw(maps)
    fell, unsettled, times = fig.axes[0].collections
    shown = [~np.ma.getmaskarray(mesh.get_array()).ravel() for mesh in (fell, unsettled, times)]
    assert (sum(part.astype(int) for part in shown) == 1).all()
    np.testing.assert_array_equal(shown[2], maps[0].recovered.ravel())
    assert "100" not in fig.axes[1].get_title()
    assert "0 % of the starts recover" in fig.axes[1].get_title()


def test_learning_curves_of_seeds_have_their_mean(two_runs):
    steps, means = curve.on_common_steps(two_runs, "returns")
    np.testing.assert_allclose(means[0], two_runs[0].returns.mean(axis=1))
    assert steps.tolist() == [256, 512, 768]
    fig = learning_curve.draw(two_runs)
    *seeds, mean = fig.axes[0].lines
    assert len(seeds) == 2
    np.testing.assert_allclose(mean.get_ydata(), means.mean(axis=0))
    np.testing.assert_allclose(mean.get_xdata(), steps / 1e3)
    assert labels_of(fig)[0] == "environment steps (thousands)"


def test_invalid_runs_are_rejected(tmp_path, tiny_run):
    with pytest.raises(FileNotFoundError, match="holds no training run"):
        curve.read(tmp_path)
    for damaged in ("{}", "[]", "", '{"seed": "0"}'):
        (tmp_path / "run.json").write_text(damaged, encoding="utf-8")
        with pytest.raises(ValueError, match=r"run\.json is damaged"):
            curve.read(tmp_path)
    (tmp_path / "run.json").write_text('{"seed": 0}', encoding="utf-8")
    with pytest.raises(FileNotFoundError, match="no evaluations yet"):
        curve.read(tmp_path)
    whole = (tiny_run / "evaluations.npz").read_bytes()
    for damaged in (b"", whole[: len(whole) // 2], b"no archive"):
        (tmp_path / "evaluations.npz").write_bytes(damaged)
        with pytest.raises(ValueError, match=r"evaluations\.npz is damaged"):
            curve.read(tmp_path)


def test_the_same_numbers_give_the_same_file(moving, tmp_path):
    for name in ("a.svg", "b.svg"):
        save(phase_portrait.draw(moving), tmp_path / name)
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


def test_the_command_writes_vectors_and_pixels(tiny_run, tmp_path, capsys):
    what = ["--figure", "trajectories", "--figure", "learning_curve", "--seconds", "0.3", "--model", "contact"]
    controllers = ["--controller", "lqr", "--controller", str(tiny_run)]
    assert main(["plot", *controllers, "-o", str(tmp_path), "--json", *what]) == 0
    files = json.loads(capsys.readouterr().out)["files"]
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(file.rsplit("/", 1)[1] for file in files)
    assert ET.parse(tmp_path / "trajectories.svg").getroot().tag.endswith("svg")
    with Image.open(tmp_path / "learning_curve.png") as image:
        assert image.size == (1200, 480)
    assert main(["plot", "--figure", "phase_portrait", "--format", "pdf", "--output", str(tmp_path)]) == 0
    assert (tmp_path / "phase_portrait.pdf").read_bytes().startswith(b"%PDF")


def test_numbers_are_written_next_to_the_pictures(tiny_run, tmp_path, capsys):
    what = ["--figure", "phase_portrait", "--figure", "trajectories", "--figure", "learning_curve", "--seconds", "0.2"]
    controllers = ["--controller", "lqr", "--controller", "pid", "--controller", str(tiny_run)]
    how = ["--data", "--width", "180", "--json", "-o", str(tmp_path)]
    assert main(["plot", *controllers, *what, *how]) == 0
    files = json.loads(capsys.readouterr().out)["files"]
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(file.rsplit("/", 1)[1] for file in files)
    name = tiny_run.resolve().name
    assert (tmp_path / f"trajectory-{name}.csv").exists()
    table = np.genfromtxt(tmp_path / "trajectory-LQR.csv", delimiter=",", names=True)
    expected = bb.simulate("lqr", seconds=0.2, tilt=(0.08, 0.05), task="balance")
    np.testing.assert_array_equal(table["time_s"], expected.times)
    learned = np.genfromtxt(tmp_path / f"learning_curve-{name}.csv", delimiter=",", names=True)
    read = curve.read(tiny_run)
    np.testing.assert_array_equal(learned["timesteps"], read.timesteps)
    np.testing.assert_array_equal(learned["return_1"], read.returns[:, 1])
    with Image.open(tmp_path / "trajectories.png") as image:
        assert image.size[0] == pytest.approx(180 / 25.4 * 150, abs=1)


def test_the_numbers_of_a_map_are_its_starts(maps, tmp_path):
    data.write(data.of_recovery(maps[0]), tmp_path / "map.npz")
    with np.load(tmp_path / "map.npz") as kept:
        assert sorted(kept) == ["azimuth_rad", "recovered", "recovery_time_s", "stood", "tilt_rad"]
        np.testing.assert_array_equal(kept["recovered"].reshape(4, 6), maps[0].recovered)
        np.testing.assert_array_equal(kept["tilt_rad"].reshape(4, 6)[:, 0], maps[0].tilts)
        np.testing.assert_array_equal(kept["azimuth_rad"].reshape(4, 6)[0], maps[0].azimuths)
    with pytest.raises(ValueError, match=r"must end in \.csv"):
        data.write(data.of_recovery(maps[0]), tmp_path / "map.txt")


def test_a_learning_curve_of_a_controller_is_rejected(capsys, tmp_path):
    assert main(["plot", "--controller", "lqr", "--figure", "learning_curve", "--output", str(tmp_path / "f")]) == 1
    assert "a learning curve needs training runs" in capsys.readouterr().err
    assert not (tmp_path / "f").exists()


def test_figures_open_no_window(moving):
    assert isinstance(phase_portrait.draw(moving), matplotlib.figure.Figure)
    assert type(phase_portrait.draw(moving).canvas).__name__ == "FigureCanvasBase"
