"""The base class of tasks in Python."""

from collections.abc import Mapping, Sequence
from typing import ClassVar, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs.envs.own.robots import Robots

#: The task of the core below a task in Python: no rows, no rewards.
BARE: Final = "bare"

#: More steps than an episode can have: 248 days at the default control rate.
NO_TIME_LIMIT: Final = 2**31


class Task:
    """A task in Python: three functions of arrays over all robots, called once per control step.

    Episodes start as in `ballbot/Balance-v0` (options `reset_tilt` and so on). They end if `terminated` returns True,
    when the body or a wheel touches the floor, when the simulation diverges, and after `max_episode_steps`. Keyword
    arguments that the environment does not have go to the constructor, whose arguments must have other names.

    ```python
    class Spin(bb.Task):
        def observe(self, robots):
            return np.column_stack([robots.gravity, robots.body_rate, robots.wheel_speeds])

        def reward(self, robots):
            return 1.0 - np.abs(robots.yaw_rate - 2.0)

        def terminated(self, robots):
            return robots.tilt > 0.4

    bb.register("me/Spin-v0", Spin)
    env = bb.BallbotVecEnv("me/Spin-v0", num_envs=1024, model="contact")
    ```
    """

    #: A task of the core to build on, as "velocity", with its commands, options, starts, falls and metrics. It is shown
    #: alike; rows of `observe` follow the rows of the base, whose reward terms have the scale 0. None: no command.
    base: ClassVar[str | None] = None
    #: Default length of an episode in control steps; None means no limit.
    max_episode_steps: ClassVar[int | None] = 1000
    #: Bound of the observations' magnitudes: a number, or one for each column. Larger values are clipped.
    observation_bound: ClassVar[float | npt.ArrayLike] = 1e3
    #: Names of the columns of `observe`, for policies in C; None: "observation 0" and so on.
    row_names: ClassVar[Sequence[str] | None] = None
    #: Units of `metrics` by name, for tables and the page.
    units: ClassVar[Mapping[str, str]] = {}
    #: How each of `metrics` is summarized over an episode: "mean" (the default), "rms", "max", "min" or "last".
    summaries: ClassVar[Mapping[str, str]] = {}

    def observe(self, robots: Robots) -> npt.ArrayLike:
        """Observations, shape (n, k), of any subset of the batch; k is constant. Optional for a task with a `base`."""
        raise NotImplementedError(f"{type(self).__name__} has no method observe(self, robots)")

    def reward(self, robots: Robots) -> npt.ArrayLike:
        """Rewards of the last step, shape (n,)."""
        raise NotImplementedError(f"{type(self).__name__} has no method reward(self, robots)")

    def terminated(self, robots: Robots) -> npt.ArrayLike:
        """Whether episodes end with the last step, bool, shape (n,)."""
        return np.zeros(len(robots), dtype=bool)

    def success(self, robots: Robots) -> npt.ArrayLike:
        """Whether episodes that end with the last step would be a success, bool, shape (n,)."""
        return np.zeros(len(robots), dtype=bool)

    def metrics(self, robots: Robots) -> Mapping[str, npt.ArrayLike]:  # noqa: ARG002
        """Numbers by name, shape (n,) each; commands, infos and the page show their `summaries` over an episode."""
        return {}

    def drawing(self, robots: Robots) -> npt.ArrayLike:
        """What the page draws on the ground: points of a line for each robot, shape (n, k, 2), inertial frame, m.

        NaN interrupts the line; k may change. One point is drawn in a ring, as a goal. The commands of a `base` are
        shown in its place.
        """
        raise NotImplementedError

    def click(self, robots: Robots, point: npt.NDArray[np.float64]) -> None:
        """Called with a click on the floor of the page, shape (2,), inertial frame, m: a goal for these robots."""
        raise NotImplementedError

    def reset(self, robots: Robots, chosen: npt.NDArray[np.intp], rngs: Sequence[np.random.Generator]) -> None:
        """Called when episodes begin: `robots` are the robots that begin one, `chosen` their numbers in the batch.

        Reset the task's memory of each robot (commands, counters) here. `rngs` are random number generators, one for
        each of these robots, seeded by the environments.
        """
