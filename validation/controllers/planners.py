"""Laws that are not compared as the others: planners and laws that yield."""

from typing import Final

#: They simulate: their decisions take milliseconds, too long for searches over many robots.
PLANNERS: Final = ("mppi", "nmpc")
#: They leave their setpoint under a force by design, which scenarios count as an error.
YIELDING: Final = ("admittance",)
