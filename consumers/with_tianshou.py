"""PPO of Tianshou on the Gymnasium vector environment, by an adapter of its `BaseVectorEnv`."""

from typing import Any

import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from tianshou.algorithm import PPO
from tianshou.algorithm.algorithm_base import policy_within_training_step
from tianshou.algorithm.modelfree.reinforce import ProbabilisticActorPolicy
from tianshou.algorithm.optim import AdamOptimizerFactory
from tianshou.data import Collector, VectorReplayBuffer
from tianshou.env import BaseVectorEnv
from tianshou.utils.net.common import Net
from tianshou.utils.net.continuous import ContinuousActorProbabilistic, ContinuousCritic
from torch.distributions import Independent, Normal

import ballbot_rs as bb
from consumers.common import NUM_ENVS, ROLLOUT, Timer, finish


class TianshouEnv(BaseVectorEnv):
    """All robots of a vector environment at once; Tianshou itself resets those whose episodes are over."""

    def __init__(self, env: bb.BallbotVectorEnv) -> None:
        # The base class makes workers from functions; here there are none.
        if env.autoreset_mode is not AutoresetMode.DISABLED:
            raise ValueError(f"autoreset_mode = {env.autoreset_mode.name.lower()}: Tianshou needs disabled")
        self._env = env
        self.env_num = env.num_envs
        self.is_async = False
        self.is_closed = False

    def get_env_attr(self, key: str, id: Any = None) -> list[Any]:  # noqa: A002, ARG002
        """An attribute of each environment."""
        return list(self._env.get_attr(key))

    def reset(self, env_id: Any = None, **kwargs: Any) -> tuple[Any, Any]:
        """Begins episodes of some or all robots."""
        ids = np.arange(self.env_num) if env_id is None else np.atleast_1d(env_id)
        mask = np.zeros(self.env_num, dtype=bool)
        mask[ids] = True
        observations, _ = self._env.reset(options={"reset_mask": mask}, **kwargs)
        return observations[ids], np.array([{} for _ in ids])

    def step(self, action: Any, id: Any = None) -> tuple[Any, ...]:  # noqa: A002
        """One control step of all robots."""
        if id is not None and len(id) != self.env_num:
            raise ValueError(f"a step of {len(id)} of {self.env_num} robots: they step together (collect by n_step)")
        observations, rewards, terminated, truncated, _ = self._env.step(np.clip(action, -1.0, 1.0))
        infos = np.array([{"env_id": i} for i in range(self.env_num)])
        return observations, rewards, terminated, truncated, infos

    def close(self) -> None:
        """Nothing is open."""
        self.is_closed = True


if __name__ == "__main__":
    torch.set_num_threads(1)
    torch.manual_seed(0)
    env = TianshouEnv(bb.BallbotVectorEnv(NUM_ENVS, autoreset_mode="disabled", seed=0))
    sizes = {"state_shape": (16,), "hidden_sizes": [64, 64], "activation": torch.nn.Tanh}
    actor = ContinuousActorProbabilistic(preprocess_net=Net(**sizes), action_shape=(3,), unbounded=True)
    policy = ProbabilisticActorPolicy(
        actor=actor,
        dist_fn=lambda parts: Independent(Normal(*parts), 1),
        action_space=env.get_env_attr("action_space")[0],
        action_scaling=False,
        action_bound_method="clip",
        deterministic_eval=True,
    )
    algorithm = PPO(
        policy=policy,
        critic=ContinuousCritic(preprocess_net=Net(**sizes)),
        optim=AdamOptimizerFactory(lr=1e-3),
        gamma=0.98,
        ent_coef=0.0,
        max_grad_norm=0.5,
        max_batchsize=4096,
    )
    buffer = VectorReplayBuffer(NUM_ENVS * ROLLOUT, NUM_ENVS)
    collector = Collector(algorithm, env, buffer)
    collector.reset()
    timer = Timer()
    steps = 0
    while not timer.is_over:
        # Elsewhere a policy acts by its means.
        with policy_within_training_step(policy):
            with torch.no_grad():
                steps += collector.collect(n_step=NUM_ENVS * ROLLOUT).n_collected_steps
            algorithm.update(buffer, batch_size=1024, repeat=5)
        collector.reset_buffer(keep_statistics=True)

    def act(observations):
        """The means."""
        with torch.no_grad():
            return actor(observations)[0][0].numpy()

    finish(steps, timer, act)
