"""Trajectory optimization by differential dynamic programming with limits of the torques.

Iterative LQR: the cost is expanded about the motion, with the exact derivatives of the steps through contact and slip,
a backward sweep finds the change of the torques and the feedback on changes of the state, and the motion is simulated
with both (Tassa, Mansard, Todorov, ICRA 2014, doi 10.1109/ICRA.2014.6907001).
"""

import dataclasses
from collections.abc import Callable
from typing import Protocol

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Ballbot
from ballbot_rs._errors import DivergedError, InvalidInputError
from ballbot_rs.optimal import tangent

Array = npt.NDArray[np.float64]

#: Fractions of a change of the torques that are tried, largest first.
FRACTIONS = 0.5 ** np.arange(10)
#: Regularization of the torques' Hessian, relative to its trace: first, least and largest value, and factor.
FIRST, LEAST, LARGEST, FACTOR = 1e-6, 1e-10, 1e6, 10.0
#: Regularization up to which the expected improvement shows how much is left.
UNDAMPED = 1e-4


@dataclasses.dataclass(frozen=True)
class Motion:
    """A motion of one robot."""

    #: Rows as `State.to_array`, shape (T + 1, 32).
    states: Array
    #: N·m, shape (T, 3).
    torques: Array
    #: Contact forces in the last time step of each control step, as `Jacobian.forces`, N, shape (T, 9).
    forces: Array


@dataclasses.dataclass(frozen=True)
class Derivatives:
    """Derivatives along a motion, in the coordinates of `Jacobian.states`."""

    #: The next state by the state, shape (T, 30, 30), and by the torques, shape (T, 30, 3).
    a: Array
    b: Array
    #: The forces by the state, shape (T, 9, 30), and by the torques, shape (T, 9, 3).
    c: Array
    d: Array


@dataclasses.dataclass(frozen=True)
class Expansion:
    """Gradients and Hessians of a cost along a motion: of the states, rows T + 1, of the torques, and of both."""

    x: Array
    xx: Array
    u: Array
    uu: Array
    ux: Array


class Cost(Protocol):
    """A sum over states, torques and forces of a motion."""

    def total(self, motion: Motion) -> float:
        """The cost."""

    def expand(self, motion: Motion, derivatives: Derivatives) -> Expansion:
        """The cost to the second order."""


class Plant:
    """One robot that is simulated again and again from the same start."""

    def __init__(self, robot: Ballbot, substeps: int, max_torque: float, largest_change: float) -> None:
        self.robot, self.substeps, self.max_torque = robot, substeps, max_torque
        #: Of a torque in an iteration, N·m: beyond it the second order is a poor model.
        self.largest_change = largest_change
        self._start = robot.snapshot()

    def motion(self, law: Callable[[int, Array], Array], steps: int) -> Motion | None:
        """The motion under torques by step and state; None if the robot diverges."""
        self.robot.restore(self._start)
        states, torques, forces = np.empty((steps + 1, tangent.NUMBERS)), np.empty((steps, 3)), np.empty((steps, 9))
        states[0] = self.robot.state.to_array()
        for k in range(steps):
            torques[k] = np.clip(law(k, states[k]), -self.max_torque, self.max_torque)
            try:
                self.robot.step(torques[k], self.substeps)
            except DivergedError:
                return None
            states[k + 1] = self.robot.state.to_array()
            contacts = self.robot.contacts
            forces[k] = np.concatenate([contacts.wheel_normal_forces, contacts.wheel_tractions, contacts.floor_force])
        return Motion(states, torques, forces)

    def derivatives(self, motion: Motion) -> Derivatives | None:
        """The derivatives along a motion from the start; None where the bot touches the floor."""
        self.robot.restore(self._start)
        try:
            found = self.robot.jacobians(motion.torques, self.substeps)
        except InvalidInputError:
            return None
        # Contact forces of the last step, on which small losses depend, are left out.
        n = tangent.COORDINATES
        return Derivatives(found.A[:, :n, :n], found.B[:, :n], found.C[:, :, :n], found.D)


@dataclasses.dataclass(frozen=True)
class Sweep:
    """Changes of the torques, N·m, shape (T, 3), and their feedback on changes of the state, shape (T, 3, 30)."""

    changes: Array
    gains: Array
    #: First and second order of the expected change of the cost.
    first: float
    second: float


def sweep(derivatives: Derivatives, cost: Expansion, low: Array, high: Array, damping: float) -> Sweep | None:
    """The backward sweep, with changes of the torques from `low` to `high`, shape (T, 3).

    None if the Hessian of the torques is not positive definite.
    """
    steps, n = derivatives.b.shape[:2]
    changes, gains = np.zeros((steps, 3)), np.zeros((steps, 3, n))
    vx, vxx = cost.x[steps], cost.xx[steps]
    first = second = 0.0
    for k in reversed(range(steps)):
        a, b = derivatives.a[k], derivatives.b[k]
        va = vxx @ a
        qx, qu = cost.x[k] + vx @ a, cost.u[k] + vx @ b
        qxx, qux = cost.xx[k] + a.T @ va, cost.ux[k] + b.T @ va
        quu = cost.uu[k] + b.T @ (vxx @ b)
        damped = quu + damping * max(np.trace(quu), 1e-12) * np.eye(3)
        solved = limited(damped, qu, low[k], high[k])
        if solved is None:
            return None
        change, free = solved
        changes[k] = change
        if free.any():
            gains[k, free] = -np.linalg.solve(damped[np.ix_(free, free)], qux[free])
        first += change @ qu
        second += 0.5 * change @ quu @ change
        vx = qx + gains[k].T @ (quu @ change + qu) + qux.T @ change
        vxx = qxx + gains[k].T @ quu @ gains[k] + gains[k].T @ qux + qux.T @ gains[k]
        vxx = 0.5 * (vxx + vxx.T)
    return Sweep(changes, gains, float(first), float(second))


def limited(hessian: Array, gradient: Array, low: Array, high: Array) -> tuple[Array, npt.NDArray[np.bool_]] | None:
    """The minimum of xᵀ H x / 2 + gᵀ x within limits, and which components are free.

    None if H is not positive definite. By projected Newton steps.
    """
    x = np.clip(np.zeros(3), low, high)
    value = float(gradient @ x + 0.5 * x @ hessian @ x)
    while True:
        slope = gradient + hessian @ x
        free = ~(((x <= low) & (slope > 0.0)) | ((x >= high) & (slope < 0.0)))
        step = np.zeros(3)
        if free.any():
            try:
                factor = np.linalg.cholesky(hessian[np.ix_(free, free)])
            except np.linalg.LinAlgError:
                return None
            step[free] = -np.linalg.solve(factor.T, np.linalg.solve(factor, slope[free]))
        for fraction in FRACTIONS:
            new = np.clip(x + fraction * step, low, high)
            change = new - x
            less = float(slope @ change + 0.5 * change @ hessian @ change)
            if less < -1e-12 * (1.0 + abs(value)):
                break
        else:
            return x, free
        x, value = new, value + less


@dataclasses.dataclass(frozen=True)
class Result:
    """Where a minimization has ended."""

    motion: Motion
    derivatives: Derivatives
    cost: float
    iterations: int
    #: Whether less than the tolerance remained to be gained.
    converged: bool


def minimize(
    plant: Plant,
    cost: Cost,
    motion: Motion,
    derivatives: Derivatives,
    *,
    iterations: int,
    tolerance: float,
    progress: Callable[[int, float], None] | None = None,
) -> Result:
    """The motion of least cost near `motion`, which has these derivatives.

    It ends where the expected improvement is below `tolerance` of the cost.
    """
    damping, total = FIRST, cost.total(motion)
    for iteration in range(iterations):
        if progress is not None:
            progress(iteration, total)
        expansion = cost.expand(motion, derivatives)
        low, high = -plant.max_torque - motion.torques, plant.max_torque - motion.torques
        found = None
        while found is None:
            swept = sweep(derivatives, expansion, low, high, damping)
            if swept is not None:
                if -(swept.first + swept.second) <= tolerance * abs(total):
                    # Damped, little is expected although much may be left.
                    return Result(motion, derivatives, total, iteration, converged=damping <= UNDAMPED)
                found = _improved(plant, cost, motion, total, swept)
            if found is None:
                damping *= FACTOR
                if damping > LARGEST:
                    return Result(motion, derivatives, total, iteration, converged=False)
        damping = max(damping / FACTOR, LEAST)
        motion, total, derivatives = found
    return Result(motion, derivatives, total, iterations, converged=False)


def _improved(
    plant: Plant, cost: Cost, motion: Motion, total: float, swept: Sweep
) -> tuple[Motion, float, Derivatives] | None:
    """The motion with a fraction of the changes, its cost and derivatives; None if none improves enough.

    It is the largest fraction with a tenth of the expected improvement.
    """
    largest = float(np.abs(swept.changes).max())
    whole = plant.largest_change / max(largest, plant.largest_change)
    for fraction in whole * FRACTIONS:

        def law(k: int, state: Array, fraction: float = fraction) -> Array:
            feedback = swept.gains[k] @ tangent.difference(state, motion.states[k])
            return np.asarray(motion.torques[k] + fraction * swept.changes[k] + feedback)

        found = plant.motion(law, len(motion.torques))
        if found is None:
            continue
        new = cost.total(found)
        if total - new >= -0.1 * (fraction * swept.first + fraction**2 * swept.second):
            derivatives = plant.derivatives(found)
            if derivatives is not None:
                return found, new, derivatives
    return None
