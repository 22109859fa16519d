"""The policies that come with the package perform as on their page."""

import re

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs._state_rows import BODY_RATE
from ballbot_rs.analysis.rollout import rollout
from ballbot_rs.control.resolve import find
from ballbot_rs.envs._batch_env import new_batch
from tests.support.paths import ROOT
from validation.policies import any_robot
from validation.policies.judging import CONTACT, FIRST_SEED, episodes_of, result
from validation.policies.shipped import SHIPPED

pytest.importorskip("onnxruntime")

PAGE = (ROOT / "docs" / "policies.md").read_text(encoding="utf-8")


def row_of(file):
    """Header and row of the policy on `contact`, as cells by name."""
    section = next(part for part in PAGE.split("\n### ") if f"`assets/policies/{file}`" in part)
    head = next(line for line in section.splitlines() if line.startswith("| judge |"))
    row = next(line for line in section.splitlines() if line.startswith("| `contact` | policy |"))
    cells = ([cell.strip() for cell in line.strip("|").split("|")] for line in (head, row))
    return dict(zip(*cells, strict=True))


def interval_in(cell):
    found = re.search(r"\((\S+) … (\S+)\)", cell)
    assert found is not None, cell
    return float(found[1]), float(found[2])


@pytest.mark.slow("repeats a page")
@pytest.mark.parametrize("one", SHIPPED, ids=lambda one: one.file)
def test_a_policy_reproduces_its_page(one):
    found = result(one.cell(str(ROOT / "assets" / "policies" / one.file), CONTACT))
    row = row_of(one.file)
    low, high = interval_in(row["success"])
    assert low - 0.05 <= 100.0 * found.success_rate <= high + 0.05
    columns = {name.partition(" (")[0].replace(" ", "_"): cell for name, cell in row.items()}
    for name, value in found.metrics.items():
        low, high = interval_in(columns[name])
        # The page has three digits.
        assert low * (1.0 - 5e-3) <= value <= high * (1.0 + 5e-3), name


def test_tasks_have_a_policy_except_those_on_hills():
    assert {one.recipe.task for one in SHIPPED} == bb._core.TASKS.keys() - {"terrain", "openballbot"}
    on_disk = {path.name for path in (ROOT / "assets" / "policies").glob("*.onnx")}
    assert on_disk == {any_robot.FILE, *(one.file for one in SHIPPED)}


def test_one_policy_balances_every_robot():
    file = ROOT / "assets" / "policies" / any_robot.FILE
    assert file.stat().st_size <= 20_000
    for robot in bb.Params.preset_names():
        options = {**episodes_of("balance"), "robot": robot, "events": None}
        found = bb.evaluate(file, episodes=64, **options)
        assert found.success_rate >= 0.98, robot
    family = {**episodes_of("balance"), "robot": {"family": 32, "seed": any_robot.SEED}, "events": None}
    found = bb.evaluate(file, episodes=256, **family)
    assert found.survival_rate >= 0.98
    assert found.success_rate >= 0.95


def test_the_policy_of_balance_does_not_turn():
    """It stops turning when its wheels stop; trained on robots that never turn, it turned at 1.2 deg/s."""
    policy = find(ROOT / "assets" / "policies" / "balance.onnx")
    seconds, robots = 60, 32
    options = {**policy.env_options, "max_episode_steps": None}
    batch = new_batch(robots, task="balance", autoreset="disabled", num_threads=1, seed=FIRST_SEED, options=options)
    turned = np.zeros(robots)
    for chunk in rollout(batch, policy, int(seconds / batch.control_dt)):
        assert not chunk.terminated.any()
        if chunk.first * batch.control_dt >= 20.0:
            turned += chunk.states[..., BODY_RATE][..., 2].sum(axis=0) * batch.control_dt
    assert np.abs(np.rad2deg(turned)).max() < 0.1 * (seconds - 20)
