"""This simulator, set up for the benchmark."""

from typing import Any

import ballbot_rs as bb
from ballbot_rs._core import MODELS
from validation.benchmarks import task

#: Models to benchmark, the most interesting first; models that this build does not have are omitted.
WANTED = ("contact", "rigid", "spatial")


def known_models(names: tuple[str, ...] = WANTED) -> list[str]:
    """The models of `names` that this build has, with a printed line for each that it does not."""
    for model in names:
        if model not in MODELS:
            print(f"model '{model}' is not in this build: left out", flush=True)
    return [model for model in names if model in MODELS]


def make_env(model: str, num_envs: int, num_threads: int, **options: Any) -> bb.BallbotVecEnv:
    """The balance task of `num_envs` robots on `num_threads` threads, started as in the other engines."""
    options = {"reset_yaw": task.RESET_YAW, "max_wheel_torque": task.MAX_TORQUE} | options
    return bb.BallbotVecEnv(num_envs=num_envs, model=model, num_threads=num_threads, seed=0, **options)
