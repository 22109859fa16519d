"""The policy of Stable-Baselines3 as a module of RLlib, so that both have the same networks and the same weights."""

from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from ray.rllib.algorithms.ppo.torch.ppo_torch_learner import PPOTorchLearner
from ray.rllib.core.columns import Columns
from ray.rllib.core.rl_module.apis import ValueFunctionAPI
from ray.rllib.core.rl_module.torch import TorchRLModule
from stable_baselines3.common.policies import ActorCriticPolicy

#: The value in Stable-Baselines3's PPO.
ADAM_EPSILON = 1e-5


class PolicyModule(TorchRLModule, ValueFunctionAPI):  # type: ignore[misc]
    """`model_config["policy"]` are the `policy_kwargs`."""

    policy: ActorCriticPolicy

    def setup(self) -> None:
        """Makes the networks."""
        # The learner's own optimizer sets the rate.
        self.policy = ActorCriticPolicy(
            self.observation_space, self.action_space, lambda _: 1.0, **self.model_config["policy"]
        )

    def _forward(self, batch: dict[str, Any], **_: Any) -> dict[str, Any]:
        policy: Any = self.policy
        features = policy.extract_features(batch[Columns.OBS], policy.pi_features_extractor)
        means = policy.action_net(policy.mlp_extractor.forward_actor(features))
        return {Columns.ACTION_DIST_INPUTS: torch.cat((means, policy.log_std.expand_as(means)), dim=-1)}

    def compute_values(self, batch: dict[str, Any], embeddings: Any = None) -> torch.Tensor:  # noqa: ARG002
        """Values of observations, shape (n,)."""
        return self.policy.predict_values(batch[Columns.OBS]).squeeze(-1)

    def distribution(
        self, observations: npt.NDArray[np.float32]
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        """Means of the actions and logarithms of their deviations, shape (n, 3) each."""
        with torch.no_grad():
            out = self._forward({Columns.OBS: torch.as_tensor(observations)})[Columns.ACTION_DIST_INPUTS].numpy()
        means, log_deviations = np.split(out, 2, axis=1)
        return means, log_deviations


class Learner(PPOTorchLearner):  # type: ignore[misc]
    """RLlib's PPO with the optimizer of Stable-Baselines3, whose state fits into its checkpoints."""

    def configure_optimizers_for_module(self, module_id: str, config: Any = None) -> None:
        """Makes the optimizer."""
        parameters = self.get_parameters(self.module[module_id])
        self.register_optimizer(
            module_id=module_id,
            optimizer=torch.optim.Adam(parameters, eps=ADAM_EPSILON),
            params=parameters,
            lr_or_lr_schedule=config.lr,
        )
