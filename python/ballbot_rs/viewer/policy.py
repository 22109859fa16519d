"""Trained policies in a session: what they see is what the balance task shows them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Batch, Params, State

#: No policy of this task comes near it; a file chosen by mistake often does.
MAX_FILE_SIZE = 64 * 2**20


class Policy(Protocol):
    """What a session needs of a policy; `ballbot_rs.control.onnx_policy.OnnxPolicy` is one."""

    @property
    def env_options(self) -> Mapping[str, Any]:
        """Arguments of the environment that it was trained in."""

    def act(self, observation: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Three actions for an observation of 16 numbers."""


def load_onnx(name: str) -> Policy:
    """The policy in an ONNX file: numbers and a fixed set of operations, never code, so that a page may choose it.

    Raises:
        ValueError: the file is no ONNX policy of this task.
        FileNotFoundError: there is no such file.
        ModuleNotFoundError: what reads ONNX is not installed.
    """
    path = Path(name)
    if path.suffix != ".onnx":
        raise ValueError(f"unknown controller '{name}': expected lqr, pid, zero or a policy file that ends in .onnx")
    if not path.is_file():
        raise FileNotFoundError(f"no policy at {name}")
    if path.stat().st_size > MAX_FILE_SIZE:
        raise ValueError(f"{name} has {path.stat().st_size} bytes, more than {MAX_FILE_SIZE}: no policy of this task")
    try:
        from ballbot_rs.control.onnx_policy import OnnxPolicy
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"a policy file needs {error.name}, which is not installed", name=error.name
        ) from error
    return OnnxPolicy(path)


class PolicyDriver:
    """A policy on every robot.

    The balance task itself makes the observations: each robot's state is put into an environment of the task, moved so
    that the setpoint is at the origin. The last action, which a state does not have, is the one the policy chose.
    """

    def __init__(self, policy: Policy, params: Params, num_robots: int) -> None:
        self.policy = policy
        # Any model observes a state alike; `contact` takes every state, be it fallen or slipping.
        options = {**policy.env_options, "params": params, "model": "contact", "setpoint": (0.0, 0.0)}
        self._observers = [Batch(1, "disabled", 1, 0, **options) for _ in range(num_robots)]
        self.control_dt = self._observers[0].control_dt
        self.sim_dt = self._observers[0].sim_dt
        self._max_torque = self._observers[0].max_wheel_torque
        self._last = np.zeros((num_robots, 3), dtype=np.float32)

    def torques(self, states: Sequence[State], setpoint: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Wheel torques for the next `control_dt`, shape (n, 3), N·m.

        Raises:
            ValueError: the policy's actions are not three finite numbers.
        """
        for i, state in enumerate(states):
            observation = self.observe(i, state, setpoint)
            action = np.zeros(3) if observation is None else np.asarray(self.policy.act(observation))
            if action.shape != (3,) or not np.isfinite(action).all():
                raise ValueError(f"the policy chose {action}: expected three finite numbers")
            self._last[i] = np.clip(action, -1.0, 1.0)
        return self._last.astype(np.float64) * self._max_torque

    def observe(self, index: int, state: State, setpoint: npt.ArrayLike) -> npt.NDArray[np.float32] | None:
        """What the policy sees of robot `index`, shape (16,); None if it is in the floor, as no-slip models can be."""
        away = np.append(np.asarray(setpoint, dtype=np.float64), 0.0)
        start = state.replace(ball_position=state.ball_position - away, body_position=state.body_position - away)
        try:
            observation: npt.NDArray[np.float32] = self._observers[index].reset(starts=[start])[0]
        except ValueError:
            return None
        observation[13:16] = self._last[index]
        return observation

    def reset(self) -> None:
        """Forgets the last actions."""
        self._last[:] = 0.0
