"""A policy in an ONNX file: run by onnxruntime alone, without torch and without pickled code."""

import json
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import OBSERVATION
from ballbot_rs._extras import require
from ballbot_rs.envs.registration import BALANCE

#: What an exported policy says of itself, each a JSON text; the keys of its file begin with `PREFIX`.
FIELDS = {
    "env_id": str,
    "env_options": dict,
    "observation": list,
    "normalisation": dict,
    "max_wheel_torque": float,
    "control_dt": float,
    "algorithm": str,
    "versions": dict,
}
PREFIX = "ballbot."


def observation_layout() -> list[list[Any]]:
    """Name, unit and bound of each row of an observation, as JSON has it."""
    return [[name, unit, bound] for name, unit, bound in OBSERVATION]


class OnnxPolicy:
    """A policy that `ballbot export` wrote.

    Args:
        path: the file.
        env_id: the environment that it is to act in.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is no exported policy, or one for another environment or another layout of observations.
        ModuleNotFoundError: onnxruntime is not installed.
    """

    def __init__(self, path: str | PathLike[str], env_id: str = BALANCE) -> None:
        file = Path(fspath(path))
        if not file.is_file():
            raise FileNotFoundError(f"no policy at {file}")
        self._session = _session(file)
        self.metadata = _metadata(file, self._session.get_modelmeta().custom_metadata_map)
        _check(file, self.metadata, env_id)
        ends = (*self._session.get_inputs(), *self._session.get_outputs())
        shapes = [(end.name, end.shape[1:]) for end in ends]
        if shapes != [("observation", [len(OBSERVATION)]), ("action", [3])]:
            raise ValueError(f"{file} maps {shapes}, expected an observation of {len(OBSERVATION)} to an action of 3")

    @property
    def env_options(self) -> dict[str, Any]:
        """Arguments of the environment that the policy was trained with."""
        return dict(self.metadata["env_options"])

    def act(self, observation: npt.ArrayLike) -> npt.NDArray[np.float32]:
        """Actions in [-1, 1]: shape (3,) for an observation (16,), shape (n, 3) for a batch (n, 16).

        Raises:
            ValueError: another shape.
        """
        rows = np.asarray(observation, dtype=np.float32)
        if rows.ndim not in (1, 2) or rows.shape[-1] != len(OBSERVATION):
            raise ValueError(f"observation has shape {rows.shape}, expected (16,) or (n, 16)")
        actions: npt.NDArray[np.float32]
        (actions,) = self._session.run(["action"], {"observation": np.ascontiguousarray(np.atleast_2d(rows))})
        return actions if rows.ndim == 2 else actions[0]


def _session(file: Path) -> Any:
    with require("an ONNX policy", "onnx"):
        import onnxruntime
    options = onnxruntime.SessionOptions()
    # The network is small: a second thread would cost more than it brings.
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        return onnxruntime.InferenceSession(file.read_bytes(), options, providers=["CPUExecutionProvider"])
    # Its exceptions have no common base of their own.
    except Exception as error:
        raise ValueError(f"{file} is not an ONNX file that onnxruntime can run: {error}") from error


def _metadata(file: Path, found: dict[str, str]) -> dict[str, Any]:
    read: dict[str, Any] = {}
    for field, kind in FIELDS.items():
        try:
            read[field] = json.loads(found[PREFIX + field])
        except (KeyError, ValueError):
            raise ValueError(f"{file} does not say its {field}: it is no policy of ballbot_rs") from None
        if not isinstance(read[field], kind):
            raise ValueError(f"{file}: {field} is {read[field]!r}, which is no {kind.__name__}")
    return read


def _check(file: Path, metadata: dict[str, Any], env_id: str) -> None:
    for field, expected in (("env_id", env_id), ("observation", observation_layout())):
        if metadata[field] != expected:
            raise ValueError(
                f"{file} was trained for another environment: {field} is {metadata[field]!r}, expected {expected!r}"
            )
