r"""Fall of the upright robot.

A small tilt follows $\theta = a e^{\lambda t} + b e^{-\lambda t}$. With the wheels counted by their absolute spin,
the linearized robot has $\lambda = \sqrt{M_b g l\ M_{11}/\det M}$ with

$$M_{11} = \frac{J_k}{r_k^2} + \frac{\bar J_w}{r_w^2} + M_k + M_b,\quad
M_{12} = M_b l - \frac{\bar J_w}{r_w}(k + 1),\quad M_{22} = J_b + M_b l^2 + \bar J_w(k + 1)^2,$$

$k = r_k/r_w$ and $\bar J_w = \tfrac32\cos^2\alpha\ J_w$: with Table II 6.09174451 1/s, one number that every error of
the dynamics enters. The rate is read from three tilts, $\cosh\lambda h = (\theta_{t-h} + \theta_{t+h})/2\theta_t$,
which holds whatever $a$ and $b$ are: a step that moves by the velocity at its end starts half a step ahead, and a fit
of $\cosh\lambda t$ would mix that into the rate. What is left at 1 kHz is the scheme's own
$(\lambda\Delta t)^2/24 = 1.5\cdot 10^{-6}$ in `contact`.
"""

from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.engines import probes
from validation.mechanics import Array, unstable_pole
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TILT = 1e-6
_SAMPLE, _SECONDS = 0.01, 1.0
_LIMITS = {"spatial": 1e-7, "contact": 2e-6, "rigid": 2e-6}


def run() -> Findings:
    """Runs each model from a small tilt."""
    params = bb.Params.paper()
    pole = unstable_pole(params)
    times = np.arange(0.0, _SECONDS + 0.5 * _SAMPLE, _SAMPLE)
    tilts = {model: fall(params, model, times) for model in _LIMITS}
    fastest = float(np.linalg.eigvals(bb.PlanarModel(params, "three_wheels").linearize()[0]).real.max())
    relative = unstable_pole(params, absolute_wheel_spin=False)
    claims = [
        Claim("pole that `PlanarModel.linearize` has, three wheels, relative spin", fastest, relative, 1e-14, "1/s")
    ]
    for model, limit in _LIMITS.items():
        claims.append(Claim(f"growth rate, `{model}`, 1 kHz", growth_rate(times, tilts[model]), pole, limit, "1/s"))

    def draw(fig: "Figure") -> None:
        from ballbot_rs.media.figures.panels import MODEL_LOOKS
        from ballbot_rs.media.figures.style import INK

        left, right = fig.subplots(1, 2)
        left.plot(times, np.degrees(_TILT * np.cosh(pole * times)), color=INK, linewidth=6, alpha=0.2, label="cosh λt")
        for model, tilt in tilts.items():
            left.plot(times, np.degrees(tilt), label=model, **MODEL_LOOKS[model])
            error = np.abs(tilt[1:] / (_TILT * np.cosh(pole * times[1:])) - 1.0)
            right.semilogy(times[1:], error, label=model, **MODEL_LOOKS[model])
        left.set(xlabel="time (s)", ylabel="tilt (deg)", yscale="log")
        right.set(xlabel="time (s)", ylabel="relative error of the tilt")
        left.legend()

    return Findings(claims, draw)


def fall(params: bb.Params, model: str, times: Array) -> Array:
    """Tilts at `times`, from rest."""
    robot = bb.Ballbot(params, model=model, sim_dt=1e-3)
    robot.reset(bb.State.at_rest(robot.params, tilt=(_TILT * np.cos(0.5), _TILT * np.sin(0.5)), yaw=0.3))
    tilts = [robot.state.tilt]
    for span in np.diff(times):
        robot.step(np.zeros(3), steps=round(span / robot.sim_dt))
        tilts.append(robot.state.tilt)
    return np.array(tilts)


def growth_rate(times: Array, tilts: Array) -> float:
    """λ from the tilts at 0.6, 0.8 and 1 s."""
    before, at, after = (float(tilts[int(np.argmin(np.abs(times - t)))]) for t in (0.6, 0.8, 1.0))
    return probes.growth_rate(before, at, after, 0.2)
