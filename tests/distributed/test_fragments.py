"""Rollouts cut into fragments: the same robots, stepped one by one, have the same episodes."""

import numpy as np
import pytest

from ballbot_rs import BalanceEnv, BallbotVectorEnv
from ballbot_rs.training.on_ray.fragments import Rollouts, first_seed

ROBOTS, SEED = 6, 41
OPTIONS = {"model": "contact", "max_episode_steps": 70}
#: With this noise some robots fall and others reach the end of an episode.
DEVIATION = 0.4


def policy(observations):
    gain = np.linspace(-0.3, 0.3, 3 * observations.shape[1], dtype=np.float32).reshape(observations.shape[1], 3)
    means = np.tanh(observations @ gain)
    return means, np.full_like(means, np.log(DEVIATION))


def rollouts(**options):
    env = BallbotVectorEnv(ROBOTS, num_threads=1, **OPTIONS)
    return Rollouts(env, SEED, np.random.default_rng(0), **options)


@pytest.fixture(scope="module")
def collected():
    """Fragments of several calls in order, and the episodes that ended."""
    made, fragments, ended = rollouts(), [], []
    for _ in range(12):
        more, over = made.collect(policy, 25)
        assert sum(len(fragment) for fragment in more) >= 25 * ROBOTS
        fragments.append(more)
        ended += over
    return fragments, ended


def test_fragments_match_robots_stepped_one_by_one(collected):
    kinds = set()
    for robot in range(ROBOTS):
        env = BalanceEnv(**OPTIONS)
        observation, _ = env.reset(seed=SEED + robot)
        number, start = 0, 0
        for fragment in (one for call in collected[0] for one in call if one.episode[0] == robot):
            assert (fragment.episode, fragment.start) == ((robot, number), start)
            np.testing.assert_array_equal(fragment.observations[0], observation)
            for step, action in enumerate(fragment.actions):
                is_last = step == len(fragment) - 1
                observation, reward, terminated, truncated, _ = env.step(np.clip(action, -1.0, 1.0))
                np.testing.assert_array_equal(fragment.observations[step + 1], observation)
                assert fragment.rewards[step] == np.float32(reward)
                assert terminated == (is_last and fragment.terminated)
                # The first episodes are shortened.
                assert truncated == (is_last and fragment.truncated) or number == 0
            start += len(fragment)
            if fragment.terminated or fragment.truncated:
                kinds.add("terminated" if fragment.terminated else "truncated")
                observation, _ = env.reset()
                number, start = number + 1, 0
    assert kinds == {"terminated", "truncated"}


def test_returns_and_lengths_are_sums_over_fragments(collected):
    fragments, ended = collected
    sums, lengths, over = {}, {}, []
    for fragment in (one for call in fragments for one in call):
        name = fragment.episode
        sums[name] = sums.get(name, 0.0) + float(fragment.rewards.sum(dtype=np.float64))
        lengths[name] = lengths.get(name, 0) + len(fragment)
        if fragment.terminated or fragment.truncated:
            over.append((lengths[name], sums[name]))
    assert len(over) == len(ended) > 2 * ROBOTS
    expected = sorted((one.length, one.total_reward) for one in ended)
    assert [length for length, _ in sorted(over)] == [length for length, _ in expected]
    np.testing.assert_allclose(sorted(s for _, s in over), sorted(s for _, s in expected), rtol=1e-5)


def test_densities_match_the_actions(collected):
    fragment = collected[0][0][0]
    means, logarithms = np.split(fragment.distributions.astype(float), 2, axis=1)
    np.testing.assert_allclose(means, policy(fragment.observations[:-1])[0], atol=1e-6)
    deviations = np.exp(logarithms)
    densities = np.exp(-0.5 * ((fragment.actions - means) / deviations) ** 2) / (deviations * np.sqrt(2.0 * np.pi))
    np.testing.assert_allclose(fragment.log_densities, np.log(densities).sum(axis=1), rtol=1e-4, atol=1e-4)


def test_rewards_are_scaled_only_for_the_learner():
    plain, scaled = (rollouts(reward_scale=scale).collect(policy, 80) for scale in (1.0, 0.25))
    for one, other in zip(plain[0], scaled[0], strict=True):
        np.testing.assert_allclose(other.rewards, 0.25 * one.rewards, rtol=1e-6)
    assert plain[1] == scaled[1] != []


@pytest.mark.parametrize("mode", ["same_step", "disabled"])
def test_another_autoreset_mode_is_rejected(mode):
    env = BallbotVectorEnv(2, autoreset_mode=mode)
    with pytest.raises(ValueError, match=f"autoreset_mode = {mode}: rollouts on Ray expect next_step"):
        Rollouts(env, 0, np.random.default_rng(0))


def test_seeds_are_disjoint_across_workers_and_new_for_a_worker_that_is_started_again():
    workers, robots, span = 5, 16, 9_000_000
    seeds = [
        first_seed(10, span, worker=worker, workers=workers, robots=robots, steps=steps) + i
        for steps in (0, 80, 160, 4096)
        for worker in range(workers)
        for i in range(robots)
    ]
    assert len(set(seeds)) == len(seeds)
    assert min(seeds) == 10
    # All used up: they begin again, within the run's own.
    late = first_seed(10, span, worker=4, workers=workers, robots=robots, steps=10**12)
    assert 10 <= late <= 10 + span - robots


def test_more_robots_than_seeds_are_rejected():
    with pytest.raises(ValueError, match="4 workers with 300 robots each are out of range: a run has 1000 seeds"):
        first_seed(0, 1000, worker=0, workers=4, robots=300)
