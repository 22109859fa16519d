"""A fast, verified simulator of a robot that balances on a ball.

The physics is in Rust; this package gives it to Python: single robots (`Ballbot`), closed-form models
(`SpatialModel`, `PlanarModel`), controllers (`Pid`, `Lqr`) and environments for reinforcement learning. Importing it
registers `ballbot/Balance-v0` with Gymnasium. SI units and radians throughout; quaternions are `[w, x, y, z]`.
"""

from typing import TYPE_CHECKING, Any

from ballbot_rs._core import (
    PAPER_BALL_VISCOUS_FRICTION,
    Ballbot,
    Contacts,
    DivergedError,
    Lqr,
    Params,
    Pid,
    PlanarModel,
    Renderer,
    SpatialModel,
    State,
    UrdfError,
    __version__,
    virtual_to_wheel_torques,
    wheel_to_virtual_torques,
)
from ballbot_rs.envs.gymnasium_env import BalanceEnv
from ballbot_rs.envs.registration import register_environments
from ballbot_rs.envs.vector_env import BalanceVectorEnv

if TYPE_CHECKING:
    from ballbot_rs.envs.sb3 import BallbotVecEnv

__all__ = [
    "PAPER_BALL_VISCOUS_FRICTION",
    "BalanceEnv",
    "BalanceVectorEnv",
    "Ballbot",
    "BallbotVecEnv",
    "Contacts",
    "DivergedError",
    "Lqr",
    "Params",
    "Pid",
    "PlanarModel",
    "Renderer",
    "SpatialModel",
    "State",
    "UrdfError",
    "__version__",
    "virtual_to_wheel_torques",
    "wheel_to_virtual_torques",
]

register_environments()


def __getattr__(name: str) -> Any:
    # Stable-Baselines3 brings torch: load it only for those who ask.
    if name == "BallbotVecEnv":
        try:
            from ballbot_rs.envs.sb3 import BallbotVecEnv
        except ModuleNotFoundError as error:
            raise ModuleNotFoundError(
                f"BallbotVecEnv needs {error.name}: install it with `pip install 'ballbot-rs[train]'`",
                name=error.name,
            ) from error
        return BallbotVecEnv
    raise AttributeError(f"module 'ballbot_rs' has no attribute '{name}'")


def __dir__() -> list[str]:
    return __all__
