"""The tab Run: time, setpoints, pushes, and how to command a task by hand."""

import math
from typing import Any

import viser

from ballbot_rs.envs.registration import description_of, known_tasks
from ballbot_rs.viewer.panels.controls import add_button, bound, on_client, put
from ballbot_rs.viewer.server.teleop import HOLD
from ballbot_rs.viewer.session.commanding import ACCELERATION, CLICKED, DRIVEN, Commanding
from ballbot_rs.viewer.session.runner import Command, Submit
from ballbot_rs.viewer.session.session import MAX_IMPULSE, MAX_SPEED, MIN_SPEED, Session

#: Buttons.
PAUSE, CONTINUE, STEP, RESET = "Pause", "Continue", "Step", "Reset"
CIRCLE, EIGHT, ORIGIN = "Circle", "Figure eight", "Origin"

#: The largest push gives the body this speed, m/s: more than any preset withstands.
PUSHED_SPEED = 3.0


class RunPanel:
    """Controls of the simulation.

    Args:
        server: shows them.
        submit: puts a command into the queue.
        session: only read here, before the runner starts.
    """

    def __init__(self, server: viser.ViserServer, submit: Submit, session: Session) -> None:
        self._gui, self._submit = server.gui, submit
        gui = server.gui
        self.task = gui.add_dropdown("Task", known_tasks(), initial_value=session.task)
        self._time = gui.add_button_group("Time", (PAUSE, STEP, RESET), hint="Step: pauses, then one control step")
        self._time.on_click(on_client(submit, self._of_time))
        self._add_push(session)
        gui.add_divider()
        self._help = gui.add_markdown("")
        self._sample = add_button(
            gui,
            submit,
            "New command of the task",
            Session.sample_commands,
            hint="the task samples new commands, from where the robots are",
        )
        self._add_routes()
        gui.add_divider()
        self._add_time(session)

    def _add_time(self, session: Session) -> None:
        gui, submit = self._gui, self._submit
        speed = self._speed = gui.add_slider(
            "Speed (×)", min=MIN_SPEED, max=MAX_SPEED, step=0.01, initial_value=1.0, hint="1: real time; above: fast"
        )
        self._shown_speed = session.speed
        speed.on_update(on_client(submit, lambda: bound(Session.set_speed, speed.value)))
        degrees = [round(math.degrees(angle), 1) for angle in session.start_tilt]
        self._tilts = [
            gui.add_slider(
                f"Reset tilt {axis} (deg)", min=-20.0, max=20.0, step=0.5, initial_value=value, hint="after Reset"
            )
            for axis, value in zip("xy", degrees, strict=True)
        ]

    def _of_time(self) -> Command:
        if self._time.value == STEP:
            return _single_step
        if self._time.value == RESET:
            return bound(Session.reset, [math.radians(slider.value) for slider in self._tilts])
        return bound(_set_paused, self._time.value == PAUSE)

    def _add_routes(self) -> None:
        gui, submit = self._gui, self._submit
        self._routes = gui.add_button_group("Send to", (CIRCLE, EIGHT, ORIGIN), hint="the setpoint moves there")
        self._routes.on_click(on_client(submit, self._of_routes))
        self.clicks = gui.add_checkbox("Click to go", True, hint="a click on the floor is the setpoint, or the goal")

    def _of_routes(self) -> Command:
        if self._routes.value == ORIGIN:
            return bound(Session.move_setpoint, 0.0, 0.0)
        return bound(Session.follow, "circle" if self._routes.value == CIRCLE else "eight")

    def _add_push(self, session: Session) -> None:
        gui = self._gui
        push = gui.add_button("Push", hint="robots may also be pulled: drag robot 0")
        push.on_click(on_client(self._submit, lambda: bound(Session.push, *self.push)))
        self._azimuth = gui.add_slider(
            "Push to (deg)",
            min=0,
            max=355,
            step=5,
            initial_value=0,
            hint="azimuth, from x, seen from above",
        )
        most = largest_push(session)
        self._impulse = gui.add_slider("Push by (N·s)", min=0.0, max=most, step=0.05, initial_value=min(0.3, most))

    @property
    def push(self) -> tuple[float, float]:
        """Direction of the push, rad, and its impulse, N·s."""
        return math.radians(self._azimuth.value), self._impulse.value

    def show(self, session: Session) -> None:
        """Shows the state of the session."""
        put(self._time, options=(CONTINUE if session.paused else PAUSE, STEP, RESET))
        put(self.task, value=session.task)
        most = largest_push(session)
        if most != self._impulse.max:
            # The value first: it must be within the bounds at all times.
            put(self._impulse, value=min(self._impulse.value, most))
            put(self._impulse, max=most)
        if session.speed != self._shown_speed:
            self._shown_speed = session.speed
            put(self._speed, value=session.speed)
        commanding = session.commanding
        text = "" if commanding is None else help_of(commanding)
        put(self._help, visible=bool(text), content=text)
        put(self._sample, visible=commanding is not None and bool(description_of(session.task)["command"]))
        # A route belongs to the task balance, a goal may be clicked.
        routes = (CIRCLE, EIGHT, ORIGIN) if commanding is None else (ORIGIN,)
        put(self._routes, visible=session.takes_clicks, options=routes)
        put(self.clicks, visible=session.takes_clicks)


def largest_push(session: Session) -> float:
    """Of the slider, N·s, at least two of its steps; it follows from the mass of the nominal robot."""
    return min(max(round(PUSHED_SPEED * session.robots.setup.nominal.body_mass, 1), 0.1), MAX_IMPULSE)


def help_of(commanding: Commanding) -> str:
    """How to command a task by hand, and the limits of its commands."""
    if commanding.geometry == DRIVEN:
        turns = f"{commanding.max_yaw_rate:g} rad/s" if commanding.max_yaw_rate > 0.0 else "no turns"
        limits = f"{commanding.max_speed:g} m/s and {turns}"
        return (
            "**Drive**: `W` `A` `S` `D` or arrows: velocity along the heading (violet marks); `Q` `E`: turn; space: "
            "stop; `C`: camera behind the robot. Gamepad: its two sticks. "
            f"At most {limits}, as the task samples; the velocity changes by {ACCELERATION:g} m/s². The robot stops if "
            f"the page loses the focus, or is silent for {HOLD:g} s. In a field, click on the scene first."
        )
    if commanding.geometry == CLICKED:
        return (
            f"**Click on the floor**: the goal. It is at most {commanding.max_distance:g} m from the ball, as the task "
            "samples; a farther click is moved closer."
        )
    if commanding.takes_clicks:
        return "**Click on the floor**: a point for the task."
    return ""


def _set_paused(session: Session, value: Any) -> None:
    session.paused = bool(value)


def _single_step(session: Session) -> None:
    session.paused = True
    session.step()
