"""Rows of a trajectory as frames of the scene."""

from typing import Final

import numpy as np
import numpy.typing as npt

from ballbot_rs.analysis.trajectory import Trajectory
from ballbot_rs.envs.registration import geometry_of
from ballbot_rs.viewer.session.recording import Commands, Frame

Array = npt.NDArray[np.float64]

#: Name of the robot in its frames: a trajectory has parameters only.
ROBOT: Final = "robot"


def rows_at(times: Array, frame_rate: float) -> list[int]:
    """The rows nearest to the times of frames, each once, and the last row.

    Args:
        times: of the rows, s, increasing.
        frame_rate: frames per second.
    """
    moments = np.arange(times[0], times[-1], 1.0 / frame_rate)
    # Rounding may place a moment behind the last row.
    after = np.minimum(np.searchsorted(times, moments), len(times) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(moments - times[before] < times[after] - moments, before, after)
    return sorted({*nearest.tolist(), len(times) - 1})


def frame_of(trajectory: Trajectory, row: int) -> Frame:
    """A row as the scene shows it."""
    commands = _commands(trajectory, row)
    places = trajectory.setpoints.get("position")
    return Frame(
        robot=ROBOT,
        time=float(trajectory.times[row]),
        states=trajectory.states[row].to_array()[np.newaxis],
        torques=trajectory.torques[row : row + 1],
        # Only plots of the page show it.
        tilt=np.zeros(2),
        estimated_tilt=None,
        contacts=trajectory.contacts[row],
        params=trajectory.params,
        loads=[(trajectory.params, trajectory.payloads[row])] if len(trajectory.payloads) else [],
        setpoint=None if commands is not None or places is None else places[row],
        commands=commands,
        terrain=trajectory.terrain,
    )


def reference_of(trajectory: Trajectory) -> Array | None:
    """The curve of a setpoint that moves, m, shape (n, 2); None if it rests or follows from the task's command."""
    places = trajectory.setpoints.get("position")
    if places is None or _commands(trajectory, 0) is not None or not np.ptp(places, axis=0).any():
        return None
    return places


def _commands(trajectory: Trajectory, row: int) -> Commands | None:
    """The task's command at a row; after a fall, the last one."""
    count, geometry = len(trajectory.commands), geometry_of(trajectory.task)
    if not count or geometry is None:
        return None
    values = trajectory.commands[min(row, count - 1)]
    places = trajectory.setpoints.get("position")
    # A recording of the page has no setpoints in this task.
    if places is None and geometry not in ("velocity", "point"):
        return None
    return Commands(
        task=trajectory.task,
        values=values[np.newaxis],
        begins=trajectory.states[0].ball_position[np.newaxis, :2],
        points=(values[:2] if places is None else places[row])[np.newaxis],
        # The arrows of a replay have all pushes.
        pushes=np.full((1, 3), np.nan),
        metrics={},
        by_hand=False,
    )
