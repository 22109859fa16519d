"""Stable-Baselines3's wrappers, callbacks and learners on `BallbotVecEnv`."""

import numpy as np
import pytest
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.callbacks import BaseCallback, EvalCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

from ballbot_rs import BallbotVecEnv

FAST = {"model": "spatial", "num_threads": 1, "max_episode_steps": 40}
SMALL = {"net_arch": [8]}


class KeepRollouts(BaseCallback):
    """Copies what PPO has stored before the update."""

    def __init__(self):
        super().__init__()
        self.observations = []
        self.actions = []
        self.starts = []

    def _on_rollout_end(self):
        buffer = self.model.rollout_buffer
        self.observations.append(buffer.observations.copy())
        self.actions.append(buffer.actions.copy())
        self.starts.append(buffer.episode_starts.copy())

    def _on_step(self):
        return True


def test_ppo_stores_what_the_environment_really_observed():
    """A reused observation buffer would make PPO store shifted data, without any error."""
    kept = KeepRollouts()
    model = PPO(
        "MlpPolicy",
        BallbotVecEnv(num_envs=3, **FAST),
        n_steps=32,
        batch_size=32,
        n_epochs=1,
        seed=4,
        device="cpu",
        policy_kwargs=SMALL,
    )
    model.learn(2 * 3 * 32, callback=kept)
    observations, actions = np.concatenate(kept.observations), np.concatenate(kept.actions)
    assert observations.shape == (64, 3, 16)
    replay = BallbotVecEnv(num_envs=3, **FAST)
    replay.seed(4)
    current = replay.reset()
    dones = np.ones(3, dtype=bool)
    ends = 0
    for stored, chosen, starts in zip(observations, actions, np.concatenate(kept.starts), strict=True):
        np.testing.assert_array_equal(stored, current)
        np.testing.assert_array_equal(starts.astype(bool), dones)
        current, _, dones, _ = replay.step(np.clip(chosen, -1.0, 1.0))
        ends += dones.sum()
    assert ends >= 3
    assert len(np.unique(observations.reshape(-1, 16), axis=0)) == 64 * 3


def test_vec_monitor_counts_episodes():
    env = VecMonitor(BallbotVecEnv(num_envs=2, seed=0, **FAST), info_keywords=("is_success",))
    env.reset()
    returns, lengths, episodes = np.zeros(2), np.zeros(2, dtype=int), 0
    for actions in np.random.default_rng(0).uniform(-0.3, 0.3, (120, 2, 3)):
        _, rewards, dones, infos = env.step(actions)
        returns += rewards
        lengths += 1
        for i in np.flatnonzero(dones):
            assert infos[i]["episode"]["l"] == lengths[i]
            assert infos[i]["episode"]["r"] == pytest.approx(returns[i], rel=1e-4)
            assert infos[i]["episode"]["is_success"] == infos[i]["is_success"]
            returns[i], lengths[i] = 0.0, 0
            episodes += 1
    assert episodes >= 4


def test_vec_normalize_survives_saving(tmp_path):
    env = VecNormalize(BallbotVecEnv(num_envs=4, seed=0, **FAST))
    env.reset()
    actions = np.random.default_rng(0).uniform(-0.5, 0.5, (60, 4, 3))
    for a in actions[:50]:
        observations, *_, infos = env.step(a)
        for info in infos:
            if "terminal_observation" in info:
                assert np.abs(info["terminal_observation"]).max() <= env.clip_obs
    assert np.abs(observations).max() > 0.1
    env.training = False
    env.save(str(tmp_path / "statistics.pkl"))
    raw = BallbotVecEnv(num_envs=4, seed=1, **FAST)
    again = VecNormalize.load(str(tmp_path / "statistics.pkl"), BallbotVecEnv(num_envs=4, seed=1, **FAST))
    np.testing.assert_array_equal(again.reset(), env.normalize_obs(raw.reset()))
    np.testing.assert_array_equal(again.get_original_obs(), BallbotVecEnv(num_envs=4, seed=1, **FAST).reset())
    for a in actions[50:]:
        np.testing.assert_array_equal(again.step(a)[0], env.normalize_obs(raw.step(a)[0]))


def test_eval_callback_records_lengths_and_successes(tmp_path):
    callback = EvalCallback(
        VecMonitor(BallbotVecEnv(num_envs=2, seed=100, **FAST)),
        n_eval_episodes=4,
        eval_freq=16,
        log_path=str(tmp_path),
        best_model_save_path=str(tmp_path),
        verbose=0,
    )
    env = VecMonitor(BallbotVecEnv(num_envs=2, seed=0, **FAST))
    model = PPO("MlpPolicy", env, n_steps=16, batch_size=32, n_epochs=1, device="cpu", policy_kwargs=SMALL)
    model.learn(64, callback=callback)
    record = np.load(tmp_path / "evaluations.npz")
    assert record["timesteps"].tolist() == [32, 64]
    assert record["results"].shape == (2, 4)
    assert (record["ep_lengths"] <= 40).all()
    assert record["successes"].shape == (2, 4)
    assert (tmp_path / "best_model.zip").is_file()


def test_evaluate_policy_is_reproducible():
    model = PPO("MlpPolicy", BallbotVecEnv(num_envs=1, seed=0, **FAST), device="cpu", policy_kwargs=SMALL, seed=0)
    scores = []
    for _ in range(2):
        env = VecMonitor(BallbotVecEnv(num_envs=2, seed=3, **FAST))
        scores.append(evaluate_policy(model, env, n_eval_episodes=4, return_episode_rewards=True))
    assert scores[0] == scores[1]
    assert len(scores[0][0]) == 4


@pytest.mark.parametrize("threads", [1, 2])
def test_ppo_is_reproducible_for_any_number_of_threads(threads):
    weights = []
    for num_threads in (1, threads):
        env = BallbotVecEnv(num_envs=4, **{**FAST, "num_threads": num_threads})
        model = PPO("MlpPolicy", env, n_steps=16, batch_size=32, n_epochs=1, seed=0, device="cpu", policy_kwargs=SMALL)
        model.learn(128)
        weights.append(np.concatenate([p.detach().numpy().ravel() for p in model.policy.parameters()]))
    np.testing.assert_array_equal(weights[0], weights[1])


def test_sac_learns_a_little(tmp_path):
    env = VecMonitor(BallbotVecEnv(num_envs=2, seed=0, **FAST))
    model = SAC(
        "MlpPolicy",
        env,
        learning_starts=20,
        batch_size=16,
        buffer_size=500,
        gradient_steps=2,
        seed=0,
        device="cpu",
        policy_kwargs=dict(SMALL),  # SAC adds entries
    )
    before = [p.detach().clone() for p in model.policy.parameters()]
    model.learn(120)
    changed = [not np.array_equal(a, b.detach()) for a, b in zip(before, model.policy.parameters(), strict=True)]
    assert any(changed)
    buffer = model.replay_buffer
    stored = buffer.observations[: buffer.pos].reshape(-1, 16)
    assert len(np.unique(stored, axis=0)) == len(stored) == 120
    # Where no episode ended, the next observation follows; where an episode ended, it is the last of the episode.
    following, next_stored = buffer.observations[1 : buffer.pos], buffer.next_observations[: buffer.pos - 1]
    dones = buffer.dones[: buffer.pos - 1].astype(bool)
    np.testing.assert_array_equal(next_stored[~dones], following[~dones])
    assert dones.any()
    assert not (next_stored[dones] == following[dones]).all(axis=-1).any()
    model.save(tmp_path / "sac.zip")
    observation = env.reset()
    again = SAC.load(tmp_path / "sac.zip", device="cpu")
    np.testing.assert_array_equal(
        again.predict(observation, deterministic=True)[0], model.predict(observation, deterministic=True)[0]
    )
