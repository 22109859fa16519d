"""Controllers by name or by path, as functions from the observations of a batch to its actions."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Batch, Lqr, Pid
from ballbot_rs.envs.registration import BALANCE, check_id

Observations = npt.NDArray[np.float32]

#: Controllers by name; anything else is the path of a policy.
CONTROLLERS = ("pid", "lqr", "zero")

#: The paper's PID has a derivative filter of 327 rad/s, which 100 Hz cannot sample: it runs at its own rate.
PID_CONTROL_DT = 0.002


class BatchController(Protocol):
    """Chooses the actions of all robots at once."""

    def __call__(self, observations: Observations) -> npt.ArrayLike:
        """Actions, shape (n, 3), for observations, shape (n, 16)."""


@dataclasses.dataclass(frozen=True)
class Controller:
    """A controller that was found, not yet on any robot."""

    name: str
    #: Arguments of the environment that a policy was trained with.
    env_options: Mapping[str, Any]
    _policy: BatchController | None = None

    def batch(self, num_envs: int, num_threads: int | None, seed: int, options: Mapping[str, Any]) -> Batch:
        """Robots that restart by themselves, sampled as this controller needs it."""
        batch = Batch(num_envs, "same_step", num_threads, seed, **options)
        if self.name != "pid" or "control_dt" in options:
            return batch
        return Batch(num_envs, "same_step", num_threads, seed, **{**options, **_sampled_for_pid(batch)})

    def on(self, batch: Batch) -> BatchController:
        """The controller on the robots of a batch."""
        if self._policy is not None:
            return self._policy
        if self.name == "zero":
            return _zero
        # The environment clips each torque at its own limit; a controller that knows it keeps their direction.
        params = batch.params.replace(max_wheel_torque=batch.max_wheel_torque)
        law: type[Pid] | type[Lqr] = Pid if self.name == "pid" else Lqr
        return _Feedback(batch, lambda: law(params, batch.control_dt))


def find(name: str, env_id: str = BALANCE) -> Controller:
    """A controller by its name, or the policy at a path: of Stable-Baselines3, of a training run, or ONNX.

    Raises:
        ValueError: an unknown environment, or a policy for another one.
        FileNotFoundError: there is no policy at that path.
        ModuleNotFoundError: what runs such a policy is not installed; the message says what to install.
    """
    check_id(env_id)
    if name in CONTROLLERS:
        return Controller(name, {})
    load = _onnx if Path(name).suffix == ".onnx" else _stable_baselines
    policy, options = load(Path(name), env_id)
    return Controller(name, options, policy)


def common_options(controllers: Sequence[Controller], env_options: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """The environment's arguments that the policies among the controllers share, then `env_options` over them.

    Raises:
        ValueError: policies that were trained with different arguments.
    """
    options: Mapping[str, Any] = {}
    for controller in controllers:
        if controller.name in CONTROLLERS:
            continue
        if options and controller.env_options != options:
            raise ValueError(
                f"{controller.name} was trained with {dict(controller.env_options)}, "
                f"another policy with {dict(options)}: not one task"
            )
        options = controller.env_options
    return {**options, **(env_options or {})}


class _Feedback:
    """A controller of this package on every robot of a batch."""

    def __init__(self, batch: Batch, make: Callable[[], Lqr | Pid]) -> None:
        self._batch = batch
        self._controllers = [make() for _ in range(batch.num_envs)]

    def __call__(self, observations: Observations) -> npt.ArrayLike:  # noqa: ARG002
        position = self._batch.setpoint
        torques = [
            controller(self._batch.state(i), position=position) for i, controller in enumerate(self._controllers)
        ]
        return np.asarray(torques) / self._batch.max_wheel_torque


def _zero(observations: Observations) -> npt.ArrayLike:
    return np.zeros((len(observations), 3), np.float32)


def _sampled_for_pid(batch: Batch) -> dict[str, Any]:
    control_dt = max(round(PID_CONTROL_DT / batch.sim_dt), 1) * batch.sim_dt
    seconds = batch.max_episode_steps * batch.control_dt
    return {"control_dt": control_dt, "max_episode_steps": round(seconds / control_dt)}


def _onnx(path: Path, env_id: str) -> tuple[BatchController, Mapping[str, Any]]:
    from ballbot_rs.control.onnx_policy import OnnxPolicy

    policy = OnnxPolicy(path, env_id)
    return lambda observations: policy.act(observations), policy.env_options


def _stable_baselines(path: Path, env_id: str) -> tuple[BatchController, Mapping[str, Any]]:
    try:
        from ballbot_rs.training.policy import act, load_policy
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"a policy file needs {error.name}: install it with `pip install 'ballbot-rs[train]'`",
            name=error.name,
        ) from error
    model, metadata = load_policy(path, env_id)
    return lambda observations: act(model, observations), metadata["env_options"]
