"""Infos as third-party clients use them: the same finite numbers at every reset and step, ends of episodes included."""

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import SyncVectorEnv

import ballbot_rs as bb
from ballbot_rs._core import TASKS
from tests.support.infos import assert_same_infos, structure

ALL = sorted(TASKS)
SHORT = {"model": "contact", "max_episode_steps": 80}
STEPS = 260


class Lean(bb.Task):
    """Ends where it leans, and counts as a success while it does not."""

    def observe(self, robots):
        return robots.gravity

    def reward(self, robots):
        return 1.0 - robots.tilt

    def terminated(self, robots):
        return robots.tilt > 0.15

    def success(self, robots):
        return robots.tilt < 0.1


@pytest.fixture(autouse=True)
def own_task():
    bb.register("test_infos/Lean-v0", Lean)


def actions(step, n):
    return 0.6 * np.sin(np.arange(3 * n).reshape(n, 3) * 7 + 3 * step).astype(np.float32)


def single_steps(env):
    """Infos of a single environment over some episodes, resets included, and the number of ends."""
    infos, ends = [env.reset(seed=5)[1]], 0
    for step in range(STEPS):
        *_, terminated, truncated, info = env.step(actions(step, 1)[0])
        infos.append(info)
        if terminated or truncated:
            ends += 1
            infos.append(env.reset()[1])
    return infos, ends


@pytest.mark.slow("all tasks, many steps")
@pytest.mark.parametrize("task", [*ALL, "test_infos/Lean-v0"])
def test_a_single_environment_has_the_same_finite_numbers_at_every_step(task):
    env = bb.BallbotEnv(task, **SHORT)
    infos, ends = single_steps(env)
    assert ends >= 3
    metrics = [] if task not in TASKS else [metric["name"] for metric in TASKS[task]["metrics"]]
    assert list(infos[0]) == ["is_success", "termination", *metrics]
    for info in infos:
        assert structure(info) == structure(infos[0])
        # As readers of infos require: TorchRL needs a dtype, Gymnasium and the array API accept only numbers.
        assert [value.dtype for value in info.values()] == [np.bool_, np.int64, *[np.float64] * len(metrics)]
        assert np.isfinite([float(value) for value in info.values()]).all()
    codes = {int(info["termination"]) for info in infos}
    assert len(codes) > 1
    assert max(codes) < len(env.metadata["terminations"])
    assert env.metadata["terminations"][0] == "none"


@pytest.mark.slow("all tasks, many steps")
@pytest.mark.parametrize("task", [*ALL, "test_infos/Lean-v0"])
@pytest.mark.parametrize("mode", ["next_step", "same_step", "disabled"])
def test_many_environments_have_the_infos_that_gymnasium_combines_from_single_environments(task, mode):
    n, enum = 3, gymnasium.vector.AutoresetMode[mode.upper()]
    fast = bb.BallbotVectorEnv(n, task=task, autoreset_mode=mode, **SHORT)
    slow = SyncVectorEnv([lambda: bb.BallbotEnv(task, **SHORT)] * n, autoreset_mode=enum)
    first, expected = fast.reset(seed=3)[1], slow.reset(seed=3)[1]
    assert_same_infos(first, expected)
    ends = 0
    for step in range(STEPS):
        found, expected = fast.step(actions(step, n)), slow.step(actions(step, n))
        np.testing.assert_array_equal(found[0], expected[0])
        assert_same_infos(found[4], expected[4])
        within = {key: value for key, value in found[4].items() if "final_" not in key}
        assert structure(within) == structure(first)
        ended = found[2] | found[3]
        ends += ended.sum()
        if mode == "disabled" and ended.any():
            masked = [env.reset(options={"reset_mask": ended.copy()})[1] for env in (fast, slow)]
            assert_same_infos(*masked)
            assert structure(masked[0]) == structure(first)
    assert ends >= 2 * n


def test_arrays_of_infos_belong_to_their_step():
    env = bb.BallbotVectorEnv(2, task="velocity", autoreset_mode="same_step", **SHORT)
    kept = [env.reset(seed=0)[1], *(env.step(actions(step, 2))[4] for step in range(30))]

    def arrays(info):
        return [part for value in info.values() for part in (arrays(value) if isinstance(value, dict) else [value])]

    for i, info in enumerate(kept):
        before = [array for other in kept[:i] for array in arrays(other)]
        assert not any(np.shares_memory(array, other) for array in arrays(info) for other in before)


@pytest.mark.slow("all tasks, many steps")
@pytest.mark.parametrize("task", [*ALL, "test_infos/Lean-v0"])
def test_the_same_seed_gives_the_same_infos(task):
    """Gymnasium's own check of determinism, over ends of episodes."""
    runs = [single_steps(bb.BallbotEnv(task, **SHORT))[0] for _ in range(2)]
    assert data_equivalence(*runs, exact=True)


def to_torch(env, wrapper):
    pytest.importorskip("array_api_compat")
    wrappers = gymnasium.wrappers.vector if isinstance(env, gymnasium.vector.VectorEnv) else gymnasium.wrappers
    return getattr(wrappers, wrapper)(env, *((np, torch) if wrapper == "ArrayConversion" else ()))


@pytest.mark.slow("all tasks, many steps")
@pytest.mark.parametrize("task", [*ALL, "test_infos/Lean-v0"])
@pytest.mark.parametrize("wrapper", ["ArrayConversion", "NumpyToTorch"])
def test_a_single_environment_is_converted_to_torch(task, wrapper):
    env, plain = to_torch(bb.BallbotEnv(task, **SHORT), wrapper), bb.BallbotEnv(task, **SHORT)
    _, info = env.reset(seed=1)
    plain.reset(seed=1)
    ends = 0
    for step in range(STEPS):
        given = actions(step, 1)[0]
        *_, terminated, truncated, info = env.step(torch.from_numpy(given))
        expected = plain.step(given)[4]
        assert all(isinstance(value, torch.Tensor) for value in info.values())
        assert {key: value.item() for key, value in info.items()} == expected
        if terminated or truncated:
            ends += 1
            env.reset()
            plain.reset()
    assert ends >= 3


def sync(task, mode):
    enum = gymnasium.vector.AutoresetMode[mode.upper()]
    return SyncVectorEnv([lambda: bb.BallbotEnv(task, **SHORT)] * 3, autoreset_mode=enum)


def batched(task, mode):
    return bb.BallbotVectorEnv(3, task=task, autoreset_mode=mode, **SHORT)


@pytest.mark.parametrize("task", ["velocity", "balance", "test_infos/Lean-v0"])
@pytest.mark.parametrize(("make", "mode"), [(batched, "next_step"), (batched, "same_step"), (sync, "next_step")])
@pytest.mark.parametrize("wrapper", ["ArrayConversion", "NumpyToTorch"])
def test_many_environments_are_converted_to_torch(task, make, mode, wrapper):
    env = to_torch(make(task, mode), wrapper)
    env.reset(seed=1)
    ends = 0
    for step in range(STEPS):
        *_, terminated, truncated, info = env.step(torch.from_numpy(actions(step, 3)))
        ends += int((terminated | truncated).sum())
        final = info.get("final_info", {})
        for key in ("is_success", "termination"):
            assert isinstance(info[key], torch.Tensor)
            assert isinstance(final.get(key, info[key]), torch.Tensor)
    assert ends >= 6


@pytest.mark.parametrize("task", [*ALL, "test_infos/Lean-v0"])
def test_stable_baselines3_has_the_same_numbers_at_every_step(task):
    n = 3
    env = bb.BallbotVecEnv(n, task=task, seed=2, **SHORT)
    env.reset()
    names = {"TimeLimit.truncated": bool, "is_success": bool, "termination": int}
    metrics = [] if task not in TASKS else [metric["name"] for metric in TASKS[task]["metrics"]]
    every = [*env.reset_infos]
    ends = 0
    for step in range(STEPS):
        *_, dones, infos = env.step(actions(step, n))
        every += infos
        for done, info in zip(dones, infos, strict=True):
            ends += done
            ending = {"terminal_observation", *metrics} if done else set()
            assert info.keys() == names.keys() | ending
            assert all(type(info[name]) is float and np.isfinite(info[name]) for name in metrics if done)
    assert ends >= 2 * n
    assert {tuple(type(info[name]) for name in names) for info in every} == {tuple(names.values())}


def test_success_is_reported_before_the_end(balance):
    env = bb.BallbotVecEnv(1, model="spatial", seed=0, max_episode_steps=400, success_window=1.0)
    single = bb.BallbotEnv(model="spatial", max_episode_steps=400, success_window=1.0)
    env.reset()
    single.reset(seed=0)
    messages = []
    for _ in range(400):
        action = balance(single.state)
        *_, infos = env.step(action[None])
        messages.append(infos[0]["is_success"])
        assert single.step(action)[4]["is_success"] == messages[-1]
    assert not messages[50]
    assert messages[-2:] == [True, True]


def test_metrics_are_running_and_zero_before_they_are_defined():
    env = bb.BallbotEnv("velocity", model="contact")
    _, info = env.reset(seed=0)
    assert info["velocity_error"] == 0.0
    *_, info = env.step(np.zeros(3))
    assert np.isnan(env.metrics()["velocity_error"])
    assert info["velocity_error"] == 0.0
    lqr = bb.Controller("lqr", env.params, env.control_dt)
    for _ in range(400):
        *_, info = env.step(lqr(env.state, velocity=env.command[:2]) / env.max_wheel_torque)
    assert info["velocity_error"] == env.metrics()["velocity_error"] > 0.0
