"""The file of a replay: the scene, and below it numbers, curves and parameters."""

from pathlib import Path
from typing import Final

from ballbot_rs import _files
from ballbot_rs._core import __version__
from ballbot_rs._short import number
from ballbot_rs.analysis.pushes import Force
from ballbot_rs.analysis.trajectory import Trajectory
from ballbot_rs.media import notebook
from ballbot_rs.media.figures.labels import short
from ballbot_rs.media.report import origin, page
from ballbot_rs.viewer.replay.recorder import record

#: Width of the figure, inches.
WIDTH: Final = 9.6


def write(trajectory: Trajectory, path: Path, *, frame_rate: float, forces: bool, dark: bool) -> None:
    """Writes the file; arguments as in `Trajectory.to_html`.

    Raises:
        OSError: the file cannot be written; an earlier one stays as it is.
    """
    # A policy's path names folders of this machine.
    controller = short(trajectory.controller)
    parts = [
        page.replay(record(trajectory, frame_rate=frame_rate, forces=forces, dark=dark)),
        page.section("Over time", _figure(trajectory)),
        page.section("In numbers", page.pairs(notebook.rows_of(trajectory.metrics()))),
        page.section("Simulation", page.pairs([("controller", controller), *_simulation(trajectory)])),
        page.section("Robot", *origin.robot(trajectory.params, {})),
    ]
    _files.write(path, page.page(notebook.title(trajectory, controller), parts, "dark" if dark else "light"))


def _figure(trajectory: Trajectory) -> str:
    try:
        from ballbot_rs.media.figures import trajectories
    except ModuleNotFoundError:
        return page.note("Curves need the extra plot.")
    drawn = trajectories.draw([trajectory], WIDTH)
    span = (float(trajectory.times[0]), float(trajectory.times[-1]))
    return page.timed_figure(drawn, trajectories.DESCRIPTION, [span] * len(drawn.axes))


def _simulation(trajectory: Trajectory) -> list[tuple[str, str]]:
    """Names and texts of what else made the trajectory."""
    known = [
        ("model", trajectory.model),
        ("task", trajectory.task),
        ("period of the controller", _milliseconds(trajectory.control_dt)),
        ("time step", _milliseconds(trajectory.sim_dt)),
        ("largest torque of a wheel", _unit(trajectory.max_wheel_torque, "N·m")),
        ("ground", None if trajectory.terrain is None else str(trajectory.terrain)),
        *(("push", f"{_vector(push.impulse)} N·s at {push.time:.4g} s") for push in trajectory.all_pushes),
        *(("force", f"{_vector(force.force)} N{_sine(force)} from {force.begin:.4g} s") for force in trajectory.forces),
        ("made with", f"ballbot_rs {__version__}"),
    ]
    return [(name, text) for name, text in known if text is not None]


def _sine(force: Force) -> str:
    return f" at {number(force.frequency)} Hz" if force.frequency else ""


def _vector(values: tuple[float, float, float]) -> str:
    return f"({', '.join(number(float(value)) for value in values)})"


def _unit(value: float | None, unit: str) -> str | None:
    return None if value is None else f"{value:.4g} {unit}"


def _milliseconds(value: float | None) -> str | None:
    return None if value is None else _unit(1e3 * value, "ms")
