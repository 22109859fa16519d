"""Scenarios: data, episodes, metrics, scores; the numbers that controllers are to reach."""

import dataclasses
import json
import math
from importlib import resources

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.cli import main
from ballbot_rs.control.resolve import find
from ballbot_rs.scenarios.matrix import rows
from ballbot_rs.scenarios.metrics import METRICS, Measures
from ballbot_rs.scenarios.outcome import Outcome
from ballbot_rs.scenarios.run import outcome_on, run_scenarios
from ballbot_rs.scenarios.scale import Scale
from ballbot_rs.scenarios.scenario import Scenario, load, select
from ballbot_rs.scenarios.stage import Stage
from ballbot_rs.scenarios.trial import trial

OWN = '[[scenario]]\nid = "A"\ntitle = ""\nseconds = 1\nscore = "rms_tilt"\n'


def score(controller, name, **arguments):
    (outcome,) = run_scenarios([controller], [name], **arguments)
    return outcome.score


def test_scale_of_the_papers_robot():
    """Independent figures: a planar model in NumPy, Table II, no friction."""
    scale = Scale.of(bb.Params.paper())
    assert scale.toppling_rate == pytest.approx(6.0917, abs=1e-4)
    assert scale.acceleration_per_lean == pytest.approx(3.7637, abs=1e-4)
    assert math.degrees(scale.holdable_lean) == pytest.approx(20.3, abs=0.05)
    assert scale.capture_impulse == pytest.approx(2.41, abs=0.005)
    # 4.69 deg a newton.
    assert math.degrees(1.0 / scale.force_per_lean) == pytest.approx(4.69, abs=0.005)


def test_targets_of_the_papers_robot():
    assert score("lqr", "S13-6s") < 3e-3
    assert score("lqr", "S13-4s") < 1e-2
    assert score("lqr", "S15-12s") < 0.5e-3
    assert score("lqi", "S6-1N") < 1e-3
    assert score("lqi", "S8-5mm") < 1e-3
    assert score("lqr", "S18-4deg") >= 4.0
    (line,) = run_scenarios(["lqr"], ["S10-3.1s"])
    assert line.metrics["final_error"].max() < 5e-3


def test_offsets_match_the_closed_form():
    """A static law comes to rest where the torques of position and lean cancel."""
    lqr = bb.Lqr()
    gain = np.asarray(lqr.gain)
    lean = 1e-3 * 5.0 / bb.Params.paper().body_com_height
    position = np.linalg.lstsq(gain[:, :2], -gain[:, 2:4] @ np.array([0.0, -math.atan(lean)]), rcond=None)[0]
    assert score("lqr", "S8-5mm") == pytest.approx(float(np.linalg.norm(position)), rel=0.02)


def test_maps_are_the_largest_number_up_to_which_all_recover():
    tilts = Scenario("map", "", seconds=4.0, tilt=(24.0, 30.0, 2.0), directions=4, score="map")
    (outcome,) = run_scenarios(["lqr"], [tilts])
    assert outcome.largest.shape == (4,)
    for direction, largest in enumerate(outcome.largest):
        passed = outcome.success.reshape(4, 4)[:, direction]
        below = [24.0, 26.0, 28.0, 30.0][: int(passed.argmin()) if not passed.all() else 4]
        assert largest == (below[-1] if below else 0.0)
    assert outcome.score == outcome.largest.min()
    none = dataclasses.replace(tilts, tilt=(50.0, 52.0, 2.0))
    assert score("lqr", none) == 0.0


def test_maps_do_not_count_a_robot_that_still_brakes_as_lost():
    """Within 6 s LQR recovered from 27 deg, and from 28 deg with more time."""
    usual = dataclasses.replace(load()["S2-rest"], tilt=(27.0, 29.0, 1.0), directions=6)
    for scenario in (usual, dataclasses.replace(usual, seconds=25.0)):
        (outcome,) = run_scenarios("lqr", scenario)
        assert outcome.score == 28.0
        times = outcome.metrics["recovery_time"].reshape(3, 6)[1]
        assert 6.0 < times.max() < 10.0
    with pytest.raises(ValueError, match="a map needs more than 1"):
        dataclasses.replace(usual, seconds=1.0)


def test_all_controllers_have_the_same_episodes():
    scenario = load()["S20-push"]
    first, second = (trial(scenario, bb.Params.paper(), 0.01, seed=3) for _ in range(2))
    assert [robot.to_dict() for robot in first.robots] == [robot.to_dict() for robot in second.robots]
    np.testing.assert_array_equal(first.impulses, second.impulses)
    other = trial(scenario, bb.Params.paper(), 0.01, seed=4)
    assert other.robots[5].to_dict() != first.robots[5].to_dict()
    assert {score("lqr", "S12", seed=1), score("lqr", "S12", seed=1)} == {score("lqr", "S12", seed=1, num_threads=1)}


@pytest.mark.parametrize("name", ["S20-push", "S22-6s"])
def test_reused_robots_repeat_their_episodes(name):
    """Other robots than the nominal one; sensors, motors and events with random numbers."""
    scenario = dataclasses.replace(load()[name], seeds=3, seconds=2.0, measure_from=0.0)
    lqr, lqi = find("lqr"), find("lqi")
    stage = Stage(lqr, scenario, bb.Params.paper(), seed=3)
    found = [outcome_on(stage, law) for law in (lqr, lqi, lqr)]
    (fresh,) = run_scenarios([lqr], [scenario], seed=3)
    for metric, values in fresh.metrics.items():
        np.testing.assert_array_equal(found[0].metrics[metric], values)
        np.testing.assert_array_equal(found[2].metrics[metric], values)
    assert (found[1].metrics["energy"] != fresh.metrics["energy"]).all()


@pytest.mark.parametrize("name", list(load()))
def test_episodes_of_every_preset(name):
    scenario = load()[name]
    for preset in ("paper", "kugle", "rezero", "asroballet"):
        params = bb.Params.preset(preset)
        found = trial(scenario, params, 0.01)
        assert len(found) == len(found.starts) == len(found.robots)
        assert found.references is None or len(found.references) == len(found)
        if found.impulses is not None:
            assert found.impulses.shape == (found.steps, len(found), 3)
        if scenario.reference:
            lean = [reference.demand for reference in {id(r): r for r in found.references}.values()]
            assert all(value < math.inf for value in lean), (preset, lean)


def test_pushes_have_the_stated_impulse():
    for duration in (0.0, 0.1):
        scenario = Scenario(
            "x", "", seconds=1.0, score="rms_tilt", push=0.7, push_time=0.3, push_duration=duration, directions=4
        )
        found = trial(scenario, bb.Params.paper(), 0.01)
        np.testing.assert_allclose(np.linalg.norm(found.impulses.sum(axis=0), axis=-1), 0.7, rtol=1e-12)
        assert not found.impulses[:30].any()
    kugle = trial(scenario, bb.Params.preset("kugle"), 0.01)
    ratio = Scale.of(bb.Params.preset("kugle")).capture_impulse / Scale.of(bb.Params.paper()).capture_impulse
    np.testing.assert_allclose(np.linalg.norm(kugle.impulses.sum(axis=0), axis=-1), 0.7 * ratio, rtol=1e-12)


def test_slow_pushes_match_simulate():
    push = bb.Push((1.0, 0.0, 0.0), time=0.3, duration=0.1)
    shares = [push.share(0.3 + 0.01 * k, 0.31 + 0.01 * k) for k in range(10)]
    scenario = Scenario("x", "", seconds=1.0, score="rms_tilt", push=1.0, push_time=0.3, push_duration=0.1)
    np.testing.assert_allclose(trial(scenario, bb.Params.paper(), 0.01).impulses[30:40, 0, 0], shares, atol=1e-14)


def test_pushes_off_the_center_of_mass():
    high, arm = (trial(load()[name], bb.Params.paper(), 0.01) for name in ("S5-high", "S5-arm"))
    np.testing.assert_array_equal(high.points, [[0.0, 0.0, 0.25]] * 4)
    com = bb.Params.paper().body_com_height
    # To the left of pushes along x, y, -x, -y.
    np.testing.assert_allclose(
        arm.points, [[0, 0.05, com], [-0.05, 0, com], [0, -0.05, com], [0.05, 0, com]], atol=1e-15
    )
    assert trial(load()["S4"], bb.Params.paper(), 0.01).points is None
    kugle = bb.Params.preset("kugle")
    np.testing.assert_allclose(
        trial(load()["S5-high"], kugle, 0.01).points[:, 2], 0.25 * kugle.body_com_height / com, rtol=1e-12
    )


def test_pushes_with_an_arm_turn_the_robot_and_high_ones_tilt_it_more():
    center = dataclasses.replace(load()["S5-high"], id="center", push_height=None)
    arm, center, high = run_scenarios("lqr", [load()["S5-arm"], center, load()["S5-high"]])
    assert arm.success_rate == 1.0
    assert arm.score > np.radians(1.0)
    np.testing.assert_array_less(arm.metrics["final_yaw_error"], np.radians(0.1))
    assert center.metrics["largest_yaw_error"].max() < 0.05 * arm.score
    assert high.metrics["largest_tilt"].min() > 1.2 * center.metrics["largest_tilt"].max()


def test_a_constant_force_holds_the_lean_of_the_closed_form():
    (outcome,) = run_scenarios(["lqi"], ["S6-1N"])
    np.testing.assert_allclose(np.degrees(outcome.metrics["final_tilt"]), 4.69, atol=0.02)


def test_metrics_of_known_rows():
    states = np.zeros((3, 2, 32))
    states[..., 16] = 1.0
    states[1:, 0, 0] = [3.0, 4.0]
    states[1:, 0, 7] = 1.0
    measures = Measures(2, 0.5, 0.0, np.array([[0.0, 0.0, 0.1]] * 2), np.ones(2))
    terminated = np.array([[False, True], [False, False]])
    torques = np.array([[[1.0, 1.0, 1.0], [2.0, 0.0, 0.0]], [[1.0, 1.0, 0.0], [9.0, 9.0, 9.0]]])
    # Turned by 90 deg of which 60 were commanded.
    states[2, 0, [16, 19]] = np.sqrt(0.5)
    still, yaw = np.zeros((3, 1, 2)), np.array([[0.0], [0.0], [np.pi / 3.0]])
    measures.add({"states": states, "torques": torques, "terminated": terminated}, still, still, yaw)
    found = measures.found()
    assert list(found) == list(METRICS)
    assert found["fell"].tolist() == [False, True]
    assert found["rms_error"][0] == pytest.approx(math.sqrt(12.5))
    assert found["largest_error"][0] == 4.0
    assert found["final_speed"][0] == 1.0
    assert found["final_yaw_error"][0] == found["largest_yaw_error"][0] == pytest.approx(np.pi / 6.0)
    assert found["rms_torque"][0] == pytest.approx(math.sqrt((1.0 + 2.0 / 3.0) / 2.0))
    assert found["torque_variation"][0] == pytest.approx(1.0)
    # After a fall nothing counts.
    assert np.isnan(found["rms_error"][1])
    assert found["settling_time"][0] == math.inf


def test_random_pushes_are_the_same_at_any_rate():
    scenario = load()["S22-10s"]
    fast, slow = (trial(scenario, bb.Params.paper(), dt, seed=2).impulses for dt in (0.01, 0.02))
    for episode in range(fast.shape[1]):
        given = [impulses[:, episode][impulses[:, episode].any(axis=-1)] for impulses in (fast, slow)]
        np.testing.assert_array_equal(*given)


def test_steps_go_in_all_directions():
    (outcome,) = run_scenarios("lqr", "S9")
    assert len(set(outcome.metrics["rms_error"].tolist())) == 6


def test_controllers_without_a_setpoint_run_scenarios_without_motion():
    pushed = Scenario("pushed", "", seconds=1.0, push=0.1, score="rms_tilt")
    (outcome,) = run_scenarios(["zero"], [pushed])
    assert outcome.metrics["fell"].all() or outcome.score > 0.1
    (own,) = run_scenarios([lambda state: [-0.001 * speed for speed in state.wheel_speeds]], [pushed])
    assert own.score > 0.0
    (skipped,) = run_scenarios(["zero"], ["S13-10s"])
    assert skipped.skipped == "the scenario is a motion, and it follows no position"
    assert repr(skipped) == f"<Outcome of zero in S13-10s: skipped, {skipped.skipped}>"
    assert np.isnan([skipped.score, skipped.success_rate, *skipped.interval()]).all()
    found = json.loads(json.dumps(skipped.row(), allow_nan=False))
    assert (found["score"], found["success_rate"], found["episodes"]) == (None, None, 0)
    assert found["skipped"] == skipped.skipped
    assert rows([skipped])[1][3] == "-"


def test_forces_and_slopes_are_withstood():
    for name in ("S6-1N", "S7-1deg"):
        assert run_scenarios("lqi", name)[0].success_rate == 1.0


def test_maps_of_other_robots_are_in_their_numbers():
    scenario = Scenario("map", "", seconds=3.0, tilt=(10.0, 14.0, 2.0), directions=3, score="map")
    (outcome,) = run_scenarios("lqr", scenario, robot="kugle")
    scale, paper = (Scale.of(bb.Params.preset(name)) for name in ("kugle", "paper"))
    assert outcome.score == pytest.approx(14.0 * scale.holdable_lean / paper.holdable_lean)


def test_rows_are_json():
    (fallen,) = run_scenarios("zero", Scenario("x", "", seconds=3.0, push=1.0, score="rms_tilt"))
    text = json.dumps(fallen.row(), allow_nan=False)
    assert json.loads(text)["score"] is None


def test_duplicate_names_are_rejected():
    with pytest.raises(ValueError, match="two controllers are named 'lqr'"):
        run_scenarios(["lqr", "lqr"], "S4")


def test_what_a_controller_cannot_follow_is_skipped():
    outcomes = run_scenarios(["pid", "lqr"], ["S4", "S13-10s"])
    found = [(one.controller, one.scenario.id, one.skipped is None) for one in outcomes]
    assert found == [("pid", "S4", True), ("pid", "S13-10s", False), ("lqr", "S4", True), ("lqr", "S13-10s", True)]
    (line,) = [line for line in rows(outcomes) if line[0] == "S13-10s"]
    assert line[3] == "-"
    assert float(line[4]) > 0.0


def test_intervals_are_wilson_intervals():
    metrics = {name: np.zeros(10) for name in METRICS} | {"fell": np.zeros(10, dtype=bool)}
    outcome = Outcome("x", load()["S20-push"], metrics, np.arange(10) < 8, np.empty(0))
    low, high = outcome.interval()
    assert (low, high) == (pytest.approx(0.4902, abs=1e-4), pytest.approx(0.9433, abs=1e-4))


#: What a field of a scenario may be in a file, right or not.
VALUES = ["5", "-1", "1e400", "nan", "true", '"x"', "[]", "[[1]]", "[1, 2, 3]", "{ a = 1 }", "1979-05-27", "[1e-9, 2]"]


def test_an_edited_file_of_scenarios_is_rejected_by_name_or_accepted(tmp_path):
    """Fields with other values, lines that are missing, bytes that are others."""
    text = resources.files("ballbot_rs.scenarios").joinpath("scenarios.toml").read_text(encoding="utf-8")
    lines = text.splitlines()
    fields = [place for place, line in enumerate(lines) if "=" in line and not line.startswith("#")]
    rng = np.random.default_rng(0)
    changed = []
    for _ in range(700):
        place = rng.choice(fields)
        value = f"{lines[place].split('=')[0]}= {rng.choice(VALUES)}"
        changed.append([*lines[:place], *rng.choice(np.array([[value], [""]], dtype=object)), *lines[place + 1 :]])
    contents = ["\n".join(part).encode() for part in changed]
    for _ in range(500):
        data = bytearray(text.encode())
        for place in rng.integers(0, len(data), 3):
            data[place] = rng.integers(256)
        contents.append(bytes(data))
    contents += [f"scenario = {value}".encode() for value in VALUES]
    contents += [b"[" * 100_000, b"scenario = " + b"[" * 100_000, b"a." * 100_000 + b"b = 1", b"x" * (1 << 21)]
    path = tmp_path / "changed.toml"
    rejected = []
    for content in contents:
        path.write_bytes(content)
        try:
            load(path)
        except bb.InvalidInputError as error:
            rejected.append(str(error))
    assert all(message.startswith(str(path)) for message in rejected)
    assert 500 < len(rejected) < len(contents)


def test_custom_scenarios(tmp_path):
    path = tmp_path / "own.toml"
    path.write_text(
        '[[scenario]]\nid = "A"\ntitle = "t"\nseconds = 2\npush = 0.3\ndirections = 2\nscore = "rms_tilt"\n'
    )
    (outcome,) = run_scenarios(["lqr"], file=path)
    assert outcome.success.all()
    for text, error in [
        ("", r"there is no \[\[scenario\]\]"),
        ("x = 1\n", r"'x' is not known, expected only tables \[\[scenario\]\]"),
        ("scenario = 5\n", r"scenario = 5, expected tables \[\[scenario\]\]"),
        ('[[scenario]]\nid = ["A"]\ntitle = ""\nseconds = 1\nscore = "map"\n', r"id = \('A',\), expected text"),
        (OWN + "seeds = 1.5\n", "A: seeds = 1.5, expected a whole number"),
        (OWN + "push = true\n", "A: push = True, expected a finite number or three of them"),
        (OWN + "actuators = 3\n", "A: actuators = 3, expected a table"),
        (OWN + "push_every = [0, 0]\n", r"push_every = \(0, 0\), expected two times, the first at least 0.01 s"),
        (OWN + "push_time = -1\n", "push_time = -1, expected at least 0 s"),
        (OWN + 'reference = { kind = "random_velocities" }\n', "expected the numbers largest, every, change, yaw_rate"),
        (OWN.replace("rms_tilt", "map") + "tilt = [0, 1, 1e-9]\n", "expected at most 1000 steps"),
        ('[[scenario]]\nid = "A"\nsecond = 2\n', "has no field 'second': did you mean 'seconds'"),
        ('[[scenario]]\nid = "A"\n', "scenario A lacks title, seconds, score"),
        ('[[scenario]]\nid = "A"\ntitle = ""\nseconds = -1\nscore = "map"\n', "seconds = -1"),
        ('[[scenario]]\nid = "A"\ntitle = ""\nseconds = 1\nscore = "mop"\n', "score = 'mop'"),
        (OWN + "tilt = [1, 2]\n", r"tilt = \(1, 2\), expected a finite number or three of them"),
        (OWN + "tilt = [1, 2, 0]\n", "a step above 0"),
        (OWN + "push = nan\n", "push = nan, expected a finite number or three of them"),
        (OWN + "push_height = inf\n", "push_height = inf, expected a finite number"),
        (OWN + "measure_from = 1\n", "measure_from = 1, expected from 0 to before seconds = 1"),
        (OWN + 'reference = { kind = "spiral" }\n', "reference.kind = 'spiral'"),
        (OWN + "reference = { radius = 1 }\n", "reference.kind = None"),
    ]:
        path.write_text(text)
        with pytest.raises(ValueError, match=error):
            load(path)


def test_selection_by_id_and_family():
    assert [one.id for one in select(["S13"], load())] == ["S13-10s", "S13-6s", "S13-4s"]
    assert [one.id for one in select(["S13-6s", "S9"], load())] == ["S13-6s", "S9"]
    with pytest.raises(ValueError, match="unknown scenario 'S99'"):
        select(["S99"], load())


def test_command(capsys):
    assert main(["compare", "S13-10s", "S4", "--controller", "lqr", "--controller", "pid"]) == 0
    text = capsys.readouterr().out
    assert "S13-10s" in text
    assert all(len(line) <= 100 for line in text.splitlines())
    assert main(["compare", "S13-10s", "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)["results"]
    assert row["scenario"] == "S13-10s"
    assert row["score"] < 1e-3
    assert main(["compare", "--list", "S13"]) == 0
    assert capsys.readouterr().out.splitlines()[1].startswith("S13-6s")
    assert main(["compare", "S99"]) == 1


def test_sensors_and_events_are_named_or_in_a_file(tmp_path):
    short = Scenario("short", "", seconds=0.1, tilt=3.0, score="rms_tilt")
    file = tmp_path / "events.toml"
    file.write_text('[[events]]\nterm = "gravity"\nop = "scale"\nrange = [2.0, 2.0]\n', encoding="utf-8")
    (plain,), (heavy,) = (bb.run_scenarios("lqr", short, events=events) for events in (None, file))
    assert heavy.metrics["rms_tilt"] != plain.metrics["rms_tilt"]
    for name in ("sensors", "events"):
        with pytest.raises(TypeError, match=f"^{name} must be a name or the path of a TOML file, not dict"):
            bb.run_scenarios("lqr", short, **{name: {}})
