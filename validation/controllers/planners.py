"""Laws that simulate: their decisions take milliseconds, too long for searches over many robots."""

from typing import Final

PLANNERS: Final = ("mppi", "nmpc")
