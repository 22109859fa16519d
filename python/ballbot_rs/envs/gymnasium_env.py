"""A task as a single Gymnasium environment."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import check_reset_options, check_seed
from ballbot_rs.envs._batch_env import BatchEnv, OneRobot, metric_names, task_metrics
from ballbot_rs.envs._render import RENDER_MODES, Frames, Rendered, warn_without_mode
from ballbot_rs.envs.registration import DEFAULT_TASK, class_of
from ballbot_rs.envs.spaces import FloatArray, action_space, observation_space_of


class BallbotEnv(BatchEnv, OneRobot, Rendered, gymnasium.Env[FloatArray, FloatArray]):
    """A robot with a task.

    ```python
    env = bb.BallbotEnv("goal", robot="kugle", actuators="kugle", events="mild")
    observation, info = env.reset(seed=0)
    observation, reward, terminated, truncated, info = env.step([0.1, 0.0, -0.1])
    ```

    The classes of the tasks, `BalanceEnv` for example, list their actions, observations, rewards and options.

    Args:
        task: name of the task.
        render_mode: None, or "rgb_array": `render()` then returns frames, without GPU or display; Gymnasium derives
            "human" from it.
        width: of a frame, pixels.
        height: of a frame, pixels.
        camera: as in `Renderer`.
        render_options: other arguments of `Renderer` (`samples`, `urdf`).
        options: of the task and of its environments, SI units and radians; `max_episode_steps=None` never truncates.

    Raises:
        ValueError: a number out of range, or an unknown name; the message has the value and the limit.
        TypeError: an unknown argument.

    The info of every reset and step has the same keys, each a finite NumPy number:

    - `is_success`: whether an episode that ended here would be a success, an array of shape (), bool; False at a reset.
    - `termination`: why the episode was terminated, int64: an index into `metadata["terminations"]`, 0 for none.
    - each metric of the task by its name, float64: of the episode so far, 0 where `metrics()` has NaN.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 100}  # noqa: RUF012

    def __init__(
        self,
        task: str = DEFAULT_TASK,
        *,
        render_mode: str | None = None,
        width: int | None = None,
        height: int | None = None,
        camera: dict[str, Any] | None = None,
        render_options: dict[str, Any] | None = None,
        **options: Any,
    ) -> None:
        self._make_batch(1, options, task=task, autoreset="disabled", num_threads=1, seed=None)
        self.observation_space = observation_space_of(self._batch)
        self.action_space = action_space()
        self._set_render(render_mode, self.params, render_options, width=width, height=height, camera=camera)
        self._metric_names = metric_names(self.task)
        rate = round(1.0 / self.control_dt)
        self.metadata = {**type(self).metadata, "render_fps": rate, "terminations": self._termination_names()}

    def _hint(self, name: str) -> str:
        if name in ("num_envs", "num_threads", "autoreset", "autoreset_mode"):
            return ": this is one robot; use gymnasium.make_vec or BallbotVectorEnv for several"
        return ""

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Begins an episode.

        Args:
            seed: seeds the following start states; None continues the current random sequence.
            options: `{"state": State}` starts from that state.

        Raises:
            ValueError: an unknown option, a seed out of range, or a state that the model cannot represent.
        """
        start = check_reset_options(options, ("state",)).get("state")
        if seed is not None:
            seed = check_seed(seed)
        observations = self._batch.reset(seeds=[seed], starts=[start])
        super().reset(seed=seed)
        return observations[0], self._info()

    def step(self, action: npt.ArrayLike) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        """Applies an action for one control step.

        Raises:
            ValueError: the action has the wrong shape or is not finite, or the episode is over.
        """
        # A masked array stays masked, which the batch rejects.
        given = np.asanyarray(action)
        if given.dtype.kind in "biuf" and given.shape != (3,):
            several = ": BallbotVectorEnv takes the actions of several robots" if given.ndim > 1 else ""
            raise ValueError(f"actions has shape {given.shape}, expected (3,) for one robot{several}")
        observations, rewards, terminated, truncated = self._batch.step(given[np.newaxis])
        return observations[0], float(rewards[0]), bool(terminated[0]), bool(truncated[0]), self._info()

    def _info(self) -> dict[str, Any]:
        is_success, terminations = self._batch.endings()
        # Not a NumPy scalar, which Gymnasium and the array API do not accept as a number.
        info: dict[str, Any] = {"is_success": is_success.reshape(()), "termination": terminations[0]}
        if self._metric_names:
            info.update(zip(self._metric_names, task_metrics(self._batch, present=True)[0], strict=True))
        return info

    def render(self) -> Frames | None:
        """The current state as a picture, shape (height, width, 3), uint8; None without a render mode."""
        if self.render_mode is None:
            warn_without_mode()
            return None
        frame: Frames = self._frames(self._batch.states())[0]
        return frame


def without_own_limit(task: str = DEFAULT_TASK, **options: Any) -> BallbotEnv:
    """An environment of the task's class whose episodes Gymnasium's `TimeLimit` ends."""
    options = {"max_episode_steps": None, **options}
    made = class_of(task, "Env")
    return BallbotEnv(task, **options) if made is None else made(**options)


# Gymnasium looks here for the render modes, from which it makes "human".
without_own_limit.metadata = BallbotEnv.metadata  # type: ignore[attr-defined]
