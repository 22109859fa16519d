"""The cost of a motion: its distance from target states, its torques, and its use of traction."""

import dataclasses

import numpy as np
import numpy.typing as npt

from ballbot_rs.optimal import tangent
from ballbot_rs.optimal.solver import Derivatives, Expansion, Motion

Array = npt.NDArray[np.float64]

_BODY = slice(9, 12)
_LOADS, _TRACTIONS = slice(0, 3), slice(3, 6)


@dataclasses.dataclass(frozen=True)
class Quadratic:
    """Half the weighted squares of differences from target states, of torques, and of tractions beyond their limit.

    A wheel that slips does not feel a little more torque, so only the limit shows the way back to grip.
    """

    #: Target states, shape (T + 1, 32).
    targets: Array
    #: Of the squares in the coordinates of `Jacobian.states`, shape (T + 1, 30).
    weights: Array
    #: Of the squares of the torques, 1/(N·m)².
    torque_weight: float
    #: Of the squares of tractions beyond `friction` times the load, 1/N².
    traction_weight: float
    friction: float

    def total(self, motion: Motion) -> float:
        """The cost."""
        errors = tangent.difference(motion.states, self.targets)
        beyond = self._beyond(motion)
        return 0.5 * float(
            np.sum(self.weights * errors**2)
            + self.torque_weight * np.sum(motion.torques**2)
            + self.traction_weight * np.sum(beyond**2)
        )

    def expand(self, motion: Motion, derivatives: Derivatives) -> Expansion:
        """The cost to the second order, without the second derivatives of differences and tractions (Gauss-Newton)."""
        errors = tangent.difference(motion.states, self.targets)
        x = self.weights * errors
        xx = np.zeros((*errors.shape, tangent.COORDINATES))
        diagonal = np.arange(tangent.COORDINATES)
        xx[:, diagonal, diagonal] = self.weights
        # A rotation of the body changes the rotation vector of its error by more than itself.
        turn = tangent.inverse_right_jacobian(errors[:, _BODY])
        x[:, _BODY] = np.einsum("kji,kj->ki", turn, x[:, _BODY])
        xx[:, _BODY, _BODY] = np.einsum("kji,kj,kjl->kil", turn, self.weights[:, _BODY], turn)
        beyond = self._beyond(motion)
        signs = np.sign(motion.forces[:, _TRACTIONS]) * (beyond > 0.0)
        limits = self.friction * (beyond > 0.0)
        by_state = signs[..., None] * derivatives.c[:, _TRACTIONS] - limits[..., None] * derivatives.c[:, _LOADS]
        by_torque = signs[..., None] * derivatives.d[:, _TRACTIONS] - limits[..., None] * derivatives.d[:, _LOADS]
        w = self.traction_weight
        x[:-1] += w * np.einsum("ki,kij->kj", beyond, by_state)
        xx[:-1] += w * np.einsum("kij,kil->kjl", by_state, by_state)
        return Expansion(
            x=x,
            xx=xx,
            u=self.torque_weight * motion.torques + w * np.einsum("ki,kij->kj", beyond, by_torque),
            uu=self.torque_weight * np.eye(3) + w * np.einsum("kij,kil->kjl", by_torque, by_torque),
            ux=w * np.einsum("kij,kil->kjl", by_torque, by_state),
        )

    def _beyond(self, motion: Motion) -> Array:
        """Tractions beyond the limit, N, shape (T, 3)."""
        return np.maximum(np.abs(motion.forces[:, _TRACTIONS]) - self.friction * motion.forces[:, _LOADS], 0.0)
