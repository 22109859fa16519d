"""The numbers at the top of the page, and the message below them."""

import html
import math
import time

import numpy as np
import viser

from ballbot_rs._state_rows import BALL_POSITION, BALL_VELOCITY
from ballbot_rs.envs.registration import description_of, geometry_of
from ballbot_rs.viewer.panels.controls import put
from ballbot_rs.viewer.scene.commands import heading_of
from ballbot_rs.viewer.session.commands import CLICKED, DRIVEN
from ballbot_rs.viewer.session.recording import Commands, Frame
from ballbot_rs.viewer.session.session import Session

#: Slip speed above which a wheel counts as slipping, m/s.
SLIPS = 1e-3

#: How long a message is shown, s.
MESSAGE_SECONDS = 8.0


class Status:
    """Shown above the controls."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._html = server.gui.add_html("")
        self._total, self._since = 0, -math.inf

    def show(self, session: Session, frame: Frame) -> None:
        """Shows robot 0 of a frame, and the newest message for a while."""
        now = time.monotonic()
        if session.notices.total != self._total:
            self._total, self._since = session.notices.total, now
        is_new = bool(session.notices) and now - self._since < MESSAGE_SECONDS
        put(self._html, content=html_of(session, frame, session.notices[-1] if is_new else ""))


def html_of(session: Session, frame: Frame, message: str) -> str:
    """The whole block."""
    state, doing = doing_of(session)
    rows = rows_of(session, frame)
    cells = "".join(
        f'<dt title="{html.escape(hint)}">{label}</dt><dd>{html.escape(value)}</dd>' for label, value, hint in rows
    )
    shown = f'<p role="alert">{html.escape(message)}</p>' if message else ""
    return (
        f'<div class="ballbot-status"><header><b>{frame.time:.2f} s</b><span class="is-{state}">{doing}</span></header>'
        f"<dl>{cells}</dl>{shown}</div>"
    )


def doing_of(session: Session) -> tuple[str, str]:
    """Activity of the session, in a word and in full."""
    if session.replay_time is not None:
        return "replay", f"replay, {session.replay_time:.1f} of {session.recording.duration:.1f} s"
    if session.paused:
        return "paused", "paused"
    doing = "running" if session.speed == 1.0 else f"running at {session.speed:g} × real time"
    if session.is_recording:
        return "recording", f"recording, {session.recording.duration:.1f} s"
    return "running", doing


def rows_of(session: Session, frame: Frame) -> list[tuple[str, str, str]]:
    """Labels, values and explanations."""
    x, y = frame.states[0, BALL_POSITION][:2].tolist()
    speed = math.hypot(*frame.states[0, BALL_VELOCITY][:2].tolist())
    heading = math.degrees(heading_of(frame.states[0]))
    rows = [
        ("Tilt", f"{math.degrees(math.hypot(*frame.tilt)):.2f} deg", "from the equilibrium"),
        ("Speed", f"{speed:.2f} m/s", "of the ball"),
        ("Position", f"({_text(x)}, {_text(y)}) m", "of the ball"),
        ("Heading", f"{_text((heading + 180.0) % 360.0 - 180.0, 0)} deg", "of the body, from x, seen from above"),
        ("Traction", traction_of(frame), "share of the friction limit in use"),
    ]
    if frame.commands is None:
        rows.append(("Setpoint", _goal_of(session, frame), "green: where the robot is sent; orange: the way there"))
    else:
        if command := command_of(frame.commands):
            rows.append(("Command", command, "of robot 0; velocities are in its heading frame"))
        above = {label for label, _, _ in rows}
        for label, value in metrics_of(frame.commands).items():
            rows.append((f"{label} so far" if label in above else label, value, "of the episode so far"))
    return rows


def traction_of(frame: Frame) -> str:
    """How close the wheels are to slipping."""
    used = float(max(frame.contacts.friction_utilization[:3]))
    if math.isinf(used):
        return "a wheel has no load"
    text = f"{100.0 * used:.0f} % of the limit"
    slip = float(np.abs(frame.contacts.wheel_slip_speeds).max())
    if slip > SLIPS:
        return f"{text}, slips at {slip:.2f} m/s"
    # Static friction may be a little above the limit of sliding friction; models without slip have no limit.
    return f"{text}, about to slip" if used > 1.0 else text


def _goal_of(session: Session, frame: Frame) -> str:
    if frame.setpoint is None:
        return f"{session.controller} does not follow a setpoint"
    x, y = frame.setpoint.tolist()
    distance = float(np.linalg.norm(frame.setpoint - frame.states[0, BALL_POSITION][:2]))
    return f"({_text(x)}, {_text(y)}) m, {distance:.2f} m away"


def _text(value: float, digits: int = 2) -> str:
    """A number without the sign of a zero."""
    return f"{round(value, digits) + 0.0:.{digits}f}"


def command_of(commands: Commands) -> str:
    """The command of robot 0, and its source; empty for a task without commands."""
    command, geometry = commands.values[0].tolist(), geometry_of(commands.task)
    if geometry == "impulse":
        impulse, azimuth = commands.pushes[0, :2].tolist()
        return (
            "no push yet" if math.isnan(impulse) else f"pushed by {impulse:.2f} N·s to {math.degrees(azimuth):.0f} deg"
        )
    if geometry == DRIVEN:
        x, y, rate = command
        text = f"({x:.2f}, {y:.2f}) m/s, {rate:.2f} rad/s"
    elif geometry == CLICKED:
        text = f"go to ({command[0]:.2f}, {command[1]:.2f}) m"
    elif geometry == "curve":
        text = f"follow the curve at {command[0]:.2f} m/s"
    elif not command:
        return ""
    else:
        rows = description_of(commands.task)["command"]
        text = ", ".join(f"{row['name']} {value:.3g}" for row, value in zip(rows, command, strict=True))
    return f"{text}; {'by hand' if commands.by_hand else 'by the task'}"


def metrics_of(commands: Commands) -> dict[str, str]:
    """The metrics of robot 0 so far, by label."""
    units = {metric["name"]: metric["unit"] for metric in description_of(commands.task)["metrics"]}
    return {
        name.replace("_", " ").capitalize(): "not yet" if math.isnan(value) else f"{value:.3f} {units[name]}".rstrip()
        for name, value in commands.metrics.items()
    }
