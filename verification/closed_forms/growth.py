r"""Fall of the upright robot.

A small tilt grows from rest as $\theta_0\cosh\lambda t$. With the wheels counted by their absolute spin, the
linearised robot of Table II has $\lambda = 6.09174451\ \mathrm{s}^{-1}$: one number that every error of the dynamics
enters.
"""

from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from verification.claim import Claim
from verification.robots import Array, unstable_pole
from verification.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TILT = 1e-6
_SAMPLE, _SECONDS = 0.01, 1.0
_LIMITS = {"spatial": 1e-7, "contact": 1e-6, "rigid": 2e-4}


def run() -> Findings:
    """Runs each model from a small tilt."""
    params = bb.Params.paper()
    pole = unstable_pole(params)
    times = np.arange(0.0, _SECONDS + 0.5 * _SAMPLE, _SAMPLE)
    tilts = {model: fall(params, model, times) for model in _LIMITS}
    claims = [Claim("pole of the linearised robot", pole, 6.09174451, 1e-8, "1/s")]
    for model, limit in _LIMITS.items():
        claims.append(Claim(f"growth rate, `{model}`, 1 kHz", growth_rate(times, tilts[model]), pole, limit, "1/s"))

    def draw(fig: "Figure") -> None:
        from ballbot_rs.plotting.style import INK, MODEL_COLOURS

        left, right = fig.subplots(1, 2)
        left.plot(times, np.degrees(_TILT * np.cosh(pole * times)), color=INK, linewidth=4, alpha=0.25, label="cosh λt")
        for model, tilt in tilts.items():
            left.plot(times, np.degrees(tilt), color=MODEL_COLOURS[model], label=model)
            error = np.abs(tilt[1:] / (_TILT * np.cosh(pole * times[1:])) - 1.0)
            right.semilogy(times[1:], error, color=MODEL_COLOURS[model], label=model)
        left.set(xlabel="time (s)", ylabel="tilt (deg)", yscale="log")
        right.set(xlabel="time (s)", ylabel="relative error of the tilt")
        left.legend()

    return Findings(claims, draw)


def fall(params: bb.Params, model: str, times: Array) -> Array:
    """Tilts at `times`, from rest."""
    robot = bb.Ballbot(params, model=model, sim_dt=1e-3)
    robot.reset(tilt=(_TILT * np.cos(0.5), _TILT * np.sin(0.5)), yaw=0.3)
    tilts = [robot.state.tilt]
    for span in np.diff(times):
        robot.step(np.zeros(3), steps=round(span / robot.sim_dt))
        tilts.append(robot.state.tilt)
    return np.array(tilts)


def growth_rate(times: Array, tilts: Array) -> float:
    """λ of cosh λt from the tilts at 0.6 s and at the end, by Newton's method from the pure exponential."""
    at = int(np.argmin(np.abs(times - 0.6)))
    (a, b), growth = (times[at], times[-1]), tilts[-1] / tilts[at]
    rate = np.log(growth) / (b - a)
    for _ in range(20):
        ratio = np.cosh(rate * b) / np.cosh(rate * a)
        rate -= (ratio - growth) / (ratio * (b * np.tanh(rate * b) - a * np.tanh(rate * a)))
    return float(rate)
