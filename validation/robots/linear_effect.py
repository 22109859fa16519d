"""An effect of the motors that keeps the LQR loop linear: its largest eigenvalue is the closed form."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from validation.claim import Claim
from validation.robots import loop
from validation.robots.sweep import Measured, Sweep
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class LinearEffect:
    """A sweep, and the same effect on the linear loop."""

    sweep: Sweep
    #: A value with its name and unit, with `{:g}` for the number.
    what: str
    #: Values at which the loop is unstable.
    unstable: Sequence[float]
    #: Arguments of `loop.matrix` and `loop.growth`.
    arguments: Callable[[float], Mapping[str, float]]
    #: Values of the curve.
    curve: Sequence[float]

    def _radius(self, value: float) -> float:
        return loop.radius(loop.matrix(**self.arguments(value)))

    def claims(self) -> list[Claim]:
        """Growth of small tilts where the loop is unstable."""
        return [
            Claim(
                f"growth a control step, `spatial`, {self.what.format(value)}",
                loop.growth(**self.arguments(value)),
                self._radius(value),
                1e-7,
            )
            for value in self.unstable
        ]

    def run(self) -> Findings:
        """Measures the sweep."""
        measured, claims = Measured(self.sweep), self.claims()
        radii = [self._radius(value) for value in self.curve]

        def draw(fig: "Figure") -> None:
            left, middle, right = fig.subplots(1, 3)
            left.plot(self.curve, radii, label="linear loop")
            left.plot(self.unstable, [claim.found for claim in claims], "o", label="spatial")
            left.axhline(1.0, color="#868e96", linestyle="--")
            left.set(xlabel=self.sweep.label, ylabel="growth a control step")
            left.legend()
            measured.draw(middle, right)

        return Findings(claims, draw, measured.markdown(), (10.0, 3.2))
