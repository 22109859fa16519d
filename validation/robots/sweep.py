"""Increasing changes of a robot or its motors: their effect on controllers made for the nominal robot."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import ballbot_rs as bb
from ballbot_rs.analysis.result import Result
from validation.claim import Claim
from validation.page import number, table
from validation.search import largest
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAPER = bb.Params.paper()
POLICY = Path(__file__).parents[2] / "assets" / "policies" / "balance.onnx"
EPISODES = 100

Options = Mapping[str, Any]


@dataclass(frozen=True)
class Sweep:
    """Values of one effect, from weak to strong."""

    #: With its unit.
    label: str
    #: As shown on the page.
    values: Sequence[float]
    #: Options of the environment; controllers remain designed for the nominal robot.
    options: Callable[[float], Options]
    #: Tolerance of the edge.
    to: float
    #: Command-line options equivalent to the second value.
    command: str
    #: The changed robot, for an LQR designed for it; None where motors change.
    robot: Callable[[float], bb.Params] | None = None


def drawn(term: str, op: str, numbers: Sequence[float] | float) -> Options:
    """A parameter changed in all episodes, unknown to the controllers."""
    given = [[float(x), float(x)] for x in np.atleast_1d(np.asarray(numbers, dtype=np.float64))]
    value = given[0] if np.isscalar(numbers) else given
    return {"events": [{"term": term, "op": op, "mode": "startup", "range": value}]}


class Measured:
    """Results of controllers in 100 episodes of the balance task at each value of a sweep."""

    def __init__(self, sweep: Sweep) -> None:
        self.sweep = sweep
        self.controllers = {"LQR": self._lqr, "policy": self._policy}
        if sweep.robot is not None:
            self.controllers["LQR made for it"] = self._own
        self.results = {name: [of(value) for value in sweep.values] for name, of in self.controllers.items()}
        self.edges = {name: self._edge(name) for name in self.controllers}

    def _lqr(self, value: float) -> Result:
        return bb.evaluate("lqr", episodes=EPISODES, **self.sweep.options(value))

    def _policy(self, value: float) -> Result:
        return bb.evaluate(POLICY, episodes=EPISODES, **self.sweep.options(value))

    def _own(self, value: float) -> Result:
        assert self.sweep.robot is not None
        return bb.evaluate("lqr", episodes=EPISODES, robot=self.sweep.robot(value))

    def _edge(self, name: str) -> float | None:
        """The strongest effect without a fall from any start; None if it is beyond the last value."""
        stands = [result.survival_rate == 1.0 for result in self.results[name]]
        if all(stands):
            return None
        first = stands.index(False)
        values = self.sweep.values
        if first == 0:
            return float("nan")
        # Sweeps may decrease: the bisection is over the fraction of the interval between two values.
        low, high = values[first - 1], values[first]

        def holds(share: float) -> bool:
            return bool(self.controllers[name](low + share * (high - low)).survival_rate == 1.0)

        return low + (high - low) * largest(holds, 0.0, 1.0, self.sweep.to / abs(high - low))

    def markdown(self) -> str:
        """A table of the episodes, the edges below, and the command of a row."""
        head = [self.sweep.label]
        for name in self.controllers:
            head += [f"{name}: success", "upright", "position rms, m"]
        rows = []
        for i, value in enumerate(self.sweep.values):
            row = [f"{value:g}"]
            for results in self.results.values():
                result = results[i]
                row += [f"{100 * result.success_rate:.0f} %", f"{100 * result.survival_rate:.0f} %"]
                row += [number(result.ball_rms, 3)]
            rows.append(row)
        edges = ["**edge**"]
        for name in self.controllers:
            edges += ["", self._edge_text(name), ""]
        return (
            f"{table(head, [*rows, edges])}\n\n"
            "Edge: the largest value at which all 100 starts stay upright, by bisection; none: beyond the last row.\n"
            "Command of the second row:\n\n"
            f"```sh\nballbot evaluate --controller lqr --controller assets/policies/balance.onnx --json \\\n"
            f"  {self.sweep.command}\n```"
        )

    def _edge_text(self, name: str) -> str:
        edge = self.edges[name]
        return "none" if edge is None else number(edge, 3)

    def findings(self, claims: list[Claim], label: str, lines: Sequence[float], dots: Sequence[float]) -> Findings:
        """Closed form and simulation of a quantity over the values, next to the episodes."""

        def draw(fig: "Figure") -> None:
            left, middle, right = fig.subplots(1, 3)
            left.plot(self.sweep.values, lines, label="closed form")
            left.plot(self.sweep.values, dots, "o", label="contact")
            left.set(xlabel=self.sweep.label, ylabel=label)
            left.legend()
            self.draw(middle, right)

        return Findings(claims, draw, self.markdown(), (10.0, 3.2))

    def draw(self, upright: "Axes", position: "Axes") -> None:
        """Fractions of upright robots, and distances of their balls from the setpoint, over the values."""
        from ballbot_rs.media.figures.panels import MARKERS, look

        values = np.asarray(self.sweep.values, dtype=np.float64)
        for place, (name, results) in enumerate(self.results.items()):
            # Curves on one another: the later ones have gaps and smaller markers.
            style: dict[str, Any] = {**look(place), "marker": MARKERS[place], "markersize": 6.5 - 1.3 * place}
            rates, distances = (np.array([getattr(r, key) for r in results]) for key in ("survival_rate", "ball_rms"))
            upright.plot(values, 100 * rates, label=name, **style)
            # After a fall an episode adds no distance: where robots fall, the mean is of those that stay near.
            position.plot(values, np.where(rates == 1.0, distances, np.nan), **style)
            fell = {**style, "linestyle": "none", "markerfacecolor": "white"}
            position.plot(values, np.where(rates < 1.0, distances, np.nan), **fell)
        if any(result.survival_rate < 1.0 for results in self.results.values() for result in results):
            hollow: dict[str, Any] = {
                "color": "#868e96",
                "marker": "o",
                "markerfacecolor": "white",
                "linestyle": "none",
            }
            position.plot([], [], label="some fell", **hollow)
            position.legend()
        upright.set(xlabel=self.sweep.label, ylabel="upright (%)", ylim=(-4, 104))
        position.set(xlabel=self.sweep.label, ylabel="position rms (m)", yscale="log")
        upright.legend()
