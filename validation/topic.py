"""A topic: one verified property. Its module's docstring is its title and text, its `run` the evidence."""

from collections.abc import Callable
from dataclasses import dataclass
from inspect import cleandoc
from types import ModuleType
from typing import TYPE_CHECKING, NamedTuple

from validation.claim import Claim

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Comparison(NamedTuple):
    """A row of a page's summary: a printed number and ours, as text, and why they differ."""

    what: str
    #: Section, equation, table or figure.
    where: str
    printed: str
    ours: str
    why: str


class Findings(NamedTuple):
    """The result of a topic's `run`: claims, how to draw them, and Markdown to place below."""

    claims: list[Claim]
    draw: "Callable[[Figure], None] | None" = None
    markdown: str = ""
    #: Of the figure, inches.
    size: tuple[float, float] = (8.0, 3.2)
    #: Where the topic repeats what others have printed.
    compared: tuple[Comparison, ...] = ()
    #: What could not be run, and why; each without a full stop.
    missing: tuple[str, ...] = ()


@dataclass(frozen=True)
class Topic:
    """`name` is the name of the figure's file; `run` does not need matplotlib, the `draw` it returns does."""

    name: str
    title: str
    text: str
    run: Callable[[], Findings]

    @classmethod
    def of(cls, module: ModuleType) -> "Topic":
        """The topic of a module."""
        title, _, text = cleandoc(module.__doc__ or "").partition("\n")
        return cls(module.__name__.rpartition(".")[2], title.rstrip("."), text.strip(), module.run)
