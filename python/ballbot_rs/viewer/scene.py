"""The scene: a floor, the robots, the setpoint and the target on the way to it, or what a task asks."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import viser

from ballbot_rs._state_rows import (
    BALL_POSITION,
    BALL_QUATERNION,
    BODY_POSITION,
    BODY_QUATERNION,
    WHEEL_ANGLES,
)
from ballbot_rs.viewer.command_nodes import CommandNodes
from ballbot_rs.viewer.recording import Frame
from ballbot_rs.viewer.shapes import Look, Piece

FloatArray = npt.NDArray[np.float64]

#: What moves when the camera is to follow a robot: all but the floor. The camera stays, as a user has put it.
WORLD = "/world"

#: Between two robots of a batch, m.
SPACING = 1.0

#: Of the floor and of the squares that it is divided into, m.
FLOOR_SIZE, SECTION = 20.0, 1.0

GOAL_COLOR, TARGET_COLOR = (30, 160, 60), (240, 140, 26)


class Scene:
    """Shows frames on a server; `look` makes a robot's look of its name."""

    def __init__(self, server: viser.ViserServer, look: Callable[[str], Look]) -> None:
        self._server = server
        self._look = look
        #: Whether robot 0 stays in the middle.
        self.follows = False
        #: The point of the floor in the middle, m.
        self.middle = np.zeros(2)
        self._shown: tuple[str, int] = ("", 0)
        self._robots: list[_RobotNodes] = []
        # Removals of old nodes may still be on their way to a client when nodes of the same name come.
        self._generation = 0
        server.scene.set_up_direction("+z")
        server.scene.world_axes.visible = False
        self._world = server.scene.add_frame(WORLD, show_axes=False)
        self._grid = server.scene.add_grid(
            "/floor",
            width=FLOOR_SIZE,
            height=FLOOR_SIZE,
            cell_size=0.1,
            cell_color=(205, 208, 214),
            section_size=SECTION,
        )
        # What is clicked is a sheet under the grid: viser tells a click on a node from a drag, which turns the camera.
        half = 0.5 * FLOOR_SIZE
        corners = np.array([(-half, -half, 0.0), (half, -half, 0.0), (half, half, 0.0), (-half, half, 0.0)])
        self.floor = server.scene.add_mesh_simple(
            "/sheet", corners, np.array([(0, 1, 2), (0, 2, 3)]), opacity=0.01, position=(0.0, 0.0, -0.002)
        )
        self._commands: CommandNodes | None = None
        self._task: str | None = None
        self._setpoint = server.scene.add_icosphere(f"{WORLD}/setpoint", 0.03, GOAL_COLOR, subdivisions=2)
        self._target = server.scene.add_icosphere(f"{WORLD}/target", 0.015, TARGET_COLOR, subdivisions=2)

    def show(self, frame: Frame) -> None:
        """Moves everything to where a frame has it."""
        wanted = (frame.robot, len(frame.states))
        task = None if frame.asked is None else frame.asked.task
        if (*wanted, task) != (*self._shown, self._task):
            self._rebuild_commands(task, len(frame.states))
        if wanted != self._shown:
            self._rebuild(*wanted)
        if self._commands is not None:
            self._commands.show(frame)
        self._move_middle(frame.states[0, BALL_POSITION][:2] if self.follows else np.zeros(2))
        for node, place in ((self._setpoint, frame.setpoint), (self._target, frame.target)):
            node.visible = place is not None
            if place is not None:
                node.position = (float(place[0]), float(place[1]), 0.0)
        for nodes, state in zip(self._robots, frame.states, strict=True):
            nodes.show(state)

    def _move_middle(self, middle: FloatArray) -> None:
        if np.array_equal(middle, self.middle):
            return
        self.middle = middle.copy()
        x, y = middle.tolist()
        self._world.position = (-x, -y, 0.0)
        # The grid looks alike after a section, so that it has no end.
        self._grid.position = (-math.fmod(x, SECTION), -math.fmod(y, SECTION), 0.0)

    def _rebuild_commands(self, task: str | None, num_robots: int) -> None:
        if self._commands is not None:
            self._commands.remove()
        self._commands, self._task = None, task
        if task is not None:
            self._commands = CommandNodes(self._server, f"{WORLD}/command_{self._generation}", task, places(num_robots))
            self._generation += 1

    def _rebuild(self, robot: str, num_robots: int) -> None:
        for nodes in self._robots:
            nodes.remove()
        look = self._look(robot)
        self._robots = [
            _RobotNodes(self._server, f"{WORLD}/robot_{self._generation}_{i}", look, place)
            for i, place in enumerate(places(num_robots))
        ]
        self._generation += 1
        self._shown = (robot, num_robots)


def places(num_robots: int) -> list[tuple[float, float, float]]:
    """Where the robots of a batch have their origins: a square, robot 0 at the center."""
    side = math.ceil(math.sqrt(num_robots))
    cells = [(float(i // side), float(i % side)) for i in range(side * side)]
    middle = float(side // 2)
    cells.sort(key=lambda cell: (max(abs(cell[0] - middle), abs(cell[1] - middle)), cell))
    return [(SPACING * (x - middle), SPACING * (y - middle), 0.0) for x, y in cells[:num_robots]]


class _RobotNodes:
    """The scene nodes of one robot."""

    def __init__(self, server: viser.ViserServer, name: str, look: Look, place: tuple[float, float, float]) -> None:
        self._scene = server.scene
        self._nodes: list[viser.SceneNodeHandle] = []
        self._frame(name, position=place)
        self._ball = self._frame(f"{name}/ball")
        self._body = self._frame(f"{name}/body")
        self._wheels = []
        self._add(f"{name}/ball", look.ball, smooth=True)
        self._add(f"{name}/body", look.body)
        for i, wheel in enumerate(look.wheels):
            mount = f"{name}/body/wheel_{i}"
            self._frame(mount, position=wheel.mount[:3, 3], wxyz=quaternion_of(wheel.mount[:3, :3]))
            self._wheels.append((self._frame(f"{mount}/turned"), wheel.axle))
            self._add(f"{mount}/turned", wheel.pieces)

    def _frame(self, name: str, **pose: Any) -> viser.FrameHandle:
        node = self._scene.add_frame(name, show_axes=False, **pose)
        self._nodes.append(node)
        return node

    def _add(self, name: str, pieces: list[Piece], *, smooth: bool = False) -> None:
        for i, one in enumerate(pieces):
            self._nodes.append(
                self._scene.add_mesh_simple(
                    f"{name}/piece_{i}", one.vertices, one.faces, color=one.color, flat_shading=not smooth
                )
            )

    def show(self, state: FloatArray) -> None:
        """Moves the robot."""
        self._ball.position = state[BALL_POSITION]
        self._ball.wxyz = state[BALL_QUATERNION]
        self._body.position = state[BODY_POSITION]
        self._body.wxyz = state[BODY_QUATERNION]
        for (node, axle), angle in zip(self._wheels, state[WHEEL_ANGLES], strict=True):
            node.wxyz = np.array([math.cos(0.5 * angle), *(math.sin(0.5 * angle) * axle)])

    def remove(self) -> None:
        """Takes the robot away: the page needs to hear of the parent first, the server of every node."""
        for node in self._nodes:
            node.remove()


def quaternion_of(rotation: FloatArray) -> tuple[float, float, float, float]:
    """`[w, x, y, z]` of a rotation matrix."""
    w, x, y, z = viser.transforms.SO3.from_matrix(rotation).wxyz
    return float(w), float(x), float(y), float(z)
