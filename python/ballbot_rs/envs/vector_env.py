"""A task as a Gymnasium vector environment, all robots stepped at once in Rust."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from ballbot_rs._checks import check_named, check_reset_options, check_seed, seed_at
from ballbot_rs._core import State
from ballbot_rs.envs._batch_env import BatchEnv, ManyRobots, fixed_option, metric_names, task_metrics
from ballbot_rs.envs._render import RENDER_MODES, Frames, Rendered, warn_without_mode
from ballbot_rs.envs.registration import DEFAULT_TASK, class_of
from ballbot_rs.envs.spaces import FloatArray, action_space, observation_space_of

BoolArray = npt.NDArray[np.bool_]


def _autoreset_name(mode: str | AutoresetMode) -> str:
    for known in AutoresetMode:
        # Gymnasium's own strings are the enum's values, as in "NextStep".
        if mode in (known, known.value, known.name):
            return known.name.lower()
    return str(mode).lower().replace("-", "_")


class BallbotVectorEnv(BatchEnv, ManyRobots, Rendered, VectorEnv[FloatArray, FloatArray, npt.NDArray[Any]]):
    """`num_envs` environments of a task; spaces and options as in `BallbotEnv`.

    ```python
    envs = bb.BallbotVectorEnv(64, task="goal", robot="kugle")
    observations, infos = envs.reset(seed=0)
    observations, rewards, terminated, truncated, infos = envs.step(envs.action_space.sample())
    ```

    Environment i, reset with seed s, is bit-identical to a `BallbotEnv` reset with seed s + i, for any `num_threads`.

    Args:
        num_envs: number of robots.
        task: name of the task.
        render_mode: None, or "rgb_array" for frames by `render()`.
        width: of a frame, pixels.
        height: of a frame, pixels.
        camera: as in `Renderer`.
        render_options: other arguments of `Renderer`.
        autoreset_mode: "next_step" (Gymnasium's default), "same_step" or "disabled", or the enum.
        num_threads: threads that step the robots; None uses all cores.
        seed: seed of the first reset, if `reset` is called without a seed.
        options: as in `BallbotEnv`.

    The info of every reset and step has the keys of `BallbotEnv`, each an array of shape (num_envs,) with a mask
    (`_is_success`), True except for environments excluded by a `reset_mask`. With "same_step" a step on which episodes
    end also has `final_obs` and `final_info`, with masks and zeros elsewhere; the other keys then belong to the
    episodes that begin.
    """

    #: Attributes that each robot has separately.
    _OF_EACH: Final = ("state", "params", "nominal_params", "command")

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": list(RENDER_MODES),
        "render_fps": 100,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        *unnamed: object,
        task: str = DEFAULT_TASK,
        render_mode: str | None = None,
        width: int | None = None,
        height: int | None = None,
        camera: dict[str, Any] | None = None,
        render_options: dict[str, Any] | None = None,
        autoreset_mode: str | AutoresetMode = "next_step",
        num_threads: int | None = None,
        seed: int | None = None,
        **options: Any,
    ) -> None:
        check_named("BallbotVectorEnv", unnamed)
        autoreset = _autoreset_name(autoreset_mode)
        # Attributes that `set_attr` set separately for each environment.
        self._own_attributes: dict[str, tuple[Any, ...]] = {}
        self._make_batch(num_envs, options, task=task, autoreset=autoreset, num_threads=num_threads, seed=seed)
        self.num_envs = num_envs
        self._metric_names = metric_names(self.task)
        self._env_seeds = tuple(seed_at(self._first_seed, i) for i in range(num_envs))
        self.autoreset_mode = AutoresetMode[autoreset.upper()]
        self._set_render(
            render_mode, self.params, render_options, num_threads, width=width, height=height, camera=camera
        )
        rate = round(1.0 / self.control_dt)
        self.metadata = {
            **type(self).metadata,
            "render_fps": rate,
            "autoreset_mode": self.autoreset_mode,
            "terminations": self._termination_names(),
        }
        self.single_observation_space = observation_space_of(self._batch)
        self.single_action_space = action_space()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Begins episodes.

        Args:
            seed: an int s seeds environment i with s + i; a list has a seed for each (None leaves it unchanged).
            options: `{"reset_mask": bool[num_envs]}` resets only these; `{"states": [State | None, ...]}` starts
                environments from given states.

        Returns:
            Observations of all environments, reset or not, and infos of the reset environments.

        Raises:
            TypeError: a mask that is not an array of bool.
            ValueError: an unknown option, a mask of the wrong shape or that is all False, a list or a seed of the wrong
                kind, a state that the model cannot represent or of an environment that is not reset. Then nothing
                has changed.
        """
        chosen = check_reset_options(options, ("reset_mask", "states"))
        mask = chosen.get("reset_mask")
        if mask is not None:
            _check_mask(mask)
        states: Sequence[State | None] | None = chosen.get("states")
        if states is not None and len(states) != self.num_envs:
            raise ValueError(f"states has {len(states)} entries, expected num_envs = {self.num_envs}")
        seeds = None if seed is None else self._seeds(seed)
        observations = self._batch.reset(mask, seeds, states)
        if seeds is not None:
            taken = np.ones(self.num_envs, dtype=bool) if mask is None else mask
            pairs = zip(seeds, self._env_seeds, taken, strict=True)
            self._env_seeds = tuple(new if new is not None and is_reset else old for new, old, is_reset in pairs)
        super().reset(seed=seed if isinstance(seed, int) else None)
        return observations, self._info(self._present(), mask)

    def _seeds(self, seed: int | Sequence[int | None]) -> list[int | None]:
        if isinstance(seed, (int, np.integer)):
            return [check_seed(seed + i) for i in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise ValueError(f"seed has {len(seed)} entries, expected num_envs = {self.num_envs}")
        return [None if s is None else check_seed(s) for s in seed]

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seed of each environment."""
        return self._env_seeds

    def step(
        self, actions: npt.ArrayLike
    ) -> tuple[FloatArray, npt.NDArray[np.float64], BoolArray, BoolArray, dict[str, Any]]:
        """Applies actions, shape (num_envs, 3), for one control step.

        Returns:
            Observations (num_envs, m) float32, rewards (num_envs,) float64, terminated and truncated (num_envs,) bool,
            and infos.

        Raises:
            ValueError: actions of the wrong shape or not finite; with "disabled", an episode that is over.
        """
        observations, rewards, terminated, truncated = self._batch.step(actions)
        present = self._present()
        ended = terminated | truncated
        if self.autoreset_mode is not AutoresetMode.SAME_STEP or not ended.any():
            return observations, rewards, terminated, truncated, self._info(present)
        begun = {name: values * ~ended for name, values in present.items()}
        # Metrics of the last episodes: the present episodes have not been stepped.
        metrics = {name: np.where(np.isfinite(values), values, 0.0) for name, values in self.metrics().items()}
        last = self._batch.final_observations()
        last[~ended] = 0.0
        info = {
            **self._info(begun),
            "final_obs": last,
            "_final_obs": ended,
            "final_info": self._info({**present, **metrics}, ended),
            "_final_info": ended.copy(),
        }
        return observations, rewards, terminated, truncated, info

    def render(self) -> tuple[Frames, ...] | None:
        """A picture of each robot, shape (height, width, 3), uint8; None without a render mode."""
        if self.render_mode is None:
            warn_without_mode()
            return None
        return tuple(self._frames(self._batch.states()))

    def _present(self) -> dict[str, npt.NDArray[Any]]:
        """Infos of the last step."""
        is_success, terminations = self._batch.endings()
        present: dict[str, npt.NDArray[Any]] = {"is_success": is_success, "termination": terminations}
        if self._metric_names:
            columns = np.ascontiguousarray(task_metrics(self._batch, present=True).T)
            present.update(zip(self._metric_names, columns, strict=True))
        return present

    def _info(self, found: dict[str, npt.NDArray[Any]], of: BoolArray | None = None) -> dict[str, Any]:
        """Each array with its mask; if only for some environments, zeros elsewhere."""
        info: dict[str, Any] = {}
        for name, values in found.items():
            info[name] = values if of is None else values * of
            info[f"_{name}"] = np.ones(self.num_envs, dtype=bool) if of is None else of.copy()
        return info

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Calls a method of every environment.

        The methods are `push`, `apply_force`, `set_params`, `reward_terms`, `draws`, `readings` and `metrics`.

        A name that is not a method is read as `get_attr` reads it.

        Raises:
            AttributeError: there is no such method, or arguments came with an attribute.
        """
        methods = ("push", "apply_force", "set_params", "reward_terms", "draws", "readings", "metrics")
        if name in methods:
            method = getattr(self._batch, name)
            return tuple(method(i, *args, **kwargs) for i in range(self.num_envs))
        is_of_each = name in self._own_attributes or name in self._OF_EACH
        if args or kwargs or (not is_of_each and callable(getattr(self, name))):
            raise AttributeError(f"environments have no method '{name}': expected one of {', '.join(methods)}")
        return self.get_attr(name)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """An attribute of every environment: its own, a space of a single environment, or a shared attribute."""
        if name in self._own_attributes:
            return self._own_attributes[name]
        if name in self._OF_EACH:
            return tuple(getattr(self._batch, name)(i) for i in range(self.num_envs))
        if name == "max_wheel_torque":
            return tuple(self._batch.action_torques.tolist())
        if name in ("observation_space", "action_space"):
            name = f"single_{name}"
        return (getattr(self, name),) * self.num_envs

    def set_attr(self, name: str, values: Any) -> None:
        """Sets an attribute of all environments; a list or tuple has a value for each.

        Raises:
            AttributeError: it is an option of the task, which is fixed once an environment is made.
            ValueError: a list of another length, or with different values of a shared attribute.
        """
        if (reason := fixed_option(self.task, name)) is not None:
            raise AttributeError(reason)
        if name == "command":
            self.command = values
            return
        if isinstance(values, (list, tuple)):
            if len(values) != self.num_envs:
                raise ValueError(f"{name} has {len(values)} values for num_envs = {self.num_envs}")
            if not all(value is values[0] or np.array_equal(value, values[0]) for value in values):
                if name not in self._own_attributes and hasattr(self, name):
                    raise ValueError(f"{name} is shared by all environments, but the values given differ")
                self._own_attributes[name] = tuple(values)
                return
            values = values[0]
        self._own_attributes.pop(name, None)
        setattr(self, name, values)


def of_task(num_envs: int = 1, *, task: str = DEFAULT_TASK, **options: Any) -> BallbotVectorEnv:
    """Environments of the task's class."""
    made = class_of(task, "VectorEnv")
    return BallbotVectorEnv(num_envs, task=task, **options) if made is None else made(num_envs, **options)


def _check_mask(mask: Any) -> None:
    if not isinstance(mask, np.ndarray):
        raise TypeError(f"reset_mask is of type {type(mask).__name__}, expected a NumPy array")
    if mask.dtype != np.bool_:
        raise TypeError(f"reset_mask has dtype {mask.dtype}, expected bool")
    if not mask.any():
        raise ValueError("reset_mask is all False: there is nothing to reset")
