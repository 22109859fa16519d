"""Many robots under one controller, and only what a study needs of their motions."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt
from typing_extensions import Unpack

from ballbot_rs._arrays import read_only
from ballbot_rs._checks import check_bounded, check_count, check_seed, did_you_mean, real_array, seed_at
from ballbot_rs._core import Batch, Params, State
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._keywords import named
from ballbot_rs._progress import Progress, no_progress
from ballbot_rs.analysis import exports
from ballbot_rs.analysis.actors import core_law, make_actor
from ballbot_rs.analysis.closed_loop import CONTACTS, ClosedLoop
from ballbot_rs.analysis.records import RECORDS, KeptRows
from ballbot_rs.analysis.result import SETTLED_TILT
from ballbot_rs.analysis.rollout import batch_for
from ballbot_rs.analysis.settling import settling_times
from ballbot_rs.analysis.simulate import check_tilt, simulated_seconds, with_given_starts
from ballbot_rs.control.resolve import Source, common_options, common_task, find
from ballbot_rs.envs.family import check_room
from ballbot_rs.envs.options import TaskOptions

Array = npt.NDArray[Any]

#: True robots, while the controller is designed for another: `Params` of each, or values of parameters by name.
OwnRobots: TypeAlias = Sequence[Params] | Mapping[str, npt.ArrayLike]

#: Memory of the rows that are not thinned out yet, bytes.
_CHUNK: Final = 1 << 26

#: Most numbers of all records: 16 GB as float32.
MAX_NUMBERS: Final = 4 * 10**9


@dataclasses.dataclass(frozen=True, repr=False)
class Rollout:
    """Many robots under one controller.

    ```python
    found = bb.rollout("lqr", 100, events="mild", seconds=2.0, record=["tilt"], every=10)
    print(found["tilt"].max(axis=0), found.fell_at)
    ```

    Its arrays are read-only; `rollout["tilt"]` is a record.

    A robot that falls, diverges or reaches the edge of the ground is frozen: its later rows repeat its last row.
    """

    controller: str
    model: str
    #: Of the rows, s, shape (k,).
    times: Array
    #: Records by name, shape (k, n), or (k, n, numbers) of vectors; torques and contacts as in `Batch.rollout`.
    records: Mapping[str, Array]
    #: Time at which each robot fell or diverged, s, shape (n,); NaN if it did not.
    fell_at: Array
    #: Time at which the episode of each robot ended in another way, s, shape (n,); NaN if it ran to the end.
    ended_at: Array

    @property
    def upright(self) -> npt.NDArray[np.bool_]:
        """Which robots neither fell nor diverged, shape (n,)."""
        return np.isnan(self.fell_at)

    def __getitem__(self, name: str) -> Array:
        if name not in self.records:
            known = ", ".join(self.records)
            raise KeyError(f"'{name}' was not recorded, only {known}: name it in record=")
        return self.records[name]

    def __repr__(self) -> str:
        fell = int((~self.upright).sum())
        return (
            f"<Rollout of {self.controller} on {self.model}: {len(self.fell_at)} robots, {self.times[-1]:g} s, "
            f"{', '.join(self.records)} in {len(self.times)} rows, {fell} fell>"
        )

    def settling_times(self, tilt: float = SETTLED_TILT) -> Array:
        """Time from which the tilt of each robot stays within a limit, s, shape (n,); infinite where it does not.

        A time is exact to a row: with `every=10`, to ten control steps.

        Args:
            tilt: the limit, rad.

        Raises:
            KeyError: the record has no "tilt".
            ValueError: a limit that is not from 0 to pi.
        """
        tilt = check_bounded("tilt", tilt, 0.0, math.pi)
        dt = float(self.times[1]) if len(self.times) > 1 else 1.0
        found = settling_times(self["tilt"], tilt, dt)
        return np.where(self.upright & np.isnan(self.ended_at), found, np.inf)

    def to_npz(self, path: str | PathLike[str]) -> None:
        """Writes `times`, `fell_at`, `ended_at` and the records, compressed, for `numpy.load`.

        Raises:
            ValueError: a suffix other than .npz.
            OSError: the file cannot be written; an earlier one stays as it is.
        """
        own = {"times": self.times, "fell_at": self.fell_at, "ended_at": self.ended_at}
        exports.write_npz({**own, **self.records}, path)


@named
def rollout(
    controller: Source,
    num_robots: int | None = None,
    *,
    robots: OwnRobots | None = None,
    seconds: float | None = None,
    tilt: npt.ArrayLike | None = None,
    record: Sequence[str] = ("ball_position", "tilt"),
    every: int = 1,
    dtype: npt.DTypeLike = np.float32,
    task: str | None = None,
    seed: int = 0,
    num_threads: int | None = None,
    progress: Progress = no_progress,
    **options: Unpack[TaskOptions],
) -> Rollout:
    """Runs a controller on many robots at once and keeps only the named records, for studies with thousands of robots.

    ```python
    masses = np.random.default_rng(0).normal(2.2, 0.2, 100)
    found = bb.rollout("lqr", robots={"body_mass": masses}, tilt=(0.05, 0.0), seconds=2.0, every=10)
    print(found.upright.mean(), np.median(found.settling_times()))
    ```

    Args:
        controller: a name, a path, or a law or class of laws in Python, as in `compare`.
        num_robots: their number; None is the number of `robots`.
        robots: the true robots, unknown to the controller: `Params` of each, or arrays by parameter, as
            {"body_mass": masses}, shape (n,), or (n, numbers) for a vector; all else is as in `robot`, for which
            the controller is designed.
        seconds: simulated time; None is 5 s.
        tilt: from the equilibrium, at rest, components (x, y), rad, shape (2,) or (n, 2); None samples starts.
        record: names: "tilt" (rad) and "tilt_components" from the equilibrium, "states" or attributes of `State` as
            "ball_position", "torques", "wheel_normal_forces", "wheel_tractions", "wheel_slip_speeds".
        every: control steps from a row to the next.
        dtype: of the records, a type of real numbers.
        task: name of the task, as in `compare`.
        seed: of the first robot; robot i has the random numbers of seed + i.
        num_threads: threads that step the robots; None uses all cores.
        progress: called with the number of control steps done and their total.
        options: as in `simulate`; `events` are sampled for each robot.

    Raises:
        ValueError: a number out of range, an unknown record, robots of another number, invalid parameters of a robot,
            or as `compare`.
        TypeError: an argument of the wrong type or of an unknown name.
        ControllerError: a controller in Python failed.
        MemoryError: the records need more memory than is available.
    """
    given = dict(options)
    names, kind = _checked_records(record), _real_type(dtype)
    every, seed = check_count("every", every), check_seed(seed)
    count = _count(num_robots, robots)
    check_room(given.get("robot"), count)
    time = simulated_seconds(seconds)
    found = find(controller, task=task, env_options=given)
    # Only a fall ends the motion; the rows after it are not kept.
    env_options = {**common_options([found], given), "max_episode_steps": None}
    named = common_task([found], task)
    if tilt is not None:
        check_tilt(tilt)
        env_options = with_given_starts(env_options, named)
    batch = batch_for(
        found,
        count,
        task=named,
        num_threads=num_threads,
        seed=seed,
        options=env_options,
        given=given,
    )
    steps = max(round(time / batch.control_dt), 1)
    kept = steps // every + 1
    if kept * count * len(names) > MAX_NUMBERS:
        raise InvalidInputError(
            f"{len(names)} records of {count} robots at {kept} rows are more than {MAX_NUMBERS} numbers: name fewer in "
            "record, or a larger every"
        )
    # Before the robots become others: it is designed for the nominal robot.
    loop = ClosedLoop(batch, core_law(found, batch) or make_actor(found, batch))
    if robots is not None:
        _set_robots(batch, robots)
    seeds = [seed_at(seed, i) for i in range(count)]
    loop.reset(seeds=seeds)
    if tilt is not None:
        loop.reset(seeds=seeds, starts=_starts(batch, tilt))
    kept_rows = KeptRows(names, kind, kept, every, np.array([batch.params(i).body_com for i in range(count)]))
    recorded = ("states", "terminated", "truncated", *(name for name in names if name in (*CONTACTS, "torques")))
    at_once = max(_CHUNK // (count * 8 * 32), 1)
    for first in range(0, steps, at_once):
        length = min(at_once, steps - first)
        kept_rows.add(loop.rows(length, recorded), first, is_last=first + length == steps)
        progress(first + length, steps)
    return Rollout(
        controller=found.name,
        model=batch.model,
        times=read_only(np.arange(kept) * every * batch.control_dt),
        records={name: read_only(values) for name, values in kept_rows.values.items()},
        fell_at=read_only(kept_rows.fell * batch.control_dt),
        ended_at=read_only(kept_rows.ended * batch.control_dt),
    )


def _checked_records(record: Sequence[str]) -> list[str]:
    if isinstance(record, (str, bytes)):
        raise TypeError(f"record = {record!r}: expected a list of names, as [{record!r}]")
    names = list(record)
    for name in names:
        if name not in RECORDS:
            close = did_you_mean(str(name), RECORDS) or f": expected one of {', '.join(RECORDS)}"
            raise InvalidInputError(f"record: unknown name '{name}'{close}")
        if names.count(name) > 1:
            raise InvalidInputError(f"record has '{name}' twice")
    return names


def _real_type(dtype: npt.DTypeLike) -> np.dtype[Any]:
    try:
        kind = np.dtype(dtype)
    except TypeError:
        raise TypeError(f"dtype = {dtype!r} is not a type of numbers: expected float32, float64 or float16") from None
    if kind.kind != "f":
        raise InvalidInputError(f"dtype = {kind} is not a type of real numbers: expected float32, float64 or float16")
    return kind


def _count(num_robots: int | None, robots: OwnRobots | None) -> int:
    """The number of robots."""
    found: dict[str, int] = {}
    if num_robots is not None:
        found["num_robots"] = check_count("num_robots", num_robots)
    if isinstance(robots, Mapping):
        for name, values in robots.items():
            array = real_array(f"robots['{name}'] is", values, "numbers of each robot")
            if array.ndim == 0:
                raise InvalidInputError(f"robots['{name}'] = {values!r}: expected one value of each robot")
            found[f"robots['{name}']"] = len(array)
    elif robots is not None:
        if not isinstance(robots, Sequence) or not all(isinstance(one, Params) for one in robots):
            raise TypeError("robots must be a list of Params, or arrays by the name of a parameter")
        found["robots"] = len(robots)
    if not found:
        raise TypeError("give the number of robots, num_robots=, or the robots, robots=")
    (first, count), *others = found.items()
    for name, other in others:
        if other != count:
            raise InvalidInputError(f"{first} has {count} robots, but {name} has {other}")
    return check_count(first, count)


def _set_robots(batch: Batch, robots: OwnRobots) -> None:
    if not isinstance(robots, Mapping):
        for i, one in enumerate(robots):
            batch.set_params(i, one)
        return
    nominal = batch.nominal_params(0)
    for i in range(batch.num_envs):
        values = {name: np.asarray(of)[i].tolist() for name, of in robots.items()}
        try:
            batch.set_params(i, nominal.replace(**values))
        except ValueError as error:
            raise InvalidInputError(f"robot {i} of robots: {error}") from error


def _starts(batch: Batch, tilt: npt.ArrayLike) -> list[State]:
    array = real_array("tilt is", tilt, "components (x, y)")
    if array.shape not in ((2,), (batch.num_envs, 2)):
        raise InvalidInputError(f"tilt has the shape {array.shape}: expected (2,) or ({batch.num_envs}, 2)")
    tilts = np.broadcast_to(array, (batch.num_envs, 2)).tolist()
    return [batch.on_ground(State.at_equilibrium(batch.params(i), tilt=one), i) for i, one in enumerate(tilts)]
