"""The numbers of figures as tables: columns by names with their units, for files next to the pictures."""

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ballbot_rs.analysis import exports
from ballbot_rs.analysis.recovery_map import Recovery
from ballbot_rs.analysis.sensitivity import Sensitivity
from ballbot_rs.training.curve import Curve

Table = dict[str, npt.NDArray[Any]]


def of_recovery(recovery: Recovery) -> Table:
    """One row per start; recovery times are NaN where the robot has not recovered."""
    tilts, azimuths = np.meshgrid(recovery.tilts, recovery.azimuths, indexing="ij")
    return {
        "tilt_rad": tilts.ravel(),
        "azimuth_rad": azimuths.ravel(),
        "stood": recovery.stood.ravel().astype(float),
        "recovered": recovery.recovered.ravel().astype(float),
        "recovery_time_s": recovery.recovery_times.ravel(),
    }


def of_sensitivity(sensitivity: Sensitivity) -> Table:
    """One row per parameter: its change, and the largest change of each quantity."""
    names = {"tilt": "tilt_deg", "ball": "ball_mm", "wheel load": "wheel_load_percent", "torque": "torque_mNm"}
    effects = {names[name]: effect for name, effect in sensitivity.effects.items()}
    return {"parameter": np.array(sensitivity.names), "change": sensitivity.changes, **effects}


def of_curve(curve: Curve) -> Table:
    """One row per evaluation, with the returns and successes of its episodes."""
    return {
        "timesteps": np.asarray(curve.timesteps, dtype=float),
        **{f"return_{i}": column for i, column in enumerate(curve.returns.T)},
        **{f"success_{i}": np.asarray(column, dtype=float) for i, column in enumerate(curve.successes.T)},
    }


def write(table: Table, path: Path) -> None:
    """Writes a table as CSV or NPZ, by the suffix of `path`.

    Raises:
        ValueError: another suffix.
        OSError: the file cannot be written; an earlier one stays as it is.
    """
    (exports.write_npz if path.suffix == ".npz" else exports.write_csv)(table, path)
