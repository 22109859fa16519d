"""The balance task as a Stable-Baselines3 `VecEnv`."""

from collections.abc import Iterable, Sequence
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvIndices, VecEnvStepReturn

from ballbot_rs._core import Params, State
from ballbot_rs.envs._batch_env import (
    BatchOwner,
    action_space,
    check_options,
    check_seed,
    observation_space,
    refuse_option,
)
from ballbot_rs.envs._render import Rendered
from ballbot_rs.envs.registration import BALANCE, MAX_EPISODE_STEPS, check_id


class EnvView:
    """One environment of a `BallbotVecEnv`, as `get_attr`, `set_attr` and `env_method` see it."""

    spec: None = None

    def __init__(self, owner: "BallbotVecEnv", index: int) -> None:
        self._owner = owner
        self._index = index
        self.render_mode = owner.render_mode

    @property
    def observation_space(self) -> gymnasium.Space[Any]:
        """Space of one observation."""
        return self._owner.observation_space

    @property
    def action_space(self) -> gymnasium.Space[Any]:
        """Space of one action."""
        return self._owner.action_space

    @property
    def control_dt(self) -> float:
        """Time between two actions, s."""
        return self._owner._batch.control_dt

    @property
    def state(self) -> State:
        """The robot's full state."""
        return self._owner._batch.state(self._index)

    @property
    def params(self) -> Params:
        """The robot's parameters."""
        return self._owner._batch.params

    def push(self, impulse: npt.ArrayLike, point: npt.ArrayLike | None = None) -> None:
        """Gives the body an impulse; see `Ballbot.push`."""
        self._owner._batch.push(self._index, impulse, point)

    def set_joint_dynamics(self, viscous_friction: float | None = None, coulomb_friction: float | None = None) -> None:
        """Changes the friction of the wheel joints; see `Ballbot.set_joint_dynamics`."""
        self._owner._batch.set_joint_dynamics(self._index, viscous_friction, coulomb_friction)

    def reward_terms(self) -> dict[str, float]:
        """The terms whose sum was the last reward (zeros right after a reset)."""
        return self._owner._batch.reward_terms(self._index)


class BallbotVecEnv(BatchOwner, Rendered, VecEnv):
    """`num_envs` balance environments for Stable-Baselines3, stepped at once in Rust.

    Task, spaces and options as in `BalanceEnv`. Finished episodes are reset within the step; their infos have
    `terminal_observation`, `TimeLimit.truncated`, `is_success` and, where terminated, `termination`.

    Args:
        env_id: "ballbot/Balance-v0".
        num_envs: number of robots.
        model: "rigid", "contact" (by far the fastest), "spatial" or "planar".
        num_threads: threads that step the robots; None takes all cores. Results do not depend on it.
        seed: environment i is seeded with seed + i; None takes one from the operating system.
        max_episode_steps: steps after which an episode is truncated.
        stagger: whether the first episodes are shortened by different amounts, so that robots that never fall are
            not all truncated on the same step.
        render_mode: None, or "rgb_array" for frames by `get_images()` and `render()`.
        render_options: arguments of `Renderer`.
        options: as in `BalanceEnv`.

    Raises:
        ValueError: an unknown name or a number out of range; the message has the value and the limit.
    """

    def __init__(
        self,
        env_id: str = BALANCE,
        num_envs: int = 1,
        *,
        model: str = "rigid",
        num_threads: int | None = None,
        seed: int | None = None,
        max_episode_steps: int = MAX_EPISODE_STEPS,
        stagger: bool = False,
        render_mode: str | None = None,
        render_options: dict[str, Any] | None = None,
        **options: Any,
    ) -> None:
        check_id(env_id)
        options |= {"model": model, "max_episode_steps": max_episode_steps}
        self._make_batch(num_envs, "same_step", num_threads, seed, options)
        self._stagger = stagger
        self._actions: npt.NDArray[Any] | None = None
        self._set_render(render_mode, self._batch.params, render_options, num_threads)
        self._views = [EnvView(self, i) for i in range(num_envs)]
        super().__init__(num_envs, observation_space(), action_space())
        metadata: dict[str, Any] = self.metadata
        metadata["render_fps"] = round(1.0 / self._batch.control_dt)

    def reset(self) -> npt.NDArray[np.float32]:
        """Begins episodes in all environments, with the seeds and options set since the last reset.

        Raises:
            ValueError: an option other than `state`, or a state that the model cannot represent.
        """
        seeds = [None if seed is None else check_seed(seed) for seed in self._seeds]
        starts = [check_options(options, ("state",)).get("state") for options in self._options]
        observations = self._batch.reset(seeds=seeds, starts=starts)
        if self._stagger:
            self._batch.stagger()
        self.reset_infos = [{} for _ in range(self.num_envs)]
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
        return observations, rewards, terminated | truncated, self._batch.infos()

    def close(self) -> None:
        """Does nothing: there are no processes or files to close."""

    def _chosen(self, indices: VecEnvIndices) -> Iterable[EnvView]:
        return (self._views[i] for i in self._get_indices(indices))

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """An attribute of the chosen environments, as `EnvView` has it or `set_attr` put it."""
        return [getattr(view, attr_name) for view in self._chosen(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Sets an attribute of the chosen environments.

        Raises:
            AttributeError: it is an option of the task, which is fixed once an environment is made.
        """
        refuse_option(attr_name)
        for view in self._chosen(indices):
            setattr(view, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Calls a method of the chosen environments, as `EnvView` has it."""
        return [getattr(view, method_name)(*method_args, **method_kwargs) for view in self._chosen(indices)]

    def env_is_wrapped(self, wrapper_class: type, indices: VecEnvIndices = None) -> list[bool]:  # noqa: ARG002
        """False for each of the chosen environments: there is nothing around them."""
        return [False for _ in self._chosen(indices)]

    def get_images(self) -> Sequence[npt.NDArray[np.uint8] | None]:
        """A picture of each robot, shape (height, width, 3), uint8; None for each without a render mode."""
        if self.render_mode is None:
            return [None] * self.num_envs
        return list(self._frames(self._batch.states()))

    @property
    def states(self) -> npt.NDArray[np.float64]:
        """Full states, one row an environment, as `State.to_array` lays them out."""
        return self._batch.states()
