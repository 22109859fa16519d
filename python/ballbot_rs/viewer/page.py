"""The page: its controls only put commands into the runner's queue, its display only reads frames."""

import functools
import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import viser

from ballbot_rs._core import MODELS
from ballbot_rs._state_rows import BALL_POSITION
from ballbot_rs.control.resolve import NAMES
from ballbot_rs.viewer.camera import floor_point, look_from
from ballbot_rs.viewer.command_panel import CommandPanel
from ballbot_rs.viewer.commanding import DRIVEN
from ballbot_rs.viewer.handle import PullHandle
from ballbot_rs.viewer.plots import Plots
from ballbot_rs.viewer.recording import Frame
from ballbot_rs.viewer.runner import Command
from ballbot_rs.viewer.scene import Scene
from ballbot_rs.viewer.session import MIN_SPEED, PAGE_TASKS, Session
from ballbot_rs.viewer.shapes import Look
from ballbot_rs.viewer.tuning import Tuning

#: What the page calls a policy, whose file is named below.
POLICY = "policy file"

#: What the page calls the choices of `session.OBSERVATIONS`.
SEES = {"ground_truth": "true state", "sensors": "estimate"}

#: Tasks whose robot would leave the picture.
FOLLOWED = (DRIVEN,)

#: Time between two updates of the numbers, and of the plots, s.
STATUS_PERIOD, PLOT_PERIOD = 0.2, 0.4

#: From where on a wheel is said to slip, m/s.
SLIPS = 1e-3

Submit = Callable[[Command], bool]


class Page:
    """Controls and display of a session on a server.

    Args:
        server: shows it.
        submit: puts a command into the queue; commands run in the thread that calls `show`.
        session: only read here, before the runner starts.
        look: makes a robot's look of its name.
    """

    def __init__(
        self, server: viser.ViserServer, submit: Submit, session: Session, look: Callable[[str], Look]
    ) -> None:
        self._server, self._submit = server, submit
        self._scene = Scene(server, look)
        self._next_status = self._next_plot = 0.0
        self._last_choice = ("", "")
        # Without its button for sharing, which this server refuses anyway, viser 0.2.23's page crashes.
        server.gui.configure_theme(control_width="large", show_logo=False)
        self._status = server.gui.add_text("Status", "", disabled=True)
        self._tilt = server.gui.add_text("Tilt", "", disabled=True, hint="from the equilibrium")
        self._traction = server.gui.add_text("Traction", "", disabled=True, hint="share of the friction limit in use")
        self._goal = server.gui.add_text(
            "Setpoint", "", disabled=True, hint="green: where you sent the robot; orange: the target on the way there"
        )
        self._commands = CommandPanel(server, submit)
        self._message = server.gui.add_text("Message", "", disabled=True)
        tabs = server.gui.add_tab_group()
        with tabs.add_tab("Run"):
            self._commands.add_controls()
            self._add_push()
            self._add_run(session)
        with tabs.add_tab("Robot"):
            self._add_choices(session)
        with tabs.add_tab("Parameters"):
            self._tuning = Tuning(server, submit, session)
        with tabs.add_tab("Record"):
            self._add_recording()
        with tabs.add_tab("Plots"):
            self._plots = Plots(server)
        self._handle = PullHandle(server, submit)
        self._scene.floor.on_click(self._floor_clicked)
        distance = 1.2 + 0.9 * math.sqrt(len(session.robots) - 1)
        server.on_client_connect(lambda client: look_from(client, distance))

    def _add_choices(self, session: Session) -> None:
        gui = self._server.gui
        names = [*NAMES, POLICY]
        chosen = session.controller if session.controller in NAMES else POLICY
        self._model = gui.add_dropdown("Model", MODELS, initial_value=session.robots.model)
        self._robot = gui.add_dropdown("Robot", session.robot_names, initial_value=session.robots.name)
        self._task = gui.add_dropdown("Task", PAGE_TASKS, initial_value=session.task)
        self._sees = gui.add_dropdown(
            "Controller sees",
            tuple(SEES.values()),
            initial_value=SEES[session.observation],
            hint="estimate: what follows from gyroscope, accelerometer and encoders",
        )
        counts = sorted({1, 4, 16, len(session.robots)})
        self._count = gui.add_dropdown("Robots", [str(n) for n in counts], initial_value=str(len(session.robots)))
        # Its list is the longest, and opens upward: low on the page, where there is room for all of it.
        self._controller = gui.add_dropdown("Controller", names, initial_value=chosen)
        self._policy = gui.add_text(
            "Policy file", "" if chosen != POLICY else session.controller, hint="path of an .onnx file"
        )
        for control in (self._model, self._robot, self._task, self._controller, self._policy, self._sees, self._count):
            control.on_update(self._choose)

    def _choose(self, event: viser.GuiEvent[Any]) -> None:
        if event.client_id is None:  # Our own correction of what is shown.
            return
        model, robot, count = self._model.value, self._robot.value, self._count.value
        controller = self._policy.value if self._controller.value == POLICY else self._controller.value
        observation = next(name for name, label in SEES.items() if label == self._sees.value)
        task = self._task.value
        waits_for_name = self._controller.value == POLICY and not controller

        def command(session: Session) -> None:
            changes: dict[str, Any] = {}
            try:
                if model != session.robots.model:
                    changes["model"] = model
                if robot != session.robots.name:
                    changes["robot"] = robot
                if count != str(len(session.robots)):
                    changes["num_robots"] = int(count)
                if task != session.task:
                    changes["task"] = task
                if observation != session.observation:
                    changes["observation"] = observation
                if waits_for_name:
                    session.notices.append("name a policy file")
                elif controller != session.controller:
                    changes["controller"] = controller
                if changes:
                    session.choose(**changes)
            finally:
                if not waits_for_name:
                    self._correct(session)

        self._submit(command)

    def _correct(self, session: Session) -> None:
        """Shows what is simulated, where a choice was refused."""
        chosen = session.controller if session.controller in NAMES else POLICY
        shown = (
            (self._model, session.robots.model),
            (self._task, session.task),
            (self._robot, session.robots.name),
            (self._controller, chosen),
            (self._sees, SEES[session.observation]),
            (self._count, str(len(session.robots))),
        )
        for control, value in shown:
            if control.value != value:
                control.value = value
        if chosen == POLICY and self._policy.value != session.controller:
            self._policy.value = session.controller

    def _add_run(self, session: Session) -> None:
        gui = self._server.gui
        self._paused = gui.add_checkbox("Paused", session.paused)
        self._paused.on_update(self._on(lambda: _set_paused(self._paused.value)))
        step = gui.add_button("Step", hint="pauses, then one control step")
        step.on_click(self._on(lambda: self._single_step))
        follow = gui.add_checkbox("Camera follows robot 0", session.task in FOLLOWED)
        self._scene.follows = follow.value
        follow.on_update(self._on(lambda: functools.partial(self._set_follows, follow.value)))
        speed = gui.add_slider("Speed", min=MIN_SPEED, max=1.0, step=0.01, initial_value=1.0, hint="1: real time")
        speed.on_update(self._on(lambda: _bind(Session.set_speed, speed.value)))
        degrees = [round(math.degrees(angle), 1) for angle in session.start_tilt]
        about_x, about_y = (
            gui.add_slider(f"Start tilt {axis} (deg)", min=-20.0, max=20.0, step=0.5, initial_value=value)
            for axis, value in zip("xy", degrees, strict=True)
        )
        reset = gui.add_button("Reset")
        reset.on_click(
            self._on(lambda: _bind(Session.reset, (math.radians(about_x.value), math.radians(about_y.value))))
        )

    def _set_follows(self, value: bool, session: Session) -> None:  # noqa: ARG002
        self._scene.follows = value

    def _single_step(self, session: Session) -> None:
        session.paused = True
        self._paused.value = True
        session.step()

    def _add_push(self) -> None:
        gui = self._server.gui
        direction = gui.add_slider(
            "Direction (deg)", min=0, max=355, step=5, initial_value=0, hint="from x, seen from above"
        )
        impulse = gui.add_slider("Impulse (N·s)", min=0.0, max=5.0, step=0.05, initial_value=0.3)
        push = gui.add_button("Push")
        push.on_click(self._on(lambda: _bind(Session.push, math.radians(direction.value), impulse.value)))
        self._clicks = gui.add_checkbox("Click on the floor moves the setpoint or goal", True)
        self._origin = gui.add_button("Setpoint or goal to the origin")
        self._origin.on_click(self._on(lambda: _bind(Session.move_setpoint, 0.0, 0.0)))

    def _add_recording(self) -> None:
        gui = self._server.gui
        buttons: dict[str, Command] = {
            "Record": Session.start_recording,
            "Stop recording": Session.stop_recording,
            "Replay": Session.replay,
            "Back to the simulation": Session.end_replay,
        }
        for label, command in buttons.items():
            gui.add_button(label).on_click(self._on(functools.partial(_same, command)))
        position = gui.add_slider("Replay from (%)", min=0.0, max=100.0, step=0.5, initial_value=0.0)
        position.on_update(
            self._on(lambda: lambda session: session.replay(0.01 * position.value * session.recording.duration))
        )

    def _on(self, make: Callable[[], Command]) -> Callable[[viser.GuiEvent[Any]], None]:
        """A callback that submits the command made when a client, not the server, changed something."""

        def callback(event: viser.GuiEvent[Any]) -> None:
            if event.client_id is not None:
                self._submit(make())

        return callback

    def _floor_clicked(self, event: viser.SceneNodePointerEvent[Any]) -> None:
        camera = event.client.camera
        # The ray of the event is wrong in viser 0.2.23; where on the screen the click was is not.
        goal = floor_point(camera.position, camera.wxyz, camera.fov, camera.aspect, event.screen_pos)
        if not self._clicks.value or goal is None:
            return
        x, y = (float(part + shift) for part, shift in zip(goal, self._scene.middle, strict=True))

        def command(session: Session) -> None:
            # The end of a drag of the handle comes as a click, too.
            if session.pull_point is None and session.takes_clicks:
                session.move_setpoint(x, y)

        self._submit(command)

    def show(self, session: Session, frame: Frame) -> None:
        """Shows a frame; the numbers and plots less often."""
        now = time.perf_counter()
        with self._server.atomic():
            self._scene.show(frame)
            self._handle.show(session)
            if (session.controller, session.task) != self._last_choice:
                self._last_choice = (session.controller, session.task)
                self._goal.visible = session.commanding is None
                self._clicks.visible = self._origin.visible = session.takes_clicks
                self._correct(session)
            if now >= self._next_status:
                self._next_status = now + STATUS_PERIOD
                self._show_status(session, frame)
                self._commands.show(session, frame)
                self._tuning.show(session)
            if now >= self._next_plot and self._server.get_clients():
                self._next_plot = now + PLOT_PERIOD
                self._plots.show(session.history)

    def _show_status(self, session: Session, frame: Frame) -> None:
        doing = (
            "paused"
            if session.paused
            else "running"
            if session.speed == 1.0
            else f"at {session.speed:.2f} of real time"
        )
        if session.replay_time is not None:
            doing = f"replay, {session.replay_time:.1f} of {session.recording.duration:.1f} s"
        elif session.is_recording:
            doing += f", recording {session.recording.duration:.1f} s"
        texts = (
            (self._status, f"{frame.time:.2f} s, {doing}"),
            (self._tilt, f"{math.degrees(math.hypot(*frame.tilt)):.2f} deg"),
            (self._traction, _traction_of(frame)),
            (self._goal, _goal_of(session, frame)),
            (self._message, session.notices[-1] if session.notices else ""),
        )
        for control, text in texts:
            if control.value != text:
                control.value = text


def _traction_of(frame: Frame) -> str:
    used = float(max(frame.utilization[:3]))
    if math.isinf(used):
        return "a wheel has no load"
    text = f"{100.0 * used:.0f} % of the limit"
    if float(np.abs(frame.slip).max()) > SLIPS:
        return f"{text}, slips at {float(np.abs(frame.slip).max()):.2f} m/s"
    # Friction at rest may be a little above the limit of sliding friction; models without slip know no limit.
    return f"{text}, about to slip" if used > 1.0 else text


def _goal_of(session: Session, frame: Frame) -> str:
    if frame.setpoint is None:
        return f"{session.controller} does not follow a setpoint"
    x, y = (float(part) for part in frame.setpoint)
    distance = float(np.linalg.norm(frame.setpoint - frame.states[0, BALL_POSITION][:2]))
    return f"({x:.2f}, {y:.2f}) m, {distance:.2f} m away"


def _bind(method: Callable[..., None], *arguments: Any) -> Command:
    return lambda session: method(session, *arguments)


def _same(command: Command) -> Command:
    return command


def _set_paused(value: Any) -> Command:
    def command(session: Session) -> None:
        session.paused = bool(value)

    return command
