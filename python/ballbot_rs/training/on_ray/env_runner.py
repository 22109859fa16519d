"""The worker: rolls a whole batch of robots and sends fragments of episodes as arrays."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from ray.rllib.core.columns import Columns
from ray.rllib.env.single_agent_env_runner import SingleAgentEnvRunner
from ray.rllib.env.single_agent_episode import SingleAgentEpisode

from ballbot_rs.envs.registration import task_of
from ballbot_rs.envs.vector_env import BallbotVectorEnv
from ballbot_rs.training.on_ray.fragments import Ended, Fragment, Rollouts, first_seed


def setup(
    env_id: str,
    options: Mapping[str, Any],
    *,
    robots: int,
    base: int,
    span: int,
    steps: int,
    reward_scale: float,
    autoreset_mode: str = "next_step",
) -> dict[str, Any]:
    """Contents of `env_config` in the runner's configuration.

    Args:
        env_id: of the task.
        options: of its environments.
        robots: number of robots of each worker.
        base: first seed of the run.
        span: number of seeds of the run.
        steps: of all robots before this training.
        reward_scale: scale of the rewards that the learner sees.
        autoreset_mode: of the environments; any but next_step is rejected.
    """
    return {
        "env_id": env_id,
        "options": dict(options),
        "robots": robots,
        "base": base,
        "span": span,
        "steps": steps,
        "reward_scale": reward_scale,
        "autoreset_mode": autoreset_mode,
    }


class BatchEnvRunner(SingleAgentEnvRunner):  # type: ignore[misc]
    """An `EnvRunner` of RLlib whose `env_config` is a `setup`."""

    def make_env(self) -> None:
        """Makes the robots."""
        self.stop()
        requested = self.config.env_config
        self.env = BallbotVectorEnv(
            requested["robots"],
            task=task_of(requested["env_id"]),
            autoreset_mode=requested["autoreset_mode"],
            # A worker has one core.
            num_threads=1,
            **requested["options"],
        )
        self.num_envs = requested["robots"]
        self._rollouts: Rollouts | None = None
        self._ended: list[Ended] = []

    def sample(
        self,
        *,
        num_timesteps: int | None = None,
        num_episodes: int | None = None,
        explore: bool | None = None,
        random_actions: bool = False,
        force_reset: bool = False,
    ) -> list[SingleAgentEpisode]:
        """Fragments of episodes under the policy and its noise.

        Args:
            num_timesteps: least number of steps of all robots; None is the configuration's.
            num_episodes: must be None.
            explore: must not be False.
            random_actions: must be False.
            force_reset: begins with new episodes.

        Raises:
            ValueError: an argument that this runner does not support.
        """
        if num_episodes is not None or explore is False or random_actions:
            raise ValueError(
                f"num_episodes = {num_episodes}, explore = {explore}, random_actions = {random_actions}: this runner "
                "samples steps under the policy and its noise"
            )
        if self._rollouts is None or force_reset:
            self._rollouts = self._new_rollouts()
        steps = self.config.get_rollout_fragment_length(self.worker_index)
        if num_timesteps is not None:
            steps = -(-num_timesteps // self.num_envs)
        fragments, ended = self._rollouts.collect(self.module.distribution, steps)
        made = sum(len(fragment) for fragment in fragments)
        self._ended += ended
        self._increase_sampled_metrics(made, len(ended))
        return [self._episode(fragment) for fragment in fragments]

    def _new_rollouts(self) -> Rollouts:
        requested = self.config.env_config
        # A restarted worker is given the steps of all workers so far.
        steps = requested["steps"] + int(self.num_env_steps_sampled_lifetime)
        seed = first_seed(
            requested["base"],
            requested["span"],
            worker=max(self.worker_index or 0, 1) - 1,
            workers=max(self.config.num_env_runners, 1),
            robots=requested["robots"],
            steps=steps,
        )
        return Rollouts(self.env, seed, np.random.default_rng(seed), reward_scale=requested["reward_scale"])

    def _episode(self, fragment: Fragment) -> SingleAgentEpisode:
        robot, number = fragment.episode
        return SingleAgentEpisode(
            id_=f"{self.worker_index}-{robot}-{number}",
            observations=fragment.observations,
            infos=[{}] * (len(fragment) + 1),
            actions=fragment.actions,
            rewards=fragment.rewards,
            terminated=fragment.terminated,
            truncated=fragment.truncated,
            extra_model_outputs={
                Columns.ACTION_DIST_INPUTS: fragment.distributions,
                Columns.ACTION_LOGP: fragment.log_densities,
            },
            t_started=fragment.start,
            len_lookback_buffer=0,
        )

    def get_metrics(self) -> Any:
        """Counts and means of the episodes that have ended since the last call."""
        for episode in self._ended:
            self._log_episode_metrics(episode.length, episode.total_reward, 0.0)
        self._ended.clear()
        return self.metrics.reduce()
