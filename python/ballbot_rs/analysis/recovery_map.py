"""From which initial tilts a controller recovers: the data of a map over tilt and azimuth."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import State
from ballbot_rs._progress import Progress
from ballbot_rs.control.resolve import Controller, common_options, find
from ballbot_rs.envs.registration import BALANCE

#: Beyond this tilt (rad) the robot has fallen: not the task's limit, which would decide about half of the map.
FALLEN = 1.0
#: Within this tilt (rad) the robot has settled.
SETTLED = np.deg2rad(1.0)


@dataclasses.dataclass(frozen=True)
class Recovery:
    """What became of a robot that starts at rest, for each initial tilt (rows) and azimuth (columns)."""

    controller: str
    model: str
    #: Angle of the mast from the vertical, rad.
    tilts: npt.NDArray[np.float64]
    #: Direction towards which the mast leans, from the x axis, rad.
    azimuths: npt.NDArray[np.float64]
    #: Azimuths of the wheels, rad.
    wheel_azimuths: tuple[float, float, float]
    #: Whether the robot never fell.
    stood: npt.NDArray[np.bool_]
    #: Whether, besides, its tilt is within 1 deg at the end.
    recovered: npt.NDArray[np.bool_]
    #: Time from which the tilt stays within 1 deg, s; NaN where it has not recovered.
    settling_times: npt.NDArray[np.float64]
    #: Simulated time, s.
    seconds: float


def collect(
    controller: str | Controller,
    *,
    max_tilt: float = 0.42,
    rings: int = 12,
    sectors: int = 24,
    seconds: float = 5.0,
    env_id: str = BALANCE,
    env_options: Mapping[str, Any] | None = None,
    num_threads: int | None = None,
    progress: Progress | None = None,
) -> Recovery:
    """Lets go of a robot at every cell of a polar grid and sees whether it recovers.

    Args:
        controller: a name or a path, as `controllers.find` takes it.
        max_tilt: outer edge of the map, rad.
        rings: number of initial tilts, at the middle of as many equal rings.
        sectors: number of azimuths.
        seconds: time to recover in.
        env_id: the task.
        env_options: arguments of the environment, over those that a policy was trained with.
        num_threads: threads that step the robots; None takes all cores.
        progress: told how many of how many steps are done.

    Raises:
        ValueError: a number out of range, or as `controllers.find`.
    """
    if not 0.0 < max_tilt < FALLEN:
        raise ValueError(f"max_tilt = {max_tilt} is out of range: it must be above 0 and below {FALLEN}")
    if rings < 1 or sectors < 3:
        raise ValueError(f"a map of {rings} rings and {sectors} sectors: it needs at least 1 and 3")
    found = find(controller, env_id) if isinstance(controller, str) else controller
    # Episodes never end by time: those that have fallen start anew and are not looked at any more.
    options = {**common_options([found], env_options), "fall_tilt": FALLEN, "max_episode_steps": 10_000_000}
    batch = found.batch(rings * sectors, num_threads, 0, options)
    act = found.on(batch)
    tilts = (np.arange(rings) + 0.5) * max_tilt / rings
    azimuths = np.arange(sectors) * 2 * np.pi / sectors
    # Leaning towards an azimuth is a rotation about the axis 90 deg ahead of it.
    leaning = [(-tilt * np.sin(azimuth), tilt * np.cos(azimuth)) for tilt in tilts for azimuth in azimuths]
    observations = batch.reset(starts=[State.upright(batch.params, tilt=components) for components in leaning])
    steps = max(round(seconds / batch.control_dt), 1)
    standing = np.ones(batch.num_envs, dtype=bool)
    last_outside = np.zeros(batch.num_envs)
    for step in range(steps):
        observations, _, terminated, _ = batch.step(np.asarray(act(observations), dtype=np.float32))
        standing &= ~terminated
        # The third row is the direction of gravity along the mast.
        outside = observations[:, 2] > -np.cos(SETTLED)
        last_outside[outside] = step + 1
        if progress is not None:
            progress(step + 1, steps)
    recovered = standing & (last_outside < steps)
    shape = (rings, sectors)
    return Recovery(
        controller=found.name,
        model=batch.model,
        tilts=tilts,
        azimuths=azimuths,
        wheel_azimuths=batch.params.wheel_azimuths,
        stood=standing.reshape(shape),
        recovered=recovered.reshape(shape),
        settling_times=np.where(recovered, last_outside * batch.control_dt, np.nan).reshape(shape),
        seconds=seconds,
    )
