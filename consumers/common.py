"""What every program here shares: how long it trains, what the policy reaches, and the line that it ends with."""

import json
import sys
import time
from collections.abc import Callable
from typing import Any, Final

import numpy as np
import numpy.typing as npt

import ballbot_rs as bb

ENV_ID: Final = "ballbot_rs:ballbot/Balance-v0"

#: Environments of a program, and steps of each before an update, so that all learners have the same batches.
NUM_ENVS: Final = 128
ROLLOUT: Final = 32

#: Fraction of robots that a trained policy keeps upright to the ends of their episodes.
LEARNED: Final = 0.9

#: Given on the command line, s; read here, for some learners have other arguments there.
_LIMIT: Final = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0

Act = Callable[[npt.NDArray[np.float32]], npt.NDArray[Any]]


class Timer:
    """The time that a program may train, from its making on."""

    def __init__(self) -> None:
        self._start = time.perf_counter()

    @property
    def seconds(self) -> float:
        """Since the start."""
        return time.perf_counter() - self._start

    @property
    def left(self) -> float:
        """Fraction of the time that is left, for rates that fall linearly."""
        return max(0.0, 1.0 - self.seconds / _LIMIT)

    @property
    def is_over(self) -> bool:
        """Whether the training should end."""
        return self.seconds >= _LIMIT


def reach(act: Act, num_envs: int = 100) -> tuple[float, float]:
    """Fractions of the episodes in which a policy keeps the robot from falling, and in which it succeeds."""
    env = bb.BallbotVectorEnv(num_envs, seed=1_000_000)
    observations, _ = env.reset()
    upright, truncated, info = np.ones(num_envs, dtype=bool), np.zeros(num_envs, dtype=bool), {}
    while not truncated.any() and upright.any():
        actions = np.clip(np.asarray(act(observations)), -1.0, 1.0)
        observations, _, terminated, truncated, info = env.step(actions)
        upright &= ~terminated
    succeeded = upright & info["is_success"] & truncated
    return float(upright.mean()), float(succeeded.mean())


def finish(steps: int, timer: Timer, act: Act | None = None, note: str = "") -> None:
    """Prints the result as the last line, which `python -m consumers` reads.

    Args:
        steps: of all robots.
        timer: of the training.
        act: the policy; without it, only steps are asserted.
        note: in addition to the result.
    """
    seconds = timer.seconds
    assert steps > 0, "no steps"
    upright, success = (None, None) if act is None else reach(act)
    result = {"steps": steps, "seconds": round(seconds, 1), "upright": upright, "success": success, "note": note}
    print(json.dumps(result), flush=True)
    assert upright is None or upright >= LEARNED, f"{upright:.0%} of the robots stay upright, expected {LEARNED:.0%}"
