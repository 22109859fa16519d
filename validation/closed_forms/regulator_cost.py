r"""What the regulator costs.

From a deviation $x_0$ the linear-quadratic regulator promises the cost
$\sum_k x_k^\top Q x_k + u_k^\top R u_k = x_0^\top P x_0$ (twice the cost in the convention that puts ½ before the
sum), with $P$ from the Riccati equation. Here the sum is taken along the motion of the nonlinear robot, over 20 s: it
must approach the promise as the deviation becomes small. And no gain nearby may do better: neither all gains off by 2
%, nor any single gain of the 30 off by ±2 % of the largest, each from a start that is off in position, heading, tilt
and their rates. There the cost is the sum over 5 s, plus the promised cost of the remaining deviation.
"""

from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.mechanics import Array
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DT, _SECONDS = 0.005, 20.0
#: The regulator's defaults: deviations that cost the same.
_DEVIATIONS = np.array([0.15, 0.15, 0.1, 0.1, 0.5, 0.4, 0.4, 1.0, 1.0, 2.0])
_TORQUE = 0.2
_LIMITS = {"spatial": 1e-6, "contact": 2e-3, "rigid": 2e-3}
#: Deviations of the starts for single gains, rad and so on, and their simulated time, s.
_SMALL, _SHORT = 1e-5, 5.0
_TILTS = np.radians([0.01, 0.1, 0.5, 1.0, 2.0])


def run() -> Findings:
    """Sums the cost in each model from tilts of several sizes."""
    claims, ratios = [], {}
    for model, limit in _LIMITS.items():
        ratios[model] = np.array([cost(model, tilt) for tilt in _TILTS])
        what = f"cost over $x_0^\\top P x_0$ from {np.degrees(_TILTS[1]):g} deg, `{model}`"
        claims.append(Claim(what, ratios[model][1], 1.0, limit))
    saved = max(ratios["spatial"][1] - cost("spatial", _TILTS[1], change) for change in (0.98, 1.02))
    claims.append(Claim("what gains 2 % off would save", max(0.0, saved), 0.0, 0.0, absolute=True))
    most, least = single_gains()
    what = "what any single gain off by 2 % of the largest would save"
    claims.append(Claim(what, max(0.0, -least), 0.0, 0.0, absolute=True))
    costs = f"Of the 60 changes of a single gain the cheapest costs {least:.1e} of the promise, the dearest {most:.1e}."

    def draw(fig: "Figure") -> None:
        from ballbot_rs.media.figures.style import MODEL_COLORS

        ax = fig.subplots()
        for model, ratio in ratios.items():
            ax.loglog(np.degrees(_TILTS), np.abs(ratio - 1.0), "o-", color=MODEL_COLORS[model], label=model)
        ax.set(xlabel="initial tilt (deg)", ylabel="|cost / $x_0^T P x_0$ − 1|")
        ax.legend()

    return Findings(claims, draw, costs, size=(6.0, 3.0))


def single_gains() -> tuple[float, float]:
    """Most and least cost, relative to the promise, after changing a single gain by ±2 % of the largest."""
    gain = np.asarray(bb.Lqr(bb.Params.paper(), control_dt=_DT).gain)
    kept, step = ride(gain), 0.02 * float(np.abs(gain).max())
    costs = []
    for index in np.ndindex(gain.shape):
        for sign in (-1.0, 1.0):
            changed = gain.copy()
            changed[index] += sign * step
            costs.append(ride(changed) - kept)
    return max(costs), min(costs)


def ride(gain: Array) -> float:
    """Ratio of the cost under `gain` from a small deviation of all kinds to the regulator's promise, in `spatial`."""
    params = bb.Params.paper()
    # Runge-Kutta at the control rate: its error is far below the effect of interest.
    robot, regulator = bb.Ballbot(params, model="spatial", sim_dt=_DT), bb.Lqr(params, control_dt=_DT)
    upright = bb.State.at_rest(params, tilt=_SMALL * np.array([0.8, -0.6]), yaw=0.3)
    rates = _SMALL * np.array([2.0, -1.0, 0.0])
    robot.reset(bb.State.rolling(params, _SMALL * np.array([0.4, 0.3]), upright.body_quaternion, rates, 0.0))
    yaw, position = 0.3 + _SMALL, _SMALL * np.array([0.1, 0.05])
    total, promised = 0.0, 0.0
    for k in range(round(_SHORT / _DT) + 1):
        x = regulator.deviation(robot.state, position=position, yaw=yaw)
        left = float(x @ regulator.riccati_solution @ x)
        promised = promised or left
        if k * _DT >= _SHORT:
            break
        torques = -gain @ x
        total += _cost_of(x, torques)
        robot.step(torques)
    return (total + left) / promised


def _cost_of(x: Array, torques: Array) -> float:
    return float(np.sum((x / _DEVIATIONS) ** 2) + np.sum((torques / _TORQUE) ** 2))


def cost(model: str, tilt: float, change: float = 1.0) -> float:
    """Ratio of the cost of a recovery to the regulator's promise; `change` multiplies its gains."""
    params = bb.Params.paper()
    robot, regulator = bb.Ballbot(params, model=model, sim_dt=1e-3), bb.Lqr(params, control_dt=_DT)
    robot.reset(bb.State.at_rest(robot.params, tilt=tilt * np.array([0.8, -0.6]), yaw=0.3))
    gain = change * regulator.gain
    # An equally large heading error and position error, so that all parts of the cost contribute.
    yaw, position = 0.3 + tilt, tilt * np.array([0.1, 0.05])
    start = regulator.deviation(robot.state, position=position, yaw=yaw)
    total = 0.0
    for _ in range(round(_SECONDS / _DT)):
        x = regulator.deviation(robot.state, position=position, yaw=yaw)
        torques = -gain @ x
        total += _cost_of(x, torques)
        robot.step(torques, steps=round(_DT / robot.sim_dt))
    return total / float(start @ regulator.riccati_solution @ start)
