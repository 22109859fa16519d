"""The scene: a floor, the robots, the setpoint and the intermediate target, or a task's commands; and its cameras."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import viser

from ballbot_rs._state_rows import BALL_POSITION
from ballbot_rs.viewer.scene.arrows import GHOST_COLOR, TRAIL_COLOR, Forces, Push, RouteLine, Trail, on_ground
from ballbot_rs.viewer.scene.boundary import BoundaryLine
from ballbot_rs.viewer.scene.cameras import FREE, Camera
from ballbot_rs.viewer.scene.commands import CommandNodes, kind_of
from ballbot_rs.viewer.scene.ground import HALF, Ground, ray_meets
from ballbot_rs.viewer.scene.heading import about_z
from ballbot_rs.viewer.scene.look import Look
from ballbot_rs.viewer.scene.robot import RobotNodes
from ballbot_rs.viewer.session.recording import Frame

FloatArray = npt.NDArray[np.float64]

#: Parent of the nodes that move when the camera follows a robot: all but the floor. The camera stays in place.
WORLD = "/world"

#: Distance between two robots of a batch, m.
SPACING = 1.0

#: Opacity of the ghost.
GHOST_OPACITY = 0.35

GOAL_COLOR, TARGET_COLOR = (30, 160, 60), (240, 140, 26)


class Scene:
    """Shows frames on a server; `look` makes a robot's look from its name.

    `dragged` is called when a mesh of robot 0 is dragged, `clicked` with a click on the ground.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        look: Callable[[str], Look],
        dragged: Callable[[viser.SceneNodeDragEvent[Any]], None],
        clicked: Callable[[viser.SceneNodePointerEvent[Any]], None],
    ) -> None:
        self._server = server
        self._look = look
        self._dragged = dragged
        self.camera = Camera()
        self.shows_trail = self.shows_shadow = True
        self.shows_forces = False
        self._casts_shadow = True
        self._shown: tuple[str, int] = ("", 0)
        self._robots: list[RobotNodes] = []
        # Removals of old nodes may reach a client after new nodes of the same name.
        self._generation = 0
        server.scene.set_up_direction("+z")
        server.scene.world_axes.visible = False
        self._world = server.scene.add_frame(WORLD, show_axes=False)
        self._ground = Ground(server, f"{WORLD}/ground", clicked)
        self._trail = Trail(server, f"{WORLD}/trail", TRAIL_COLOR)
        self._ghost_trail = Trail(server, f"{WORLD}/ghost_trail", GHOST_COLOR)
        self._forces = Forces(server, f"{WORLD}/forces")
        self._push, self._route = Push(server, f"{WORLD}/push"), RouteLine(server, f"{WORLD}/route")
        self._boundary = BoundaryLine(server, f"{WORLD}/boundary")
        self._ghost: RobotNodes | None = None
        self._commands: list[CommandNodes] = []
        self._task: str | None = None
        self._setpoint = server.scene.add_icosphere(f"{WORLD}/setpoint", 0.03, GOAL_COLOR, subdivisions=2)
        self._target = server.scene.add_icosphere(f"{WORLD}/target", 0.015, TARGET_COLOR, subdivisions=2)

    def show(self, frame: Frame) -> None:
        """Moves everything to its place in a frame."""
        current = (frame.robot, len(frame.states))
        kind = None if frame.commands is None else kind_of(frame.commands)
        task = None if frame.commands is None else frame.commands.task
        if (*current, task) != (*self._shown, self._task):
            self._task = task
            self._rebuild_commands(kind, len(frame.states))
        if current != self._shown:
            self._rebuild(*current)
        if frame.commands is not None:
            for index, command in enumerate(self._commands):
                command.show(frame, frame.commands, index)
        self._show_ground(frame)
        for node, place in ((self._setpoint, frame.setpoint), (self._target, frame.target)):
            node.visible = place is not None
            if place is not None:
                node.position = on_ground(frame, place)
        heights = frame.heights(frame.states[:, BALL_POSITION])
        for index, (nodes, state, height) in enumerate(zip(self._robots, frame.states, heights, strict=True)):
            nodes.show(state, float(height))
            nodes.payloads.show(*(frame.loads[index] if frame.loads else (frame.params, None)))
        self._show_ghost(frame)
        self._trail.show(frame, frame.states[0], self.shows_trail)
        self._forces.show(frame, self.shows_forces)
        self._push.show(frame)
        self._route.show(frame)
        self._boundary.show(frame)
        if self._casts_shadow != self.shows_shadow:
            # Without shadows slow machines draw several times as many pictures.
            self._casts_shadow = self.shows_shadow
            self._server.scene.configure_default_lights(cast_shadow=self.shows_shadow)

    def set_dark(self, is_dark: bool) -> None:
        """Shows the ground in light or dark colors."""
        self._ground.set_dark(is_dark)

    def _show_ghost(self, frame: Frame) -> None:
        if (frame.ghost is None) != (self._ghost is None):
            if self._ghost is not None:
                self._ghost.remove()
                self._ghost = None
            else:
                name = f"{WORLD}/ghost_{self._generation}"
                self._ghost = RobotNodes(self._server, name, self._look(frame.robot), (0.0, 0.0, 0.0), GHOST_OPACITY)
                self._generation += 1
        if self._ghost is not None and frame.ghost is not None:
            self._ghost.show(frame.ghost.state, float(frame.heights(frame.ghost.state[BALL_POSITION])))
        self._ghost_trail.show(frame, None if frame.ghost is None else frame.ghost.state, self.shows_trail)

    def extent(self, robot: str, num_robots: int) -> tuple[float, float]:
        """Largest distance of robots from the middle, and their height, m."""
        look = self._look(robot)
        wheels = [piece.vertices @ w.mount[:3, :3].T + w.mount[:3, 3] for w in look.wheels for piece in w.pieces]
        parts = np.concatenate([*(piece.vertices for piece in look.body), *wheels])
        radius = max(float(piece.vertices[:, 2].max()) for piece in look.ball)
        half = float(np.abs(parts[:, :2]).max())
        return half + max(math.hypot(x, y) for x, y, _ in places(num_robots)), radius + float(parts[:, 2].max())

    def point_at(self, origin: FloatArray, direction: FloatArray) -> tuple[float, float] | None:
        """Intersection of a camera ray with the ground, m; None if there is none."""
        return ray_meets(self._ground.terrain, self.camera.point(origin), self.camera.vector(direction))

    def _show_ground(self, frame: Frame) -> None:
        ball = frame.states[0, BALL_POSITION][:2]
        self._ground.show(frame.terrain, ball)
        level = np.zeros(2) if frame.terrain is None else self.camera.middle[:2]
        # A robot on another tile is outside the former patch.
        is_away = frame.terrain is not None and np.abs(ball - level).max() > HALF
        place = ball if self.camera.kind != FREE or is_away else level
        if self.camera.follow(np.append(place, frame.heights(place)), frame.states[0]):
            self._world.wxyz = about_z(-self.camera.turn)
            self._world.position = -self.camera.rotation.T @ self.camera.middle
            self._ground.move_floor(self.camera)

    def _rebuild_commands(self, kind: type[CommandNodes] | None, num_robots: int) -> None:
        for command in self._commands:
            command.remove()
        name = f"{WORLD}/command_{self._generation}"
        self._commands = (
            [] if kind is None else [kind(self._server, f"{name}_{i}", at) for i, at in enumerate(places(num_robots))]
        )
        self._generation += 1

    def _rebuild(self, robot: str, num_robots: int) -> None:
        for nodes in self._robots:
            nodes.remove()
        if self._ghost is not None:
            self._ghost.remove()
            self._ghost = None
        look = self._look(robot)
        self._robots = [
            RobotNodes(self._server, f"{WORLD}/robot_{self._generation}_{i}", look, place)
            for i, place in enumerate(places(num_robots))
        ]
        for mesh in self._robots[0].meshes:
            mesh.on_drag(self._dragged)
        self._generation += 1
        self._shown = (robot, num_robots)


def places(num_robots: int) -> list[tuple[float, float, float]]:
    """Origins of the robots of a batch: a square, robot 0 at the center."""
    side = math.ceil(math.sqrt(num_robots))
    cells = [(float(i // side), float(i % side)) for i in range(side * side)]
    middle = float(side // 2)
    cells.sort(key=lambda cell: (max(abs(cell[0] - middle), abs(cell[1] - middle)), cell))
    return [(SPACING * (x - middle), SPACING * (y - middle), 0.0) for x, y in cells[:num_robots]]
