"""The benchmark's action sizes, its worst case and their table."""

import itertools

import numpy as np
import pytest

import ballbot_rs as bb
from validation.benchmarks import actions, task
from validation.benchmarks.fallen import Thrashing
from validation.benchmarks.report import markdown
from validation.benchmarks.simulators import environment
from validation.engines.steps import SIM_DT, SUBSTEPS

_MODELS = ("contact", "rigid", "spatial", "planar")


def test_actions_have_the_requested_size_and_are_otherwise_unchanged() -> None:
    small, large = task.make_actions(50, 8, 0.1), task.make_actions(50, 8, 1.0)
    assert 0.09 < np.abs(small).max() * task.MAX_TORQUE <= 0.1
    np.testing.assert_allclose(small * 10.0, large, rtol=1e-6)
    np.testing.assert_array_equal(task.make_actions(50, 8), task.make_actions(50, 8, task.HEADLINE_TORQUE))


@pytest.mark.parametrize(
    ("signs", "slips_from"), [((1.0, 0.0, 0.0), 0.57), ((1.0, -1.0, -1.0), 0.20), ((-1.0, 1.0, 1.0), 0.20)]
)
def test_the_upright_robot_slips_at_the_torques_that_the_report_names(
    signs: tuple[float, float, float], slips_from: float
) -> None:
    def slip(torque: float) -> float:
        robot = bb.Ballbot(model="contact", sim_dt=SIM_DT)
        robot.reset(bb.State.at_rest(robot.params))
        robot.step(np.multiply(signs, torque))
        return float(np.abs(robot.contacts.wheel_slip_speeds).max())

    stick = 1e-5  # m/s; what the solver leaves without slip
    assert slip(slips_from - 0.005) < stick
    assert slip(slips_from + 0.005) > 10.0 * stick


def test_no_wheel_of_the_upright_robot_slips_at_the_headline() -> None:
    robot = bb.Ballbot(model="contact", sim_dt=SIM_DT)
    for signs in itertools.product((-1.0, 0.0, 1.0), repeat=3):
        robot.reset(bb.State.at_rest(robot.params))
        robot.step(np.multiply(signs, task.HEADLINE_TORQUE))
        assert np.abs(robot.contacts.wheel_slip_speeds).max() < 1e-5, signs


def test_robots_fall_more_often_under_larger_actions() -> None:
    falls = [environment("ours:contact", 64, 1, torque, 200).found()["falls_per_second"] for torque in (0.1, 1.0)]
    assert 1.0 < falls[0] < falls[1] < 1.0 / (SUBSTEPS * SIM_DT)


def test_thrashing_robots_lie_on_the_floor_and_continue_where_they_were() -> None:
    robots = Thrashing(16)
    kept = 0
    for _ in range(30):
        ended = robots.batch.states()
        robots.before()
        begun = robots.batch.states()
        # All but those that sank too deep; a quaternion is made a unit one again.
        kept += int(np.isclose(begun, ended, rtol=0.0, atol=1e-14).all(axis=1).sum())
        robots.step()
        moved = robots.batch.states()
        assert np.isfinite(moved).all()
        assert (moved != begun).any(axis=1).all()
    assert kept >= 0.9 * 30 * 16
    found = robots.found()
    assert found["lying_mean"] >= 0.9
    assert 0.0 <= found["lying_min"] <= found["lying_mean"] <= 1.0
    # Not ended (a robot that hops), or on the floor: neither tilted too far nor diverged.
    assert set(robots.batch.endings()[1].tolist()) <= {0, 2}


def test_thrashing_robots_that_did_not_fall_are_rejected() -> None:
    robots = Thrashing(8)
    robots.batch.reset()
    robots.batch.step(np.zeros((8, 3), dtype=np.float32))
    robots._shares[:] = [robots.lying()]
    with pytest.raises(RuntimeError, match="0% of the robots lay on the floor, not 90%"):
        robots.found()


@pytest.mark.slow("a benchmark")
def test_table_has_every_model_at_every_size_and_names_the_headline() -> None:
    rows = actions.measure_here([(f"ours:{model}", 64) for model in _MODELS], rounds=1, seconds=0.001)
    assert not [row["reason"] for row in rows if "reason" in row]
    driven = [row for row in rows if row["case"] == "driven"]
    assert {(row["simulator"], row["torque"]) for row in driven} == {
        (f"ours:{model}", torque) for model in _MODELS for torque in actions.TORQUES
    }
    assert {row["torque"] for row in rows if row["headline"]} == {task.HEADLINE_TORQUE}
    assert [row["simulator"] for row in rows if row["case"] == "fallen"] == ["ours:contact"]

    machine = {
        "versions": {}, "load_before": None, "command": "", "date": "", "processor": "", "cores": 1, "memory_gib": 1,
        "system": "",
    }  # fmt: skip
    text = markdown({"machine": machine, "measured": {"actions": ""}, "actions": rows})
    head = next(line for line in text.splitlines() if line.startswith("| simulator"))
    assert [cell.strip() for cell in head.split("|")[3:7]] == [
        "±0.1 N·m (headline)", "±0.3 N·m", "±0.6 N·m", "±1.0 N·m",
    ]  # fmt: skip
    for model in _MODELS:
        line = next(line for line in text.splitlines() if line.startswith(f"| ballbot-rs, {model} |"))
        medians = [f"{row['median']:,.0f}" for row in driven if row["simulator"] == f"ours:{model}"]
        assert [cell.strip() for cell in line.split("|")[3:7]] == medians
    (fallen,) = (line for line in text.splitlines() if "everybody fallen and thrashing" in line)
    assert [cell.strip() for cell in fallen.split("|")[3:6]] == ["—"] * 3
    assert fallen.split("|")[6].strip() == f"{next(r for r in rows if r['case'] == 'fallen')['median']:,.0f}"
