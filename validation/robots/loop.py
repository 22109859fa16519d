"""LQR on the linear model through motors with delay, lag and strength; the same loop in `spatial`."""

import math

import numpy as np

import ballbot_rs as bb
from validation.mechanics import Array

SIM_DT, CONTROL_DT = 0.002, 0.01
SUBSTEPS = 5

#: Initial tilt of a growth test, rad, and the limit up to which it counts as small.
_TILT, _SMALL = 1e-9, 1e-5


def matrix(delay: float = 0.0, lag: float = 0.0, strength: Array | float = 1.0) -> Array:
    """The map of a control step of 10 ms, five model steps. Delay and lag in s; strength of all motors or of each.

    Its state: the ten states of `LinearModel`, three lagging torques, and the commands of earlier control steps.
    """
    gain = bb.Lqr(control_dt=CONTROL_DT).gain
    a, b = bb.LinearModel().discretize(SIM_DT)
    steps = round(delay / SIM_DT)
    kept = steps // SUBSTEPS + 1
    size = 13 + 3 * kept
    state, torque = np.eye(10, size), np.eye(3, size, 10)
    # The present command, then earlier commands.
    commands = [-gain @ state, *(np.eye(3, size, 13 + 3 * age) for age in range(kept))]
    shares = np.broadcast_to(strength, (3,))[:, np.newaxis]
    for step in range(SUBSTEPS):
        commanded = shares * commands[-((step - steps) // SUBSTEPS)]
        torque = torque + (1.0 - math.exp(-SIM_DT / lag) if lag else 1.0) * (commanded - torque)
        state = a @ state + b @ torque
    return np.vstack([state, torque, *commands[:kept]])


def radius(loop: Array) -> float:
    """The largest absolute value of the eigenvalues: growth per control step."""
    return float(np.abs(np.linalg.eigvals(loop)).max())


def growth(delay: float = 0.0, lag: float = 0.0, strength: Array | float = 1.0) -> float:
    """Growth per control step of a small tilt in `spatial`, for an unstable loop.

    Two past samples give the next once one pair of eigenvalues, or a single eigenvalue, dominates.
    """
    shares = np.broadcast_to(strength, (3,)).tolist()
    batch = bb.Batch(
        1,
        model="spatial",
        max_wheel_torque=bb.Params.paper().max_wheel_torque,
        actuators={"delay": delay, "lag": lag, "strength": shares},
        max_episode_steps=100_000,
    )
    batch.reset(starts=[bb.State.at_rest(batch.params(), tilt=(_TILT, 0.3 * _TILT))])
    rows = batch.rollout(bb.Lqr(control_dt=CONTROL_DT), 3000, record=("states",))["states"][:, 0]
    tilts = np.array([bb.State.from_array(row).tilt_components[0] for row in rows])
    end = int(np.argmax(np.abs(tilts) > _SMALL)) or len(tilts)
    y = tilts[end - 40 : end]
    coefficients = np.linalg.lstsq(np.column_stack([y[1:-1], y[:-2]]), y[2:], rcond=None)[0]
    return float(np.abs(np.roots([1.0, *-coefficients])).max())
