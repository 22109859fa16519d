"""A page in the browser of robots that touch each other."""

from __future__ import annotations

import functools
import math
import threading
import time
import webbrowser
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import viser

from ballbot_rs._core import Controller, Crowd, State
from ballbot_rs._errors import DivergedError, InvalidInputError
from ballbot_rs._keywords import named
from ballbot_rs.viewer.scene.ground import Ground
from ballbot_rs.viewer.scene.look import from_params
from ballbot_rs.viewer.scene.robot import RobotNodes
from ballbot_rs.viewer.server.server import HOST, LocalServer, free_port
from ballbot_rs.viewer.server.teleop import Teleop
from ballbot_rs.viewer.session.robots import FALLEN_TILT, com_of, pull_of
from ballbot_rs.viewer.session.runner import FRAME_DT, MAX_DELAY, STOP_TIMEOUT

FloatArray = npt.NDArray[np.float64]
Law = Callable[[State], npt.ArrayLike]

#: Time between two torques, s.
CONTROL_DT: Final = 0.01


@named
def show_crowd(crowd: Crowd, laws: Sequence[Law], *, port: int = 8080, open_browser: bool = False) -> CrowdPage:
    """Shows robots that touch each other in the browser, in real time, and returns a handle; drag a robot to pull it.

    ```python
    crowd = bb.Crowd(["paper", "kugle"], positions=[(0.0, 0.0), (0.5, 0.0)])
    with bb.show_crowd(crowd, [bb.Lqr(params, control_dt=0.01) for params in crowd.params]) as page:
        print(page.url)
        page.wait(0.5)
    ```

    Args:
        crowd: the robots; the page advances them from now on, and nothing else may.
        laws: of each robot, called with its `State` every 10 ms, returns its wheel torques. A `Controller` holds its
            robot where it is now. The motors of a robot that has fallen are off.
        port: where the page is served, on 127.0.0.1; if it is taken, the next free one.
        open_browser: whether to open the page.

    Raises:
        ValueError: not a law for each robot, or a port out of range.
        OSError: no port is free.
        ModuleNotFoundError: viser is not installed (extra `view`).
    """
    if len(laws) != len(crowd):
        raise InvalidInputError(f"laws has {len(laws)} entries, expected {len(crowd)}: one for each robot")
    held = [
        functools.partial(law, position=state.ball_position[:2]) if isinstance(law, Controller) else law
        for law, state in zip(laws, crowd.states, strict=True)
    ]
    page = CrowdPage(crowd, held, port)
    if open_browser:
        webbrowser.open(page.url)
    return page


class CrowdPage:
    """Robots that touch each other on a page in the browser; `show_crowd` makes one.

    ```python
    crowd = bb.Crowd(["paper", "paper"], positions=[(0.0, 0.0), (0.5, 0.0)])
    with bb.show_crowd(crowd, [bb.Lqr(control_dt=0.01)] * 2) as page:
        page.pull(0, (0.6, 0.0, 0.3))
        page.wait(0.5)
        print(page.time, [state.tilt for state in page.states])
    ```

    They move in real time in a separate thread. A context manager closes the page. Everything may be called from any
    thread.
    """

    def __init__(self, crowd: Crowd, laws: Sequence[Law], port: int) -> None:
        self._crowd, self._laws, self._params = crowd, laws, crowd.params
        #: Where each robot is pulled to, inertial frame, m.
        self._pulled: dict[int, FloatArray] = {}
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._rest = 0.0
        self._error: BaseException | None = None
        self._server = LocalServer(free_port(port), Teleop(lambda _: False))
        self._server.scene.set_up_direction("+z")
        self._server.scene.world_axes.visible = False
        self._ground = Ground(self._server, "/ground", lambda _: None)
        self._robots = [
            RobotNodes(self._server, f"/robot_{i}", from_params(params), (0.0, 0.0, 0.0))
            for i, params in enumerate(self._params)
        ]
        for i, nodes in enumerate(self._robots):
            for mesh in nodes.meshes:
                mesh.on_drag(functools.partial(self._dragged, i))
        self._server.gui.add_button("Restart").on_click(lambda _: self.reset())
        self._pause = self._server.gui.add_checkbox("Pause", initial_value=False)
        self._text = self._server.gui.add_markdown("")
        self._server.on_client_connect(self._frame)
        self._show()
        self._thread = threading.Thread(target=self._run, name="ballbot-crowd", daemon=True)
        self._thread.start()

    def __enter__(self) -> CrowdPage:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def url(self) -> str:
        """The page's address."""
        return f"http://{HOST}:{self._server.get_port()}"

    @property
    def time(self) -> float:
        """Simulated time since the last restart, s."""
        with self._lock:
            return self._crowd.time

    @property
    def states(self) -> list[State]:
        """Current state of each robot."""
        with self._lock:
            return self._crowd.states

    def pull(self, robot: int, towards: npt.ArrayLike | None) -> None:
        """Pulls the CoM of a robot towards a point (inertial frame, shape (3,), m) from now on; None releases it.

        The force grows to a fifth of the body's weight.

        Raises:
            ValueError: not the number of a robot, or a wrong shape.
        """
        if robot not in range(len(self._laws)):
            raise InvalidInputError(f"robot = {robot} is out of range: there are robots 0 to {len(self._laws) - 1}")
        point = None if towards is None else np.asarray(towards, dtype=np.float64)
        if point is not None and (point.shape != (3,) or not np.isfinite(point).all()):
            raise InvalidInputError(f"pull towards {towards!r}: expected three finite numbers")
        with self._lock:
            if point is None:
                self._pulled.pop(robot, None)
            else:
                self._pulled[robot] = point

    def reset(self) -> None:
        """Restarts the robots where the crowd began."""
        with self._lock:
            self._crowd.reset()

    def wait(self, seconds: float) -> None:
        """Waits for this real time, s.

        Raises:
            RuntimeError: a law has failed.
        """
        self._stop.wait(seconds)
        if self._error is not None:
            raise RuntimeError("the simulation has stopped") from self._error

    def close(self) -> None:
        """Ends the simulation and the server."""
        if not self._stop.is_set():
            self._stop.set()
            self._thread.join(STOP_TIMEOUT)
            self._server.stop()

    def _dragged(self, robot: int, event: viser.SceneNodeDragEvent[Any]) -> None:
        stretch = np.subtract(event.end_position, event.start_position)
        state = self.states[robot]
        self.pull(robot, None if event.phase == "end" else com_of(self._params[robot], state) + stretch)

    def _frame(self, client: viser.ClientHandle) -> None:
        places = np.array([state.ball_position for state in self.states])
        middle = 0.5 * (places.min(axis=0) + places.max(axis=0)) + (0.0, 0.0, 0.3)
        away = 2.0 + float(np.linalg.norm(np.ptp(places, axis=0)))
        # The look-at point moves along with the camera, so it comes last.
        client.camera.position = tuple(middle + away * np.array([0.5, -0.8, 0.35]))
        client.camera.look_at = tuple(middle)

    def _run(self) -> None:
        last = time.perf_counter()
        try:
            while not self._stop.is_set():
                now = time.perf_counter()
                if not self._pause.value:
                    self._advance(min(now - last, MAX_DELAY))
                last = now
                self._show()
                self._stop.wait(max(0.0, FRAME_DT - (time.perf_counter() - now)))
        except Exception as error:
            self._error = error
            self._text.content = f"The simulation has stopped: {error or type(error).__name__}"

    def _advance(self, seconds: float) -> None:
        crowd = self._crowd
        steps = max(1, round(CONTROL_DT / crowd.sim_dt))
        self._rest += seconds
        while self._rest >= steps * crowd.sim_dt and not self._stop.is_set():
            self._rest -= steps * crowd.sim_dt
            with self._lock:
                states = crowd.states
                for i, params in enumerate(self._params):
                    towards = self._pulled.get(i)
                    force = np.zeros(3) if towards is None else pull_of(params, com_of(params, states[i]), towards)
                    crowd.apply_force(i, force)
                torques = [
                    np.zeros(3) if state.tilt > FALLEN_TILT else np.asarray(law(state), dtype=np.float64)
                    for law, state in zip(self._laws, states, strict=True)
                ]
                try:
                    crowd.step(np.array(torques), steps)
                except DivergedError:
                    # A robot has left the terrain.
                    crowd.reset()

    def _show(self) -> None:
        with self._lock:
            states, payloads, terrain = self._crowd.states, self._crowd.payloads, self._crowd.terrain
        with self._server.atomic():
            self._ground.show(terrain, states[0].ball_position[:2])
            for nodes, params, state, carried in zip(self._robots, self._params, states, payloads, strict=True):
                x, y, _ = state.ball_position
                nodes.show(state.to_array(), 0.0 if terrain is None else float(terrain.height(x, y)))
                nodes.payloads.show(params, carried)
            rows = [f"| {i} | {math.degrees(state.tilt):.1f}° |" for i, state in enumerate(states)]
            self._text.content = "\n".join(["| robot | tilt |", "|---|---|", *rows])
