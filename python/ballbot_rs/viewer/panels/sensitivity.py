"""The table of sensitivities in the tab Parameters: which parameter moves the robot how much after a push."""

import html
from collections.abc import Callable

import viser

from ballbot_rs.analysis.sensitivity import QUANTITIES, Sensitivity
from ballbot_rs.viewer.panels.controls import add_note, note, on_client, put
from ballbot_rs.viewer.session.runner import Command, Submit
from ballbot_rs.viewer.session.sensitivity import Sensitivities
from ballbot_rs.viewer.session.session import Session

#: Labels of the button.
COMPUTE, STOP = "Compute sensitivities", "Stop"

INTRODUCTION = (
    "Largest change of the motion after the push of tab Run, due to 10 % of each parameter or of a small effect if it "
    "may be zero. The controller is designed for the nominal robot."
)


class SensitivityPanel:
    """A button, and the table that follows.

    Args:
        server: shows them.
        submit: puts a command into the queue.
        push: direction, rad, and impulse, N·s, of the push.
    """

    def __init__(self, server: viser.ViserServer, submit: Submit, push: Callable[[], tuple[float, float]]) -> None:
        self._push, self._sensitivities = push, Sensitivities()
        with server.gui.add_folder("Sensitivity", expand_by_default=False):
            add_note(server.gui, INTRODUCTION)
            self._button = server.gui.add_button(COMPUTE)
            self._button.on_click(on_client(submit, self._pressed))
            self._note = add_note(server.gui, "")
            self._table = server.gui.add_html("")

    def _pressed(self) -> Command:
        if self._button.label == STOP:
            return lambda _: self._sensitivities.stop()
        direction, impulse = self._push()
        return lambda session: self._sensitivities.start(session, direction, impulse)

    def show(self, session: Session) -> None:  # noqa: ARG002
        """Shows how far the computation is, its result or its error."""
        now = self._sensitivities
        now.update()
        progress = now.progress
        put(self._button, label=COMPUTE if progress is None else STOP)
        text = now.error if progress is None else f"computing, {100.0 * progress:.0f} %"
        put(self._note, content=note(text or ("" if now.found is None else now.conditions)))
        put(self._table, content="" if now.found is None else table_of(now.found))

    def stop(self) -> None:
        """Ends a computation."""
        self._sensitivities.stop()


def table_of(sensitivity: Sensitivity) -> str:
    """The parameters with the largest effects, as HTML; a bar compares an effect with the largest of its column."""
    shown = sensitivity.largest()
    peaks = {name: max(effects.max(), 1e-300) for name, effects in shown.effects.items()}
    head = "".join(f"<th>{name}<br>{unit}</th>" for name, unit in QUANTITIES.items())
    rows = []
    for i, parameter in enumerate(shown.names):
        size = f"{digits(shown.values[i])} + {digits(shown.changes[i])} {shown.units[i]}".rstrip()
        cells = "".join(
            f'<td style="--part: {100.0 * shown.effects[name][i] / peak:.0f}%">{digits(shown.effects[name][i])}</td>'
            for name, peak in peaks.items()
        )
        # Where a long name may break.
        name = html.escape(parameter).replace("_", "_<wbr>")
        rows.append(f"<tr><th>{name}<small>{html.escape(size)}</small></th>{cells}</tr>")
    return f'<table class="ballbot-table"><tr><th>parameter</th>{head}</tr>{"".join(rows)}</table>'


def digits(value: float) -> str:
    """A number with three digits."""
    if value and not 1e-4 <= abs(value) < 1e4:
        return f"{value:.2e}"
    return f"{value:#.3g}".rstrip(".") if value else "0"
