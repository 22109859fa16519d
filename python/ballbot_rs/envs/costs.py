"""Costs of falls, traction and speed for constrained reinforcement learning, apart from the reward."""

from typing import Any, Final

import gymnasium
import numpy as np

from ballbot_rs._checks import check_bounded
from ballbot_rs._errors import InvalidInputError
from ballbot_rs.envs.gymnasium_env import BallbotEnv

#: Largest limits of traction and speed.
_MOST_TRACTION: Final = 1.0
_MOST_SPEED: Final = 100.0


class CostInfo(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Puts the costs of each step into the info: `cost_fall`, `cost_traction`, `cost_speed`, and `cost`, their sum.

    ```python
    env = bb.CostInfo(bb.BalanceEnv(), max_speed=0.5)
    env.reset(seed=0)
    print(env.step([0.1, 0.0, -0.1])[-1]["cost"])
    ```

    Each is 1 or 0 as float: whether the step terminated the episode, as by a fall; whether a wheel or the floor used
    more of its friction limit than `max_traction` at the end of the step; whether the ball was faster than `max_speed`.
    After a reset they are 0.

    Args:
        env: an environment of one robot of this package, wrapped or not.
        max_traction: fraction of the dynamic friction limit, 0 to 1.
        max_speed: horizontal speed of the ball, m/s.

    Raises:
        ValueError: another environment, or a number out of range.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], *, max_traction: float = 0.9, max_speed: float = 1.0) -> None:
        super().__init__(env)
        if not isinstance(env.unwrapped, BallbotEnv):
            raise InvalidInputError(f"{env.unwrapped} is not an environment of one robot of this package")
        self._robot: BallbotEnv = env.unwrapped
        self._max_traction = check_bounded("max_traction", max_traction, 0.0, _MOST_TRACTION)
        self._max_speed = check_bounded("max_speed", max_speed, 0.0, _MOST_SPEED)

    def reset(self, **arguments: Any) -> tuple[Any, dict[str, Any]]:
        """As of the environment."""
        observation, info = self.env.reset(**arguments)
        return observation, {**info, **dict.fromkeys(("cost_fall", "cost_traction", "cost_speed", "cost"), 0.0)}

    def step(self, action: Any) -> Any:
        """As of the environment."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        return observation, reward, terminated, truncated, {**info, **self._costs(terminated=bool(terminated))}

    def _costs(self, *, terminated: bool) -> dict[str, float]:
        used = float(self._robot._batch.contacts(0).friction_utilization.max())
        speed = float(np.hypot(*self._robot.state.ball_velocity[:2]))
        costs = {
            "cost_fall": float(terminated),
            "cost_traction": float(used > self._max_traction),
            "cost_speed": float(speed > self._max_speed),
        }
        return {**costs, "cost": sum(costs.values())}


class SafetyEnv(CostInfo):
    """`CostInfo` with the interface of Safety-Gymnasium: `step` returns the cost after the reward, six values.

    ```python
    env = bb.SafetyEnv(bb.BalanceEnv(), max_speed=0.5)
    env.reset(seed=0)
    observation, reward, cost, terminated, truncated, info = env.step([0.1, 0.0, -0.1])
    ```

    It is the outermost wrapper: wrappers of Gymnasium expect five values.
    """

    def step(  # type: ignore[override]
        self, action: Any
    ) -> tuple[Any, Any, float, bool, bool, dict[str, Any]]:
        """Applies an action: observation, reward, cost, terminated, truncated, info."""
        observation, reward, terminated, truncated, info = super().step(action)
        return observation, reward, info["cost"], terminated, truncated, info
