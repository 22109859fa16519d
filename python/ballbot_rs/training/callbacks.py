"""Callbacks during training: checkpoints, and evaluations that keep the best policy."""

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback, ProgressBarCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecEnv

from ballbot_rs import _interrupts
from ballbot_rs._core import Batch
from ballbot_rs.control import sb3_policy
from ballbot_rs.training import run_folder, run_state
from ballbot_rs.training.run_folder import Array, Evaluations


class Ended(Exception):
    """Ends training before its last step; not an error."""


class Checkpoints:
    """Keeps the model of a run.

    Args:
        folder: the run.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._kept_at: int | None = None
        #: Whether the model is between two rollouts, from where a run can be resumed bit for bit.
        self.is_between_rollouts = True

    def keep(self, model: BaseAlgorithm, is_due: bool = True) -> Path:
        """Writes a checkpoint unless one was just written; returns its file.

        Args:
            model: the model.
            is_due: whether an evaluation follows.
        """
        path = run_folder.checkpoint_path(self._folder, model.num_timesteps)
        if self._kept_at != model.num_timesteps:
            state = run_state.taken(model, is_due) if self.is_between_rollouts else None
            sb3_policy.write(model, path, {} if state is None else {run_state.ENTRY: state})
            self._kept_at = model.num_timesteps
        return path


class KeepBest:
    """Evaluates the policy; the best one and all evaluations are kept in the run.

    Args:
        folder: the run.
        env: where the policy is evaluated, from the same starts each time.
        nominal: where the best policy is tested: the same without events.
        seed: of both.
        episodes: of an evaluation.
        success: fraction of nominal robots with which the best policy must succeed; None requires nothing.
        total_timesteps: steps after which training ends once the best policy has succeeded.
        stops: called with the steps and the mean return of an evaluation; True ends the training.
    """

    def __init__(
        self,
        folder: Path,
        env: VecEnv,
        nominal: VecEnv,
        *,
        seed: int,
        episodes: int,
        success: float | None,
        total_timesteps: int,
        stops: Callable[[int, float], bool] | None = None,
    ) -> None:
        self._stops = stops
        self._folder = folder
        self._env = env
        self._nominal = nominal
        self._seed = seed
        self._episodes = episodes
        self._success = success
        self._total_timesteps = total_timesteps
        self._past: Evaluations | None = None
        self._best = -np.inf
        #: Success rate of the best policy, once it has been tested.
        self._judged: float | None = None

    def remember(self, past: Evaluations | None, timesteps: int, task: str) -> None:
        """Takes over the results of an interrupted run: only a better policy replaces its best policy.

        Args:
            past: all its evaluations.
            timesteps: where it continues; later evaluations are dropped.
            task: name of the task.

        Raises:
            ValueError: the best policy cannot be read.
        """
        path = self._folder / run_folder.BEST
        if path.is_file():
            try:
                model, _ = sb3_policy.load(path, task)
            except ValueError as error:
                raise ValueError(f"{error}; delete the file to continue without it") from error
            known = [] if past is None else past.returns[past.timesteps == model.num_timesteps]
            # A run killed between the two files has a best policy without its evaluation. If it is the policy of the
            # checkpoint, it is evaluated at once.
            if len(known):
                self._best = float(known[-1].mean())
            elif model.num_timesteps != timesteps:
                self._best = float(self._evaluated(model)[0].mean())
        self._past = None if past is None else past.up_to(timesteps)

    def evaluate_and_log(self, model: BaseAlgorithm) -> bool:
        """Evaluates a policy and logs the result; returns whether training continues."""
        returns, lengths, successes = self.evaluate(model)
        model.logger.record("eval/mean_reward", float(returns.mean()))
        model.logger.record("eval/mean_ep_length", float(lengths.mean()))
        model.logger.record("eval/success_rate", float(successes.mean()))
        model.logger.record("time/total_timesteps", model.num_timesteps, exclude="tensorboard")
        model.logger.dump(model.num_timesteps)
        if self._stops is not None and self._stops(model.num_timesteps, float(returns.mean())):
            return False
        return not self.is_over(model)

    def is_over(self, model: BaseAlgorithm) -> bool:
        """Whether the run has done its steps and its best policy succeeds."""
        if self._success is None or model.num_timesteps < self._total_timesteps:
            return False
        return self.success_of_best() >= self._success

    def evaluate(self, model: BaseAlgorithm) -> tuple[Array, Array, Array]:
        """Evaluates a policy unless it just was; gives returns, lengths and successes, each of shape (episodes,)."""
        past = self._past
        if past is not None and past.timesteps[-1:].tolist() == [model.num_timesteps]:
            return past.returns[-1], past.lengths[-1], past.successes[-1]
        returns, lengths, successes = self._evaluated(model)
        # The policy first: a policy without its evaluation is evaluated again; the other way around it would be lost.
        if returns.mean() > self._best:
            sb3_policy.write(model, self._folder / run_folder.BEST)
            self._best, self._judged = float(returns.mean()), None
        row = Evaluations(np.array([model.num_timesteps], dtype=float), returns[None], lengths[None], successes[None])
        self._past = row if past is None else past.followed_by(row)
        self._past.save(self._folder)
        return returns, lengths, successes

    def success_of_best(self) -> float:
        """Fraction of nominal robots with which the best policy succeeds."""
        if self._judged is None:
            with run_state.same_random_numbers():
                model, _ = sb3_policy.load(self._folder / run_folder.BEST)
            _, _, successes = evaluated(model, self._nominal, self._nominal.num_envs, self._seed)
            self._judged = float(successes.mean())
        return self._judged

    def _evaluated(self, model: BaseAlgorithm) -> tuple[Array, Array, Array]:
        return evaluated(model, self._env, self._episodes, self._seed)


class BetweenRollouts(BaseCallback):
    """Keeps checkpoints and evaluates between two rollouts, when the learner has used all of its data.

    Signals wait for that moment: from there a run can be resumed bit for bit.

    Args:
        checkpoints: of the run.
        keep_best: of the run.
        every: steps of all environments between two checkpoints, and between two evaluations.
    """

    def __init__(self, checkpoints: Checkpoints, keep_best: KeepBest, every: int) -> None:
        super().__init__()
        self._checkpoints = checkpoints
        self._keep_best = keep_best
        self._every = every
        self._before: int | None = None
        self._rollout = contextlib.ExitStack()

    def _on_rollout_start(self) -> None:
        self.end_rollout()
        done = self.model.num_timesteps
        if self._before is None:
            if self._keep_best.is_over(self.model):
                raise Ended
        elif done // self._every > self._before // self._every:
            self._checkpoints.keep(self.model)
            if not self._keep_best.evaluate_and_log(self.model):
                raise Ended
        self._before = done
        self._checkpoints.is_between_rollouts = False
        self._rollout.enter_context(_interrupts.held_back())

    def _on_step(self) -> bool:
        return True

    def _on_training_end(self) -> None:
        self.end_rollout()

    def end_rollout(self) -> None:
        """Handles a signal that came during the rollout."""
        self._checkpoints.is_between_rollouts = True
        self._rollout.close()

    def abandon(self) -> None:
        """Leaves a rollout that ended in an error; a signal that came during it counts."""
        self._rollout.close()


class ProgressBar(ProgressBarCallback):
    """The bar of Stable-Baselines3, up to the steps after which training usually ends."""

    def __init__(self, total: int) -> None:
        super().__init__()
        self._total = total

    def _on_training_start(self) -> None:
        self.locals = {**self.locals, "total_timesteps": max(self._total, self.model.num_timesteps)}
        super()._on_training_start()


def evaluated(model: BaseAlgorithm, env: VecEnv, episodes: int, seed: int) -> tuple[Array, Array, Array]:
    """Returns, lengths and successes of episodes, each of shape (episodes,); their starts depend only on the seed.

    Args:
        model: whose policy acts. Small networks are evaluated in Rust.
        env: a robot for each episode.
        episodes: how many.
        seed: of the first robot; each further robot has the next.
    """
    batch: Batch = env.unwrapped._batch  # type: ignore[attr-defined]
    network = sb3_policy.tanh_network(model)
    if network is None or batch.stage is not None:
        return _evaluated_by_sb3(model, env, episodes, seed)
    batch.reset(seeds=list(range(seed, seed + episodes)))
    found = batch.episodes(network)
    return found["returns"], found["lengths"].astype(float), found["success"].astype(float)


def _evaluated_by_sb3(model: BaseAlgorithm, env: VecEnv, episodes: int, seed: int) -> tuple[Array, Array, Array]:
    successes: list[bool] = []

    def note(local: dict[str, Any], _: dict[str, Any]) -> None:
        if local["done"]:
            successes.append(bool(local["info"].get("is_success", False)))

    env.seed(seed)
    returns, lengths = evaluate_policy(
        model, env, n_eval_episodes=episodes, deterministic=True, return_episode_rewards=True, callback=note
    )
    return np.array(returns, dtype=float), np.array(lengths, dtype=float), np.array(successes, dtype=float)
