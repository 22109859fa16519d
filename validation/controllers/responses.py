"""Responses of a law to a motion and a setpoint step, and the tilts from which it recovers."""

from collections.abc import Mapping
from functools import cache
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

import ballbot_rs as bb
from ballbot_rs._state_rows import tilt_of
from ballbot_rs.analysis.settling import HOLD
from validation.closed_forms import holdable_tilt
from validation.controllers.planners import PLANNERS

#: The motion: from rest to rest, m, s. It uses 0.41 of the traction.
DISTANCE: Final = 0.5
MOVING: Final = 2.5
#: The step of the setpoint, m.
STEP: Final = 0.3
#: Simulated time of both, s.
SECONDS: Final = 4.0
#: Simulated time of the basin, s, and the tilt of a robot that has recovered, rad.
BASIN_SECONDS: Final = 15.0
_UPRIGHT: Final = np.radians(2.0)
#: Tilts of the basin, deg: the middles of rings.
RING: Final = 1.0
TILTS: Final = np.arange(0.5, 55.0, RING)
#: Directions: the wheels repeat after 120 deg.
SECTORS: Final = 24
#: Fall tilt, rad: a task's limit would cut off a part of the basin.
_FALLEN: Final = 1.0

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]


class Response(NamedTuple):
    """The ball's position along x, m, and the lean towards it, deg, at times, s."""

    times: Array
    position: Array
    lean: Array
    #: Position of the setpoint.
    reference: Array


class Measured(NamedTuple):
    """Contents of the figure of a law."""

    motion: Response
    #: None for a law that does not follow a position.
    step: Response | None
    #: Whether the robot recovers: tilts by directions.
    recovered: Mask


@cache
def measure(name: str) -> Measured:
    """The responses and the basin of a controller with its default options."""
    follows = "position" in bb.controllers()[name].setpoint_parts
    return Measured(_motion(name, follows), _step(name) if follows else None, _basin(name))


def _motion(name: str, follows: bool) -> Response:
    line = bb.Reference.line((DISTANCE, 0.0), MOVING)
    per_acceleration = 1.0 / bb.Scale.of(bb.Params.paper()).acceleration_per_lean

    def leaning(time: float) -> Mapping[str, object]:
        """The lean of the motion, for a law without other setpoints."""
        return {"tilt": (0.0, per_acceleration * line(time)["acceleration"][0])}

    done = bb.simulate(name, reference=line if follows else leaning, seconds=SECONDS)
    return _response(done, np.array([line(float(time))["position"][0] for time in done.times]))


def _step(name: str) -> Response:
    done = bb.simulate(name, reference={"position": (STEP, 0.0)}, seconds=SECONDS)
    return _response(done, np.full(len(done.times), STEP))


def _response(done: bb.Trajectory, reference: Array) -> Response:
    lean = np.degrees(done.of_states("tilt_components")[:, 1])
    return Response(done.times, done.of_states("ball_position")[:, 0], lean, reference)


def _basin(name: str) -> Mask:
    # Of planners only the edge of the basin is searched, in a third of the directions.
    if name not in PLANNERS:
        return recovers(name, *np.meshgrid(TILTS, _azimuths(SECTORS), indexing="ij"))
    some = _azimuths(SECTORS)[: SECTORS // 3]
    low, high = np.zeros(len(some), dtype=int), np.full(len(some), len(TILTS))
    while (high - low).max() > 1:
        middle = (low + high) // 2
        stands = recovers(name, TILTS[middle], some)
        low, high = np.where(stands, middle, low), np.where(stands, high, middle)
    return np.tile(np.arange(len(TILTS))[:, None] <= low, (1, 3))


def recovers(name: str, tilts: Array, azimuths: Array) -> Mask:
    """Whether the robot, released at rest at tilts (deg) towards azimuths (rad), is upright all the last second."""
    params = bb.Params.paper()
    control_dt = bb.controllers()[name].control_dt or 0.01
    batch = bb.Batch(
        tilts.size,
        num_threads=2,
        control_dt=control_dt,
        fall_tilt=_FALLEN,
        max_episode_steps=10**9,
        max_wheel_torque=params.max_wheel_torque,
    )
    leaning = np.radians(tilts.ravel())[:, None] * np.stack([-np.sin(azimuths), np.cos(azimuths)], -1).reshape(-1, 2)
    batch.reset(starts=[bb.State.at_equilibrium(params, tilt=lean) for lean in leaning])
    controller = bb.make_controller(name, params, control_dt)
    before = batch.rollout(controller, round((BASIN_SECONDS - HOLD) / control_dt), record=("terminated",))
    last = batch.rollout(controller, round(HOLD / control_dt), record=("terminated", "states"))
    upright = (tilt_of(last["states"], params.body_com) < _UPRIGHT).all(axis=0)
    fell = before["terminated"].any(axis=0) | last["terminated"].any(axis=0)
    recovered: Mask = (upright & ~fell).reshape(tilts.shape)
    return recovered


def bound() -> tuple[Array, Array]:
    """Azimuths, rad, and the largest tilts towards them at which traction can turn the robot back, deg."""
    third = np.degrees(holdable_tilt.largest_tilts(holdable_tilt.robot(bb.Params.paper().wheel_dynamic_friction)))
    azimuths = np.concatenate([holdable_tilt.AZIMUTHS + turn for turn in np.radians([0.0, 120.0, 240.0])])
    return azimuths, np.tile(third, 3)


def _azimuths(sectors: int) -> Array:
    return np.arange(sectors) * 2.0 * np.pi / sectors
