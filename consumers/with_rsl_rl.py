"""PPO of rsl-rl on a `Batch`, by an adapter of its `VecEnv`."""

from typing import Any

import torch
from rsl_rl.env import VecEnv
from rsl_rl.runners import OnPolicyRunner
from tensordict import TensorDict

import ballbot_rs as bb
from consumers.common import NUM_ENVS, ROLLOUT, Timer, finish


class RslRlEnv(VecEnv):
    """A vector environment with resets within the step, as rsl-rl has them."""

    def __init__(self, env: bb.BallbotVectorEnv) -> None:
        self._env = env
        self.num_envs = env.num_envs
        self.num_actions = env.single_action_space.shape[0]
        self.max_episode_length = env.task_options["max_episode_steps"]
        self.episode_length_buf = torch.zeros(env.num_envs, dtype=torch.long)
        self.device = "cpu"
        self.cfg: dict[str, Any] = {"task": env.task, **env.task_options}
        self._observations = self._as_dict(env.reset()[0])

    def _as_dict(self, observations: Any) -> TensorDict:
        return TensorDict({"policy": torch.as_tensor(observations)}, batch_size=[self.num_envs])

    def get_observations(self) -> TensorDict:
        """The observations of the last step."""
        return self._observations

    def step(self, actions: torch.Tensor) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict[str, Any]]:
        """One control step of all robots."""
        observations, rewards, terminated, truncated, _ = self._env.step(actions.clamp(-1.0, 1.0).cpu().numpy())
        self._observations = self._as_dict(observations)
        dones = torch.as_tensor(terminated | truncated)
        self.episode_length_buf = torch.where(dones, 0, self.episode_length_buf + 1)
        # From these rsl-rl continues with its estimate of the value.
        extras = {"time_outs": torch.as_tensor(truncated)}
        return self._observations, torch.as_tensor(rewards, dtype=torch.float32), dones.long(), extras


if __name__ == "__main__":
    torch.set_num_threads(1)
    torch.manual_seed(0)
    env = RslRlEnv(bb.BallbotVectorEnv(NUM_ENVS, autoreset_mode="same_step", seed=0))
    network = {"class_name": "MLPModel", "hidden_dims": [64, 64], "activation": "tanh"}
    settings = {
        "num_steps_per_env": ROLLOUT,
        "save_interval": 10**9,
        "obs_groups": {"actor": ["policy"], "critic": ["policy"]},
        "actor": {**network, "distribution_cfg": {"class_name": "GaussianDistribution", "init_std": 1.0}},
        "critic": dict(network),
        # The rate that rsl-rl adapts to the divergence by default sinks too soon: robots stay upright, 0.26 m off.
        "algorithm": {
            "class_name": "PPO",
            "gamma": 0.98,
            "learning_rate": 1e-3,
            "entropy_coef": 0.0,
            "schedule": "fixed",
        },
    }
    runner = OnPolicyRunner(env, settings, log_dir=None, device="cpu")
    timer = Timer()
    updates = 0
    while not timer.is_over:
        runner.learn(10)
        updates += 10
    policy = runner.get_inference_policy()

    def act(observations):
        """The means."""
        with torch.inference_mode():
            return policy(TensorDict({"policy": torch.as_tensor(observations)}, batch_size=[len(observations)])).numpy()

    finish(updates * ROLLOUT * NUM_ENVS, timer, act)
