"""The page's sliders that change the running robots, and the resulting robot 0."""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import viser

from ballbot_rs.viewer.changes import CHANGES, NEUTRAL
from ballbot_rs.viewer.controls import put
from ballbot_rs.viewer.runner import Command
from ballbot_rs.viewer.session import Session


class Tuning:
    """Sliders, a button to restore the nominal robot, and a table.

    Args:
        server: shows them.
        submit: puts a command into the queue.
        session: only read here, before the runner starts.
    """

    def __init__(self, server: viser.ViserServer, submit: Callable[[Command], bool], session: Session) -> None:
        gui = server.gui
        self._submit = submit
        self._shown = session.changes
        self._sliders: dict[str, viser.GuiSliderHandle[float]] = {}
        self._wanted: dict[str, float] = {}
        for name, change in CHANGES.items():
            slider = gui.add_slider(
                change.label,
                min=change.low,
                max=change.high,
                step=change.step,
                initial_value=session.changes[name],
                hint=change.hint,
            )
            slider.on_update(functools.partial(self._moved, name))
            self._sliders[name] = slider
        back = gui.add_button("Nominal robot", hint="takes all changes back")
        back.on_click(self._pressed)
        self._table = gui.add_markdown("")

    async def _moved(self, name: str, event: viser.GuiEvent[Any]) -> None:
        if event.client_id is None:  # Our own correction of the display.
            return
        # During a drag, only the newest waiting value is applied.
        self._wanted[name] = event.target.value

        def command(session: Session) -> None:
            value = self._wanted.pop(name, None)
            if value is None:
                return
            try:
                session.change(**{name: value})
            finally:
                self._correct(session)

        if not self._submit(command):
            self._wanted.pop(name, None)
            self._shown = {}

    def _pressed(self, event: viser.GuiEvent[Any]) -> None:
        if event.client_id is not None:
            self._submit(self._take_back)

    def _take_back(self, session: Session) -> None:
        try:
            session.change(**NEUTRAL)
        finally:
            self._correct(session)

    def _correct(self, session: Session) -> None:
        """Shows the actual values where a change was rejected or reverted; a waiting slider stays."""
        changes = session.changes
        for name, value in changes.items():
            if name not in self._wanted:
                put(self._sliders[name], value=value)
        self._shown = changes

    def show(self, session: Session) -> None:
        """Shows robot 0, and changes made elsewhere."""
        if session.changes != self._shown:
            self._correct(session)
        text = table_of(session)
        if self._table.content != text:
            self._table.content = text


def table_of(session: Session) -> str:
    """Differences of robot 0 from the nominal robot, and its samples, as a Markdown table in SI units."""
    robots = session.robots
    nominal, params = robots.params, robots.params_of(0)
    # A push at the center of mass has no separate height.
    draws = {name: draw[np.isfinite(draw)] for name, draw in robots.draws_of(0).items() if np.isfinite(draw).any()}
    # A term may occur several times, with an id.
    terms = [name.partition(":")[0] for name in draws]
    now = params.to_dict()
    rows = [
        f"| {name} | {_text(value)} | {_text(now[name])} | {_drawn(name, draws)} |"
        for name, value in nominal.to_dict().items()
        if now[name] != value or name in terms
    ]
    rows += [f"| {name} | | | {_text(draw)} |" for name, draw in draws.items() if name.partition(":")[0] not in now]
    sensors = {name: value for name, value in (robots.setup.changed_sensors or {}).items() if np.any(value)}
    rows += [f"| {name} | | {_text(value)} | |" for name, value in (robots.motors_of(0) | sensors).items()]
    if not rows:
        return "Robot 0 is the nominal one, with ideal motors."
    return "\n".join(["| robot 0, SI units | nominal | now | drawn |", "|---|---|---|---|", *rows])


def _drawn(term: str, draws: dict[str, Any]) -> str:
    return "; ".join(_text(draw) for name, draw in draws.items() if name.partition(":")[0] == term)


def _text(value: Any) -> str:
    return ", ".join(f"{number:.4g}" for number in np.atleast_1d(np.asarray(value, dtype=np.float64)))
