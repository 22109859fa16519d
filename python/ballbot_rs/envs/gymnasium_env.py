"""The balance task as a single Gymnasium environment."""

import sys
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import check_reset_options, check_seed
from ballbot_rs.envs._batch_env import BatchEnv, OneRobot
from ballbot_rs.envs._render import RENDER_MODES, Frames, Rendered, warn_without_mode
from ballbot_rs.envs.registration import MAX_EPISODE_STEPS
from ballbot_rs.envs.spaces import FloatArray, action_space, observation_space


class BalanceEnv(BatchEnv, OneRobot, Rendered, gymnasium.Env[FloatArray, FloatArray]):
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
    default control rate; None: never). `is_success` in the info of an episode's last step says whether it is a success:
    not terminated, and over the last 2 s tilt ≤ 1 deg and ball within 0.10 m of the setpoint.

    A `TimeLimit` wrapper put on by hand truncates where the environment does not know of it: the info then lacks
    `is_success`; `env.unwrapped.is_success` has it.

    ## Rendering
    `render_mode="rgb_array"` lets `render()` give frames, without GPU or display; Gymnasium makes "human" of it.
    `width`, `height` and `camera` are those of `Renderer`; `render_options` has its others (`samples`, `urdf`).

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
        width: int | None = None,
        height: int | None = None,
        camera: dict[str, Any] | None = None,
        render_options: dict[str, Any] | None = None,
        max_episode_steps: int | None = MAX_EPISODE_STEPS,
        **options: Any,
    ) -> None:
        self.observation_space = observation_space()
        self.action_space = action_space()
        options["max_episode_steps"] = max_episode_steps
        self._make_batch(1, options, autoreset="disabled", num_threads=1, seed=None)
        self._set_render(render_mode, self.params, render_options, width=width, height=height, camera=camera)
        # Steps of the episode, and the number from which Gymnasium's TimeLimit may truncate it.
        self._steps = 0
        self._outer_limit = float("inf")
        self.metadata = {**type(self).metadata, "render_fps": round(1.0 / self.control_dt)}

    def _hint(self, name: str) -> str:
        if name in ("num_envs", "num_threads", "autoreset", "autoreset_mode"):
            return ": this is one robot; use gymnasium.make_vec or BalanceVectorEnv for several"
        return ""

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
        start = check_reset_options(options, ("state",)).get("state")
        if seed is not None:
            seed = check_seed(seed)
        observations = self._batch.reset(seeds=[seed], starts=[start])
        super().reset(seed=seed)
        self._steps = 0
        return observations[0], {}

    def step(self, action: npt.ArrayLike) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        """Applies an action for one control step.

        Raises:
            ValueError: the action has the wrong shape or is not finite, or the episode is over.
        """
        given = np.asarray(action)
        if given.dtype.kind in "biuf" and given.shape != (3,):
            several = ": BalanceVectorEnv takes the actions of several robots" if given.ndim > 1 else ""
            raise ValueError(f"actions has shape {given.shape}, expected (3,) for one robot{several}")
        observations, rewards, terminated, truncated = self._batch.step(given[np.newaxis])
        self._steps += 1
        ended = bool(terminated[0] or truncated[0])
        info: dict[str, Any] = {}
        if ended or self._steps >= self._outer_limit:
            info["is_success"], termination = self._batch.ending(0)
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


def without_time_limit(**options: Any) -> BalanceEnv:
    """A `BalanceEnv` for `gymnasium.make`, which itself ends episodes after the number of steps that it is given."""
    env = BalanceEnv(max_episode_steps=None, **options)
    # `gymnasium.make` passes its argument to TimeLimit alone, but the info of the last step has `is_success`.
    caller = sys._getframe(1)
    is_make = caller.f_globals.get("__name__") == "gymnasium.envs.registration"
    limit = caller.f_locals.get("max_episode_steps") if is_make else None
    env._outer_limit = MAX_EPISODE_STEPS if limit is None else limit if limit > 0 else float("inf")
    return env


# Gymnasium looks here for the render modes, from which it makes "human".
without_time_limit.metadata = BalanceEnv.metadata  # type: ignore[attr-defined]
