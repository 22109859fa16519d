"""Hyperparameters for rl-zoo3, without rl-zoo3."""

import importlib

import pytest
from stable_baselines3 import PPO

from ballbot_rs import BallbotVecEnv
from ballbot_rs._core import TASKS
from ballbot_rs.training.rl_zoo3 import hyperparams

#: What rl-zoo3 takes out before the rest goes to the algorithm.
OF_THE_ZOO = ("n_timesteps", "n_envs", "env_kwargs", "vec_env_wrapper")


def test_every_task_has_hyperparameters():
    assert set(hyperparams) == {task["id"] for task in TASKS.values()}


def test_a_second_training_in_one_process_finds_them_all():
    """rl-zoo3 deletes from them what it has used."""
    module = importlib.import_module("ballbot_rs.training.rl_zoo3")
    before = module.hyperparams
    for used in module.hyperparams.values():
        used["env_kwargs"].clear()
        del used["n_envs"], used["n_timesteps"]
    assert module.hyperparams == before == hyperparams


@pytest.mark.slow("a training")
@pytest.mark.parametrize("env_id", hyperparams)
def test_environment_and_algorithm_use_them(env_id):
    settings = {name: value for name, value in hyperparams[env_id].items() if name not in OF_THE_ZOO}
    rate = settings["learning_rate"]
    if isinstance(rate, str):
        kind, _, value = rate.partition("_")
        assert kind == "lin"
        rate = float(value)
    assert 1e-5 <= rate <= 1e-2
    env = BallbotVecEnv(2, task=env_id, seed=0, **hyperparams[env_id]["env_kwargs"])
    small = {**settings, "learning_rate": rate, "n_steps": 4, "batch_size": 8, "n_epochs": 1}
    model = PPO(env=env, **small).learn(8)
    assert model.num_timesteps == 8
