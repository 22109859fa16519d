"""The initial tilts from which a controller recovers: data of a map over tilt and azimuth."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import State
from ballbot_rs._progress import Progress, no_progress
from ballbot_rs._state_rows import tilt_of
from ballbot_rs.analysis.result import SETTLED_TILT
from ballbot_rs.analysis.rollout import batch_for, rollout
from ballbot_rs.analysis.settling import HOLD, recovery_times
from ballbot_rs.control.resolve import Source, common_options, common_task, find
from ballbot_rs.envs._batch_env import has_fall_tilt
from ballbot_rs.envs.family import first_of

#: Beyond this tilt (rad) the robot has fallen. The task's limit would decide half of the map.
FALLEN = 1.0


@dataclasses.dataclass(frozen=True)
class Recovery:
    """Outcome for a robot that starts at rest, for each initial tilt (rows) and azimuth (columns)."""

    controller: str
    model: str
    #: Initial tilts from the equilibrium, rad; equal to the tilts of the mast if the center of mass is on it.
    tilts: npt.NDArray[np.float64]
    #: Directions of these tilts, from the x axis, rad.
    azimuths: npt.NDArray[np.float64]
    #: Azimuths of the wheels, rad.
    wheel_azimuths: tuple[float, float, float]
    #: Whether the robot never fell.
    stood: npt.NDArray[np.bool_]
    #: Whether, in addition, its tilt stays within 1 deg from some time to the end, for at least 1 s.
    recovered: npt.NDArray[np.bool_]
    #: Time from which the tilt stays within 1 deg, s; NaN where it has not recovered.
    recovery_times: npt.NDArray[np.float64]
    #: Simulated time, s.
    seconds: float
    #: Torque of an action of 1, or the motors' limit of a feedback law, N·m.
    max_wheel_torque: float


def collect(
    controller: Source,
    *,
    max_tilt: float = 0.42,
    rings: int = 12,
    sectors: int = 24,
    seconds: float = 10.0,
    task: str | None = None,
    env_options: Mapping[str, Any] | None = None,
    num_threads: int | None = None,
    progress: Progress = no_progress,
) -> Recovery:
    """Releases a robot at every cell of a polar grid and checks whether it recovers.

    Args:
        controller: a name, a path or an object, as in `compare`.
        max_tilt: outer edge of the map, rad.
        rings: number of initial tilts, at the middle of as many equal rings.
        sectors: number of azimuths.
        seconds: simulated time. A start counts as recovered if the tilt stays within 1 deg from some time to the end,
            for at least 1 s. 10 s are enough for the classical controllers on the paper's robot; robots that stay
            upright without recovering are shown separately.
        task: name of the task, as in `compare`.
        env_options: options of the environment; they override the options that a policy was trained with.
        num_threads: threads that step the robots; None uses all cores.
        progress: called with the number of steps done and their total.

    Raises:
        ValueError: a number out of range, or as `compare`.
    """
    if not 0.0 < max_tilt < FALLEN:
        raise ValueError(f"max_tilt = {max_tilt} is out of range: it must be above 0 and below {FALLEN}")
    if rings < 1 or sectors < 3:
        raise ValueError(f"a map of {rings} rings and {sectors} sectors: it needs at least 1 and 3")
    if not seconds >= HOLD:
        raise ValueError(f"seconds = {seconds} is out of range: a robot must stay upright for {HOLD:g} s to recover")
    found = find(controller, task=task, env_options=env_options)
    # Episodes never end by time: robots that have fallen restart and are ignored from then on.
    named = common_task([found], task)
    options: dict[str, Any] = {**common_options([found], env_options), "max_episode_steps": None}
    if has_fall_tilt(named):
        options["fall_tilt"] = FALLEN
    if options.get("events"):
        raise ValueError("a recovery map is for one robot: it does not accept events")
    if "robot" in options:
        options["robot"] = first_of(options["robot"])
    batch = batch_for(
        found,
        rings * sectors,
        task=named,
        num_threads=num_threads,
        seed=0,
        options=options,
        given=env_options or (),
    )
    tilts = (np.arange(rings) + 0.5) * max_tilt / rings
    azimuths = np.arange(sectors) * 2 * np.pi / sectors
    # Leaning towards an azimuth is a rotation about the axis 90 deg ahead of it.
    leaning = [(-tilt * np.sin(azimuth), tilt * np.cos(azimuth)) for tilt in tilts for azimuth in azimuths]
    params = batch.params(0)
    starts = [batch.on_ground(State.at_equilibrium(params, tilt=components)) for components in leaning]
    steps = max(round(seconds / batch.control_dt), 1)
    standing = np.ones(batch.num_envs, dtype=bool)
    leans = np.empty((steps, batch.num_envs))
    for chunk in rollout(batch, found, steps, starts):
        end = chunk.first + len(chunk)
        leans[chunk.first : end] = tilt_of(chunk.states, params.body_com)
        standing &= ~chunk.terminated.any(axis=0)
        progress(end, steps)
    times = np.where(standing, recovery_times(leans, SETTLED_TILT, batch.control_dt), np.inf)
    recovered = np.isfinite(times)
    shape = (rings, sectors)
    return Recovery(
        controller=found.name,
        model=batch.model,
        tilts=tilts,
        azimuths=azimuths,
        wheel_azimuths=params.wheel_azimuths,
        stood=standing.reshape(shape),
        recovered=recovered.reshape(shape),
        recovery_times=np.where(recovered, times, np.nan).reshape(shape),
        seconds=seconds,
        max_wheel_torque=batch.max_wheel_torque,
    )
