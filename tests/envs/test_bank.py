"""The starts and commands of evaluations and of their pages: seeds 1000 and up."""

import json

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs._core import TASKS
from tests.support.paths import ROOT

BANK = json.loads((ROOT / "tests" / "envs" / "bank.json").read_text())
EPISODES, STEPS = 200, 900


def drawn(task):
    """First states, and the commands of the first nine seconds without an end: values, and sums over all episodes."""
    # `spatial` does not simulate the terrain that two tasks have.
    plane = {"terrain": {"kind": "plane", "slope": 0.05}, "max_episode_steps": 1000}
    own = plane if TASKS[task]["has_terrain"] else {}
    batch = bb.Batch(EPISODES, task, autoreset="disabled", seed=1000, model="spatial", fall_tilt=np.pi, **own)
    batch.reset()
    starts = batch.states()
    commands = [batch.command()]
    lqr = bb.Lqr(batch.params(0), batch.control_dt)
    for _ in range(STEPS):
        batch.step(batch.control(lqr))
        if (batch.command() != commands[-1]).any():
            commands.append(batch.command())
    # The position of the ball when a goal is sampled depends on the regulator.
    if task in ("goal", "carry", "navigate"):
        commands = commands[:1]
    return {
        "start": starts[0].tolist(),
        "starts": np.abs(starts).sum(axis=0).tolist(),
        "command": commands[0][0].tolist(),
        "commands": np.abs(commands).sum(axis=(0, 1)).tolist(),
    }


@pytest.mark.slow("200 episodes a task")
@pytest.mark.parametrize("task", sorted(TASKS))
def test_the_bank_matches_the_committed_bank(task):
    """If it is not, the numbers of docs/policies.md and docs/transfer.md are of other episodes."""
    found = drawn(task)
    assert found.keys() == BANK[task].keys()
    for name, values in BANK[task].items():
        np.testing.assert_allclose(found[name], values, rtol=1e-9, atol=1e-12, err_msg=name)
