"""Published tunings on other robots, mapped to our options by the poles of their closed loops.

Poles are scaled to another robot by the rate at which it topples: the poles of the published loop, times the ratio of
our λ to its own. The options of a law follow in closed form.
"""

import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from ballbot_rs import _toml
from ballbot_rs._core import LinearModel, Params
from ballbot_rs.scenarios.scale import Scale

PATH: Final = Path(__file__).with_name("published.toml")

#: Weight of the input of a regulator, N·m: its scale by itself has no effect.
_TORQUE: Final = 0.2
#: A deviation of negligible cost, in any unit.
_FREE: Final = 1e3

Array = npt.NDArray[np.float64]
Poles = npt.NDArray[np.complex128]


class Plane(NamedTuple):
    """θ̈ = λ² θ + u and ÿ = g θ − ℓ θ̈, docs/laws.md."""

    toppling: float
    acceleration: float
    lever: float
    #: Squared length of the wheel torques of u = 1, (N·m·s²)².
    effort: float

    @classmethod
    def of(cls, params: Params) -> "Plane":
        """The plane of x."""
        linear = LinearModel(params)
        a, b = np.asarray(linear.A), np.asarray(linear.B)
        torques = np.linalg.inv(b[7:10])[:, 1]
        lever = -float(b[5] @ torques)
        return cls(math.sqrt(a[8, 3]), float(a[5, 3] + lever * a[8, 3]), lever, float(torques @ torques))


class Tuning(NamedTuple):
    """A published tuning."""

    source: str
    #: λ of its robot, 1/s.
    toppling: float
    #: Poles of its closed loop, 1/s; for an attitude controller only the pole of its lean.
    poles: Poles
    #: As in the file.
    numbers: Mapping[str, Any]

    def scaled(self, toppling: float) -> Poles:
        """The poles for a robot that topples at another rate."""
        return self.poles * (toppling / self.toppling)


@cache
def published() -> Mapping[str, Tuning]:
    """The tunings of the file, by law."""
    return {name: _tuning(table) for name, table in _toml.loads(PATH.read_text(encoding="utf-8")).items()}


def _tuning(table: Mapping[str, Any]) -> Tuning:
    if "robot" in table:
        k, reaching = table["surface"][0], table["switching"][0] / table["layer"][0]
        toppling = Scale.of(Params.preset(table["robot"])).toppling_rate
        return Tuning(table["source"], toppling, np.array([-k, -reaching], dtype=np.complex128), table)
    a, b = np.array(table["state_matrix"], dtype=np.float64), np.array(table["input_matrix"], dtype=np.float64)
    if "state_weights" in table:
        poles = _regulator_poles(a, b, np.array(table["state_weights"], dtype=np.float64), table["input_weight"])
    else:
        gain = np.array(table["gain"]) if "gain" in table else _linearizing_gain(a, b, table)
        poles = np.linalg.eigvals(a - np.outer(b, gain)).astype(np.complex128)
    return Tuning(table["source"], math.sqrt(a[3, 1]), poles, table)


def _linearizing_gain(a: Array, b: Array, table: Mapping[str, Any]) -> Array:
    """Gain of the torque with lean acceleration -k (lean + k' ball): a PD of the lean commanded by a PD."""
    k, rate = table["lean_gains"]
    ball, ball_rate = table["ball_gains"]
    gain: Array = np.array([k * ball, a[3, 1] + k, k * ball_rate, rate]) / b[3]
    return gain


def _regulator_poles(a: Array, b: Array, q: Array, r: float) -> Poles:
    """The stable eigenvalues of the Hamiltonian matrix."""
    hamiltonian = np.block([[a, -np.outer(b, b) / r], [-np.diag(q), -a.T]])
    poles: Poles = np.linalg.eigvals(hamiltonian).astype(np.complex128)
    return poles[poles.real < 0.0]


def options(law: str, params: Params) -> dict[str, float]:
    """Options of a law with the published tuning, for a robot."""
    tuning, plane = published()[law], Plane.of(params)
    if law == "sliding_mode":
        return _sliding_mode(tuning, plane.toppling)
    poles = tuning.scaled(plane.toppling)
    return _inverse_dynamics(poles, plane) if law == "pd_inverse_dynamics" else _regulator(poles, plane)


def _regulator(poles: Poles, plane: Plane) -> dict[str, float]:
    """Deviations of equal cost of the regulator with these poles.

    With w = s², p(s) p(−s) = w² (w − λ²)² + (q_y − q_v w) (g − ℓ w)² + q_θ w² − q_ω w³ has one more weight in each
    coefficient. A regulator has no negative weights: zero replaces them.
    """
    c = np.poly(poles).real
    even, odd = c[[0, 2, 4]], c[[1, 3]]
    _, w3, w2, w1, w0 = np.polysub(np.polymul(even, even), np.polymul([1.0, 0.0], np.polymul(odd, odd)))
    g, lever, toppling = plane.acceleration, plane.lever, plane.toppling**2
    position = w0 / g**2
    velocity = -(w1 + 2.0 * g * lever * position) / g**2
    tilt = w2 - toppling**2 - lever**2 * position - 2.0 * g * lever * velocity
    rate = -(w3 + 2.0 * toppling + lever**2 * velocity)
    # The weight of u, in units of the weight of the torques.
    r = plane.effort / _TORQUE**2
    weights = {"position": position, "velocity": velocity, "tilt": tilt, "tilt_rate": rate}
    return {"torque": _TORQUE, **{name: float(q * r) ** -0.5 if q > 0.0 else _FREE for name, q in weights.items()}}


def _inverse_dynamics(poles: Poles, plane: Plane) -> dict[str, float]:
    """The two slowest poles belong to the position; the poles of the lean itself follow from all four."""
    ordered = poles[np.argsort(np.abs(poles))]
    _, c1, c0 = np.poly(ordered[:2]).real
    _, p1, p0 = np.poly(ordered[2:]).real
    stiffness = p0 + c1 * p1 + c0
    return {
        "lean_bandwidth": math.sqrt(stiffness) / plane.toppling,
        "lean_damping": float(c1 + p1) / (2.0 * math.sqrt(stiffness)),
        "position_bandwidth": math.sqrt(c0) / plane.toppling,
        "position_damping": float(c1) / (2.0 * math.sqrt(c0)),
    }


def _sliding_mode(tuning: Tuning, toppling: float) -> dict[str, float]:
    """Lean in units of λ; the heading, with options in 1/s, scales with λ. The position is unchanged."""
    (surface, yaw_surface), (switching, yaw_switching), (layer, yaw_layer) = (
        tuning.numbers[name] for name in ("surface", "switching", "layer")
    )
    faster = toppling / tuning.toppling
    return {
        "surface": surface / tuning.toppling,
        "switching": switching / tuning.toppling**2,
        "layer": layer / tuning.toppling,
        "yaw_surface": yaw_surface * faster,
        "yaw_switching": yaw_switching * faster**2,
        "yaw_layer": yaw_layer * faster,
    }
