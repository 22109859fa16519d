"""What happens on the way of a training: checkpoints, and evaluations of which the best policy is kept."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecEnv

from ballbot_rs.control import sb3_policy
from ballbot_rs.training import run_folder
from ballbot_rs.training.run_folder import Array, Evaluations


class Checkpoints(BaseCallback):
    """Keeps the model every so many calls, and when asked to.

    Args:
        folder: the run.
        every: calls between two checkpoints; a call is one step of all environments.
    """

    def __init__(self, folder: Path, every: int) -> None:
        super().__init__()
        self._folder = folder
        self._every = every
        self._kept_at: int | None = None

    def _on_step(self) -> bool:
        if self.n_calls % self._every == 0:
            self.keep(self.model)
        return True

    def keep(self, model: BaseAlgorithm) -> Path:
        """Writes a checkpoint unless there has just been one; returns its file."""
        path = run_folder.checkpoint_path(self._folder, model.num_timesteps)
        if self._kept_at != model.num_timesteps:
            sb3_policy.write(model, path)
            self._kept_at = model.num_timesteps
        return path


class KeepBest(BaseCallback):
    """Evaluates the policy every so many calls; the best one and all evaluations are kept in the run.

    Args:
        folder: the run.
        env: where the policy is evaluated.
        every: calls between two evaluations.
        episodes: of an evaluation.
        stops: called with the steps and the mean return of an evaluation; True ends the training.
    """

    def __init__(
        self,
        folder: Path,
        env: VecEnv,
        *,
        every: int,
        episodes: int,
        stops: Callable[[int, float], bool] | None = None,
    ) -> None:
        super().__init__()
        self._stops = stops
        self._folder = folder
        self._env = env
        self._every = every
        self._episodes = episodes
        self._past: Evaluations | None = None
        self._best = -np.inf

    def remember(self, past: Evaluations | None, timesteps: int, task: str) -> None:
        """Takes over what an interrupted run has: only a better policy replaces its best one.

        Args:
            past: all its evaluations.
            timesteps: from where it goes on; later evaluations are dropped.
            task: name of the task.

        Raises:
            ValueError: the best policy cannot be read.
        """
        path = self._folder / run_folder.BEST
        if path.is_file():
            try:
                model, _ = sb3_policy.load(path, task)
            except ValueError as error:
                raise ValueError(f"{error}; delete the file to go on without it") from error
            known = [] if past is None else past.returns[past.timesteps == model.num_timesteps]
            # Killed between the two files, a run has a best policy without its evaluation. If it is the one of the
            # checkpoint, this is made up for at once.
            if len(known):
                self._best = float(known[-1].mean())
            elif model.num_timesteps != timesteps:
                self._best = float(evaluated(model, self._env, self._episodes)[0].mean())
        self._past = None if past is None else past.up_to(timesteps)

    def _on_step(self) -> bool:
        return self.n_calls % self._every != 0 or self.evaluate_and_log(self.model)

    def evaluate_and_log(self, model: BaseAlgorithm) -> bool:
        """Evaluates a policy and logs the result; returns whether the training goes on."""
        returns, lengths, successes = self.evaluate(model)
        model.logger.record("eval/mean_reward", float(returns.mean()))
        model.logger.record("eval/mean_ep_length", float(lengths.mean()))
        model.logger.record("eval/success_rate", float(successes.mean()))
        model.logger.record("time/total_timesteps", model.num_timesteps, exclude="tensorboard")
        model.logger.dump(model.num_timesteps)
        return self._stops is None or not self._stops(model.num_timesteps, float(returns.mean()))

    def evaluate(self, model: BaseAlgorithm) -> tuple[Array, Array, Array]:
        """Evaluates a policy unless it has just been; returns, lengths and successes, each of shape (episodes,)."""
        past = self._past
        if past is not None and past.timesteps[-1:].tolist() == [model.num_timesteps]:
            return past.returns[-1], past.lengths[-1], past.successes[-1]
        returns, lengths, successes = evaluated(model, self._env, self._episodes)
        # The policy first: one without its evaluation is evaluated again, the other way round it would be lost.
        if returns.mean() > self._best:
            sb3_policy.write(model, self._folder / run_folder.BEST)
            self._best = float(returns.mean())
        row = Evaluations(np.array([model.num_timesteps], dtype=float), returns[None], lengths[None], successes[None])
        self._past = row if past is None else past.followed_by(row)
        self._past.save(self._folder)
        return returns, lengths, successes


def evaluated(model: BaseAlgorithm, env: VecEnv, episodes: int) -> tuple[Array, Array, Array]:
    """Returns, lengths and successes of episodes, each of shape (episodes,)."""
    successes: list[bool] = []

    def note(local: dict[str, Any], _: dict[str, Any]) -> None:
        if local["done"]:
            successes.append(bool(local["info"].get("is_success", False)))

    returns, lengths = evaluate_policy(
        model, env, n_eval_episodes=episodes, deterministic=True, return_episode_rewards=True, callback=note
    )
    return np.array(returns, dtype=float), np.array(lengths, dtype=float), np.array(successes, dtype=float)
