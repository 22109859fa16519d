"""Arrows of a picture: pushes and forces on the body, and the task's command."""

import math
from collections.abc import Iterator
from typing import Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._state_rows import body_axes_of
from ballbot_rs.analysis.trajectory import Trajectory
from ballbot_rs.envs.registration import geometry_of

Array = npt.NDArray[np.float64]

#: How long an instantaneous push is shown, s.
PUSH_SECONDS: Final = 0.4
#: Lengths in ball radii: of the arrow of the largest push, and from its tip to the pushed point.
PUSH_LENGTH, PUSH_GAP = 3.0, 1.0
#: Gap between the ball's center and the arrow of a commanded velocity, ball radii, and its time ahead, s.
CLEAR, AHEAD = 1.4, 1.0
#: Height of the mark above a goal, radii of the ball.
GOAL_HEIGHT = 3.0
#: Arrows along a path.
PATH_ARROWS = 48
#: Height above the ground, m.
HEIGHT = 0.012


def arrows(trajectory: Trajectory, row: int) -> Array:
    """From tails to tips, inertial frame, m, shape (n, 2, 3), as `Renderer.render` takes them."""
    found = [*loads(trajectory, row), *_command(trajectory, row)]
    return np.array(found).reshape(-1, 2, 3)


def pushed(trajectory: Trajectory, time: float) -> list[tuple[Array, Array | None]]:
    """Impulses of the pushes shown at a time, N·s, with their points, body frame, m."""
    shown = (
        push for push in trajectory.all_pushes if 0.0 <= time - push.time <= max(push.duration, PUSH_SECONDS) + 1e-9
    )
    return [(np.array(push.impulse), None if push.point is None else np.array(push.point)) for push in shown]


def pulled(trajectory: Trajectory, time: float) -> list[tuple[Array, Array | None]]:
    """The same for forces, N."""
    shown = ((force, force.factor(time)) for force in trajectory.forces)
    return [
        (factor * np.array(force.force), None if force.point is None else np.array(force.point))
        for force, factor in shown
        if factor != 0.0
    ]


def loads(trajectory: Trajectory, row: int) -> Iterator[tuple[Array, Array]]:
    """Tails and tips of the pushes and forces on the body."""
    time, radius = float(trajectory.times[row]), trajectory.params.ball_radius
    state = trajectory.states[row]
    axes = body_axes_of(state.to_array())
    kinds = (
        (pushed(trajectory, time), [push.impulse for push in trajectory.all_pushes]),
        (pulled(trajectory, time), [force.force for force in trajectory.forces]),
    )
    for shown, among in kinds:
        largest = max((float(np.linalg.norm(vector)) for vector in among), default=0.0)
        for vector, point in shown:
            size = float(np.linalg.norm(vector))
            if size == 0.0:
                continue
            at = state.body_position + axes @ (trajectory.params.body_com if point is None else point)
            tip = at - PUSH_GAP * radius * vector / size
            yield tip - PUSH_LENGTH * radius * vector / largest, tip


def _command(trajectory: Trajectory, row: int) -> Iterator[tuple[Array, Array]]:
    commands = trajectory.commands
    if row >= len(commands) or not commands.shape[1]:
        return
    geometry = geometry_of(trajectory.task)
    command, radius, state = commands[row], trajectory.params.ball_radius, trajectory.states[row]
    if geometry == "velocity":
        speed = math.hypot(command[0], command[1])
        if speed > 0.0:
            angle = state.yaw + math.atan2(command[1], command[0])
            way = np.array([math.cos(angle), math.sin(angle)])
            tail = state.ball_position[:2] + CLEAR * radius * way
            yield _on_ground(trajectory, tail), _on_ground(trajectory, tail + AHEAD * speed * way)
    elif geometry == "point":
        tip = _on_ground(trajectory, command)
        yield tip + np.array([0.0, 0.0, GOAL_HEIGHT * radius]), tip
        way = command - state.ball_position[:2]
        distance = float(np.linalg.norm(way))
        # The camera stays at the robot: a far goal is not in the picture.
        if distance > 2.0 * CLEAR * radius:
            tail = state.ball_position[:2] + CLEAR * radius * way / distance
            yield _on_ground(trajectory, tail), _on_ground(trajectory, command)
    elif geometry == "curve":
        curve = path_of(command, trajectory.states[0].ball_position[:2], PATH_ARROWS)
        ends = [_on_ground(trajectory, point) for point in curve]
        yield from zip(ends, [*ends[1:], ends[0]], strict=True)


def _on_ground(trajectory: Trajectory, point: Array) -> Array:
    x, y = float(point[0]), float(point[1])
    ground = 0.0 if trajectory.terrain is None else float(trajectory.terrain.height(x, y))
    return np.array([x, y, ground + HEIGHT])


def path_of(command: Array, begin: Array, count: int) -> Array:
    """Points of the closed curve commanded by the task path, from its start, m, shape (count, 2)."""
    phases = 2.0 * np.pi * np.arange(count) / count
    coefficients = command[1:].reshape(2, -1, 2)
    orders = np.arange(1, coefficients.shape[1] + 1)[:, np.newaxis]
    waves = np.stack([np.cos(orders * phases), np.sin(orders * phases)], axis=1)
    curve = np.einsum("akp,kpt->ta", coefficients, waves)
    shifted: Array = begin + curve - curve[0]
    return shifted
