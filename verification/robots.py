"""What several topics ask of a robot."""

import numpy as np
import numpy.typing as npt

import ballbot_rs as bb

Array = npt.NDArray[np.float64]


def unstable_pole(params: bb.Params) -> float:
    """Growth rate of a small tilt (1/s), from the equations of the `spatial` model linearised about rest upright."""
    model = bb.SpatialModel(params)
    upright = np.array([1.0, 0.0, 0.0, 0.0])
    angle = 1e-6
    tilted = np.array([np.cos(0.5 * angle), np.sin(0.5 * angle), 0.0, 0.0])
    rest, torque = np.zeros(5), np.zeros(3)
    slope = model.accelerations(tilted, rest, torque) - model.accelerations(upright, rest, torque)
    return float(np.sqrt(slope[2] / angle))
