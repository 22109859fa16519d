"""The page: its controls only put commands into the runner's queue, its display only reads frames."""

import time
from collections.abc import Callable
from typing import Any

import viser

from ballbot_rs.viewer.camera import frame_robots, screen_ray
from ballbot_rs.viewer.command_panel import CommandPanel
from ballbot_rs.viewer.controls import Submit
from ballbot_rs.viewer.handle import PullHandle
from ballbot_rs.viewer.plots import Plots
from ballbot_rs.viewer.record_panel import RecordPanel
from ballbot_rs.viewer.recording import Frame
from ballbot_rs.viewer.robot_panel import RobotPanel, chosen
from ballbot_rs.viewer.run_panel import RunPanel
from ballbot_rs.viewer.scene import Scene
from ballbot_rs.viewer.server import unheard
from ballbot_rs.viewer.session import Session
from ballbot_rs.viewer.shapes import Look
from ballbot_rs.viewer.status import Status
from ballbot_rs.viewer.tuning import Tuning
from ballbot_rs.viewer.view_panel import ViewPanel

#: Time between two updates of the numbers, and of the plots, s.
STATUS_PERIOD, PLOT_PERIOD = 0.2, 0.4

#: Width of the panel, px.
PANEL_WIDTH = 400

#: Color of buttons and selections: white text on it has a contrast of 8.
BRAND = (26, 76, 140)


class Page:
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
        self._scene = Scene(server, look, PullHandle(submit).attach, self._floor_clicked)
        self._next_status = self._next_plot = 0.0
        self._last_choice: dict[str, str] = {}
        self._framed = (session.robots.name, len(session.robots))
        server.gui.configure_theme(control_width="large", show_logo=False, show_share_button=False, brand_color=BRAND)
        # Next to the scene, so that no robot is behind it.
        server.gui.main_panel.dock_right()
        server.gui.main_panel.set_width(PANEL_WIDTH)
        self._status = Status(server)
        self._commands = CommandPanel(server, submit)
        tabs = server.gui.add_tab_group()
        with tabs.add_tab("Run"):
            self.run = RunPanel(server, submit, session, self._commands)
        with tabs.add_tab("Robot"):
            self.robot = RobotPanel(server, submit, session, self.run.task)
        with tabs.add_tab("Parameters"):
            self._tuning = Tuning(server, submit, session)
        with tabs.add_tab("Plots"):
            self._plots = Plots(server)
        with tabs.add_tab("Record"):
            self._record = RecordPanel(server, submit)
        with tabs.add_tab("View"):
            self._view = ViewPanel(server, submit, self._scene, self._frame_all)
        server.on_client_connect(self._frame)

    def _frame(self, client: viser.ClientHandle) -> None:
        # The page may close in the meantime.
        with unheard(client._websock_connection):
            frame_robots(client, *self._scene.extent(*self._framed))

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
                session.move_setpoint(x, y)

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
                for panel in (self._commands, self.run, self.robot, self._tuning, self._record):
                    panel.show(session)
            if now >= self._next_plot and self._server.get_clients():
                self._next_plot = now + PLOT_PERIOD
                self._plots.show(session.history)
