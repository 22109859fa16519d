"""A policy in an ONNX file: runs in onnxruntime, without torch and without pickled code."""

import json
from collections.abc import Mapping
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import check_count, real_array
from ballbot_rs._core import Controller, _policy_controller
from ballbot_rs._extras import require
from ballbot_rs._keywords import named
from ballbot_rs._robot import Robot, params_of
from ballbot_rs.control import deadline, policy_file, policy_size
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

#: Metadata that only recurrent policies have.
OF_STATE: Final = "state"

#: Options of an environment, all numbers, on which the actions of its policies depend.
ACTING: Final = ("control_dt", "sim_dt", "max_wheel_torque", "scale_observations", "scale_by_robot", "integral_rate")

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
        self._state_len = _state_len(shapes)
        if shapes != _expected(self._rows, self._state_len):
            raise ValueError(
                f"{file} maps {shapes}, expected an observation of {self._rows} to an action of 3, or an observation "
                "and a state to an action and a next_state"
            )
        if self._state_len > policy_size.MAX_STATE:
            raise ValueError(f"{file} has a state of {self._state_len} numbers, more than {policy_size.MAX_STATE}")
        for end in self._session.get_inputs():
            if end.type != "tensor(float)":
                raise ValueError(f"{file} takes {end.name} as {end.type}, expected tensor(float)")
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

    @property
    def state_len(self) -> int:
        """Length of the state of a recurrent policy; 0 for other policies."""
        return self._state_len

    def initial_state(self, count: int | None = None) -> npt.NDArray[np.float32]:
        """The state where an episode begins, zeros: shape (`state_len`,), or (count, `state_len`) for a batch.

        Raises:
            ValueError: a count below 1.
            TypeError: not a whole number.
        """
        shape = () if count is None else (check_count("count", count),)
        return np.zeros((*shape, self._state_len), dtype=np.float32)

    def act(self, observation: npt.ArrayLike) -> npt.NDArray[np.float32]:
        """Actions in [-1, 1]: shape (3,) for an observation (m,), shape (n, 3) for a batch (n, m).

        Raises:
            ValueError: another shape, or a recurrent policy: `step` takes its state.
            TypeError: not numbers.
            TimeoutError: the model runs for more than `CALL_LIMIT` and `ROW_LIMIT` allow; the call is aborted.
        """
        if self._state_len:
            raise ValueError(f"{self._file} is a recurrent policy: step(observation, state) returns its next state")
        rows = self._numbers("observation", observation, self._rows)
        (actions,) = self._infer({"observation": rows}, ["action"])
        return actions if rows.ndim == 2 else actions[0]

    def step(
        self, observation: npt.ArrayLike, state: npt.ArrayLike
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        """Actions in [-1, 1], shape (3,), and the next state, (k,); shapes (n, 3) and (n, k) for a batch.

        ```python
        state = policy.initial_state()      # where an episode begins
        action, state = policy.step(observation, state)
        ```

        Args:
            observation: of one robot, shape (m,), or of n robots, shape (n, m).
            state: of the same robots, shape (k,) or (n, k); k is `state_len`, 0 for a policy that is not recurrent.

        Raises:
            ValueError: another shape; of a recurrent policy also a number that is not finite, which would stay in the
                state, or a file that gives a next state of another shape.
            TypeError: not numbers.
            TimeoutError: as `act`.
        """
        rows = self._numbers("observation", observation, self._rows)
        states = self._numbers("state", state, self._state_len)
        if states.shape[:-1] != rows.shape[:-1]:
            raise ValueError(f"state has shape {states.shape} for an observation of shape {rows.shape}")
        if not self._state_len:
            return self.act(rows), states
        for name, values in {"observation": rows, "state": states}.items():
            if not np.isfinite(values).all():
                value = values[~np.isfinite(values)][0]
                raise ValueError(f"{name} has the value {value}: all must be finite in single precision")
        actions, after = self._infer({"observation": rows, "state": states}, ["action", "next_state"])
        expected = np.atleast_2d(states).shape
        if after.shape != expected:
            raise ValueError(f"{self._file} gives a next_state of shape {after.shape}, expected {expected}")
        return (actions, after) if rows.ndim == 2 else (actions[0], after[0])

    def _numbers(self, name: str, values: npt.ArrayLike, width: int) -> npt.NDArray[np.float32]:
        rows: npt.NDArray[np.float32] = real_array(f"{name} is", values, "numbers").astype(np.float32, copy=False)
        if rows.ndim not in (1, 2) or rows.shape[-1] != width:
            raise ValueError(f"{name} has shape {rows.shape}, expected ({width},) or (n, {width})")
        return rows

    def _infer(self, rows: Mapping[str, npt.NDArray[np.float32]], names: list[str]) -> list[npt.NDArray[np.float32]]:
        """The outputs of the network, of at least one row each."""
        given = {name: np.ascontiguousarray(np.atleast_2d(values)) for name, values in rows.items()}
        limit = CALL_LIMIT + ROW_LIMIT * len(given["observation"])
        self._run = self._new_options()
        # The exception has its message on an ended run.
        self._run.log_severity_level = 4
        found: list[npt.NDArray[np.float32]]
        try:
            found = deadline.run(limit, self._run, lambda options: self._session.run(names, given, options))
        except TimeoutError as error:
            raise TimeoutError(f"{self._file} was aborted: {error}") from error
        return found

    def controller(self, robot: Robot | None = None) -> Controller:
        """The policy as a controller of a robot, in Rust: it follows setpoints, and runs on all robots of a `Batch`.

        A policy of the tasks balance and push follows the motion of a setpoint: it observes the robot in the frame of
        the motion, without the lean that the motion requires of `robot`, and its torques are added to the torques of
        the motion. A policy of goal follows a position, a policy of velocity a velocity and a rate of the heading.
        Motors, sensors and events of its training are not part of it.

        ```python
        law = bb.OnnxPolicy("assets/policies/balance-any.onnx").controller("kugle")
        circle = bb.Reference.circle(radius=0.5, period=10.0, robot="kugle")
        print(bb.simulate(law, robot="kugle", seconds=5.0, reference=circle).metrics().position_error_rms)
        ```

        Args:
            robot: as in `Controller`; the scale of actions and observations follows from it if it did in training.

        Raises:
            ValueError: a policy of another task, or a network other than LSTM cells and dense layers with tanh between
                them.
            ModuleNotFoundError: onnx is not installed.
        """
        from ballbot_rs.control import network_file

        options = self.env_options
        scalars = {name: float(options[name]) for name in ACTING if options.get(name) is not None}
        cells, layers = (
            [(weights[np.newaxis], biases[np.newaxis]) for weights, biases in part]
            for part in network_file.read_parts(self._file)
        )
        history = options.get("history", 1)
        return _policy_controller(self._file.stem, self.task, layers, history, scalars, params_of(robot), cells=cells)

    def interrupt(self) -> None:
        """Ends a call of `act` or `step` in another thread, which then raises: a file may hold an endless loop."""
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


def _state_len(shapes: list[tuple[str, list[Any]]]) -> int:
    """Length of the state that a network takes; 0 without a state."""
    (length,) = dict(shapes).get("state", [0])[:1] or [0]
    return length if isinstance(length, int) else 0


def _expected(rows: int, state_len: int) -> list[tuple[str, list[Any]]]:
    """Names and lengths of the inputs and outputs of a network."""
    if not state_len:
        return [("observation", [rows]), ("action", [3])]
    return [("observation", [rows]), ("state", [state_len]), ("action", [3]), ("next_state", [state_len])]


def _metadata(file: Path, found: dict[str, str]) -> dict[str, Any]:
    read: dict[str, Any] = {}
    fields = {**FIELDS, **({OF_STATE: dict} if PREFIX + OF_STATE in found else {})}
    for field, kind in fields.items():
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
