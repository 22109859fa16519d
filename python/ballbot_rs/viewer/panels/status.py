"""The numbers at the top of the page, and the message below them."""

import dataclasses
import html
import math
import time
from typing import Final

import numpy as np
import numpy.typing as npt
import viser

from ballbot_rs._state_rows import BALL_POSITION, BALL_VELOCITY
from ballbot_rs.envs.registration import description_of, geometry_of
from ballbot_rs.viewer.panels.controls import put
from ballbot_rs.viewer.scene.heading import heading_of
from ballbot_rs.viewer.session.commanding import CLICKED, DRIVEN
from ballbot_rs.viewer.session.recording import Commands, Frame
from ballbot_rs.viewer.session.session import Session

FloatArray = npt.NDArray[np.float64]

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
    has_ghost = frame.ghost is not None
    cells = "".join(cells_of(row, has_ghost) for row in rows)
    shown = f'<p role="alert">{html.escape(message)}</p>' if message else ""
    kind = ' class="has-ghost"' if has_ghost else ""
    return (
        f'<div class="ballbot-status"><header><b>{frame.time:.2f} s</b><span class="is-{state}">{doing}</span>'
        f'<button data-ballbot="help" title="Help: keys and mouse">?</button></header>'
        f"<dl{kind}>{legend_of(frame)}{cells}</dl>{shown}</div>"
    )


def legend_of(frame: Frame) -> str:
    """Which robot is which, above two columns of numbers; empty without a ghost."""
    if frame.ghost is None:
        return ""
    return (
        f'<dt></dt><dd class="is-solid">{html.escape(frame.label)}</dd>'
        f'<dd class="is-ghost" title="the transparent robot">{html.escape(frame.ghost.label)}</dd>'
    )


def cells_of(row: "Row", has_ghost: bool) -> str:
    """A line of the block."""
    ghost = f"<dd>{html.escape(row.ghost)}</dd>" if has_ghost and row.ghost else ""
    wide = ' class="is-wide"' if has_ghost and not row.ghost else ""
    label = f'<dt title="{html.escape(row.hint)}">{html.escape(row.label)}</dt>'
    return f"{label}<dd{wide}>{html.escape(row.value)}</dd>{ghost}"


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


@dataclasses.dataclass(frozen=True)
class Row:
    """A number of robot 0, and of the ghost if it has it."""

    label: str
    value: str
    hint: str
    ghost: str = ""


def rows_of(session: Session, frame: Frame) -> list[Row]:
    """The numbers of a frame."""
    motion = motion_of(frame.states[0], frame.tilt)
    ghost = {} if frame.ghost is None else motion_of(frame.ghost.state, frame.ghost.tilt)
    rows = [Row(label, value, HINTS[label], ghost.get(label, "")) for label, value in motion.items()]
    if frame.has_forces:
        rows.append(Row("Traction", traction_of(frame), "fraction of the friction limit in use"))
    rows += limits_of(frame)
    # A log has no setpoint.
    if frame.commands is None and (frame.setpoint is not None or frame.has_forces):
        rows.append(Row("Setpoint", _goal_of(session, frame), "green: where the robot is sent; orange: the way there"))
    if frame.commands is not None:
        if command := command_of(frame.commands):
            rows.append(Row("Command", command, "of robot 0; forward and left are along its heading"))
        rows += metrics_of(frame.commands)
    return rows


def limits_of(frame: Frame) -> list[Row]:
    """How close robot 0 is to the limits that a control barrier keeps."""
    rows = []
    if frame.speed_limit is not None:
        speed = float(np.linalg.norm(frame.states[0, BALL_VELOCITY][:2]))
        beyond = " (beyond)" if speed > frame.speed_limit else ""
        text = f"{frame.speed_limit:.2f} m/s, {100.0 * speed / frame.speed_limit:.0f} % in use{beyond}"
        rows.append(Row("Speed limit", text, "a control barrier keeps the ball slower"))
    if frame.boundary is not None:
        least_x, largest_x, least_y, largest_y = frame.boundary
        x, y = frame.states[0, BALL_POSITION][:2].tolist()
        left = min(x - least_x, largest_x - x, y - least_y, largest_y - y)
        text = f"{left:.2f} m away" if left >= 0.0 else f"{-left:.2f} m beyond"
        rows.append(Row("Boundary", text, "red line: a control barrier stops the ball before it"))
    return rows


#: Explanations of `motion_of`.
HINTS = {
    "Tilt": "from the equilibrium",
    "Speed": "of the ball",
    "Position": "of the ball",
    "Heading": "of the body, from x, seen from above: the direction of the violet marks",
}


def motion_of(state: FloatArray, tilt: FloatArray) -> dict[str, str]:
    """How a robot moves."""
    x, y = state[BALL_POSITION][:2].tolist()
    heading = math.degrees(heading_of(state))
    return {
        "Tilt": f"{math.degrees(math.hypot(*tilt)):.2f} deg",
        "Speed": f"{math.hypot(*state[BALL_VELOCITY][:2].tolist()):.2f} m/s",
        "Position": f"({_text(x)}, {_text(y)}) m",
        "Heading": f"{_text((heading + 180.0) % 360.0 - 180.0, 0)} deg",
    }


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
    ball = frame.states[0, BALL_POSITION][:2]
    if frame.route is not None:
        # On a curve the setpoint leads: its distance is not an error.
        return f"({_text(x)}, {_text(y)}) m, ball {_distance(frame.route, ball):.2f} m off the curve"
    distance = float(np.linalg.norm(frame.setpoint - ball))
    return f"({_text(x)}, {_text(y)}) m, {distance:.2f} m away"


def _distance(curve: npt.NDArray[np.float64], point: npt.NDArray[np.float64]) -> float:
    """Distance of a point from a closed polygon, m."""
    edges = np.roll(curve, -1, axis=0) - curve
    along = np.einsum("ij,ij->i", point - curve, edges) / np.einsum("ij,ij->i", edges, edges)
    nearest = curve + np.clip(along, 0.0, 1.0)[:, np.newaxis] * edges
    return float(np.linalg.norm(nearest - point, axis=1).min())


def _text(value: float, digits: int = 2) -> str:
    """A number without the sign of a zero."""
    return f"{round(value, digits) + 0.0:.{digits}f}"


def command_of(commands: Commands) -> str:
    """The command of robot 0 in words, and its source; empty for a task without commands."""
    command, geometry = commands.values[0].tolist(), geometry_of(commands.task)
    if geometry == "impulse":
        impulse, azimuth = commands.pushes[0, :2].tolist()
        return (
            "no push yet" if math.isnan(impulse) else f"pushed by {impulse:.2f} N·s to {math.degrees(azimuth):.0f} deg"
        )
    if geometry == DRIVEN:
        text = velocity_of(*command)
    elif geometry == CLICKED:
        text = f"go to ({_text(command[0])}, {_text(command[1])}) m"
    elif geometry == "curve":
        text = f"follow the curve at {command[0]:.2f} m/s"
    elif not command:
        return ""
    else:
        rows = description_of(commands.task)["command"]
        text = ", ".join(f"{row['name']} {value:.3g}" for row, value in zip(rows, command, strict=True))
    return f"{text} ({'by hand' if commands.by_hand else 'from the task'})"


def velocity_of(x: float, y: float, rate: float) -> str:
    """A commanded velocity in the heading frame, m/s, and rate of the heading, rad/s, in words."""
    parts = [
        f"{abs(value):.2f} {unit} {names[value < 0.0]}"
        for value, unit, names in (
            (x, "m/s", ("forward", "back")),
            (y, "m/s", ("left", "right")),
            (rate, "rad/s", ("turning left", "turning right")),
        )
        if round(value, 2)
    ]
    return ", ".join(parts) or "stay at rest"


#: Metrics whose name is not a word for a reader, by task: label, factor to the unit shown, and format with it.
WORDS: Final = {
    ("terrain", "share"): ("Progress", 100.0, "{:.0f} % of the commanded distance"),
    ("terrain", "level"): ("Terrain", 1.0, "level {:.0f}"),
    ("goal", "goals_held"): ("Goals reached", 100.0, "{:.0f} %"),
    ("goal", "time_ratio"): ("Time to a goal", 1.0, "{:.2f} × a fast move from rest to rest"),
    ("carry", "goals_held"): ("Goals reached", 100.0, "{:.0f} %"),
    ("carry", "time_ratio"): ("Time to a goal", 1.0, "{:.2f} × a fast move from rest to rest"),
    ("carry", "spilled"): ("Spilled", 100.0, "{:.0f} %"),
    ("carry", "slosh"): ("Highest water", 1e3, "{:.1f} mm at the wall of the glass"),
    ("carry", "tray_acceleration"): ("Force on the glass", 1.0, "{:.2f} m/s² in the plane of the tray (rms)"),
    ("navigate", "goals_held"): ("Goals reached", 100.0, "{:.0f} %"),
    ("navigate", "time_ratio"): ("Time to a goal", 1.0, "{:.2f} × a fast move from rest to rest"),
    ("navigate", "collisions"): ("Collisions", 1.0, "{:.0f}"),
    ("navigate", "clearance"): ("Nearest obstacle", 1.0, "{:.2f} m from the robot"),
    ("ride", "braking_distance"): ("Braking distance", 1.0, "{:.2f} m"),
    ("ride", "braking_time"): ("Braking time", 1.0, "{:.2f} s"),
    ("ride", "stops"): ("Stops", 1.0, "{:.0f}"),
    ("ride", "top_speed"): ("Largest speed", 1.0, "{:.2f} m/s"),
    ("ride", "peak_tilt"): ("Largest tilt", math.degrees(1.0), "{:.1f} deg"),
    ("ride", "effort"): ("Effort", 100.0, "{:.1f} % of the largest action (rms)"),
    ("ride", "rider_effort"): ("Lean of the rider", math.degrees(1.0), "{:.1f} deg (rms)"),
    ("push", "distance"): ("Distance", 1.0, "{:.3f} m from the setpoint (rms)"),
    ("openballbot", "speed"): ("Mean speed", 1.0, "{:.2f} m/s along y"),
}


def metrics_of(commands: Commands) -> list[Row]:
    """The metrics of robot 0 so far."""
    rows = []
    for metric in description_of(commands.task)["metrics"]:
        name, unit = metric["name"], metric["unit"]
        plain = (name.replace("_", " ").capitalize(), 1.0, f"{{:.3f}} {unit}".rstrip())
        label, factor, text = WORDS.get((commands.task, name), plain)
        value = commands.metrics[name]
        shown = "not yet" if math.isnan(value) else text.format(factor * value)
        rows.append(Row(label, shown, f"{metric['doc']}; of the episode so far"))
    return rows
