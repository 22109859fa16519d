r"""Ripple of the rollers.

A wheel of rollers is not round: between two rollers its radius is less by $A$ (`roller_ripple`), $n$ times a turn
([rollers.md](rollers.md)). The body then bobs on its wheels, at the frequency $n\dot\psi/2\pi$ of a wheel at the rate
$\dot\psi$; with all wheels in phase, as when the ball spins below an upright robot, by $A/\cos\alpha$ from top to
bottom.

The gyroscope spectrum has lines at these frequencies, which no filter running at the control rate can remove at low
speed. The second table is of a robot that LQR drives towards its first wheel, which then stops; the other two turn at
$\frac{\sqrt3}{2}\cos\alpha\ v/r_w$. Its first row is the baseline with round wheels. The sweep is over $A$, with phases
of the wheels that differ from robot to robot.
"""

import math

import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.page import number, table
from validation.robots.sweep import PAPER, Measured, Sweep
from validation.topic import Findings

_PHASES = [-math.pi, math.pi]


def _options(ripple: float) -> dict[str, object]:
    drawn = {"roller_ripple": [ripple, ripple], "roller_phases": [_PHASES] * 3}
    return {"events": [{"term": term, "op": "abs", "mode": "startup", "range": pair} for term, pair in drawn.items()]}


SWEEP = Sweep(
    "ripple of the rims (m)",
    (0.0, 1e-4, 2e-4, 5e-4, 1e-3, 1.5e-3),
    _options,
    1e-5,
    '--set \'events=[{"term": "roller_ripple", "range": [1e-4, 1e-4]}]\'',
)
_SPEEDS = (0.2, 0.5)
_SIM_DT = 5e-4
_WHEEL_RATE = 7.0
_FALL_TILT = 0.5


def spin(params: bb.Params, model: str) -> tuple[float, float, float]:
    """Bob of the body above a spinning ball (m), its frequency (Hz) and the mean rate of the wheels (rad/s)."""
    ratio = params.ball_radius / params.wheel_radius
    robot = bb.Ballbot(params, model=model, sim_dt=_SIM_DT)
    robot.reset(bb.State.rolling(params, (0.0, 0.0), ball_spin=_WHEEL_RATE / (ratio * math.sin(params.wheel_zenith))))
    robot.step((0.0, 0.0, 0.0), 400)
    first = robot.state.wheel_angles[0]
    heights, times, fell = [], [], 0.0
    for step in range(4000):
        robot.step((0.0, 0.0, 0.0))
        velocity = float(robot.state.body_velocity[2])
        heights.append(float(robot.state.body_position[2]))
        if fell > 0.0 >= velocity:
            times.append((step + velocity / (fell - velocity)) * _SIM_DT)
        fell = velocity
    rate = float(robot.state.wheel_angles[0] - first) / (4000 * _SIM_DT)
    return float(np.ptp(heights)), (len(times) - 1) / (times[-1] - times[0]), rate


def gyro(params: bb.Params, speed: float, model: str = "contact") -> float | None:
    """RMS of the tilt rates of a robot that LQR drives towards its first wheel, rad/s; None if it falls."""
    robot = bb.Ballbot(params, model=model, sim_dt=1e-3)
    lqr = bb.Lqr(PAPER, control_dt=0.01)
    rates = []
    for step in range(600):
        time = 0.01 * step
        torques = lqr(robot.state, position=(speed * time, 0.0), velocity=(speed, 0.0))
        for _ in range(10):
            robot.step(torques)
            if time >= 3.0:
                rates.append(np.asarray(robot.state.body_angular_velocity)[:2])
        if robot.state.tilt > _FALL_TILT:
            return None
    return float(np.sqrt(np.mean(np.square(rates)) * 2.0))


def claims() -> list[Claim]:
    """Bob and its frequency in both simulations."""
    rippled = PAPER.replace(roller_ripple=1e-4)
    found = []
    for model in ("contact", "rigid"):
        bob, frequency, rate = spin(rippled, model)
        expected = rippled.roller_ripple / math.cos(rippled.wheel_zenith)
        found += [
            Claim(f"bob, top to bottom, {model}", 1e3 * bob, 1e3 * expected, 5e-3, "mm"),
            Claim(f"frequency of the bob, {model}", frequency, rippled.roller_count * rate / math.tau, 1e-3, "Hz"),
        ]
    return found


def run() -> Findings:
    """Sweeps the ripple."""
    robots = [PAPER.replace(roller_ripple=ripple, roller_phases=(0.5, 2.0, -1.5)) for ripple in SWEEP.values]
    heads = [SWEEP.label, *(f"tilt rate at {speed:g} m/s, rms, rad/s" for speed in _SPEEDS)]
    rates = [[gyro(params, speed) for speed in _SPEEDS] for params in robots]
    texts = [["falls" if rate is None else number(rate, 2) for rate in of] for of in rates]
    rows = [[f"{ripple:g}", *of] for ripple, of in zip(SWEEP.values, texts, strict=True)]
    lines = [1e3 * ripple / math.cos(PAPER.wheel_zenith) for ripple in SWEEP.values]
    dots = [1e3 * spin(PAPER.replace(roller_ripple=r), "contact")[0] if r > 0.0 else 0.0 for r in SWEEP.values]
    findings = Measured(SWEEP).findings(claims(), "bob at 7 rad/s (mm)", lines, dots)
    return findings._replace(markdown=f"{findings.markdown}\n\n{table(heads, rows)}")
