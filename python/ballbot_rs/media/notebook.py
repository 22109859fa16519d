"""A trajectory as a notebook shows it: a table of its numbers, and its figure where matplotlib is installed."""

import base64
import dataclasses
import html
import io
import math
from typing import Any

from ballbot_rs import _files, _short
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
    "traction_utilization_max": ("friction limit, largest fraction used", "%", 100.0),
}


@dataclasses.dataclass(frozen=True, repr=False)
class Animation:
    """A video in the output of a notebook."""

    title: str
    #: The file, H.264 in MP4.
    mp4: bytes

    @classmethod
    def of(cls, trajectory: Trajectory, **options: Any) -> "Animation":
        """The video of a trajectory; `options` as in `write_video`."""
        from ballbot_rs.media.video import write_video

        with _files.scratch_folder() as folder:
            write_video(trajectory, folder / "animation.mp4", **options)
            return cls(title(trajectory, trajectory.controller), (folder / "animation.mp4").read_bytes())

    def __repr__(self) -> str:
        return f"<Animation of {self.title}: {len(self.mp4) / 1e3:.0f} kB>"

    def _repr_html_(self) -> str:
        data = base64.b64encode(self.mp4).decode("ascii")
        label = html.escape(self.title, quote=True)
        # Browsers start only muted videos by themselves.
        return f'<video controls loop autoplay muted aria-label="{label}" src="data:video/mp4;base64,{data}"></video>'


def shown(trajectory: Trajectory) -> str:
    """An HTML fragment without scripts."""
    name = html.escape(title(trajectory, trajectory.controller))
    return f"<div><b>{name}</b>{table_of(trajectory.metrics())}{_figure(trajectory)}</div>"


def title(trajectory: Trajectory, controller: str) -> str:
    """Name of the controller, model, duration and ending."""
    ending = "upright to the end" if trajectory.fell_at is None else f"fell at {trajectory.fell_at:.2f} s"
    return f"{controller} on {trajectory.model}, {trajectory.times[-1]:.2f} s, {ending}"


def table_of(metrics: Metrics) -> str:
    """The numbers of a trajectory with their units."""
    return _short.table(rows_of(metrics))


def rows_of(metrics: Metrics) -> list[tuple[str, str]]:
    """Names and texts of the numbers that a trajectory has."""
    rows = []
    for name, value in dataclasses.asdict(metrics).items():
        label, unit, factor = _LABELS[name]
        if not math.isnan(value):
            rows.append((label, f"{factor * value:.4g} {unit}"))
    return rows


def _figure(trajectory: Trajectory) -> str:
    try:
        from ballbot_rs.media.figures import trajectories
    except ModuleNotFoundError:
        return f"<p>A figure needs matplotlib: <code>{html.escape(install_hint('plot'))}</code></p>"
    drawn = io.BytesIO()
    trajectories.draw([trajectory]).savefig(drawn, format="svg", metadata={"Date": None, "Creator": None})
    # As an image: otherwise ids of several figures in one page would collide.
    data = base64.b64encode(drawn.getvalue()).decode("ascii")
    return f'<img alt="{trajectories.DESCRIPTION}" src="data:image/svg+xml;base64,{data}">'
