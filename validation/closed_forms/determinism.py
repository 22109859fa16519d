"""Determinism, to the last bit.

The same run gives the same bits: again in this process, in other processes, and in a batch on any number of threads.
What is compared is a digest of every observation, reward and ending of 64 robots under random actions with falls and
resets, and of every state of a single robot.
"""

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.topic import Findings

_MODELS = ("planar", "spatial", "contact", "rigid")
_ENVS, _STEPS = 64, 60
_ROOT = Path(__file__).parents[2]


def run() -> Findings:
    """Counts the runs whose digest differs from the first."""
    claims = []
    for model in _MODELS:
        first = digest(model, 1)
        here = [digest(model, threads) for threads in (1, 2, 3)]
        code = f"from {__name__} import digest; print(digest({model!r}, 2))"
        command = [sys.executable, "-c", code]
        outside = [subprocess.check_output(command, text=True, cwd=_ROOT).strip() for _ in range(2)]
        for what, digests in ((f"on 1, 2, 3 threads, `{model}`", here), (f"in 2 other processes, `{model}`", outside)):
            claims.append(Claim(f"runs that differ, {what}", sum(d != first for d in digests), 0, 0.0, absolute=True))
    return Findings(claims)


def digest(model: str, threads: int) -> str:
    """SHA-256 of all results of a batch and a single robot."""
    found = hashlib.sha256()
    envs = bb.BalanceVectorEnv(_ENVS, num_threads=threads, model=model, max_episode_steps=40, reset_tilt=0.2)
    found.update(envs.reset(seed=7)[0].tobytes())
    actions = np.random.default_rng(3).uniform(-1.0, 1.0, (_STEPS, _ENVS, 3)).astype(np.float32)
    for action in actions:
        for array in envs.step(action)[:4]:
            found.update(array.tobytes())
        found.update(envs.states.tobytes())
    robot = bb.Ballbot(model=model)
    robot.reset(bb.State.at_rest(robot.params, tilt=(0.1, 0.05)))
    for torques in np.random.default_rng(4).uniform(-0.2, 0.2, (300, 3)):
        robot.step(torques)
        found.update(robot.state.to_array().tobytes())
    return found.hexdigest()
