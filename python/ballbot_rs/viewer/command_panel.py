"""What a task asks, in words: the command, the metrics so far, and how to command it by hand."""

import math
from collections.abc import Callable
from typing import Any

import viser

from ballbot_rs._core import TASKS
from ballbot_rs.viewer.asked import Asked
from ballbot_rs.viewer.commanding import ACCELERATION, CLICKED, DRIVEN, Commanding
from ballbot_rs.viewer.driving import HOLD
from ballbot_rs.viewer.recording import Frame
from ballbot_rs.viewer.runner import Command
from ballbot_rs.viewer.session import Session


class CommandPanel:
    """Texts, shown with the task that they are of; `add_controls` adds the rest where it is to be.

    Args:
        server: shows them.
        submit: puts a command into the queue.
    """

    def __init__(self, server: viser.ViserServer, submit: Callable[[Command], bool]) -> None:
        self._gui, self._submit = server.gui, submit
        self._command = self._gui.add_text(
            "Command", "", disabled=True, hint="of robot 0; velocities are in its heading frame"
        )
        most = max(len(task["metrics"]) for task in TASKS.values())
        self._metrics = [self._gui.add_text(f"Metric {i}", "", disabled=True, visible=False) for i in range(most)]

    def add_controls(self) -> None:
        """Adds how to command by hand, and the way back."""
        self._help = self._gui.add_markdown("")
        self._draw = self._gui.add_button(
            "New command of the task", hint="the task draws the commands again, from where the robots are"
        )
        self._draw.on_click(self._pressed)

    def _pressed(self, event: viser.GuiEvent[Any]) -> None:
        if event.client_id is not None:
            self._submit(Session.draw_commands)

    def show(self, session: Session, frame: Frame) -> None:
        """Shows what is asked in a frame."""
        asked, commanding = frame.asked, session.commanding
        metrics = {} if asked is None else metrics_of(asked)
        rows = [*metrics.items(), *[("", "")] * (len(self._metrics) - len(metrics))]
        is_drawn = commanding is not None and bool(TASKS[session.task]["command"])
        help_text = "" if commanding is None else help_of(commanding)
        for control, is_visible in ((self._help, bool(help_text)), (self._draw, is_drawn)):
            if control.visible != is_visible:
                control.visible = is_visible
        if self._help.content != help_text:
            self._help.content = help_text
        texts = [("Command" if asked else "", command_of(asked) if asked else ""), *rows]
        for text, (label, value) in zip([self._command, *self._metrics], texts, strict=True):
            if text.visible != bool(label):
                text.visible = bool(label)
            if label and (text.label, text.value) != (label, value):
                text.label, text.value = label, value


def command_of(asked: Asked) -> str:
    """The command of robot 0, and who gave it."""
    command = asked.commands[0].tolist()
    if asked.task == "push":
        impulse, azimuth = asked.pushes[0, :2].tolist()
        return (
            "no push yet" if math.isnan(impulse) else f"pushed by {impulse:.2f} N·s to {math.degrees(azimuth):.0f} deg"
        )
    if asked.task == "velocity":
        x, y, rate = command
        text = f"({x:.2f}, {y:.2f}) m/s, {rate:.2f} rad/s"
    elif asked.task == "goal":
        text = f"go to ({command[0]:.2f}, {command[1]:.2f}) m"
    elif asked.task == "path":
        text = f"follow the curve at {command[0]:.2f} m/s"
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
    """How to command a task by hand, and what is the most that it takes."""
    if commanding.task == DRIVEN:
        limits = f"{commanding.max_speed:g} m/s and {commanding.max_yaw_rate:g} rad/s"
        return (
            "**Drive**: `W` `A` `S` `D` or arrows: velocity; `Q` `E`: turn; space: stop. Gamepad: its two sticks. "
            f"At most {limits}, as the task draws; the velocity changes by {ACCELERATION:g} m/s². The robot stops if "
            f"the page loses the focus, or is silent for {HOLD:g} s. In a field, click on the scene first."
        )
    if commanding.task == CLICKED:
        return (
            f"**Click on the floor**: the goal. It is at most {commanding.max_distance:g} m from the ball, as the task "
            "draws; a farther click is brought nearer."
        )
    return ""
