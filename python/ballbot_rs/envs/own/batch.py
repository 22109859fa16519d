"""A batch of robots with a task in Python; the front ends use it as a `Batch`."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._arrays import read_only
from ballbot_rs._checks import real_array
from ballbot_rs._core import Batch, State
from ballbot_rs._errors import InvalidInputError
from ballbot_rs.envs.own.robots import COLUMNS, Robots
from ballbot_rs.envs.own.task import Task, checked

FloatArray = npt.NDArray[np.float32]
BoolArray = npt.NDArray[np.bool_]

#: More steps than an episode can have: 248 days at the default control rate.
NO_TIME_LIMIT: Final = 2**31

#: The task of the core that observes everything and commands nothing.
BARE: Final = "bare"

#: Reasons for the end of an episode with their conditions: the core's, and last the task's.
REASONS: Final = (
    ("tilt", "never"),
    ("bot_on_floor", "the body or a wheel touches the floor"),
    ("diverged", "the state left the bounds of the simulation"),
    ("task", "the method `terminated` of the task says so"),
)


class OwnBatch:
    """`num_envs` robots with a `Task`.

    All other attributes come from the robots' `Batch`: states, contacts, readings, parameters, draws, pushes.
    """

    def __init__(
        self,
        num_envs: int,
        task: str,
        made: Task,
        *,
        autoreset: str,
        num_threads: int | None,
        seed: int,
        options: Mapping[str, Any],
        own_options: Mapping[str, Any],
    ) -> None:
        steps = NO_TIME_LIMIT if made.max_episode_steps is None else made.max_episode_steps
        options = {"max_episode_steps": steps, **options}
        if options.get("history", 1) != 1:
            raise InvalidInputError("history of a task in Python must be 1: its `observe` keeps what it needs")
        if options.setdefault("scale_observations", False):
            raise InvalidInputError("scale_observations of a task in Python must be False: its `observe` scales")
        for instrument in ("scan", "depth"):
            if options.get(instrument) is not None:
                raise InvalidInputError(f"{instrument}: a task in Python has none")
        fall_tilt = options.pop("fall_tilt", None)
        inner_reset = "next_step" if autoreset == "next_step" else "disabled"
        self._inner: Any = Batch(num_envs, BARE, autoreset=inner_reset, num_threads=num_threads, seed=seed, **options)
        if fall_tilt not in (None, self._inner.options["fall_tilt"]):
            raise InvalidInputError("fall_tilt: the method `terminated` of a task in Python defines a fall")
        self._own_options = dict(own_options)
        self.task = task
        self.made = made
        self.autoreset = autoreset
        self.num_envs = num_envs
        self.history = 1
        self.scale_observations = False
        self._sensed = self._inner.options["observation"] == "sensors"
        self._drawn = bool(self._inner.options.get("events"))
        self._has_reset = type(made).reset is not Task.reset
        self._has_success = type(made).success is not Task.success
        self._seeds: list[int] = [(seed + i) % 2**64 for i in range(num_envs)]
        self._rngs: list[np.random.Generator | None] = [None] * num_envs
        self._steps = np.zeros(num_envs, dtype=np.int64)
        self._over = np.ones(num_envs, dtype=bool)
        self._stopped = np.zeros(num_envs, dtype=bool)
        self._numbers = np.arange(num_envs)
        self._com = self._com_of(range(num_envs))
        self._rewards = np.zeros(num_envs)
        self._success = np.zeros(num_envs, dtype=bool)
        self._reasons = np.zeros(num_envs, dtype=np.int64)
        self._truncated = np.zeros(num_envs, dtype=bool)
        # Robots at rest show what `observe` returns, without an episode.
        rows = np.zeros((num_envs, self._inner.observation_len), dtype=np.float32)
        rows[:, COLUMNS["gravity"]] = (0.0, 0.0, -1.0)
        rows[:, COLUMNS["body_quaternion"]] = (1.0, 0.0, 0.0, 0.0)
        robots = self._robots(rows)
        if self._has_reset:
            made.reset(robots, self._numbers, [np.random.default_rng(i) for i in range(num_envs)])
        width = real_array(f"{type(made).__name__}.observe returned", made.observe(robots), "numbers")
        if width.ndim != 2 or width.shape[0] != num_envs or width.shape[1] == 0:
            raise InvalidInputError(
                f"{type(made).__name__}.observe returned shape {width.shape}, expected ({num_envs}, k): a row a robot"
            )
        self.observation_len = width.shape[1]
        #: As `Batch.observation_layout`.
        self.observation_layout: dict[str, tuple[int, ...]] = {"state": (self.observation_len,)}
        self._observations: FloatArray = np.zeros((num_envs, self.observation_len), dtype=np.float32)
        self._final: FloatArray = self._observations.copy()
        bound = real_array(f"observation_bound of {type(made).__name__} is", made.observation_bound, "numbers")
        try:
            bound = np.broadcast_to(bound.astype(np.float32), (self.observation_len,))
        except ValueError:
            shape, wanted = np.shape(made.observation_bound), (self.observation_len,)
            raise InvalidInputError(
                f"observation_bound of {type(made).__name__} has shape {shape}, expected () or {wanted}"
            ) from None
        if not (np.isfinite(bound) & (bound > 0.0)).all():
            raise InvalidInputError(f"observation_bound of {type(made).__name__} must be finite and above 0")
        #: Bounds of the columns of observations.
        self.bound: FloatArray = read_only(bound.copy())

    @property
    def options(self) -> dict[str, Any]:
        """As `Batch.options`, with the options of the task's constructor."""
        return {**self._inner.options, **self._own_options}

    def replace_robots(self, make: Callable[[Any], Any]) -> None:
        """Replaces the robots' `Batch` by the result of `make` for it."""
        self._inner = make(self._inner)

    def command(self, index: int | None = None) -> npt.NDArray[np.float64]:
        """No command: tasks in Python keep their own commands."""
        return np.zeros((0,) if index is not None else (self.num_envs, 0))

    def set_command(self, index: int, command: npt.ArrayLike) -> None:  # noqa: ARG002
        """As `Batch.set_command`.

        Raises:
            ValueError: always.
        """
        raise InvalidInputError(f"the task {self.task} has no command")

    def __getattr__(self, name: str) -> Any:
        # Not during construction or unpickling.
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self._inner, name)

    def __repr__(self) -> str:
        return f"OwnBatch({self.num_envs}, '{self.task}', {type(self.made).__name__})"

    def _seed_again(self, seeds: Sequence[int | None]) -> None:
        for i, seed in enumerate(seeds):
            if seed is not None:
                self._seeds[i], self._rngs[i] = int(seed), None

    def _rng(self, i: int) -> np.random.Generator:
        found = self._rngs[i]
        if found is None:
            found = self._rngs[i] = np.random.default_rng(self._seeds[i])
        return found

    def _com_of(self, chosen: Sequence[int] | range) -> npt.NDArray[np.float64]:
        return np.array([self._inner.params(i).body_com for i in chosen], dtype=np.float64).reshape(len(chosen), 3)

    def _note_com(self, chosen: Sequence[int]) -> None:
        # Not in place: robots that a task has kept stay unchanged.
        self._com = self._com.copy()
        self._com[chosen] = self._com_of(chosen)

    def set_params(self, index: int, params: Any) -> None:
        """As `Batch.set_params`."""
        self._inner.set_params(index, params)
        self._note_com([index])

    def _robots(self, rows: FloatArray) -> Robots:
        return Robots(rows, self._com, self._steps, self._numbers, self._inner.control_dt)

    def _observe(self, robots: Robots) -> FloatArray:
        shape = (len(robots), self.observation_len)
        seen = checked(self.made, "observe", self.made.observe(robots), shape, None)
        # Before the conversion to float32, which may overflow.
        clipped: FloatArray = np.clip(seen, -self.bound, self.bound).astype(np.float32)
        return clipped

    def _begin(self, rows: FloatArray, chosen: npt.NDArray[np.intp], seen: FloatArray) -> None:
        """Begins the episodes of placed robots, and writes their observations into `seen`.

        If a method of the task raises, the episodes are over and have to begin again.
        """
        self._over[chosen] = self._stopped[chosen] = True
        self._steps = self._steps.copy()
        self._steps[chosen] = 0
        if self._drawn:
            self._note_com(chosen.tolist())
        robots = self._robots(rows)[chosen]
        if self._has_reset:
            self.made.reset(robots, read_only(chosen), [self._rng(i) for i in chosen.tolist()])
        seen[chosen] = self._observe(robots)
        self._over[chosen] = self._stopped[chosen] = False

    def reset(
        self,
        mask: BoolArray | None = None,
        seeds: Sequence[int | None] | None = None,
        starts: Sequence[State | None] | None = None,
    ) -> FloatArray:
        """As `Batch.reset`."""
        rows = self._inner.reset(mask, seeds, starts)
        if seeds is not None:
            self._seed_again(seeds)
        chosen = np.flatnonzero(np.ones(self.num_envs, dtype=bool) if mask is None else mask)
        self._rewards[chosen] = 0.0
        self._success[chosen] = False
        self._reasons[chosen] = 0
        self._truncated[chosen] = False
        seen: FloatArray = self._observations.copy()
        self._begin(rows, chosen, seen)
        self._observations = seen.copy()
        return seen

    def step(self, actions: npt.ArrayLike) -> tuple[FloatArray, npt.NDArray[np.float64], BoolArray, BoolArray]:
        """As `Batch.step`."""
        before = self._over.copy()
        if self.autoreset != "next_step" and before.any():
            i = int(np.argmax(before))
            raise InvalidInputError(
                f"the episode of environment {i} is over (or has not begun): reset it before it is stepped"
            )
        late = before & self._stopped
        rows, _, fallen, truncated = self._inner.step(actions)
        # Until the task has judged the step: if one of its methods raises, these begin again.
        self._over |= fallen | truncated
        self._stopped |= before
        self._steps = self._steps + 1
        robots = self._robots(rows)
        true = self._robots(self._inner.privileged_observations()) if self._sensed else robots
        shape = (self.num_envs,)
        rewards = checked(self.made, "reward", self.made.reward(true), shape, np.float64).copy()
        ended_by_task = checked(self.made, "terminated", self.made.terminated(true), shape, np.bool_)
        seen = self._observe(robots)
        # The core knows that the others are over.
        stopped = ended_by_task & ~fallen & ~truncated
        terminated = fallen | ended_by_task
        truncated = truncated & ~terminated
        if self.autoreset == "next_step" and before.any():
            # Instead of a step these robots began an episode: robots that the task had stopped are placed now.
            terminated, truncated, rewards = terminated & ~before, truncated & ~before, np.where(before, 0.0, rewards)
            if late.any():
                rows = self._inner.reset(late)
            self._begin(rows, np.flatnonzero(before), seen)
        ended = terminated | truncated
        self._rewards = rewards
        self._truncated = truncated
        self._success = np.zeros(shape, dtype=bool)
        self._reasons = np.zeros(shape, dtype=np.int64)
        if self._has_success:
            won = checked(self.made, "success", self.made.success(true), shape, np.bool_)
            self._success = won & ~fallen & ~before
        if ended.any():
            self._reasons = np.where(fallen, self._inner.endings()[1], np.where(terminated, len(REASONS), 0))
            self._final = seen.copy()
            if self.autoreset == "same_step":
                self._begin(self._inner.reset(ended), np.flatnonzero(ended), seen)
            else:
                self._over |= ended
                self._stopped |= stopped & ended
        self._observations = seen.copy()
        return seen, rewards, terminated, truncated

    def observations(self) -> FloatArray:
        """As `Batch.observations`."""
        seen: FloatArray = self._observations.copy()
        return seen

    def privileged_observations(self, index: int | None = None) -> FloatArray:
        """As `Batch.privileged_observations`."""
        seen = self._observe(self._robots(self._inner.privileged_observations()))
        row: FloatArray = seen if index is None else seen[index]
        return row

    def final_observations(self) -> FloatArray:
        """As `Batch.final_observations`."""
        last: FloatArray = self._final.copy()
        return last

    def endings(self) -> tuple[BoolArray, npt.NDArray[np.int64]]:
        """As `Batch.endings`."""
        return self._success.copy(), self._reasons.copy()

    def ending(self, index: int) -> tuple[bool, str | None]:
        """As `Batch.ending`."""
        reason = int(self._reasons[index])
        return bool(self._success[index]), REASONS[reason - 1][0] if reason else None

    def reward_terms(self, index: int | None = None) -> Any:
        """The reward, as its only term."""
        return self._rewards[:, np.newaxis].copy() if index is None else {"reward": float(self._rewards[index])}

    def rollout(self, *_: Any, **__: Any) -> None:
        """Not available: the core does not know the rewards and ends of a task in Python.

        Raises:
            TypeError: always.
        """
        raise TypeError(f"the task {self.task} is in Python: step its robots one step at a time")

    def infos(self) -> list[dict[str, Any]]:
        """As `Batch.infos`."""
        parts = (self._truncated.tolist(), self._success.tolist(), self._reasons.tolist())
        infos: list[dict[str, Any]] = [
            {"TimeLimit.truncated": truncated, "is_success": success, "termination": reason}
            for truncated, success, reason in zip(*parts, strict=True)
        ]
        for i in np.flatnonzero((self._reasons > 0) | self._truncated).tolist():
            infos[i]["terminal_observation"] = self._final[i].copy()
        return infos

    def snapshot(self, index: int) -> bytes:
        """As `Batch.snapshot`, without the memory of the task itself."""
        inner: bytes = self._inner.snapshot(index)
        flags = int(self._over[index]) | int(self._stopped[index]) << 1
        return int(self._steps[index]).to_bytes(8, "little") + bytes([flags]) + inner

    def restore(self, index: int, snapshot: bytes) -> None:
        """As `Batch.restore`."""
        self._inner.restore(index, snapshot[9:])
        self._steps = self._steps.copy()
        self._steps[index] = int.from_bytes(snapshot[:8], "little")
        self._over[index], self._stopped[index] = bool(snapshot[8] & 1), bool(snapshot[8] & 2)
        self._note_com([index])
        rows = self._inner.observations()
        self._observations[index] = self._observe(self._robots(rows)[np.array([index])])[0]

    def memory(self) -> tuple[Any, ...]:
        """State of the task and its random numbers, to continue from after `restore`."""
        return self.made, list(self._seeds), list(self._rngs)

    def remember(self, memory: tuple[Any, ...]) -> None:
        """Continues from a result of `memory`."""
        self.made, self._seeds, self._rngs = memory
