"""Sweeps of `compare` and `run_scenarios`: their points, their order, their files, their figures."""

import csv
import itertools
import json
import math
import threading

import numpy as np
import pytest
from matplotlib.figure import Figure

import ballbot_rs as bb
from ballbot_rs.analysis import checkpoint
from ballbot_rs.analysis.sweep import points_of
from ballbot_rs.media.figures.study import draw

SHORT = {"episodes": 4, "max_episode_steps": 40}
GRID = {"body_mass": [2.0, 2.5], "actuators.delay": [0.0, 0.02, 0.04]}


def study(**changes):
    return bb.compare(**{"controllers": ["lqr", "lqi"], **SHORT, "sweep": GRID, **changes})


def test_a_grid_has_all_combinations_and_a_list_its_points():
    assert points_of({"a": [1, 2], "b": ["x", "y"]}) == [
        {"a": 1, "b": "x"},
        {"a": 1, "b": "y"},
        {"a": 2, "b": "x"},
        {"a": 2, "b": "y"},
    ]
    assert points_of([{"a": np.float64(1.0)}, {"a": np.arange(2)}]) == [{"a": 1.0}, {"a": [0, 1]}]


def test_the_rows_of_a_point_are_the_comparison_at_its_options():
    found = study()
    for i, point in enumerate(found.points):
        robot = bb.Params.paper().replace(body_mass=point["body_mass"])
        options = {"max_episode_steps": 40, "robot": robot, "actuators": {"delay": point["actuators.delay"]}}
        alone = bb.compare(["lqr", "lqi"], episodes=4, **options)
        assert found.rows[2 * i : 2 * i + 2] == [{**point, **result.row()} for result in alone]


def test_the_answers_do_not_depend_on_the_number_of_threads():
    assert study(num_threads=1).rows == study(num_threads=3).rows


def test_a_law_with_memory_is_not_on_two_points_at_once():
    found = set()

    def law(_state):
        found.add(threading.get_ident())
        return (0.0, 0.0, 0.0)

    study(controllers=[law], num_threads=4, episodes=1)
    assert found == {threading.get_ident()}


def test_robots_and_other_options_are_swept_by_their_names():
    found = study(sweep={"robot": ["paper", "kugle"], "model": ["contact", "spatial"], "control_dt": [0.02]})
    assert [(row["robot"], row["model"], row["control_dt"]) for row in found.rows[::2]] == [
        ("paper", "contact", 0.02),
        ("paper", "spatial", 0.02),
        ("kugle", "contact", 0.02),
        ("kugle", "spatial", 0.02),
    ]


def test_an_event_changes_the_robot_and_not_the_controller():
    known, unknown = (
        study(controllers=["lqr"], sweep={name: [1.2 * bb.Params.paper().body_mass]})
        for name in ("body_mass", "events.body_mass")
    )
    event = {"term": "body_mass", "range": [1.2 * bb.Params.paper().body_mass] * 2}
    options = {"max_episode_steps": 40, "events": [event]}
    assert unknown.column("tilt_rms") == [bb.evaluate("lqr", episodes=4, **options).tilt_rms]
    assert unknown.column("tilt_rms") != known.column("tilt_rms")


def test_a_sweep_of_a_given_event_changes_its_range():
    push = {"term": "push", "at": 0.1, "range": [0.0, 0.0]}
    options = {"max_episode_steps": 40, "events": [push, {"term": "body_mass", "op": "scale", "range": [1.0, 1.1]}]}
    found = study(controllers=["lqr"], **options, sweep={"events.push": [[0.3, 0.3], [0.5, 0.5]]})
    for ends, tilt in zip(([0.3, 0.3], [0.5, 0.5]), found.column("tilt_rms"), strict=True):
        alone = {**options, "events": [{**push, "range": ends}, options["events"][1]]}
        assert bb.evaluate("lqr", episodes=4, **alone).tilt_rms == tilt


def test_controllers_of_one_name_are_numbered():
    found = study(controllers=["lqr", bb.Lqr(position=0.3), bb.Lqr(position=0.6)], sweep={"body_mass": [2.0, 2.5]})
    assert found.table()[0] == ["body_mass", "lqr", "lqr-2", "lqr-3"]
    assert len(found.column("tilt_rms", controller="lqr-2")) == 2


@pytest.mark.parametrize(
    ("sweep", "error", "message"),
    [
        ({}, ValueError, "no points"),
        ("body_mass", TypeError, "expected lists of values by name"),
        ({"body_mass": 2.0}, TypeError, r"sweep\['body_mass'\] = 2.0: expected a list of values, as \[2.0\]"),
        ({"body_mass": []}, ValueError, "no values"),
        ({"body_mass": [2.0, 2]}, ValueError, "has 2 twice"),
        ({"body_mas": [2.0]}, ValueError, "unknown option 'body_mas': did you mean 'body_mass'"),
        ({"actuators.dela": [0.0]}, ValueError, "did you mean 'delay'"),
        ({"robot.body_mass": [2.0], "body_mass": [2.0]}, ValueError, "which are the same option"),
        ({"body_mass": [2.0, -1.0]}, ValueError, "sweep at body_mass = -1: .*body_mass = -1 is out of range"),
        ({"body_mass": [math.nan]}, ValueError, "NaN is out of range"),
        ({"model.x": [1]}, ValueError, "'model' has no parts"),
        ([{"body_mass": 2.0}, {"control_dt": 0.02}], ValueError, "point 1 has control_dt, point 0 body_mass"),
        ([{"body_mass": 2.0}, {"body_mass": 2.0}], ValueError, "the point body_mass = 2 twice"),
        ({"body_mass": range(1, 10**12)}, ValueError, "more than 100000 points"),
        (({"body_mass": 1.0 + i} for i in itertools.count()), ValueError, "more than 100000 points"),
        ({"body_mass": range(1, 400), "control_dt": range(1, 400)}, ValueError, "159201 points, more than 100000"),
    ],
)
def test_points_that_are_invalid_are_found_before_the_first_is_run(sweep, error, message):
    with pytest.raises(error, match=message):
        study(sweep=sweep, progress=lambda *_: pytest.fail("a point was run"))


def test_an_interrupted_study_continues_from_its_file(tmp_path, monkeypatch):
    monkeypatch.setattr(checkpoint, "EVERY", 0.0)
    file, counts = tmp_path / "study.json", []

    def interrupt(done, total):
        counts.append((done, total))
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        study(checkpoint=file, num_threads=1, progress=interrupt)
    assert counts == [(0, 6), (1, 6), (2, 6)]
    assert len(json.loads(file.read_text())["rows"]) == 2
    counts.clear()
    found = study(checkpoint=file, num_threads=1, progress=lambda *now: counts.append(now))
    assert counts == [(done, 6) for done in range(2, 7)]
    assert found.rows == study().rows
    counts.clear()
    assert study(checkpoint=file, progress=lambda *now: counts.append(now)).rows == found.rows
    assert counts == [(6, 6)]


def test_the_file_of_an_interrupted_study_is_whole_at_any_time(tmp_path, monkeypatch):
    monkeypatch.setattr(checkpoint, "EVERY", 0.0)
    file = tmp_path / "study.json"
    found = []
    study(checkpoint=file, progress=lambda done, _: found.append((done, len(json.loads(file.read_text())["rows"]))))
    assert found == [(i, i) for i in range(7)]
    assert [path.name for path in tmp_path.iterdir()] == ["study.json"]


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"episodes": 5}, "episodes is 4 there and 5 here"),
        ({"seed": 1}, "seed is 1000 there and 1 here"),
        ({"controllers": ["lqr", "pid"]}, "controllers is"),
        ({"controllers": ["lqr", bb.Lqr(position=0.3)]}, "controllers is"),
        ({"max_episode_steps": 41}, "options is"),
        ({"sweep": {**GRID, "body_mass": [2.0, 3.0]}}, "points is"),
    ],
)
def test_a_changed_study_is_not_mixed_with_the_former(tmp_path, change, what):
    study(checkpoint=tmp_path / "study.json")
    with pytest.raises(ValueError, match=rf"of another study, {what}.*name another file"):
        study(checkpoint=tmp_path / "study.json", **change)


def test_laws_in_python_are_distinguished_by_their_numbers(tmp_path):
    class Damping:
        def __init__(self, gain):
            self.gain = gain

        def __call__(self, state):
            return -self.gain * state.wheel_speeds

    def law(gain):
        return lambda state: -gain * state.wheel_speeds

    few = {**SHORT, "episodes": 1, "sweep": {"body_mass": [2.0]}}
    for i, make in enumerate((Damping, law)):
        file = tmp_path / f"{i}.json"
        bb.compare([make(0.001)], checkpoint=file, **few)
        bb.compare([make(0.001)], checkpoint=file, **few)
        with pytest.raises(ValueError, match="of another study, controllers is"):
            bb.compare([make(0.002)], checkpoint=file, **few)


def test_a_file_that_is_not_a_checkpoint_stays_as_it_is(tmp_path):
    file = tmp_path / "notes.json"
    for text in ("my notes", "[]", "[" * 100_000, '{"format": "ballbot study 1"}'):
        file.write_text(text)
        with pytest.raises(ValueError, match=r"notes\.json is not a checkpoint of a study"):
            study(checkpoint=file)
        assert file.read_text() == text
    with pytest.raises(OSError, match="not written"):
        study(checkpoint=file / "study.json")
    with pytest.raises(TypeError, match="checkpoint needs a sweep"):
        bb.compare(["lqr"], checkpoint=file)


def test_a_study_is_a_table(tmp_path):
    found = study(sweep={"body_mass": [2.0, 2.5]})
    assert repr(found) == "<Study of lqr, lqi: 2 points of body_mass>"
    assert found.table()[0] == ["body_mass", "lqr", "lqi"]
    assert "<td>2.5</td>" in found._repr_html_()
    frame = found.to_dataframe()
    assert list(frame.columns) == list(found.rows[0])
    assert frame.groupby("controller")["tilt_rms"].mean()["lqr"] == np.mean(found.column("tilt_rms", controller="lqr"))
    found.to_csv(tmp_path / "study.csv")
    read = list(csv.DictReader((tmp_path / "study.csv").open()))
    assert [float(row["tilt_rms"]) for row in read] == found.column("tilt_rms")
    with pytest.raises(ValueError, match="no column 'tilt_rm': did you mean 'tilt_rms'"):
        found.table("tilt_rm")
    with pytest.raises(ValueError, match=r"must end in \.csv"):
        found.to_csv(tmp_path / "study.txt")


@pytest.mark.parametrize("width", [None, 3.5])
def test_one_name_gives_curves_and_two_give_heat_maps(tmp_path, width):
    one = study(sweep={"body_mass": [2.5, 2.0]})
    curves = one.plot("tilt_rms", width=width)
    assert isinstance(curves, Figure)
    (ax,) = curves.axes
    assert ax.get_xlabel() == "body mass (kg)"
    assert ax.get_ylabel() == "tilt rms (rad)"
    for line, controller in zip(ax.lines, ("lqr", "lqi"), strict=True):
        np.testing.assert_array_equal(line.get_xdata(), [2.0, 2.5])
        np.testing.assert_array_equal(line.get_ydata(), one.column("tilt_rms", controller=controller)[::-1])
    two = study()
    *maps, bar = two.plot("tilt_rms", tmp_path / "study.png", width=width).axes
    assert [ax.get_title(loc="left") for ax in maps] == ["(a) LQR", "(b) LQI"]
    assert bar.get_ylabel() == "tilt rms (rad)"
    cells = maps[0].collections[0].get_array().reshape(3, 2)
    np.testing.assert_array_equal(cells.T.ravel(), two.column("tilt_rms", controller="lqr"))
    assert (tmp_path / "study.png").stat().st_size > 0


def test_rates_have_intervals_and_robots_have_places():
    rates = study(sweep={"body_mass": [2.0, 2.5]}).plot()
    assert len(rates.axes[0].collections) == 2
    robots = study(sweep={"robot": [bb.Params.preset("kugle"), bb.Params.paper()]}).plot("tilt_rms").axes[0]
    assert [tick.get_text() for tick in robots.get_xticklabels()] == ["1", "2"]
    unknown = study(sweep={"events.body_mass": [2.0, 2.5]}).plot("tilt_rms").axes[0]
    assert unknown.get_xlabel() == "true body mass (kg)"


@pytest.mark.parametrize(
    ("sweep", "value", "message"),
    [
        (GRID, "recovery_time", "no number in the column 'recovery_time'"),
        (GRID, "model", "not of numbers"),
        ({**GRID, "control_dt": [0.01]}, "tilt_rms", "one or two names"),
        ([{"body_mass": 2.0, "control_dt": 0.01}, {"body_mass": 2.1, "control_dt": 0.02}], "tilt_rms", "not a grid"),
    ],
)
def test_what_has_no_figure_is_named(sweep, value, message):
    with pytest.raises(ValueError, match=message):
        draw(study(sweep=sweep), value)


def test_scenarios_are_swept_by_robot_motors_and_their_numbers(tmp_path):
    pushed = bb.Scenario("pushed", "", seconds=0.5, push=1.0, score="largest_tilt")
    sweep = {"push": [0.5, 1.0], "body_mass": [2.5], "actuators.delay": [0.02]}
    found = bb.run_scenarios(["lqr", "pid"], pushed, sweep=sweep, checkpoint=tmp_path / "study.json", num_threads=2)
    assert found == bb.run_scenarios(["lqr", "pid"], pushed, sweep=sweep, num_threads=1)
    for push, score in zip((0.5, 1.0), found.column("score", controller="lqr"), strict=True):
        alone = bb.Scenario("x", "", seconds=0.5, push=push, score="largest_tilt", actuators={"delay": 0.02})
        assert bb.run_scenarios("lqr", alone, robot=bb.Params.paper().replace(body_mass=2.5))[0].score == score
    assert found.table()[0] == ["push", "body_mass", "actuators.delay", "pushed lqr (deg)", "pushed pid (deg)"]
    assert float(found.table()[1][3]) == pytest.approx(math.degrees(found.rows[0]["score"]), rel=1e-3)
    for wrong, message in (({"pus": [1.0]}, "did you mean 'push'"), ({"actuators": [0.0]}, "expected a part")):
        with pytest.raises(ValueError, match=message):
            bb.run_scenarios("lqr", pushed, sweep=wrong)
    with pytest.raises(TypeError, match="checkpoint needs a sweep"):
        bb.run_scenarios("lqr", pushed, checkpoint=tmp_path / "study.json")


def test_a_sweep_of_nothing_is_an_error():
    for compare in (bb.compare, bb.run_scenarios):
        with pytest.raises(ValueError, match="none is given"):
            compare([], sweep={"body_mass": [2.0]})


def test_evaluate_has_one_result():
    with pytest.raises(TypeError, match=r"compare\(\['lqr'\], sweep="):
        bb.evaluate("lqr", sweep=GRID)
