"""Observations in groups: state and the reading of each instrument, each in a separate space."""

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from gymnasium.vector import VectorEnv, VectorObservationWrapper
from gymnasium.vector.utils import batch_space

FloatArray = npt.NDArray[np.float32]


class Groups:
    """The parts of an observation by name.

    Args:
        space: of a whole observation.
        layout: shape of each part, in order, as in `Batch.observation_layout`.
    """

    def __init__(self, space: gymnasium.Space[Any], layout: Mapping[str, tuple[int, ...]]) -> None:
        self._layout = dict(layout)
        low, high = self.split(space.low), self.split(space.high)  # type: ignore[attr-defined]
        #: Space of the parts.
        self.space = spaces.Dict({name: spaces.Box(low[name], high[name], dtype=np.float32) for name in layout})

    def split(self, observation: FloatArray) -> dict[str, FloatArray]:
        """The parts of observations of any leading shape, as views."""
        parts, first = {}, 0
        for name, shape in self._layout.items():
            last = first + int(np.prod(shape))
            parts[name] = observation[..., first:last].reshape(*observation.shape[:-1], *shape)
            first = last
        return parts


class GroupedObservations(gymnasium.ObservationWrapper[Any, Any, Any]):
    """A `BallbotEnv` whose observation is a dict: `state`, and the robot's instruments by name.

    ```python
    env = bb.GroupedObservations(bb.BallbotEnv(terrain="wave", scan={"points": (3, 3)}))
    observation, info = env.reset(seed=0)
    print(observation["state"].shape, observation["scan"].shape)
    ```
    """

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        super().__init__(env)
        batch: Any = env.unwrapped
        self._groups = Groups(env.observation_space, batch.observation_layout)
        self.observation_space = self._groups.space

    def observation(self, observation: FloatArray) -> dict[str, FloatArray]:
        """The parts of an observation."""
        return self._groups.split(observation)


class GroupedVectorObservations(VectorObservationWrapper):
    """A `BallbotVectorEnv` whose observations are dicts, as in `GroupedObservations`.

    ```python
    envs = bb.GroupedVectorObservations(bb.BallbotVectorEnv(8, terrain="wave", scan={"points": (3, 3)}))
    observations, infos = envs.reset(seed=0)
    print(observations["scan"].shape)
    ```
    """

    def __init__(self, env: VectorEnv[Any, Any, Any]) -> None:
        super().__init__(env)
        batch: Any = env.unwrapped
        self._groups = Groups(env.single_observation_space, batch.observation_layout)
        self.single_observation_space = self._groups.space
        self.observation_space = batch_space(self._groups.space, env.num_envs)

    def observations(self, observations: FloatArray) -> dict[str, FloatArray]:
        """The parts of the observations."""
        return self._groups.split(observations)
