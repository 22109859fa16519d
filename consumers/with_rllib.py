"""PPO of RLlib on the Gymnasium vector environment, which it makes by the id."""

import numpy as np
import ray
import torch
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core import DEFAULT_MODULE_ID
from ray.rllib.core.columns import Columns
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig

from consumers.common import ENV_ID, NUM_ENVS, ROLLOUT, Timer, finish

if __name__ == "__main__":
    ray.init("local", num_cpus=1, include_dashboard=False, log_to_driver=False)
    config = (
        PPOConfig()
        .environment(ENV_ID)
        .env_runners(num_env_runners=0, num_envs_per_env_runner=NUM_ENVS, rollout_fragment_length=ROLLOUT)
        .rl_module(
            model_config=DefaultModelConfig(
                fcnet_hiddens=[64, 64], fcnet_activation="tanh", vf_share_layers=False, free_log_std=True
            )
        )
        .training(
            train_batch_size_per_learner=NUM_ENVS * ROLLOUT,
            minibatch_size=1024,
            num_epochs=5,
            gamma=0.98,
            lambda_=0.95,
            lr=1e-3,
            grad_clip=0.5,
            # Returns reach some hundreds; RLlib's own limit cuts the gradient of the value off.
            vf_clip_param=1e6,
            use_kl_loss=False,
        )
        .debugging(seed=0)
    )
    algorithm = config.build_algo()
    timer = Timer()
    steps = 0
    while not timer.is_over:
        result = algorithm.train()
        steps = int(result["env_runners"]["num_env_steps_sampled_lifetime"])
    module = algorithm.get_module(DEFAULT_MODULE_ID)

    def act(observations):
        """The means, the first half of the outputs."""
        with torch.no_grad():
            out = module.forward_inference({Columns.OBS: torch.as_tensor(observations)})
        return np.asarray(out[Columns.ACTION_DIST_INPUTS])[:, :3]

    finish(steps, timer, act)
    algorithm.stop()
    ray.shutdown()
