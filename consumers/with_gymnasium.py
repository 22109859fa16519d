"""Gymnasium: its checkers, its conversions to other arrays, and workers that have imported nothing but the id."""

import warnings

import gymnasium
import jax.numpy as jnp
import numpy as np
import torch
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import vector

from ballbot_rs._core import TASKS
from consumers.common import ENV_ID, NUM_ENVS, Timer, finish

#: Vector wrappers that convert arrays: the type that a learner gets, and the function that makes its actions.
CONVERSIONS = {
    "ArrayConversion to torch": (lambda env: vector.ArrayConversion(env, np, torch), torch.Tensor, torch.from_numpy),
    "ArrayConversion to jax": (lambda env: vector.ArrayConversion(env, np, jnp), jnp.ndarray, jnp.asarray),
    "NumpyToTorch": (vector.NumpyToTorch, torch.Tensor, torch.from_numpy),
    "JaxToTorch": (vector.JaxToTorch, torch.Tensor, torch.from_numpy),
    "JaxToNumpy": (vector.JaxToNumpy, np.ndarray, np.asarray),
}


def leaves(value):
    """The arrays of a nested result."""
    parts = value.values() if isinstance(value, dict) else value if isinstance(value, tuple) else None
    return [value] if parts is None else [leaf for part in parts for leaf in leaves(part)]


def check_conversions(env_id, mode):
    """Each wrapper returns the numbers of the environment in the arrays of its library, ends of episodes included."""
    for name, (wrapper, kind, make) in CONVERSIONS.items():
        plain, env = (
            gymnasium.make_vec(env_id, 4, autoreset_mode=mode, max_episode_steps=30, seed=0) for _ in range(2)
        )
        env, rng = wrapper(env), np.random.default_rng(0)
        results = [(env.reset(seed=0), plain.reset(seed=0))]
        for _ in range(70):
            actions = rng.uniform(-1.0, 1.0, (4, 3)).astype(np.float32)
            results.append((env.step(make(actions)), plain.step(actions)))
        ends = 0
        for found, expected in results:
            for leaf, number in zip(leaves(found), leaves(expected), strict=True):
                assert isinstance(leaf, kind), (env_id, name, type(leaf))
                np.testing.assert_array_equal(np.asarray(leaf), np.asarray(number, dtype=np.asarray(leaf).dtype))
            ends += int(np.sum(expected[-2])) if len(expected) == 5 else 0
        assert ends > 0, (env_id, name)


if __name__ == "__main__":
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for task in TASKS.values():
            check_env(gymnasium.make(f"ballbot_rs:{task['id']}").unwrapped, skip_render_check=True)
    for task in TASKS.values():
        for mode in ("next_step", "same_step"):
            check_conversions(f"ballbot_rs:{task['id']}", mode)
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
    finish(steps, timer, note="only steps; checkers and conversions clean, spawned workers")
