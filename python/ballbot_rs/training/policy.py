"""The network's features: observations of magnitudes near one."""

from typing import Any

import gymnasium
import numpy as np
import torch
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

#: Typical values while a robot balances, in the rows' own units: what the network sees is the observation less the
#: value of a robot at rest, over these.
TYPICAL = np.array([0.1] * 3 + [1.0] * 3 + [5.0] * 3 + [0.1] * 2 + [0.2] * 2 + [0.5] * 3, dtype=np.float32)
AT_REST = np.array([0.0, 0.0, -1.0] + [0.0] * 13, dtype=np.float32)


class ScaledObservation(BaseFeaturesExtractor):
    """Brings the rows of an observation to magnitudes near one, with constants rather than statistics.

    A policy then needs nothing but its own file, and sees the same at its first step as at its last.
    """

    at_rest: torch.Tensor
    gain: torch.Tensor

    def __init__(self, observation_space: gymnasium.Space[Any]) -> None:
        super().__init__(observation_space, features_dim=len(TYPICAL))
        self.register_buffer("at_rest", torch.as_tensor(AT_REST))
        self.register_buffer("gain", torch.as_tensor(1.0 / TYPICAL))

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Scaled observations, cut off at ten times the typical magnitude."""
        return ((observations - self.at_rest) * self.gain).clamp(-10.0, 10.0)
