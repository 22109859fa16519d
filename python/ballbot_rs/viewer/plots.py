"""Live plots of robot 0: tilt and its estimate, torques, loads, slip and how much of the traction limit is in use."""

import numpy as np
import plotly.graph_objects as go
import viser
from plotly.subplots import make_subplots

from ballbot_rs.viewer.history import SERIES, SPAN, History

#: Title, row of `SERIES`, factor to the unit shown, names of the curves.
PLOTS = (
    ("tilt from the equilibrium (deg); dotted: estimate", "tilt", 180.0 / np.pi, ("about x", "about y")),
    ("wheel torques (N·m)", "torques", 1.0, ("wheel 0", "wheel 1", "wheel 2")),
    ("wheel loads (N)", "loads", 1.0, ("wheel 0", "wheel 1", "wheel 2")),
    ("slip speeds (m/s)", "slip", 1.0, ("wheel 0", "wheel 1", "wheel 2")),
    ("traction in use (1: limit)", "utilization", 1.0, ("wheel 0", "wheel 1", "wheel 2", "floor")),
)
COLORS = ("#1f77b4", "#ff7f0e", "#2ca02c", "#7f7f7f")

#: Rows of `SERIES` that are drawn dotted over others.
DOTTED = {"tilt": "estimated tilt"}

#: A contact without load has no limit: its share is infinite, and drawn at this height.
TOP = 2.0

#: Smallest range of each ordinate, so that noise of rounding does not fill a plot.
LEAST_RANGE = {"tilt": 0.5, "torques": 0.02, "loads": 1.0, "slip": 0.01}


class Plots:
    """One figure on the page with a row for each of `PLOTS`."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._figure = make_subplots(
            rows=len(PLOTS), cols=1, shared_xaxes=True, vertical_spacing=0.05, subplot_titles=[p[0] for p in PLOTS]
        )
        for row, (_, key, _, names) in enumerate(PLOTS, start=1):
            for dash in ("solid", "dot") if key in DOTTED else ("solid",):
                for name, color in zip(names, COLORS, strict=False):
                    line = {"color": color, "width": 1.5, "dash": dash}
                    self._figure.add_trace(go.Scatter(name=name, line=line, mode="lines"), row=row, col=1)
        self._figure.add_hline(y=1.0, line={"color": "#d62728", "dash": "dash", "width": 1.5}, row=len(PLOTS), col=1)
        self._figure.update_yaxes(range=[0.0, TOP], row=len(PLOTS), col=1)
        self._figure.update_layout(
            showlegend=False, margin={"l": 36, "r": 6, "t": 22, "b": 26}, font={"size": 10}, template="plotly_white"
        )
        self._figure.update_annotations(font_size=11)
        self._figure.update_xaxes(title_text="time (s)", row=len(PLOTS), col=1)
        self._handle = server.gui.add_plotly(self._figure, aspect=1.9)

    def show(self, history: History) -> None:
        """Draws the last seconds."""
        series = history.series()
        if not series.shape[1]:
            return
        time = np.round(series[0], 3)
        traces = iter(self._figure.data)
        with self._figure.batch_update():
            for row, (_, key, factor, _) in enumerate(PLOTS, start=1):
                rows = [series[SERIES[name]] for name in (key, DOTTED.get(key)) if name is not None]
                values = factor * np.concatenate(rows)
                if key == "utilization":
                    values = np.nan_to_num(np.minimum(values, TOP), nan=0.0)
                else:
                    self._set_range(row, values, LEAST_RANGE[key])
                for curve in values:
                    trace = next(traces)
                    trace.x, trace.y = time, np.round(curve, 5)
            self._figure.update_xaxes(range=[time[-1] - SPAN, time[-1]])
        self._handle.figure = self._figure

    def _set_range(self, row: int, values: np.ndarray, least: float) -> None:
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        margin = 0.05 * (high - low) + max(0.0, 0.5 * (least - (high - low)))
        self._figure.update_yaxes(range=[low - margin, high + margin], row=row, col=1)
