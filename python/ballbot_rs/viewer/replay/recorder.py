"""Records the scene of the page, with viser's own player, into one HTML document."""

import asyncio
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Final

import numpy as np
import viser
from viser import _messages
from viser.infra import WebsockServer
from viser.infra._async_message_buffer import AsyncMessageBuffer

from ballbot_rs._checks import check_bounded
from ballbot_rs._errors import InvalidInputError
from ballbot_rs.analysis.trajectory import Trajectory
from ballbot_rs.media.arrows import loads
from ballbot_rs.media.video import FRAME_RATES, has_meshes
from ballbot_rs.viewer.replay.frames import ROBOT, frame_of, reference_of, rows_at
from ballbot_rs.viewer.scene.arrows import ROUTE_COLOR, THICKNESS, open_line, push_arrows
from ballbot_rs.viewer.scene.cameras import place_camera
from ballbot_rs.viewer.scene.look import Look, from_params
from ballbot_rs.viewer.scene.scene import WORLD, Scene
from ballbot_rs.viewer.scene.urdf import URDFS, from_urdf

#: How long the last frame is shown before the replay begins again, s.
REST: Final = 1.0

#: Width over height of the frame of the document.
ASPECT: Final = 1.6


class Recorder(viser.ViserServer):
    """The scene of a server without the server: no port, no thread.

    Raises:
        RuntimeError: a version of viser whose scene needs other parts of a server.
    """

    def __init__(self) -> None:
        # The scene wakes the loop of a server, but not a closed one.
        loop = asyncio.new_event_loop()
        loop.close()
        try:
            self._websock_server = WebsockServer("127.0.0.1", 0)
            self._websock_server._broadcast_buffer = AsyncMessageBuffer(loop, persistent_messages=True)
            self._scene_lifecycle_lock = threading.RLock()
            self._initial_camera = viser.InitialCameraConfig(self._websock_server.queue_message)
            self.scene = viser.SceneApi(self, ThreadPoolExecutor(1), loop)
        except (AttributeError, TypeError) as error:
            raise RuntimeError(f"viser {viser.__version__} cannot record a scene without a server") from error

    def post(self, time: float) -> None:
        """Has the document send a time to the page around it."""
        source = f"parent.postMessage({time:.6g}, '*')"
        self._websock_server.queue_message(_messages.RunJavascriptMessage(source))


def record(trajectory: Trajectory, *, frame_rate: float = 60.0, forces: bool = False, dark: bool = False) -> str:
    """The document of a replay, which sends the time of each frame, s, to the page around it as a message.

    Every frame is a row of the trajectory at its time. The player begins at 0 s; a trajectory of one row is a picture.

    Args:
        trajectory: what is shown.
        frame_rate: frames per second.
        forces: whether arrows show the forces at the contacts.
        dark: whether the colors are dark.

    Raises:
        ValueError: a frame rate out of range, or a trajectory without contacts.
    """
    check_bounded("frame_rate", frame_rate, *FRAME_RATES)
    if len(trajectory.contacts) < len(trajectory.times):
        raise InvalidInputError(
            f"a replay needs the contacts of all rows: the trajectory has {len(trajectory.contacts)} of "
            f"{len(trajectory.times)}"
        )
    recorder = Recorder()
    scene = Scene(recorder, lambda _: _look_of(trajectory), _ignore, _ignore)
    scene.shows_forces = forces
    scene.set_dark(dark)
    place_camera(recorder.initial_camera, ASPECT, *scene.extent(ROBOT, 1), behind=False)
    rows = rows_at(trajectory.times, frame_rate)
    _add_reference(recorder, trajectory, rows)
    shown = _Loads(recorder)

    def show(row: int) -> None:
        scene.show(frame_of(trajectory, row))
        shown.show(trajectory, row)
        recorder.post(float(trajectory.times[row]))

    first, *others = rows
    show(first)
    serializer = recorder.get_scene_serializer()
    for before, row in zip((first, *others), others, strict=False):
        serializer.insert_sleep(float(trajectory.times[row] - trajectory.times[before]))
        show(row)
    if others:
        serializer.insert_sleep(REST)
    return serializer.as_html(dark_mode=dark)


class _Loads:
    """Arrows of pushes and forces on the body, as in videos."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._arrows = push_arrows(server, f"{WORLD}/loads")

    def show(self, trajectory: Trajectory, row: int) -> None:
        """Draws the arrows of a row."""
        found = np.array(list(loads(trajectory, row)), dtype=np.float32)
        self._arrows.visible = len(found) > 0
        if len(found):
            self._arrows.points = found


def _add_reference(server: viser.ViserServer, trajectory: Trajectory, rows: list[int]) -> None:
    curve = reference_of(trajectory)
    if curve is not None and len(rows) > 1:
        points = open_line(curve[rows], frame_of(trajectory, 0).heights)
        server.scene.add_line_segments(f"{WORLD}/reference", points, ROUTE_COLOR, thickness=THICKNESS)


def _look_of(trajectory: Trajectory) -> Look:
    """Meshes where they fit the robot, as in videos; otherwise shapes from its parameters."""
    params = trajectory.params
    return from_urdf(params, *URDFS["paper"]) if has_meshes(params) else from_params(params)


def _ignore(_: Any) -> None:
    """Takes events of nodes: a document sends none."""
