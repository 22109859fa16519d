"""A task's command in words, the metrics so far, and how to command it by hand."""

import math

import viser

from ballbot_rs._core import TASKS
from ballbot_rs.envs.registration import geometry_of
from ballbot_rs.viewer.asked import Asked
from ballbot_rs.viewer.commanding import ACCELERATION, CLICKED, DRIVEN, Commanding
from ballbot_rs.viewer.controls import Submit, add_button, put
from ballbot_rs.viewer.driving import HOLD
from ballbot_rs.viewer.session import Session


class CommandPanel:
    """How to command a task by hand, and a button to undo it; `add_controls` adds it to the page.

    Args:
        server: shows it.
        submit: puts a command into the queue.
    """

    def __init__(self, server: viser.ViserServer, submit: Submit) -> None:
        self._gui, self._submit = server.gui, submit

    def add_controls(self) -> None:
        """Adds the help, and the button."""
        self._help = self._gui.add_markdown("")
        self._draw = add_button(
            self._gui,
            self._submit,
            "New command of the task",
            Session.draw_commands,
            hint="the task draws the commands again, from where the robots are",
        )

    def show(self, session: Session) -> None:
        """Shows the controls that fit the task."""
        commanding = session.commanding
        text = "" if commanding is None else help_of(commanding)
        put(self._help, visible=bool(text), content=text)
        put(self._draw, visible=commanding is not None and bool(TASKS[session.task]["command"]))


def command_of(asked: Asked) -> str:
    """The command of robot 0, and its source; empty for a task without commands."""
    command, geometry = asked.commands[0].tolist(), geometry_of(asked.task)
    if geometry == "impulse":
        impulse, azimuth = asked.pushes[0, :2].tolist()
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
        rows = TASKS[asked.task]["command"]
        text = ", ".join(f"{row['name']} {value:.3g}" for row, value in zip(rows, command, strict=True))
    return f"{text}; {'by hand' if asked.by_hand else 'by the task'}"


def metrics_of(asked: Asked) -> dict[str, str]:
    """The metrics of robot 0 so far, by label."""
    units = {metric["name"]: metric["unit"] for metric in TASKS[asked.task]["metrics"]}
    return {
        name.replace("_", " ").capitalize(): "not yet" if math.isnan(value) else f"{value:.3f} {units[name]}".rstrip()
        for name, value in asked.metrics.items()
    }


def help_of(commanding: Commanding) -> str:
    """How to command a task by hand, and the limits of its commands."""
    if commanding.geometry == DRIVEN:
        turns = f"{commanding.max_yaw_rate:g} rad/s" if commanding.max_yaw_rate > 0.0 else "no turns"
        limits = f"{commanding.max_speed:g} m/s and {turns}"
        return (
            "**Drive**: `W` `A` `S` `D` or arrows: velocity; `Q` `E`: turn; space: stop. Gamepad: its two sticks. "
            f"At most {limits}, as the task draws; the velocity changes by {ACCELERATION:g} m/s². The robot stops if "
            f"the page loses the focus, or is silent for {HOLD:g} s. In a field, click on the scene first."
        )
    if commanding.geometry == CLICKED:
        return (
            f"**Click on the floor**: the goal. It is at most {commanding.max_distance:g} m from the ball, as the task "
            "draws; a farther click is brought nearer."
        )
    return ""
