"""A trajectory as a notebook shows it: a table of its numbers, and its figure where matplotlib is installed."""

import base64
import dataclasses
import html
import io

from ballbot_rs import _short
from ballbot_rs._extras import install_hint
from ballbot_rs.analysis.metrics import Metrics
from ballbot_rs.analysis.trajectory import Trajectory

#: Label, unit and factor of each number.
_LABELS = {
    "tilt_rms": ("tilt, rms", "deg", 57.29577951308232),
    "tilt_max": ("tilt, largest", "deg", 57.29577951308232),
    "position_error_rms": ("position error, rms", "mm", 1e3),
    "position_error_max": ("position error, largest", "mm", 1e3),
    "position_error_final": ("position error, at the end", "mm", 1e3),
    "torque_rms": ("wheel torque, rms", "N·m", 1.0),
    "torque_max": ("wheel torque, largest", "N·m", 1.0),
    "traction_utilization_max": ("friction limit, largest share", "%", 100.0),
}


def to_html(trajectory: Trajectory) -> str:
    """An HTML fragment without scripts."""
    ending = "upright to the end" if trajectory.fell_at is None else f"fell at {trajectory.fell_at:.2f} s"
    title = f"{trajectory.controller} on {trajectory.model}, {trajectory.times[-1]:.2f} s, {ending}"
    return f"<div><b>{html.escape(title)}</b>{table_of(trajectory.metrics())}{_figure(trajectory)}</div>"


def table_of(metrics: Metrics) -> str:
    """The numbers of a trajectory with their units."""
    rows = []
    for name, value in dataclasses.asdict(metrics).items():
        label, unit, factor = _LABELS[name]
        rows.append((label, f"{factor * value:.4g} {unit}"))
    return _short.table(rows)


def _figure(trajectory: Trajectory) -> str:
    try:
        from ballbot_rs.media.figures import trajectories
    except ModuleNotFoundError:
        return f"<p>A figure needs matplotlib: <code>{html.escape(install_hint('plot'))}</code></p>"
    drawn = io.BytesIO()
    trajectories.draw([trajectory]).savefig(drawn, format="svg", metadata={"Date": None, "Creator": None})
    # As an image: otherwise ids of several figures in one page would collide.
    data = base64.b64encode(drawn.getvalue()).decode("ascii")
    return f'<img alt="tilt, position, torques and loads over time" src="data:image/svg+xml;base64,{data}">'
