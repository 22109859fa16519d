"""A task as a Stable-Baselines3 `VecEnv`."""

from __future__ import annotations

import contextlib
import copy
import operator
import os
from collections.abc import Iterable, Sequence
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
import torch
from gymnasium.envs.registration import EnvSpec
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvIndices, VecEnvStepReturn
from typing_extensions import Unpack

from ballbot_rs._checks import check_named, check_reset_options, check_seed
from ballbot_rs._core import Batch
from ballbot_rs.envs._batch_env import BatchEnv, ManyRobots, OneRobot, fixed_option
from ballbot_rs.envs._render import Rendered
from ballbot_rs.envs._sb3_functions import Episodes, Functions, Made
from ballbot_rs.envs.options import TaskOptions
from ballbot_rs.envs.registration import DEFAULT_TASK, env_id_of
from ballbot_rs.envs.spaces import action_space, observation_space_of


class EnvView(OneRobot):
    """One environment of a `BallbotVecEnv`, as `get_attr`, `set_attr` and `env_method` reach it."""

    def __init__(self, owner: BallbotVecEnv, index: int) -> None:
        self._owner = owner
        self._index = index
        self.render_mode = owner.render_mode
        self._np_random: np.random.Generator | None = None

    @property
    def _batch(self) -> Batch:  # type: ignore[override]
        return self._owner._batch

    @property
    def unwrapped(self) -> EnvView:
        """The environment itself: it has no wrappers."""
        return self

    @property
    def observation_space(self) -> gymnasium.Space[Any]:
        """Space of one observation."""
        return self._owner.observation_space

    @property
    def action_space(self) -> gymnasium.Space[Any]:
        """Space of one action."""
        return self._owner.action_space

    @property
    def metadata(self) -> dict[str, Any]:
        """Render modes and frame rate."""
        return self._owner.metadata

    @property
    def task(self) -> str:
        """Name of the task."""
        return self._owner.task

    @property
    def task_options(self) -> dict[str, Any]:
        """All options of the environment, defaults included, as JSON values."""
        return self._owner.task_options

    @property
    def spec(self) -> EnvSpec:
        """The spec from which `gymnasium.make` makes the same environment."""
        spec = copy.deepcopy(gymnasium.spec(env_id_of(self.task)))
        options = self.task_options
        spec.max_episode_steps = options.pop("max_episode_steps")
        spec.kwargs.update(options)
        return spec

    @property
    def np_random(self) -> np.random.Generator:
        """Random numbers for wrappers; the robots' generators are in Rust."""
        if self._np_random is None:
            self._np_random = np.random.default_rng(self._owner._first_seed + self._index)
        return self._np_random

    @np_random.setter
    def np_random(self, value: np.random.Generator) -> None:
        self._np_random = value

    def has_wrapper_attr(self, name: str) -> bool:
        """Whether the environment has an attribute."""
        return hasattr(self, name)

    def get_wrapper_attr(self, name: str) -> Any:
        """An attribute."""
        return getattr(self, name)

    def set_wrapper_attr(self, name: str, value: Any, *, force: bool = True) -> bool:
        """Sets an attribute; without `force` only an existing attribute. Returns whether it was set."""
        if (reason := fixed_option(self.task, name)) is not None:
            raise AttributeError(reason)
        if force or hasattr(self, name):
            setattr(self, name, value)
            return True
        return False


class BallbotVecEnv(BatchEnv, ManyRobots, Rendered, VecEnv):
    """`num_envs` environments for Stable-Baselines3, stepped at once in Rust.

    ```python
    env = bb.BallbotVecEnv("goal", num_envs=64, robot="kugle", model="contact")
    observations = env.reset()
    observations, rewards, dones, infos = env.step(np.zeros((64, 3)))
    ```

    Spaces and options as in `BallbotEnv`. The info of every reset and step has `TimeLimit.truncated`, `is_success` and
    `termination`, an index into the names `metadata["terminations"]`. Finished episodes are reset within the step;
    their infos also have `terminal_observation` and the task's metrics. `metrics()` has these at any time.

    Args:
        first: number of robots, or name or id of the task, in place of `num_envs` or `task`; or the functions of
            `make_vec_env(..., vec_env_cls=BallbotVecEnv)`, whose environments give number, task and options.
        num_envs: number of robots.
        task: name or id of the task.
        num_threads: threads that step the robots; None uses all cores. Results do not depend on it.
        seed: environment i is seeded with seed + i; None takes a seed from the operating system.
        stagger: whether the first episodes are shortened by different amounts, so that robots that never fall are
            not all truncated on the same step.
        torch_threads: threads that PyTorch uses within an operation, set for the whole process (networks of this size
            train several times slower with two threads than with one); None, or the variable OMP_NUM_THREADS, leaves
            PyTorch's setting unchanged.
        render_mode: None, or "rgb_array" for frames by `get_images()` and `render()`.
        width: of a frame, pixels.
        height: of a frame, pixels.
        camera: as in `Renderer`.
        render_options: other arguments of `Renderer`.
        options: as in `BallbotEnv`; `model="contact"` is by far the fastest.

    Raises:
        ValueError: an unknown name or a number out of range; the message has the value and the limit.
        TypeError: an unknown argument.
    """

    def __init__(
        self,
        first: int | str | Functions | None = None,
        /,
        *unnamed: object,
        num_envs: int | None = None,
        task: str | None = None,
        num_threads: int | None = None,
        seed: int | None = None,
        stagger: bool = False,
        torch_threads: int | None = 1,
        render_mode: str | None = None,
        width: int | None = None,
        height: int | None = None,
        camera: dict[str, Any] | None = None,
        render_options: dict[str, Any] | None = None,
        **options: Unpack[TaskOptions],
    ) -> None:
        check_named("BallbotVecEnv", unnamed)
        self._episodes = Episodes([])
        first = _checked(first)
        if first is not None and not isinstance(first, (int, str)):
            made = Made(
                _functions_alone(
                    first,
                    num_envs=num_envs,
                    task=task,
                    render_mode=render_mode,
                    width=width,
                    height=height,
                    camera=camera,
                    render_options=render_options,
                    **options,
                )
            )
            num_envs, task, options = made.num_envs, made.task, made.options  # type: ignore[assignment]
            render_mode, render_options = made.render_mode, made.render_options
            self._episodes = made.monitor
        elif first is not None:
            name, other = ("task", task) if isinstance(first, str) else ("num_envs", num_envs)
            if other is not None:
                raise TypeError(f"BallbotVecEnv got {first!r} and {name}={other!r}: give one of the two")
            if isinstance(first, str):
                task = first
            else:
                num_envs = first
        num_envs = 1 if num_envs is None else num_envs
        task = DEFAULT_TASK if task is None else task
        self._make_batch(num_envs, dict(options), task=task, autoreset="same_step", num_threads=num_threads, seed=seed)
        if torch_threads is not None and "OMP_NUM_THREADS" not in os.environ:
            torch.set_num_threads(torch_threads)
        self._stagger = stagger
        self._actions: npt.NDArray[Any] | None = None
        self._set_render(
            render_mode, self.params, render_options, num_threads, width=width, height=height, camera=camera
        )
        self._views = [EnvView(self, i) for i in range(num_envs)]
        super().__init__(num_envs, observation_space_of(self._batch), action_space())
        metadata: dict[str, Any] = self.metadata
        metadata["render_fps"] = round(1.0 / self.control_dt)
        metadata["terminations"] = self._termination_names()

    def reset(self) -> npt.NDArray[np.float32]:
        """Begins episodes in all environments, with the seeds and options set since the last reset.

        Raises:
            ValueError: an option other than `state`, or a state that the model cannot represent.
        """
        seeds = [None if seed is None else check_seed(seed) for seed in self._seeds]
        starts = [check_reset_options(options, ("state",)).get("state") for options in self._options]
        observations = self._batch.reset(seeds=seeds, starts=starts)
        if self._stagger:
            self._batch.stagger()
        if self._episodes.is_used:
            self._episodes.reset()
        self.reset_infos = self._batch.infos()
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: npt.NDArray[Any]) -> None:
        """Takes the actions of the next `step_wait`, shape (num_envs, 3)."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Applies the actions for one control step; all arrays and infos returned are fresh.

        Raises:
            ValueError: actions of the wrong shape, or not finite.
            RuntimeError: there was no `step_async`.
        """
        if self._actions is None:
            raise RuntimeError("step_wait without step_async")
        actions, self._actions = self._actions, None
        observations, rewards, terminated, truncated = self._batch.step(actions)
        dones, infos = np.logical_or(terminated, truncated, out=terminated), self._batch.infos()
        self._add_metrics(infos, dones)
        if self._episodes.is_used:
            self._episodes.step(rewards, dones, infos)
        # Stable-Baselines3 keeps rewards as float32.
        return observations, rewards.astype(np.float32), dones, infos

    def _add_metrics(self, infos: list[dict[str, Any]], dones: npt.NDArray[np.bool_]) -> None:
        """Adds the metrics of a task in Python to the infos of the episodes that have ended."""
        own = None if self._batch.stage is None else self._batch.stage.metrics
        if own is not None and dones.any():
            found = own.last()
            for i in np.flatnonzero(dones).tolist():
                infos[i].update(zip(own.names, found[i].tolist(), strict=True))

    def close(self) -> None:
        """Closes the files of monitors made by functions; there is nothing else to close."""
        self._episodes.close()

    def _chosen(self, indices: VecEnvIndices) -> Iterable[EnvView]:
        return (self._views[i] for i in self._get_indices(indices))

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """An attribute of the chosen environments, from `EnvView` or as set by `set_attr`."""
        return [getattr(view, attr_name) for view in self._chosen(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Sets an attribute of the chosen environments.

        Raises:
            AttributeError: it is an option of the task, which is fixed once an environment is made.
        """
        if (reason := fixed_option(self.task, attr_name)) is not None:
            raise AttributeError(reason)
        for view in self._chosen(indices):
            setattr(view, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Calls a method of `EnvView` on the chosen environments."""
        return [getattr(view, method_name)(*method_args, **method_kwargs) for view in self._chosen(indices)]

    def env_is_wrapped(self, wrapper_class: type, indices: VecEnvIndices = None) -> list[bool]:
        """Whether each of the chosen environments has the wrapper: only a `Monitor`, if functions added it."""
        wrapped = self._episodes.is_used and issubclass(Monitor, wrapper_class)
        return [wrapped for _ in self._chosen(indices)]

    def get_images(self) -> Sequence[npt.NDArray[np.uint8] | None]:
        """A picture of each robot, shape (height, width, 3), uint8; None for each without a render mode."""
        if self.render_mode is None:
            return [None] * self.num_envs
        return list(self._frames(self._batch.states()))


def _checked(first: Any) -> int | str | Functions | None:
    """The first argument, a number as `int`."""
    if first is None or isinstance(first, str):
        return first
    if not isinstance(first, bool):
        with contextlib.suppress(TypeError):
            return operator.index(first)
        if isinstance(first, Sequence) and all(callable(one) for one in first):
            return first
    raise TypeError(
        f"BallbotVecEnv got {first!r}: expected a number of robots, the name or id of a task, or a list of functions"
    )


def _functions_alone(functions: Functions, **others: Any) -> Functions:
    for name, value in others.items():
        if value is not None:
            raise TypeError(f"BallbotVecEnv got functions and {name}={value!r}: their environments define it")
    return functions
