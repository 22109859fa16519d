"""How far a controller can be tilted, and how hard it can be pushed."""

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

import ballbot_rs as bb
from ballbot_rs._state_rows import tilt_of
from ballbot_rs.analysis import recovery_map
from validation.page import table

#: Tilts of the maps, deg, and the largest.
RING: Final = 0.5
MAX_TILT: Final = 34.0
#: Impulses, N·s, and the largest.
IMPULSE: Final = 0.05
MAX_IMPULSE: Final = 3.5
#: Directions.
SECTORS: Final = 24
#: Time to recover in, s, and the tilt that is upright, rad.
SECONDS: Final = 6.0
UPRIGHT: Final = np.radians(2.0)

Array = npt.NDArray[np.float64]


class Stood(NamedTuple):
    """What a controller stands, in each direction."""

    #: deg.
    tilt: Array
    #: N·s.
    at_once: Array
    slow: Array


def measure(controller: bb.Controller) -> Stood:
    """The basin, and pushes at once and in 0.1 s."""
    return Stood(basin(controller), pushes(controller, 0.0), pushes(controller, 0.1))


def side_by_side(what: str, stood: Mapping[str, Stood]) -> str:
    """A table of the worst and the mean over all directions."""
    head = [what]
    for column in ("tilt, worst (deg)", "push at once, worst (N·s)", "push in 0.1 s, worst (N·s)"):
        head += [column, "mean"]
    rows = [
        [name, *(f"{value:.2f}" for of in found for value in (of.min(), of.mean()))] for name, found in stood.items()
    ]
    return table(head, rows)


def basin(controller: bb.Controller) -> Array:
    """The tilt from which the robot recovers, let go at rest, and from all smaller ones, in each direction, deg."""
    found = recovery_map.collect(
        controller,
        max_tilt=float(np.radians(MAX_TILT)),
        rings=round(MAX_TILT / RING),
        sectors=SECTORS,
        seconds=SECONDS,
        num_threads=2,
    )
    # Tilts are in the middle of the rings.
    return RING * (_first_failures(found.recovered) - 0.5)


def pushes(controller: bb.Controller, duration: float) -> Array:
    """The impulse at the center of mass that the upright robot stands, and all smaller ones, in each direction, N·s.

    The impulse is given at once (`duration` = 0), or along a half sine at each of the control steps in `duration`, s.
    """
    sizes = np.arange(1, round(MAX_IMPULSE / IMPULSE) + 1) * IMPULSE
    azimuths = np.arange(SECTORS) * 2.0 * np.pi / SECTORS
    directions = np.stack([np.cos(azimuths), np.sin(azimuths), np.zeros(SECTORS)], axis=-1)
    impulses = (sizes[:, None, None] * directions).reshape(-1, 3)
    torque = bb.Params.paper().max_wheel_torque
    batch = bb.Batch(len(impulses), num_threads=2, fall_tilt=1.0, max_episode_steps=10**9, max_wheel_torque=torque)
    upright = bb.State.at_rest(bb.Params.paper())
    batch.reset(starts=[upright] * len(impulses))
    count = max(round(duration / batch.control_dt), 1)
    # These shares of a half sine sum to one.
    shares = np.sin((np.arange(count) + 0.5) * np.pi / count) * np.sin(0.5 * np.pi / count)
    fallen = np.zeros(len(impulses), dtype=bool)
    for share in shares:
        for i in np.flatnonzero(~fallen).tolist():
            batch.push(i, share * impulses[i])
        fallen |= batch.rollout(controller, 1, record=("terminated",))["terminated"].any(axis=0)
    left = batch.rollout(controller, round(SECONDS / batch.control_dt), record=("terminated", "states"))
    fallen |= left["terminated"].any(axis=0)
    stands = ~fallen & (tilt_of(left["states"][-1:], bb.Params.paper().body_com)[0] < UPRIGHT)
    return IMPULSE * _first_failures(stands.reshape(len(sizes), SECTORS))


def _first_failures(passed: npt.NDArray[np.bool_]) -> Array:
    """How many rows of each column pass before the first that does not."""
    failed = ~passed
    return np.where(failed.any(axis=0), failed.argmax(axis=0), len(passed)).astype(np.float64)
