"""The figure of a law: its response to a motion and a step, and the tilts from which it recovers."""

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from validation.controllers.responses import DISTANCE, MOVING, RING, STEP, TILTS, Mask, Measured, Response, bound

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.path import Path

#: Of the figure, inches.
SIZE: Final = (8.0, 3.3)
#: Axis limits, the same for all laws for comparison: m, deg, and deg of the basin.
_POSITIONS: Final = (-0.06, 0.56)
_LEANS: Final = (-13.0, 13.0)
_LARGEST: Final = 52.0


def draw(fig: "Figure", found: Measured) -> None:
    """Position and lean over time on the left, the basin on the right."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    from ballbot_rs.media.figures.style import COLORS, INK

    grid = fig.add_gridspec(2, 2, width_ratios=(1.5, 1.0))
    position = fig.add_subplot(grid[0, 0])
    lean = fig.add_subplot(grid[1, 0], sharex=position)
    keys: list[Any] = [_follow(position, lean, found.motion, COLORS[0], f"{DISTANCE:g} m in {MOVING:g} s")]
    if found.step is not None:
        keys.append(_follow(position, lean, found.step, COLORS[1], f"a bare step of {STEP:g} m"))
    keys.append(Line2D([], [], color=INK, linestyle=":", linewidth=1.0, label="setpoint"))
    position.set(ylabel="position (m)", ylim=_POSITIONS, xlim=(0.0, float(found.motion.times[-1])))
    position.tick_params(labelbottom=False)
    lean.set(ylabel="lean (deg)", xlabel="time (s)", ylim=_LEANS, yticks=(-10, 0, 10))
    fig.align_ylabels([position, lean])
    basin = fig.add_subplot(grid[:, 1], projection="polar")
    _basin(basin, found)
    keys += [
        Patch(color=COLORS[0], alpha=0.35, label="recovers from this tilt"),
        Line2D([], [], color=INK, linewidth=1.2, label="what traction allows"),
    ]
    fig.legend(handles=keys, loc="outside lower center", ncols=len(keys), handlelength=1.4, columnspacing=1.2)


def _follow(position: "Axes", lean: "Axes", response: Response, color: str, label: str) -> Any:
    from ballbot_rs.media.figures.style import INK

    position.plot(response.times, response.reference, color=INK, linestyle=":", linewidth=1.0)
    lean.plot(response.times, response.lean, color=color)
    (line,) = position.plot(response.times, response.position, color=color, label=label)
    return line


def _basin(axes: Any, found: Measured) -> None:
    from matplotlib.patches import PathPatch

    from ballbot_rs.media.figures.style import COLORS, INK

    axes.set_axisbelow(False)
    axes.add_patch(PathPatch(_cells(found), color=COLORS[0], alpha=0.35, linewidth=0.0))
    azimuths, tilts = bound()
    axes.plot(np.append(azimuths, azimuths[0]), np.append(tilts, tilts[0]), color=INK, linewidth=1.2)
    axes.set_rlim(0.0, _LARGEST)
    ticks = (10, 20, 30, 40)
    axes.set_rgrids(ticks, [f"{tick}°" for tick in ticks], angle=90, fontsize=7.5, color=INK)
    axes.set_thetagrids(np.arange(0, 360, 60), fontsize=8)
    axes.yaxis.grid(True, color=INK, linewidth=0.3, alpha=0.5)


def _cells(found: Measured) -> "Path":
    """All cells of the map from which the robot recovers, as one path: a file of patches would be twice as large."""
    from matplotlib.path import Path

    sectors = found.recovered.shape[1]
    # An arc as four chords.
    arc = np.linspace(-0.5, 0.5, 5) * 2.0 * np.pi / sectors
    paths = []
    for sector, recovered in enumerate(found.recovered.T):
        azimuths = arc + sector * 2.0 * np.pi / sectors
        for first, last in _runs(recovered):
            inner = np.stack([azimuths, np.full(len(arc), first)], axis=-1)
            outer = np.stack([azimuths, np.full(len(arc), last)], axis=-1)
            # Its last vertex closes it.
            corners = np.concatenate([inner if first > 0.0 else inner[:1], outer[::-1]])
            paths.append(Path(np.concatenate([corners, corners[:1]]), closed=True))
    return Path.make_compound_path(*paths)


def _runs(recovered: Mask) -> list[tuple[float, float]]:
    """The ranges of tilts, deg, from which the robot recovers."""
    changes = np.flatnonzero(np.diff(np.concatenate([[False], recovered, [False]]).astype(int)))
    edges = TILTS[0] - 0.5 * RING + RING * changes
    return [(float(first), float(last)) for first, last in zip(edges[::2], edges[1::2], strict=True)]
