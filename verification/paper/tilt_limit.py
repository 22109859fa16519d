r"""Section III-A: falling above 30°.

The paper says that the robot "falls immediately" once the tilt exceeds 30°, and gives no reason. Traction gives one.
To hold a tilt, the ball has to accelerate under the body, and the wheels have to pass on what that takes: from the
`spatial` model, the torques at which the tilt of a robot at rest stays as it is, the loads and tractions that go with
them, and the tilt at which the first wheel's traction reaches $\mu N$. It depends on the direction of the lean; the
worst counts. With the printed wheel friction the limit is 29.7° (dynamic, 1.0) to 31.6° (static, 1.1).

The points are found by bisection in the simulations with the same torques held for 20 ms.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from verification.claim import Claim
from verification.robots import Array
from verification.topic import Comparison, Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PRINTED_DEGREES = 30.0
_MEASURED = (0.5, 0.8, 1.0, 1.1)
_AZIMUTHS = np.radians(np.arange(0.0, 120.0, 2.5))


def run() -> Findings:
    """The limit over friction, and in the simulations at its worst azimuth."""
    frictions = np.linspace(0.3, 1.3, 21)
    limits = {float(mu): limits_of(_robot(float(mu))) for mu in (*frictions, *_MEASURED)}
    claims: list[Claim] = []
    measured: dict[str, list[float]] = {}
    for model in ("contact", "rigid"):
        measured[model] = []
        for mu in _MEASURED:
            azimuth = float(_AZIMUTHS[int(limits[mu].argmin())])
            found = simulated_limit(_robot(mu), model, azimuth)
            measured[model].append(found)
            what = f"largest tilt held at μ = {mu:g}, `{model}`"
            claims.append(Claim(what, found, float(limits[mu].min()), 1e-2, "deg"))
    dynamic, static = float(limits[1.0].min()), float(limits[1.1].min())
    compared = Comparison(
        "largest tilt",
        "Section III-A",
        "falls above 30°",
        f"{dynamic:.1f}° to {static:.1f}° before a wheel slips (μ = 1.0 to 1.1)",
        "no reason is printed; traction gives the same number",
    )

    def draw(fig: "Figure") -> None:
        from ballbot_rs.plotting.style import COLOURS, INK, MODEL_COLOURS

        ax = fig.subplots()
        worst = np.array([limits[float(mu)].min() for mu in frictions])
        best = np.array([limits[float(mu)].max() for mu in frictions])
        ax.fill_between(frictions, worst, best, color=COLOURS[4], alpha=0.3, linewidth=0, label="other directions")
        ax.plot(frictions, worst, color=INK, label="worst direction of lean")
        for model, marker, size in (("rigid", "s", 8), ("contact", "o", 4)):
            ax.plot(_MEASURED, measured[model], marker, markersize=size, color=MODEL_COLOURS[model], label=model)
        ax.axhline(PRINTED_DEGREES, color=INK, linestyle="--", linewidth=0.8, label="printed")
        ax.set(xlabel="friction coefficient of the wheels", ylabel="largest tilt held (deg)", ylim=(0.0, 60.0))
        ax.legend(loc="upper left")

    return Findings(claims, draw, compared=(compared,))


def _robot(friction: float) -> bb.Params:
    return bb.Params.paper().replace(wheel_static_friction=friction, wheel_dynamic_friction=friction)


def holding_torques(params: bb.Params, tilt: float, azimuth: float) -> tuple[Array, bb.Contacts]:
    """Wheel torques under which a robot at rest keeps its tilt about the axis at `azimuth`, and the forces then."""
    model = bb.SpatialModel(params)
    quaternion = _leaning(tilt, azimuth)
    rest = np.zeros(5)
    free = model.accelerations(quaternion, rest, np.zeros(3))
    per_torque = np.array([model.accelerations(quaternion, rest, unit) - free for unit in np.eye(3)]).T
    torques = np.linalg.solve(per_torque[2:], -free[2:])
    return torques, model.contacts(quaternion, rest, torques)


def _leaning(tilt: float, azimuth: float) -> Array:
    half = 0.5 * tilt
    return np.array([np.cos(half), np.sin(half) * np.cos(azimuth), np.sin(half) * np.sin(azimuth), 0.0])


def limits_of(params: bb.Params) -> Array:
    """Largest tilt held at each azimuth, degrees."""
    found = []
    for azimuth in _AZIMUTHS:

        def holds(tilt: float, azimuth: float = float(azimuth)) -> bool:
            return _grips(params, tilt, azimuth)

        found.append(np.degrees(_bisect(holds)))
    return np.array(found)


def _grips(params: bb.Params, tilt: float, azimuth: float) -> bool:
    contacts = holding_torques(params, tilt, azimuth)[1]
    loads = contacts.wheel_normal_forces
    return bool((loads > 0.0).all() and (np.abs(contacts.friction_utilization[:3]) < 1.0).all())


def simulated_limit(params: bb.Params, model: str, azimuth: float) -> float:
    """The same in a simulation, degrees."""

    def holds(tilt: float) -> bool:
        robot = bb.Ballbot(params, model=model, sim_dt=1e-3)
        robot.reset(tilt=(tilt * np.cos(azimuth), tilt * np.sin(azimuth)))
        robot.step(holding_torques(params, tilt, azimuth)[0], steps=20)
        return bool(np.abs(robot.contacts.wheel_slip_speeds).max() < 2e-3)

    return float(np.degrees(_bisect(holds)))


def _bisect(holds: Callable[[float], bool]) -> float:
    low, high = 0.0, float(np.radians(60.0))
    while high - low > 1e-4:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
