"""Gymnasium: its checkers, and worker processes that have imported nothing but the id."""

import warnings

import gymnasium
import numpy as np
from gymnasium.utils.env_checker import check_env

from ballbot_rs._core import TASKS
from consumers.common import ENV_ID, NUM_ENVS, Timer, finish

if __name__ == "__main__":
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for task in TASKS.values():
            check_env(gymnasium.make(f"ballbot_rs:{task['id']}").unwrapped, skip_render_check=True)
    # A function of no closure: a process that is spawned imports this module, and by it the package by the id alone.
    workers = gymnasium.make_vec(
        ENV_ID, 2, vectorization_mode="async", vector_kwargs={"context": "spawn", "shared_memory": True}
    )
    workers.reset(seed=0)
    observations = workers.step(np.zeros((2, 3), dtype=np.float32))[0]
    workers.close()
    env = gymnasium.make_vec(ENV_ID, NUM_ENVS)
    env.reset(seed=0)
    np.testing.assert_array_equal(env.step(np.zeros((NUM_ENVS, 3), dtype=np.float32))[0][:2], observations)
    timer = Timer()
    actions = env.action_space.sample()
    steps = 0
    while not timer.is_over:
        env.step(actions)
        steps += NUM_ENVS
    finish(steps, timer, note="only steps; checkers clean, spawned workers")
