"""PuffeRL, the learner of PufferLib, on a native `PufferEnv` around the Gymnasium vector environment."""

import tempfile
from typing import Any

import numpy as np
import torch
from pufferlib import PufferEnv
from pufferlib.pufferl import PuffeRL
from torch import nn

import ballbot_rs as bb
from consumers.common import ENV_ID, NUM_ENVS, ROLLOUT, Timer, finish


class BallbotPufferEnv(PufferEnv):
    """All robots of a vector environment, each an agent of PufferLib, with resets within the step."""

    def __init__(self, env: bb.BallbotVectorEnv, buf: Any = None) -> None:
        self._env = env
        self.single_observation_space = env.single_observation_space
        self.single_action_space = env.single_action_space
        self.num_agents = env.num_envs
        super().__init__(buf)

    def reset(self, seed: int | None = None) -> tuple[Any, list[dict[str, Any]]]:
        """Begins episodes of all robots."""
        self.observations[:], _ = self._env.reset(seed=seed)
        return self.observations, []

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, list[dict[str, Any]]]:
        """One control step of all robots; infos are for the episodes that end."""
        found = self._env.step(np.clip(actions, -1.0, 1.0))
        self.observations[:], self.rewards[:], self.terminals[:], self.truncations[:], info = found
        ended = self.terminals | self.truncations
        infos = [{"is_success": float(one)} for one in info["final_info"]["is_success"][ended]] if ended.any() else []
        return self.observations, self.rewards, self.terminals, self.truncations, infos

    def close(self) -> None:
        """Closes the vector environment."""
        self._env.close()


class Policy(nn.Module):
    """As PuffeRL expects."""

    def __init__(self, observations: int, actions: int) -> None:
        super().__init__()
        self.mean, self.value = self._layers(observations, actions), self._layers(observations, 1)
        self.log_std = nn.Parameter(torch.zeros(actions))

    @staticmethod
    def _layers(inputs: int, outputs: int) -> nn.Sequential:
        return nn.Sequential(nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs))

    def forward_eval(self, observations: Any, state: Any = None) -> tuple[Any, Any]:  # noqa: ARG002
        """The distribution of the actions, and the value."""
        mean = self.mean(observations)
        return torch.distributions.Normal(mean, self.log_std.exp().expand_as(mean)), self.value(observations)

    forward = forward_eval


#: Of PuffeRL: its own defaults, but for the optimizer, the rate and what follows from the number of robots.
SETTINGS = {
    "env": ENV_ID,
    "seed": 0,
    "torch_deterministic": True,
    "device": "cpu",
    "cpu_offload": False,
    "precision": "float32",
    "compile": False,
    "use_rnn": False,
    "batch_size": "auto",
    "bptt_horizon": ROLLOUT,
    "minibatch_size": 1024,
    "max_minibatch_size": 1024,
    "update_epochs": 5,
    "total_timesteps": 10**9,
    "optimizer": "adam",
    "learning_rate": 1e-3,
    "anneal_lr": False,
    "adam_beta1": 0.9,
    "adam_beta2": 0.999,
    "adam_eps": 1e-8,
    "max_grad_norm": 0.5,
    "gamma": 0.98,
    "gae_lambda": 0.95,
    "clip_coef": 0.2,
    "vf_coef": 2.0,
    "vf_clip_coef": 0.2,
    "ent_coef": 0.0,
    "vtrace_rho_clip": 1.0,
    "vtrace_c_clip": 1.0,
    "prio_alpha": 0.8,
    "prio_beta0": 0.2,
    "checkpoint_interval": 10**9,
}


if __name__ == "__main__":
    torch.set_num_threads(1)
    torch.manual_seed(0)
    env = BallbotPufferEnv(bb.BallbotVectorEnv(NUM_ENVS, autoreset_mode="same_step"))
    policy = Policy(env.single_observation_space.shape[0], env.single_action_space.shape[0])
    with tempfile.TemporaryDirectory() as folder:
        learner = PuffeRL({**SETTINGS, "data_dir": folder}, env, policy)
        timer = Timer()
        while not timer.is_over:
            learner.evaluate()
            learner.train()
        learner.close()

    def act(observations):
        """The means."""
        with torch.no_grad():
            return policy.mean(torch.as_tensor(observations)).numpy()

    finish(learner.global_step, timer, act)
