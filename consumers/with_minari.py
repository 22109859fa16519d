"""Minari: datasets with the infos of every task, and a linear policy that imitates LQR from a dataset of balance."""

import os
import tempfile

import gymnasium
import minari
import numpy as np

import ballbot_rs as bb
from ballbot_rs._core import TASKS
from consumers.common import ENV_ID, Timer, finish

#: Standard deviation of what is added to the actions of LQR, so that a dataset has more than its closed loop.
NOISE = 0.05


def record(env_id, name, episodes, **options):
    """A dataset of episodes with the actions of LQR, read back from its files."""
    env = minari.DataCollector(gymnasium.make(env_id, **options), record_infos=True)
    robot, rng = env.unwrapped, np.random.default_rng(0)
    lqr = bb.Lqr(robot.params, control_dt=robot.control_dt)
    for seed in range(episodes):
        env.reset(seed=seed)
        is_over = False
        while not is_over:
            action = lqr(robot.state) / robot.max_wheel_torque + rng.normal(0.0, NOISE, 3)
            *_, terminated, truncated, _ = env.step(np.clip(action, -1.0, 1.0).astype(np.float32))
            is_over = terminated or truncated
    env.create_dataset(name, eval_env=env.spec, algorithm_name="LQR", description="LQR with noise on its actions.")
    env.close()
    dataset = minari.load_dataset(name)
    assert dataset.total_episodes == episodes
    return list(dataset.iterate_episodes())


def check(task, episodes):
    """Infos are stored for each reset and step, as finite numbers."""
    names = {"is_success", "termination", *(metric["name"] for metric in task["metrics"])}
    for episode in episodes:
        assert set(episode.infos) == names
        for values in episode.infos.values():
            assert values.shape == (len(episode.rewards) + 1,)
            assert np.isfinite(values).all()
        assert (episode.infos["termination"][-1] > 0) == episode.terminations[-1]


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        os.environ["MINARI_DATASETS_PATH"] = folder
        for name, task in TASKS.items():
            check(task, record(f"ballbot_rs:{task['id']}", f"{name}/short-v0", 2, max_episode_steps=100))
        data = bb.record_dataset("lqr", episodes=20, noise=NOISE, seed=1)
        assert data.to_minari("balance/lqr-v1", description="LQR with noise on its actions.").total_episodes == 20
        first = next(minari.load_dataset("balance/lqr-v1").iterate_episodes())
        assert np.array_equal(first.actions, data.actions[: len(first.actions)])
        timer = Timer()
        episodes = record(ENV_ID, "balance/lqr-v0", 20)
    observed = np.concatenate([episode.observations[:-1] for episode in episodes])
    acted = np.concatenate([episode.actions for episode in episodes])
    # The last action is not a part of the state.
    gain, *_ = np.linalg.lstsq(observed[:, :-3], acted, rcond=None)
    finish(len(acted), timer, lambda observations: observations[:, :-3] @ gain, "infos of all tasks; imitates LQR")
