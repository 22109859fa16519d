r"""Products of inertia.

The paper's body has $J_{xx} = J_{yy} = J$. A product $J_{xy} = p$ (`body_products_of_inertia`) turns the principal
axes by 45°: their moments are $J + p$ about $(1, 1, 0)$ and $J - p$ about $(1, -1, 0)$. A small tilt about one of them
grows as on a symmetric robot with this moment ([growth](verification.md#fall-of-the-upright-robot)). A body can have
$p$ up to $J_{zz}/2 = 0.00685$ kg·m², where the triangle inequality of the moments ends: the growth rate then differs by
8 % between the two axes. Neither controller is affected.
"""

from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.closed_forms.growth import growth_rate
from validation.mechanics import unstable_pole
from validation.robots.sweep import PAPER, Measured, Sweep, drawn
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TILT = 1e-6
_TIMES = np.arange(0.0, 1.0 + 0.005, 0.01)
SWEEP = Sweep(
    "J_xy (g·m²)",
    (0.0, 2.0, 4.0, 6.8),
    lambda product: drawn("body_products_of_inertia", "abs", (1e-3 * product, 0.0, 0.0)),
    0.1,
    '--set \'events=[{"term": "body_products_of_inertia", "range": [[0.002, 0.002], [0, 0], [0, 0]]}]\'',
    lambda product: with_product(1e-3 * product),
)


def with_product(product: float) -> bb.Params:
    """The paper's robot with J_xy, kg·m²."""
    return PAPER.replace(body_products_of_inertia=(product, 0.0, 0.0))


def pole(product: float, sign: int) -> float:
    """Growth rate of a tilt about (1, ±1, 0), 1/s."""
    j_x, j_y, j_z = PAPER.body_inertia
    return unstable_pole(PAPER.replace(body_inertia=(j_x + sign * product, j_y + sign * product, j_z)))


def found_rate(product: float, sign: int) -> float:
    """The same in `spatial`, 1/s."""
    robot = bb.Ballbot(with_product(product), "spatial", 1e-3)
    robot.reset(bb.State.at_rest(robot.params, tilt=(_TILT, sign * _TILT)))
    tilts = [robot.state.tilt]
    for _ in _TIMES[1:]:
        robot.step(np.zeros(3), 10)
        tilts.append(robot.state.tilt)
    return growth_rate(_TIMES, np.array(tilts))


def claims() -> list[Claim]:
    """Growth about both principal axes."""
    return [
        Claim(
            f"growth about (1, {sign}, 0), J_xy = {product} kg·m²",
            found_rate(product, sign),
            pole(product, sign),
            1e-6,
            "1/s",
        )
        for product in (0.003, 0.0068)
        for sign in (1, -1)
    ]


def run() -> Findings:
    """Sweeps the product."""
    measured = Measured(SWEEP)
    rates = {sign: [found_rate(1e-3 * product, sign) for product in SWEEP.values] for sign in (1, -1)}

    def draw(fig: "Figure") -> None:
        left, middle, right = fig.subplots(1, 3)
        for sign, found in rates.items():
            (line,) = left.plot(
                SWEEP.values, [pole(1e-3 * p, sign) for p in SWEEP.values], label=f"about (1, {sign}, 0)"
            )
            left.plot(SWEEP.values, found, "o", color=line.get_color())
        left.set(xlabel=SWEEP.label, ylabel="growth rate (1/s)")
        left.legend()
        measured.draw(middle, right)

    return Findings(claims(), draw, measured.markdown(), (10.0, 3.2))
