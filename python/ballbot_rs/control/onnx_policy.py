"""A policy in an ONNX file: runs in onnxruntime, without torch and without pickled code."""

import json
from collections.abc import Mapping
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import real_array
from ballbot_rs._core import Controller, _policy_controller
from ballbot_rs._extras import require
from ballbot_rs._keywords import named
from ballbot_rs._robot import Robot, params_of
from ballbot_rs.control import deadline, policy_file
from ballbot_rs.envs.spaces import observation_width

#: Metadata of an exported policy, each a JSON text; the keys in its file begin with `PREFIX`.
FIELDS: Final[Mapping[str, type | tuple[type, ...]]] = {
    "env_id": str,
    "env_options": dict,
    "observation": list,
    "max_wheel_torque": (float, type(None)),
    "control_dt": float,
    "algorithm": str,
    "versions": dict,
}
PREFIX = "ballbot."

#: Options of an environment, all numbers, on which the actions of its policies depend.
ACTING: Final = ("control_dt", "sim_dt", "max_wheel_torque", "scale_observations", "scale_by_robot")

#: Tasks whose policies can follow setpoints.
FOLLOWING: Final = ("balance", "push", "goal", "velocity")

#: Longest time that a policy may take for actions, s: per call, plus per observation in it.
CALL_LIMIT = 1.0
ROW_LIMIT = 1e-3


@named
class OnnxPolicy:
    """A policy that `ballbot export` wrote.

    ```python
    policy = bb.OnnxPolicy("assets/policies/balance.onnx")
    observation, info = bb.BalanceEnv(**policy.env_options).reset(seed=0)
    print(policy.act(observation))
    ```

    Args:
        path: the file.
        task: the task that it is to act in; None is the task that the file names.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is not an exported policy, or is for another environment or another layout of observations.
        ModuleNotFoundError: onnxruntime is not installed.
    """

    def __init__(self, path: str | PathLike[str], task: str | None = None) -> None:
        file = Path(fspath(path))
        if not file.is_file():
            raise FileNotFoundError(f"no policy at {file}")
        self._file = file.absolute()
        self._session, self._new_options = _session(file)
        self.metadata = _metadata(file, self._session.get_modelmeta().custom_metadata_map)
        #: Name of the task.
        self.task = policy_file.task_in(file, self.metadata["env_id"], task)
        _check_layout(file, self.metadata, self.task)
        ends = (*self._session.get_inputs(), *self._session.get_outputs())
        shapes = [(end.name, end.shape[1:]) for end in ends]
        self._env_options = policy_file.completed(self.task, self.metadata["env_options"])
        self._rows = observation_width(self.task, self._env_options)
        if shapes != [("observation", [self._rows]), ("action", [3])]:
            raise ValueError(f"{file} maps {shapes}, expected an observation of {self._rows} to an action of 3")
        self._run: Any = None

    def __reduce__(self) -> tuple[Any, ...]:
        # A session has no copy: a copy reads the file.
        return type(self), (self._file.absolute(), self.task)

    @property
    def env_options(self) -> dict[str, Any]:
        """Options of the environment that the policy was trained in.

        A policy from before 0.2.0 gets observations without scaling, and 1 N·m per unit of action, as in its training.
        """
        return dict(self._env_options)

    def act(self, observation: npt.ArrayLike) -> npt.NDArray[np.float32]:
        """Actions in [-1, 1]: shape (3,) for an observation (m,), shape (n, 3) for a batch (n, m).

        Raises:
            ValueError: another shape.
            TypeError: not numbers.
            TimeoutError: the model runs for more than `CALL_LIMIT` and `ROW_LIMIT` allow; it has been ended.
        """
        rows = real_array("observation is", observation, "numbers").astype(np.float32, copy=False)
        if rows.ndim not in (1, 2) or rows.shape[-1] != self._rows:
            raise ValueError(f"observation has shape {rows.shape}, expected ({self._rows},) or (n, {self._rows})")
        given = {"observation": np.ascontiguousarray(np.atleast_2d(rows))}
        limit = CALL_LIMIT + ROW_LIMIT * len(given["observation"])
        actions: npt.NDArray[np.float32]
        self._run = self._new_options()
        # The exception has its message on an ended run.
        self._run.log_severity_level = 4
        try:
            (actions,) = deadline.run(limit, self._run, lambda options: self._session.run(["action"], given, options))
        except TimeoutError as error:
            raise TimeoutError(f"{self._file} has been ended: {error}") from error
        return actions if rows.ndim == 2 else actions[0]

    def controller(self, robot: Robot | None = None) -> Controller:
        """The policy as a controller of a robot, in Rust: it follows setpoints, and runs on all robots of a `Batch`.

        A policy of the tasks balance and push follows the motion of a setpoint: it observes the robot in a frame that
        moves, accelerates and turns with it. A policy of goal follows a position, a
        policy of velocity a velocity and a rate of the heading. Motors, sensors and events of its training are not part
        of it.

        ```python
        law = bb.OnnxPolicy("assets/policies/balance-any.onnx").controller("kugle")
        circle = bb.Reference.circle(radius=0.5, period=10.0, robot="kugle")
        print(bb.simulate(law, robot="kugle", seconds=5.0, reference=circle).metrics().position_error_rms)
        ```

        Args:
            robot: as in `Controller`; the scale of actions and observations follows from it if it did in training.

        Raises:
            ValueError: a policy of another task, or another network than dense layers with tanh between them.
            ModuleNotFoundError: onnx is not installed.
        """
        from ballbot_rs.control import network_file

        options = self.env_options
        scalars = {name: float(options[name]) for name in ACTING if options.get(name) is not None}
        layers = [(weights[np.newaxis], biases[np.newaxis]) for weights, biases in network_file.read(self._file)]
        history = options.get("history", 1)
        return _policy_controller(self._file.stem, self.task, layers, history, scalars, params_of(robot))

    def interrupt(self) -> None:
        """Ends a call of `act` in another thread, which then raises: a file may hold a loop that does not end."""
        if self._run is not None:
            self._run.terminate = True


def _session(file: Path) -> tuple[Any, Any]:
    """The model, ready to run, and a function that makes the options of a run."""
    with require("an ONNX policy", "onnx"):
        import onnxruntime
    options = onnxruntime.SessionOptions()
    # The network is small: a second thread would cost more than it gains.
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        session = onnxruntime.InferenceSession(file.read_bytes(), options, providers=["CPUExecutionProvider"])
    # Its exceptions have no common base class.
    except Exception as error:
        raise ValueError(f"{file} is not an ONNX file that onnxruntime can run: {error}") from error
    return session, onnxruntime.RunOptions


def _metadata(file: Path, found: dict[str, str]) -> dict[str, Any]:
    read: dict[str, Any] = {}
    for field, kind in FIELDS.items():
        try:
            read[field] = json.loads(found[PREFIX + field])
        except (KeyError, ValueError, RecursionError):
            raise ValueError(f"{file} does not name its {field}: it is not a policy of ballbot_rs") from None
        if not isinstance(read[field], kind):
            known = " or ".join(one.__name__ for one in (kind if isinstance(kind, tuple) else (kind,)))
            raise ValueError(f"{file}: {field} is {read[field]!r}, not a {known}")
    return read


def _check_layout(file: Path, metadata: dict[str, Any], task: str) -> None:
    if not policy_file.fits(metadata["observation"], task):
        expected = policy_file.observation_layout(task)
        raise ValueError(
            f"{file} was trained for another environment: "
            f"observation is {metadata['observation']!r}, expected {expected!r}"
        )
