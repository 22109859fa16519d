"""The balance task as a single Gymnasium environment."""

from typing import Any, Final

import gymnasium
import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Params, State
from ballbot_rs.batch_owner import (
    BatchOwner,
    FloatArray,
    action_space,
    check_options,
    check_seed,
    observation_space,
)
from ballbot_rs.registration import MAX_EPISODE_STEPS
from ballbot_rs.rendering import RENDER_MODES, Frames, Rendered, warn_without_mode

#: More steps than an episode can have: 248 days at the default control rate.
NEVER: Final = 2**31


class BalanceEnv(BatchOwner, Rendered, gymnasium.Env[FloatArray, FloatArray]):
    """Keep a ballbot upright with its ball at the setpoint.

    ## Action space
    `Box(-1, 1, (3,), float32)`: torque of each wheel motor as a share of `max_wheel_torque` (1 N·m); clipped.

    ## Observation space
    `Box(16, float32)`, what the robot can sense. The heading frame has the robot's yaw and a vertical z axis.

    | rows  | what                                              | unit  | bound |
    |-------|---------------------------------------------------|-------|-------|
    | 0-2   | direction of gravity in the body frame            |       | 1     |
    | 3-5   | angular velocity of the body, body frame          | rad/s | 20    |
    | 6-8   | wheel speeds, relative to the body (encoders)     | rad/s | 200   |
    | 9-10  | ball position from the setpoint, heading frame    | m     | 10    |
    | 11-12 | ball velocity, heading frame                      | m/s   | 10    |
    | 13-15 | last action                                       |       | 1     |

    Values saturate at the bounds.

    ## Rewards
    The sum of named terms times their scales (`reward={"tilt": 2.0, ...}` changes a scale; `reward_terms()` gives the
    last step's): `alive` 1 for a step that does not end in a fall, less costs of `tilt`, `position`, `velocity`,
    `rate` (of the body), `action` and `action_change`. The best possible return is 1000.

    ## Starting state
    The ball at the origin; tilt drawn evenly from a cone of 5 deg, any yaw, ball speed up to 0.1 m/s, tilt rate up to
    0.2 rad/s, rolling without slip. `reset(options={"state": State(...)})` starts from a given state instead.

    ## Episode end
    Terminated when the tilt exceeds 20 deg, the body or a wheel touches the floor, or the simulation diverges; the
    info then has `termination`: "tilt", "bot_on_floor" or "diverged". Truncated after `max_episode_steps` (10 s at the
    default control rate; `gymnasium.make(..., max_episode_steps=n)` changes it). `is_success` in a step's info says
    whether an episode that ends with it is a success: not terminated, and over the last 2 s tilt ≤ 1 deg and ball
    within 0.10 m of the setpoint.

    ## Rendering
    `render_mode="rgb_array"` lets `render()` give frames, without GPU or display; Gymnasium makes "human" of it.
    `render_options` are the arguments of `Renderer`: `width`, `height`, `samples`, `camera`, `urdf`.

    ## Arguments
    All keyword, SI units and radians: `params` (parameters, the name of a preset, or the path of a TOML file), `model`
    ("rigid", "contact", "spatial" or "planar"), `sim_dt` (0.002), `control_dt` (0.01, a whole multiple of `sim_dt`),
    `max_wheel_torque`, `setpoint`, `reset_tilt`, `reset_yaw`, `reset_ball_speed`, `reset_tilt_rate`, `fall_tilt`,
    `success_window`, `success_tilt`, `success_radius`, `reward`.

    Raises:
        ValueError: a number is out of range, or a name is not known; the message has the value and the limit.
        TypeError: an argument is not known.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 100}  # noqa: RUF012

    def __init__(
        self,
        *,
        render_mode: str | None = None,
        render_options: dict[str, Any] | None = None,
        max_episode_steps: int | None = MAX_EPISODE_STEPS,
        **options: Any,
    ) -> None:
        self.observation_space = observation_space()
        self.action_space = action_space()
        options["max_episode_steps"] = NEVER if max_episode_steps is None else max_episode_steps
        self._make_batch(1, "disabled", 1, None, options)
        self._set_render(render_mode, self._batch.params, render_options)
        self.metadata = {**type(self).metadata, "render_fps": round(1.0 / self._batch.control_dt)}

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Begins an episode.

        Args:
            seed: seeds the start states to come; None goes on with the present random numbers.
            options: `{"state": State}` starts from that state.

        Raises:
            ValueError: an unknown option, a seed out of range, or a state that the model cannot represent.
        """
        start = check_options(options, ("state",)).get("state")
        if seed is not None:
            seed = check_seed(seed)
        observations = self._batch.reset(seeds=[seed], starts=[start])
        super().reset(seed=seed)
        return observations[0], {}

    def step(self, action: npt.ArrayLike) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        """Applies an action for one control step.

        Raises:
            ValueError: the action has the wrong shape or is not finite, or the episode is over.
        """
        observations, rewards, terminated, truncated = self._batch.step(np.asarray(action)[np.newaxis])
        is_success, termination = self._batch.ending(0)
        info: dict[str, Any] = {"is_success": is_success}
        if termination is not None:
            info["termination"] = termination
        return observations[0], float(rewards[0]), bool(terminated[0]), bool(truncated[0]), info

    def render(self) -> Frames | None:
        """The present state as a picture, shape (height, width, 3), uint8; None without a render mode."""
        if self.render_mode is None:
            warn_without_mode()
            return None
        frame: Frames = self._frames(self._batch.states())[0]
        return frame

    @property
    def state(self) -> State:
        """The robot's full state, of which the observation is a part."""
        return self._batch.state(0)

    @property
    def params(self) -> Params:
        """The robot's parameters."""
        return self._batch.params

    def reward_terms(self) -> dict[str, float]:
        """The terms whose sum was the last reward."""
        return self._batch.reward_terms(0)

    def push(self, impulse: npt.ArrayLike, point: npt.ArrayLike | None = None) -> None:
        """Gives the body an impulse; see `Ballbot.push`."""
        self._batch.push(0, impulse, point)

    def set_joint_dynamics(self, viscous_friction: float | None = None, coulomb_friction: float | None = None) -> None:
        """Changes the friction of the wheel joints; see `Ballbot.set_joint_dynamics`."""
        self._batch.set_joint_dynamics(0, viscous_friction, coulomb_friction)


def without_time_limit(**options: Any) -> BalanceEnv:
    """A `BalanceEnv` for `gymnasium.make`, which itself ends episodes after the number of steps that it is given."""
    return BalanceEnv(max_episode_steps=None, **options)


# Gymnasium looks here for the render modes, from which it makes "human".
without_time_limit.metadata = BalanceEnv.metadata  # type: ignore[attr-defined]
