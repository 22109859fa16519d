r"""How fast the PID must be sampled.

The paper does not print a sampling rate; its PID runs in Simulink with a derivative filter of $N = 327$ rad/s. Here
the sampled loop of `Pid` (zero-order hold, filter exact) with the linearized tilt of the robot on which wheels count
by their absolute spin: the spectral radius of its state matrix over the time between two samples. Above 1 the loop is
unstable. Eq. (8) as printed makes the tilt torque 1.68 times what the PID commands, and so leaves less margin: with it
the loop at 100 Hz grows by 30 % per sample, with the consistent map by 1 %. At 500 Hz and 1 kHz both are well damped.
The points are growth factors measured in `spatial` from a tilt of $10^{-6}$ rad.

A growing loop need not fall: with the torque capped at what traction allows, its oscillation is bounded by the cap.
And near the limit the time step of the simulation counts: `contact` and `rigid` move by semi-implicit Euler, which at
1 ms gives a torque held for 10 ms a tenth more effect on the tilt than it has, and so delays the loop less.
"""

from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.mechanics import Array, unstable_pole, upright_mass
from validation.paper_replication.loop import MAPS
from validation.paper_replication.response import DERIVATIVE, FILTER, INTEGRAL, PROPORTIONAL
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Periods at which the largest eigenvalue is far from the next, so that a simulation shows it.
_MEASURED = {"as_printed": (0.008, 0.009, 0.01), "consistent": (0.01, 0.011, 0.012)}
_TILT = 1e-6


def run() -> Findings:
    """The spectral radius of both loops, and growth in the simulation."""
    params = bb.Params.paper()
    gains = {mapping: tilt_gain(params, mapping) for mapping in MAPS}
    claims = []
    measured: dict[str, list[float]] = {}
    for mapping, times in _MEASURED.items():
        measured[mapping] = [growth(params, mapping, control_dt) for control_dt in times]
        for control_dt, found in zip(times, measured[mapping], strict=True):
            expected = spectral_radius(params, gains[mapping], control_dt)
            what = f"growth in a sample of {1e3 * control_dt:g} ms, `spatial`, `{mapping}`"
            claims.append(Claim(what, found, expected, 5e-4))
    periods = np.linspace(2e-4, 0.0125, 150)
    radii = {mapping: np.array([spectral_radius(params, gain, t) for t in periods]) for mapping, gain in gains.items()}
    stable = {mapping: 1e3 * float(periods[radius < 1.0].max()) for mapping, radius in radii.items()}
    text = (
        f"The loop is stable up to {stable['as_printed']:.1f} ms between samples with eq. (8) as printed, "
        f"up to {stable['consistent']:.1f} ms with the consistent map."
    )

    def draw(fig: "Figure") -> None:
        from ballbot_rs.media.figures.style import COLORS, INK

        ax = fig.subplots()
        for mapping, color in zip(MAPS, (COLORS[1], COLORS[0]), strict=True):
            ax.plot(1e3 * periods, radii[mapping], color=color, label=f"{mapping}: spectral radius")
            times = 1e3 * np.array(_MEASURED[mapping])
            ax.plot(times, measured[mapping], "o", color=color, label=f"{mapping}: growth in spatial")
        ax.axhline(1.0, color=INK, linewidth=0.8)
        for control_dt, name in ((1.0, "1 kHz"), (2.0, "500 Hz"), (10.0, "100 Hz")):
            ax.axvline(control_dt, color=INK, linewidth=0.8, linestyle=":")
            ax.annotate(name, (control_dt + 0.08, 1.52), fontsize=9)
        ax.set(xlabel="time between samples (ms)", ylabel="growth in a sample", ylim=(0.9, 1.6), xlim=(0.0, 12.5))
        ax.legend(loc="upper left", bbox_to_anchor=(0.22, 0.95))

    return Findings(claims, draw, text)


def tilt_gain(params: bb.Params, mapping: str) -> float:
    """Ratio of the actual to the commanded tilt torque."""
    wheels = bb.virtual_to_wheel_torques(params, (1.0, 0.0, 0.0), mapping)
    return float(bb.wheel_to_virtual_torques(params, wheels)[0])


def tilt_plant(params: bb.Params) -> tuple[Array, Array]:
    """A and B of (tilt about x, its rate) under a virtual torque τ_x, which turns the body about +x, upright."""
    p = params
    # Eq. (6) has (1/r_w, −r_k/r_w) on position and on a tilt that is counted about −x.
    drive = np.array([1.0, -p.ball_radius]) / p.wheel_radius
    per_torque = -float(np.linalg.solve(upright_mass(p), drive)[1])
    return np.array([[0.0, 1.0], [unstable_pole(p) ** 2, 0.0]]), np.array([0.0, per_torque])


def spectral_radius(params: bb.Params, gain: float, control_dt: float) -> float:
    """Spectral radius of the sampled loop with state (tilt, rate, integral, filter) and PID torque times `gain`."""
    a, b = tilt_plant(params)
    held = np.zeros((3, 3))
    held[:2, :2], held[:2, 2] = a, gain * b
    over_step = _exponential(held * control_dt)
    # The error is minus the tilt.
    torque = np.array([-(PROPORTIONAL + DERIVATIVE * FILTER), 0.0, INTEGRAL, -DERIVATIVE * FILTER])
    loop = np.zeros((4, 4))
    loop[:2, :2] = over_step[:2, :2]
    loop[:2] += np.outer(over_step[:2, 2], torque)
    share = -np.expm1(-FILTER * control_dt)
    loop[2] = [-control_dt, 0.0, 1.0, 0.0]
    loop[3] = [-share, 0.0, 0.0, 1.0 - share]
    return float(np.abs(np.linalg.eigvals(loop)).max())


def _exponential(matrix: Array) -> Array:
    """Matrix exponential by its series: the matrices here are small."""
    total, term = np.eye(len(matrix)), np.eye(len(matrix))
    for k in range(1, 30):
        term = term @ matrix / k
        total = total + term
    return total


def growth(params: bb.Params, mapping: str, control_dt: float, model: str = "spatial") -> float:
    """Growth factor of a small tilt about x per sample, once the fastest one or two modes dominate."""
    robot = bb.Ballbot(params, model=model, sim_dt=1e-3)
    robot.reset(bb.State.at_rest(robot.params, tilt=(_TILT, 0.0)))
    pid = bb.Pid(params, control_dt, mapping=mapping, max_torque=params.max_wheel_torque)
    tilts: list[float] = []
    while robot.state.tilt < 1e-3 and len(tilts) < 2000:
        tilts.append(float(robot.state.tilt_components[0]))
        robot.step(pid(robot.state), steps=round(control_dt / robot.sim_dt))
    x = np.array(tilts[len(tilts) // 2 :])
    x /= np.abs(x).max()
    recursion = np.linalg.lstsq(np.column_stack([x[1:-1], x[:-2]]), x[2:], rcond=None)[0]
    return float(np.abs(np.roots([1.0, *-recursion])).max())
