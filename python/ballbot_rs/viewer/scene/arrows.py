"""Arrows and lines: forces and a push on robot 0, its trail and its route; flat arrows for commands."""

import math
from collections import deque
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import viser

from ballbot_rs._state_rows import BALL_POSITION, BODY_POSITION, body_axes_of
from ballbot_rs.engines.robot_geometry import robot_geometry
from ballbot_rs.viewer.session.recording import Frame

FloatArray = npt.NDArray[np.float64]
Place = tuple[float, float, float]

#: Half widths of shaft and head, and largest length of the head, m.
SHAFT, HEAD, HEAD_LENGTH = 0.012, 0.035, 0.07

#: Height above the floor, m: the grid is at 0.
HEIGHT = 0.006

#: Segments of a shaft.
PIECES = 24

#: Corner numbers: the shaft in pairs from the tail, then two of the head and the tip.
FACES: npt.NDArray[np.int64] = np.array(
    [
        *[(2 * i, 2 * i + 1, 2 * i + 3) for i in range(PIECES)],
        *[(2 * i, 2 * i + 3, 2 * i + 2) for i in range(PIECES)],
        (2 * PIECES + 2, 2 * PIECES + 3, 2 * PIECES + 4),
    ]
)

TRAIL_COLOR, GHOST_COLOR, ROUTE_COLOR, PUSH_COLOR = (26, 76, 140), (136, 144, 156), (30, 140, 60), (204, 56, 46)

#: As in pictures of `ballbot record`: loads, tractions, force along the ground.
LOAD_COLOR, TRACTION_COLOR, FLOOR_COLOR = (25, 113, 194), (47, 158, 68), (224, 49, 49)
FORCE_COLORS = np.array([*[LOAD_COLOR] * 3, *[TRACTION_COLOR] * 3, FLOOR_COLOR], dtype=np.uint8)

#: Length of an arrow per force, m/N, and per impulse, m/(N·s); arrows shorter than the last number have no direction.
FORCE_LENGTH, PUSH_LENGTH, SHORTEST = 0.012, 0.35, 0.004

#: Segments of the trail, least length of a segment, m, and time between two updates, s.
TRAIL_POINTS, TRAIL_STEP, TRAIL_PERIOD = 400, 0.01, 0.1

#: Above the floor, m.
TRAIL_HEIGHT, LINE_HEIGHT = 0.003, 0.004

#: Thickness of lines on the floor, m.
THICKNESS = 0.008


def straight(tail: float, length: float) -> FloatArray:
    """Corners of an arrow along x, starting at a distance from the origin, m, shape (k, 3)."""
    ways, sides = _outline(length, HEAD_LENGTH)
    return _on_floor(tail + ways, sides)


def arc(radius: float, angle: float) -> FloatArray:
    """Corners of an arrow along a circle about the origin, from x, counterclockwise for a positive angle, rad."""
    angles, sides = _outline(angle, HEAD_LENGTH / radius)
    return _on_floor((radius + sides) * np.cos(angles), (radius + sides) * np.sin(angles))


def _outline(length: float, head_length: float) -> tuple[FloatArray, FloatArray]:
    """Positions along an arrow, and lateral offsets."""
    neck = length - math.copysign(min(head_length, 0.5 * abs(length)), length)
    ways = np.append(np.repeat(np.linspace(0.0, neck, PIECES + 1), 2), [neck, neck, length])
    sides = np.append(np.tile([-SHAFT, SHAFT], PIECES + 1), [-HEAD, HEAD, 0.0])
    return ways, sides


def _on_floor(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.stack([x, y, np.full_like(x, HEIGHT)], axis=1)


def closed_line(points: FloatArray, heights: npt.ArrayLike = 0.0) -> FloatArray:
    """The segments of a closed line on the ground, shape (n, 2, 3)."""
    lifted = np.column_stack([points, np.broadcast_to(np.asarray(heights) + LINE_HEIGHT, len(points))])
    return np.stack([lifted, np.roll(lifted, -1, axis=0)], axis=1)


def on_ground(frame: Frame, point: FloatArray) -> Place:
    """A point (x, y) at the height of the ground there, m."""
    return float(point[0]), float(point[1]), float(frame.heights(point))


class Trail:
    """The path of a ball as a line on the floor."""

    def __init__(self, server: viser.ViserServer, name: str, color: tuple[int, int, int]) -> None:
        self._line = server.scene.add_line_segments(
            name, np.zeros((1, 2, 3)), color, thickness=THICKNESS, visible=False
        )
        self._points: deque[FloatArray] = deque(maxlen=TRAIL_POINTS)
        self._time = self._drawn = -math.inf

    def show(self, frame: Frame, state: FloatArray | None, is_on: bool) -> None:
        """Adds the ball's position in a state; after a jump in time or position the trail restarts."""
        if state is None:
            self._points.clear()
            _set_visible(self._line, False)
            return
        ball = state[BALL_POSITION][:2]
        point = np.append(ball, frame.heights(ball) + TRAIL_HEIGHT)
        step = float(np.linalg.norm(point - self._points[-1])) if self._points else math.inf
        if frame.time < self._time or (self._points and step > 0.5):
            self._points.clear()
            step = math.inf
        if step >= TRAIL_STEP:
            self._points.append(point)
        if frame.time < self._time or frame.time - self._drawn >= TRAIL_PERIOD:
            self._drawn = frame.time
            points = np.array(self._points)
            if is_on and len(points) > 1:
                self._line.points = np.float32(np.stack([points[:-1], points[1:]], axis=1))
            _set_visible(self._line, is_on and len(points) > 1)
        self._time = frame.time


class Forces:
    """Arrows of the contact forces."""

    def __init__(self, server: viser.ViserServer, name: str) -> None:
        self._arrows = server.scene.add_arrows(
            name,
            np.tile([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]], (7, 1, 1)),
            FORCE_COLORS,
            shaft_radius=0.005,
            head_radius=0.013,
            head_length=0.03,
            visible=False,
        )

    def show(self, frame: Frame, is_on: bool) -> None:
        """Draws the forces of a frame."""
        is_on = is_on and frame.has_forces
        _set_visible(self._arrows, is_on)
        if is_on:
            self._arrows.points = np.float32(force_arrows(frame))


def push_arrows(server: viser.ViserServer, name: str) -> viser.ArrowsHandle:
    """Arrows as of pushes, which are not shown yet."""
    return server.scene.add_arrows(
        name,
        np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]]),
        PUSH_COLOR,
        shaft_radius=0.012,
        head_radius=0.03,
        head_length=0.06,
        visible=False,
    )


class Push:
    """An arrow at the body, for a while after a push."""

    def __init__(self, server: viser.ViserServer, name: str) -> None:
        self._arrow = push_arrows(server, name)

    def show(self, frame: Frame) -> None:
        """Draws the push of a frame."""
        push = frame.push
        length = 0.0 if push is None else PUSH_LENGTH * float(np.linalg.norm(push))
        _set_visible(self._arrow, length >= SHORTEST)
        if push is not None and length >= SHORTEST:
            way = np.append(push, 0.0) * ((length + 0.08) / np.linalg.norm(push))
            com = frame.states[0, BODY_POSITION] + body_axes_of(frame.states[0]) @ np.asarray(frame.params.body_com)
            # Its tip is outside the mast.
            tip = com - 0.06 * way / np.linalg.norm(way)
            self._arrow.points = np.array([[tip - way, tip]], dtype=np.float32)


def open_line(points: FloatArray, heights: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """The segments of a line on the ground, which NaN interrupts, shape (n, 2, 3); `heights` gets the others."""
    is_there = np.isfinite(points).all(axis=1)
    lifted = np.full((len(points), 3), np.nan)
    lifted[is_there] = np.column_stack([points[is_there], heights(points[is_there]) + LINE_HEIGHT])
    segments = np.stack([lifted[:-1], lifted[1:]], axis=1)
    found: FloatArray = segments[np.isfinite(segments).all(axis=(1, 2))]
    return found


class RouteLine:
    """The curve along which the setpoint moves."""

    def __init__(self, server: viser.ViserServer, name: str) -> None:
        self._line = server.scene.add_line_segments(
            name, np.zeros((1, 2, 3)), ROUTE_COLOR, thickness=THICKNESS, visible=False
        )
        self._shown: FloatArray | None = None

    def show(self, frame: Frame) -> None:
        """Draws the route of a frame."""
        _set_visible(self._line, frame.route is not None)
        if frame.route is not None and (self._shown is None or not np.array_equal(frame.route, self._shown)):
            self._shown = frame.route
            self._line.points = np.float32(closed_line(frame.route, frame.heights(frame.route)))


def force_arrows(frame: Frame) -> FloatArray:
    """Tails and tips, m, shape (7, 2, 3): loads on the wheels from above, tractions at the contacts, the floor's force.

    A force that is too small for an arrow has zero length, far below the floor.
    """
    state, contacts, params = frame.states[0], frame.contacts, frame.params
    axes, center = body_axes_of(state), state[BODY_POSITION]
    robot = robot_geometry(params)
    outwards, drives = robot.contacts, robot.drives
    touched = center + params.ball_radius * outwards @ axes.T
    # Load arrows end at the outside of the wheel, which would hide them otherwise.
    tops = touched + 2.0 * params.wheel_radius * outwards @ axes.T
    loads = FORCE_LENGTH * contacts.wheel_normal_forces[:, np.newaxis] * (outwards @ axes.T)
    tractions = FORCE_LENGTH * contacts.wheel_tractions[:, np.newaxis] * (drives @ axes.T)
    ball = state[BALL_POSITION]
    normal = _normal_at_contact(frame, params.ball_radius)
    lowest = ball - 0.98 * params.ball_radius * normal
    floor = FORCE_LENGTH * (contacts.floor_force - contacts.floor_force @ normal * normal)
    tails = np.concatenate([tops + loads, touched, [lowest]])
    tips = np.concatenate([tops, touched + tractions, [lowest + floor]])
    arrows = np.stack([tails, tips], axis=1)
    arrows[np.linalg.norm(tips - tails, axis=1) < SHORTEST] = [[0.0, 0.0, -9.0], [0.0, 0.0, -9.1]]
    return arrows


def _normal_at_contact(frame: Frame, radius: float) -> FloatArray:
    """Normal of the ground at the contact of robot 0's ball, which on a slope is not below the ball's center."""
    ball = frame.states[0, BALL_POSITION][:2]
    normal = np.array([0.0, 0.0, 1.0])
    if frame.terrain is not None:
        # A contraction, since no valley is as narrow as the ball.
        for _ in range(8):
            normal = frame.terrain.normal(*(ball - radius * normal[:2]))
    return normal


def _set_visible(node: viser.SceneNodeHandle, is_visible: bool) -> None:
    if node.visible != is_visible:
        node.visible = is_visible
