"""Legends that hide no curve: a legend that would moves to a free corner, or above its axes."""

from typing import Any, Final

from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

#: Positions within the axes, in the order tried.
PLACES: Final = (
    *("upper right", "upper left", "lower right", "lower left"),
    *("center right", "center left", "upper center", "lower center"),
)


def clear_curves(fig: Figure) -> None:
    """Moves legends that overlap a curve, a mark or a text."""
    if not fig.axes:
        return
    # Boxes are known after the layout of the figure.
    fig.draw_without_rendering()
    for ax in fig.axes:
        legend = ax.get_legend()
        if legend is None or not hides(ax):
            continue
        for place in PLACES:
            legend.set_loc(place)
            if not hides(ax):
                break
        else:
            texts = legend.get_texts()
            handles = [handle for handle in legend.legend_handles if handle is not None]
            for across in range(min(len(texts), 3), 0, -1):
                above = ax.legend(
                    handles,
                    [text.get_text() for text in texts],
                    loc="lower left",
                    bbox_to_anchor=(0.0, 1.0),
                    ncols=across,
                    fontsize=texts[0].get_fontsize(),
                    columnspacing=1.0,
                )
                # A legend wider than its axes would push the other panels away.
                if above.get_window_extent().width <= ax.get_window_extent().width:
                    break


def hides(ax: Any) -> bool:
    """Whether the legend overlaps the contents of its axes."""
    box: Bbox = ax.get_legend().get_window_extent()
    for line in ax.lines:
        path = line.get_transform().transform_path(line.get_path())
        if len(path.vertices) and (path.intersects_bbox(box, filled=False) or _marked(line, path.vertices, box)):
            return True
    for collection in ax.collections:
        if any(
            collection.get_transform().transform_path(path).intersects_bbox(box, filled=True)
            for path in collection.get_paths()
            if len(path.vertices) > 1
        ):
            return True
    if any(patch.get_window_extent().overlaps(box) for patch in ax.patches):
        return True
    return any(text.get_text() and text.get_window_extent().overlaps(box) for text in ax.texts)


def _marked(line: Any, places: Any, box: Bbox) -> bool:
    """Whether a mark of a line is in a box."""
    if line.get_marker() in (None, "", "None"):
        return False
    return bool(box.padded(line.get_markersize()).count_contains(places))
