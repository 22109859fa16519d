"""A task's commands in the scene: an arrow, a goal, a path with the moving point, the last push."""

import math

import numpy as np
import numpy.typing as npt
import viser

from ballbot_rs._state_rows import BALL_POSITION
from ballbot_rs.envs.registration import geometry_of
from ballbot_rs.media.arrows import path_of
from ballbot_rs.viewer.scene import arrows
from ballbot_rs.viewer.scene.arrows import Place, on_ground
from ballbot_rs.viewer.scene.heading import about_z, heading_of
from ballbot_rs.viewer.session.recording import Commands, Frame
from ballbot_rs.viewer.session.session import PUSH_SECONDS

FloatArray = npt.NDArray[np.float64]

COMMAND_COLOR, TURN_COLOR, PUSH_COLOR = (30, 160, 60), (240, 140, 26), (204, 56, 46)

#: Arrows show the distance and turn over this time, s.
AHEAD = 1.0

#: Arrows begin outside the ball and the mark of the heading, m.
CLEAR, TURN_CLEAR = 0.21, 0.25

#: Radius of rings on the floor, which are visible around the ball, m.
RING = 0.16

#: Length of a push arrow, m/(N·s).
PUSH_LENGTH = 0.25

#: Points of a path.
SAMPLES = 128


class CommandNodes:
    """A task's command to one robot, in the frame in which the robot starts."""

    def __init__(self, server: viser.ViserServer, name: str, place: Place) -> None:
        self._scene, self._name = server.scene, name
        self._root = server.scene.add_frame(name, show_axes=False, position=place)

    def _arrow(self, name: str, color: tuple[int, int, int]) -> viser.MeshHandle:
        corners = arrows.straight(0.0, AHEAD)
        path = f"{self._name}/{name}"
        return self._scene.add_mesh_simple(path, corners, arrows.FACES, color=color, side="double", visible=False)

    def _line(self, name: str, points: FloatArray, color: tuple[int, int, int]) -> viser.LineSegmentsHandle:
        return self._scene.add_line_segments(f"{self._name}/{name}", arrows.closed_line(points), color, thickness=0.006)

    def _point(self, name: str, radius: float, color: tuple[int, int, int]) -> viser.SceneNodeHandle:
        return self._scene.add_icosphere(f"{self._name}/{name}", radius, color, subdivisions=2)

    def show(self, frame: Frame, commands: Commands, index: int) -> None:
        """Shows the command of robot `index`."""
        raise NotImplementedError

    def remove(self) -> None:
        """Removes the nodes."""
        self._root.remove()


class _Velocity(CommandNodes):
    """An arrow at the ball in the heading frame, and an arrow around it for the yaw rate."""

    def __init__(self, server: viser.ViserServer, name: str, place: Place) -> None:
        super().__init__(server, name, place)
        self._way = self._arrow("way", COMMAND_COLOR)
        self._turn = self._arrow("turn", TURN_COLOR)
        self._shown: FloatArray | None = None

    def show(self, frame: Frame, commands: Commands, index: int) -> None:
        """As `CommandNodes`."""
        x, y, rate = commands.values[index].tolist()
        speed = math.hypot(x, y)
        yaw = heading_of(frame.states[index])
        for arrow, angle in ((self._way, yaw + math.atan2(y, x)), (self._turn, yaw)):
            arrow.position = on_ground(frame, frame.states[index, BALL_POSITION])
            arrow.wxyz = about_z(angle)
        if self._shown is not None and np.array_equal(self._shown, commands.values[index]):
            return
        self._shown = commands.values[index].copy()
        self._way.visible, self._turn.visible = speed > 0.0, rate != 0.0
        if speed > 0.0:
            self._way.vertices = np.float32(arrows.straight(CLEAR, AHEAD * speed))
        if rate != 0.0:
            self._turn.vertices = np.float32(arrows.arc(TURN_CLEAR, AHEAD * rate))


class _Goal(CommandNodes):
    """A point in a ring, which is visible around the ball."""

    def __init__(self, server: viser.ViserServer, name: str, place: Place) -> None:
        super().__init__(server, name, place)
        self._ring = self._line("ring", RING * _circle(48), COMMAND_COLOR)
        self._goal = self._point("goal", 0.03, COMMAND_COLOR)

    def show(self, frame: Frame, commands: Commands, index: int) -> None:
        """As `CommandNodes`."""
        self._goal.position = self._ring.position = on_ground(frame, commands.points[index])


class _Path(CommandNodes):
    """The whole curve, and the point that moves along it, in a ring."""

    def __init__(self, server: viser.ViserServer, name: str, place: Place) -> None:
        super().__init__(server, name, place)
        self._curve = self._line("curve", _circle(SAMPLES), COMMAND_COLOR)
        self._ring = self._line("ring", RING * _circle(48), TURN_COLOR)
        self._moving = self._point("moving", 0.025, TURN_COLOR)
        self._shown: FloatArray | None = None

    def show(self, frame: Frame, commands: Commands, index: int) -> None:
        """As `CommandNodes`."""
        self._moving.position = self._ring.position = on_ground(frame, commands.points[index])
        current = np.append(commands.values[index], commands.begins[index])
        if self._shown is None or not np.array_equal(self._shown, current):
            self._shown = current
            points = path_of(commands.values[index], commands.begins[index], SAMPLES)
            self._curve.points = np.float32(arrows.closed_line(points, frame.heights(points)))


class _Push(_Goal):
    """The point to hold, and for a while an arrow in the direction of a push."""

    def __init__(self, server: viser.ViserServer, name: str, place: Place) -> None:
        super().__init__(server, name, place)
        self._push = self._arrow("push", PUSH_COLOR)
        self._last, self._since = np.full(3, np.nan), -math.inf

    def show(self, frame: Frame, commands: Commands, index: int) -> None:
        """As `CommandNodes`."""
        super().show(frame, commands, index)
        push = commands.pushes[index]
        if not np.array_equal(push, self._last, equal_nan=True):
            self._last, self._since = push.copy(), frame.time
            if np.isfinite(push[0]):
                self._push.vertices = np.float32(arrows.straight(CLEAR, PUSH_LENGTH * float(push[0]) + 0.05))
                self._push.wxyz = about_z(float(push[1]))
        self._push.visible = bool(np.isfinite(push[0])) and 0.0 <= frame.time - self._since < PUSH_SECONDS
        self._push.position = on_ground(frame, frame.states[index, BALL_POSITION])


class _Drawing(_Goal):
    """The line of a task in Python, or its only point in a ring."""

    def __init__(self, server: viser.ViserServer, name: str, place: Place) -> None:
        super().__init__(server, name, place)
        self._curve = self._line("curve", np.zeros((1, 2)), COMMAND_COLOR)
        self._shown: FloatArray | None = None

    def show(self, frame: Frame, commands: Commands, index: int) -> None:
        """As `CommandNodes`."""
        # Robots that have failed to draw keep their last line.
        if index >= len(commands.drawings):
            return
        points = commands.drawings[index]
        if self._shown is not None and np.array_equal(points, self._shown, equal_nan=True):
            return
        self._shown = points
        is_goal = len(points) == 1
        self._ring.visible = self._goal.visible = bool(is_goal and np.isfinite(points).all())
        if self._goal.visible:
            self._goal.position = self._ring.position = on_ground(frame, points[0])
        segments = arrows.open_line(points, frame.heights)
        self._curve.visible = len(segments) > 0
        if self._curve.visible:
            self._curve.points = np.float32(segments)


def kind_of(commands: Commands) -> type[CommandNodes] | None:
    """How commands are shown; None if they are not."""
    return KINDS.get(geometry_of(commands.task) or "", _Drawing if commands.drawings else None)


#: By the geometry of a command.
KINDS: dict[str, type[CommandNodes]] = {
    "velocity": _Velocity,
    "point": _Goal,
    "curve": _Path,
    "impulse": _Push,
}


def _circle(count: int) -> FloatArray:
    angles = 2.0 * np.pi * np.arange(count) / count
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)
