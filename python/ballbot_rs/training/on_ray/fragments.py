"""Rollouts of a whole batch of robots, cut into fragments of episodes. Only arrays: no torch, no Ray."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode

from ballbot_rs.envs.vector_env import BallbotVectorEnv

Floats = npt.NDArray[np.float32]
#: From observations, shape (n, m), to the means of the actions and the logarithms of their deviations, both (n, 3).
Policy = Callable[[Floats], tuple[Floats, Floats]]


@dataclasses.dataclass(frozen=True)
class Fragment:
    """Steps of one robot within one episode."""

    #: Identifies the episode: unique among these robots, and common to all fragments of the episode.
    episode: tuple[int, int]
    #: Steps of the episode before this fragment.
    start: int
    #: One more than the steps: the last is the observation after the last step.
    observations: Floats
    #: Before they are clipped to the range of the motors.
    actions: Floats
    rewards: Floats
    #: Means and logarithms of deviations, and logarithms of the densities of the actions.
    distributions: Floats
    log_densities: Floats
    terminated: bool
    truncated: bool

    def __len__(self) -> int:
        return len(self.actions)


@dataclasses.dataclass(frozen=True)
class Ended:
    """An episode that has ended."""

    total_reward: float
    length: int


def first_seed(base: int, span: int, *, worker: int, workers: int, robots: int, steps: int = 0) -> int:
    """The seed of a worker's first robot; robot i has this seed plus i.

    Workers do not share seeds, and a worker that is recreated later in training has unused seeds, until all seeds of
    the run are used up.

    Args:
        base: first seed of the run.
        span: number of seeds of the run.
        worker: number of the worker, from 0.
        workers: number of workers.
        robots: number of robots of each worker.
        steps: of all robots so far.

    Raises:
        ValueError: the run has fewer seeds than there are robots.
    """
    together = workers * robots
    if together > span:
        raise ValueError(f"{workers} workers with {robots} robots each are out of range: a run has {span} seeds")
    return base + steps // together % (span // together) * together + worker * robots


class Rollouts:
    """Steps robots under a policy with Gaussian noise.

    Args:
        env: in autoreset mode next_step: the step after the end of an episode begins the next one, takes no action,
            and is in no fragment.
        seed: environment i begins with seed + i.
        rng: samples the noise.
        reward_scale: scale of the rewards in fragments; rewards of episodes are the task's own.

    Raises:
        ValueError: another autoreset mode, in which fragments would mix episodes.
    """

    def __init__(
        self, env: BallbotVectorEnv, seed: int, rng: np.random.Generator, *, reward_scale: float = 1.0
    ) -> None:
        mode = env.metadata["autoreset_mode"]
        if mode is not AutoresetMode.NEXT_STEP:
            raise ValueError(f"autoreset_mode = {mode.name.lower()}: rollouts on Ray expect next_step")
        self._env = env
        self._rng = rng
        self._reward_scale = np.float32(reward_scale)
        self._observations, _ = env.reset(seed=seed)
        # Otherwise robots that never fall are all truncated on the same step.
        env._batch.stagger()
        self._is_over = np.zeros(env.num_envs, dtype=bool)
        self._episodes = np.zeros(env.num_envs, dtype=np.int64)
        self._lengths = np.zeros(env.num_envs, dtype=np.int64)
        self._returns = np.zeros(env.num_envs)

    def collect(self, policy: Policy, steps: int) -> tuple[list[Fragment], list[Ended]]:
        """Steps all robots until there are `steps` of each on average, not counting resets.

        Returns:
            The fragments, at least one of every robot that has made a step, and the episodes that have ended.
        """
        first_episodes, starts = self._episodes.copy(), self._lengths.copy()
        rows: dict[str, list[npt.NDArray[Any]]] = {name: [] for name in _COLUMNS}
        rows["observations"].append(self._observations)
        ended: list[Ended] = []
        made, needed = 0, steps * self._env.num_envs
        while made < needed:
            means, log_deviations = policy(self._observations)
            noise = self._rng.standard_normal(means.shape, dtype=np.float32)
            actions = means + np.exp(log_deviations) * noise
            self._observations, rewards, terminated, truncated, _ = self._env.step(np.clip(actions, -1.0, 1.0))
            counts = ~self._is_over
            log_densities = -(0.5 * np.square(noise) + log_deviations + _HALF_LOG_TWO_PI).sum(axis=1)
            new = (self._observations, actions, rewards, means, log_deviations, log_densities, terminated, truncated)
            for name, values in zip(_COLUMNS, (*new, counts), strict=True):
                rows[name].append(values)
            made += int(counts.sum())
            ended += self._note(rewards, terminated | truncated, counts)
        return self._cut(rows, first_episodes, starts), ended

    def _note(
        self, rewards: npt.NDArray[np.float64], done: npt.NDArray[np.bool_], counts: npt.NDArray[np.bool_]
    ) -> list[Ended]:
        """Tracks the episodes; returns those that ended with this step."""
        began = ~counts
        self._returns[began] = 0.0
        self._lengths[began] = 0
        self._episodes[began] += 1
        self._returns[counts] += rewards[counts]
        self._lengths[counts] += 1
        self._is_over = done
        return [Ended(float(self._returns[i]), int(self._lengths[i])) for i in np.flatnonzero(done)]

    def _cut(
        self,
        rows: dict[str, list[npt.NDArray[Any]]],
        first_episodes: npt.NDArray[np.int64],
        starts: npt.NDArray[np.int64],
    ) -> list[Fragment]:
        columns = {name: np.stack(values, axis=1) for name, values in rows.items()}
        columns["rewards"] = (columns["rewards"] * self._reward_scale).astype(np.float32)
        distributions = np.concatenate((columns["means"], columns["log_deviations"]), axis=2)
        total = columns["actions"].shape[1]
        fragments = []
        for robot in range(self._env.num_envs):
            resets = np.flatnonzero(~columns["counts"][robot])
            begins, ends = (-1, *resets), (*resets, total)
            for number, (before, end) in enumerate(zip(begins, ends, strict=True)):
                begin = before + 1
                if end == begin:
                    continue
                steps = slice(begin, end)
                fragments.append(
                    Fragment(
                        episode=(robot, int(first_episodes[robot]) + number),
                        start=0 if number else int(starts[robot]),
                        observations=columns["observations"][robot, begin : end + 1],
                        actions=columns["actions"][robot, steps],
                        rewards=columns["rewards"][robot, steps],
                        distributions=distributions[robot, steps],
                        log_densities=columns["log_densities"][robot, steps],
                        terminated=bool(columns["terminated"][robot, end - 1]),
                        truncated=bool(columns["truncated"][robot, end - 1]),
                    )
                )
        return fragments


_COLUMNS = (
    "observations",
    "actions",
    "rewards",
    "means",
    "log_deviations",
    "log_densities",
    "terminated",
    "truncated",
    "counts",
)
_HALF_LOG_TWO_PI = np.float32(0.5 * np.log(2.0 * np.pi))
