"""The page in the browser: session, runner, server, scene and panels put together."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import viser

from ballbot_rs.viewer.panels.display import DisplayPanel
from ballbot_rs.viewer.panels.plots import Plots
from ballbot_rs.viewer.panels.record import RecordPanel
from ballbot_rs.viewer.panels.robot import ParameterPanel, RobotPanel, chosen
from ballbot_rs.viewer.panels.run import RunPanel
from ballbot_rs.viewer.panels.sensitivity import SensitivityPanel
from ballbot_rs.viewer.panels.status import Status
from ballbot_rs.viewer.scene.cameras import CHASE, frame_robots, screen_ray
from ballbot_rs.viewer.scene.look import Look, from_params
from ballbot_rs.viewer.scene.scene import Scene
from ballbot_rs.viewer.scene.urdf import URDFS, from_urdf
from ballbot_rs.viewer.server.server import HOST, LocalServer, free_port, unheard
from ballbot_rs.viewer.server.teleop import Report, Teleop
from ballbot_rs.viewer.session.recording import Frame
from ballbot_rs.viewer.session.runner import Runner, Submit
from ballbot_rs.viewer.session.session import Session

#: Time between two updates of the numbers, and of the plots, s.
STATUS_PERIOD, PLOT_PERIOD = 0.2, 0.4

#: Width of the panel, px.
PANEL_WIDTH = 400


class Display:
    """Controls and display of a session on a server.

    Args:
        server: shows it.
        submit: puts a command into the queue; commands run in the thread that calls `show`.
        session: only read here, before the runner starts.
        look: makes a robot's look from its name.
    """

    def __init__(
        self, server: viser.ViserServer, submit: Submit, session: Session, look: Callable[[str], Look]
    ) -> None:
        self._server, self._submit = server, submit
        self._scene = Scene(server, look, self._dragged, self._floor_clicked)
        self._next_status = self._next_plot = 0.0
        self._last_choice: dict[str, str] = {}
        self._framed = (session.robots.name, len(session.robots))
        # Next to the scene, so that no robot is behind it.
        server.gui.main_panel.dock_right()
        server.gui.main_panel.set_width(PANEL_WIDTH)
        self._status = Status(server)
        self.tabs = tabs = server.gui.add_tab_group()
        with tabs.add_tab("Run"):
            self.run = RunPanel(server, submit, session)
        with tabs.add_tab("Robot"):
            self.robot = RobotPanel(server, submit, session, self.run.task)
        with tabs.add_tab("Parameters"):
            self._parameters = ParameterPanel(server, submit, session)
            self.sensitivity = SensitivityPanel(server, submit, lambda: self.run.push)
        with tabs.add_tab("Plots"):
            self._plots = Plots(server)
        with tabs.add_tab("Record"):
            self._record = RecordPanel(server, submit)
        with tabs.add_tab("View"):
            self.display = DisplayPanel(server, submit, self._scene, self._plots, self._frame_all)
        server.on_client_connect(self._frame)

    def reported(self, report: Report) -> None:
        """Follows a report of a page."""
        if report.dark is not None:
            self.display.set_system_dark(report.dark)
        if report.chase:
            self.display.toggle_chase()

    def _frame(self, client: viser.ClientHandle) -> None:
        # The page may close in the meantime.
        with unheard(client._websock_connection):
            behind = self._scene.camera.kind == CHASE
            frame_robots(client, *self._scene.extent(*self._framed), behind=behind)

    def _frame_all(self) -> None:
        for client in self._server.get_clients().values():
            self._frame(client)

    def _floor_clicked(self, event: viser.SceneNodePointerEvent[Any]) -> None:
        camera = event.client.camera
        ray = screen_ray(camera.wxyz, camera.fov, camera.aspect, event.screen_pos)
        goal = self._scene.point_at(camera.position, ray)
        if not self.run.clicks.value or goal is None:
            return
        x, y = goal

        def command(session: Session) -> None:
            if session.takes_clicks:
                session.click(x, y)

        self._submit(command)

    def _dragged(self, event: viser.SceneNodeDragEvent[Any]) -> None:
        """Pulls robot 0: dragging stretches a spring from its center of mass to the pointer."""
        stretch = self._scene.camera.vector(np.subtract(event.end_position, event.start_position))
        ends = event.phase == "end"

        def command(session: Session) -> None:
            if ends:
                session.pull(None)
            elif session.replay_time is None:
                session.pull(session.robots.com + stretch)

        self._submit(command)

    def show(self, session: Session, frame: Frame) -> None:
        """Shows a frame; the numbers and plots less often."""
        now = time.perf_counter()
        with self._server.atomic():
            self._scene.show(frame)
            choice = chosen(session)
            if choice != self._last_choice:
                self._last_choice = choice
                self.robot.correct(session)
            shown = (frame.robot, len(frame.states))
            if shown != self._framed:
                self._framed = shown
                self._frame_all()
            if now >= self._next_status:
                self._next_status = now + STATUS_PERIOD
                self._status.show(session, frame)
                for panel in (self.run, self.robot, self._parameters, self.sensitivity, self._record):
                    panel.show(session)
            if now >= self._next_plot and self._server.get_clients():
                self._next_plot = now + PLOT_PERIOD
                self._plots.show(session.history)


class View:
    """A session on a page in the browser, running from the constructor to `stop`.

    Args:
        session: the session to show; the view owns it from now on.
        port: where the server listens; if it is taken, the next free one.
        urdfs: bot and ball of robots by name, in addition to the robots of this package.

    Raises:
        ValueError: a port out of range, or a URDF that cannot be shown.
        OSError: no port is free, or a file of a URDF cannot be read.
    """

    def __init__(self, session: Session, port: int = 8080, urdfs: dict[str, tuple[Path, Path]] | None = None) -> None:
        self._urdfs = {**URDFS, **(urdfs or {})}
        self._params = {name: session.params_of(name) for name in session.robot_names}
        # Invalid files are rejected here, not by the display thread.
        self._look(session.robots.name)
        #: What the page shows now.
        self.frame: Frame | None = None
        self.runner = Runner(session, self._show)
        self._teleop = Teleop(self.runner.submit)
        self.server = LocalServer(free_port(port), self._teleop)
        self._page = Display(self.server, self.runner.submit, session, self._look)
        self._teleop.on_report = self._page.reported
        self.runner.start()

    def _show(self, session: Session, frame: Frame) -> None:
        self._teleop.show(session)
        self._page.show(session, frame)
        self.frame = frame

    def _look(self, name: str) -> Look:
        params = self._params[name]
        files = self._urdfs.get(name)
        if files is None or not all(path.is_file() for path in files):
            return from_params(params)
        return from_urdf(params, *files)

    def add_tab(self, title: str) -> viser.GuiTabHandle:
        """Another tab of the panel."""
        return self._page.tabs.add_tab(title)

    @property
    def url(self) -> str:
        """The page's address."""
        return f"http://{HOST}:{self.server.get_port()}"

    def stop(self) -> None:
        """Ends the simulation and the server."""
        self.runner.stop()
        self._page.sensitivity.stop()
        self.server.stop()
