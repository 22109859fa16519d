"""One interface to all that can drive the robots of a batch: a law of the core, a law in Python or a policy."""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import real_array
from ballbot_rs._core import Batch, Controller
from ballbot_rs._errors import InvalidInputError
from ballbot_rs.control.laws import Laws, parts_for
from ballbot_rs.control.recurrent import Policy, PolicyMemory
from ballbot_rs.control.resolve import ResolvedController
from ballbot_rs.control.setpoints import Setpoint
from ballbot_rs.envs.family import has_several_robots

Actions = npt.NDArray[np.float32]


class Actor(Protocol):
    """Chooses the actions of all robots of a batch."""

    def __call__(self, observations: npt.NDArray[np.float32], setpoint: Mapping[str, Any] | None = None) -> Actions:
        """Actions within [-1, 1], shape (n, 3), for the parts of a setpoint; None is the task's setpoint."""

    def ended(self, mask: npt.NDArray[np.bool_]) -> None:
        """Takes a mask of the robots that have begun a new episode, shape (n,)."""


def core_law(controller: ResolvedController, batch: Batch) -> Controller | None:
    """A controller as a law of the core that fits all robots of a batch; None if it is anything else."""
    return None if has_several_robots(batch) else _designed(controller, batch)


def _designed(controller: ResolvedController, batch: Batch) -> Controller | None:
    """A law of the core, designed for the first robot of a batch."""
    if controller.policy is not None:
        return None
    # A controller keeps the direction of its torques within this limit.
    params = batch.nominal_params(0).replace(max_wheel_torque=batch.max_wheel_torque)
    law = controller.law(params, batch.control_dt)
    return law if isinstance(law, Controller) else None


def make_actor(controller: ResolvedController, batch: Batch) -> Actor:
    """A controller on all robots of a batch.

    Raises:
        ValueError: a law in Python on several robots.
    """
    law, several = _designed(controller, batch), has_several_robots(batch)
    if law is not None:
        return CoreActor(controller.name, law, batch, drawn=several)
    if controller.policy is not None:
        return PolicyActor(controller.name, controller.policy)
    if several:
        raise InvalidInputError(f"{controller.name} is a law in Python: it runs on one robot, not on several")
    params = batch.nominal_params(0).replace(max_wheel_torque=batch.max_wheel_torque)
    return LawActor(controller.laws(batch.num_envs, params, batch.control_dt), batch)


def observes_estimates(batch: Batch) -> bool:
    """Whether the task of a batch observes estimates from sensors."""
    return bool(batch.options["observation"] == "sensors")


class CoreActor:
    """A law of the core; the batch keeps its memory of each robot.

    With `drawn` it is designed for each robot, events included.
    """

    def __init__(self, name: str, law: Controller, batch: Batch, *, drawn: bool = False) -> None:
        self._name, self._law, self._batch, self._drawn = name, law, batch, drawn

    def __call__(self, observations: npt.NDArray[np.float32], setpoint: Mapping[str, Any] | None = None) -> Actions:  # noqa: ARG002
        """As `Actor`."""
        parts = None if setpoint is None else parts_for(self._name, self._law.setpoint_parts, setpoint)
        return self._batch.control(self._law, parts, drawn=self._drawn)

    def ended(self, mask: npt.NDArray[np.bool_]) -> None:
        """As `Actor`."""


class PolicyActor:
    """A policy, which observes the setpoint of its task."""

    def __init__(self, name: str, policy: Policy) -> None:
        self._name, self._memory = name, PolicyMemory(policy)

    def __call__(self, observations: npt.NDArray[np.float32], setpoint: Mapping[str, Any] | None = None) -> Actions:
        """As `Actor`.

        Raises:
            TypeError: a setpoint.
        """
        if setpoint is not None:
            raise TypeError(
                f"{self._name} is a policy: its only setpoint is its task's, the option 'setpoint' of "
                "env_options where the task has one; OnnxPolicy(file).controller(robot) follows any setpoint"
            )
        return _limited(real_array(f"{self._name} gave", self._memory.act(observations), "actions"))

    def ended(self, mask: npt.NDArray[np.bool_]) -> None:
        """As `Actor`."""
        self._memory.reset(mask)


class LawActor:
    """A law in Python, on the states that the task of a batch observes, or on the readings of the sensors."""

    def __init__(self, laws: Laws, batch: Batch) -> None:
        self._laws, self._batch = laws, batch
        if laws.reads_sensors and batch.options["sensors"] is None:
            raise InvalidInputError(f"{laws.name} reads sensors, and the robots have none: name them (sensors=)")

    def __call__(
        self,
        observations: npt.NDArray[np.float32],  # noqa: ARG002
        setpoint: Mapping[str, Any] | Sequence[Mapping[str, Any]] | None = None,
    ) -> Actions:
        """As `Actor`; a sequence has the parts of each robot."""
        batch, laws = self._batch, self._laws
        if setpoint is None:
            setpoints = [Setpoint(**batch.setpoint(i)) for i in range(batch.num_envs)]
        elif isinstance(setpoint, Mapping):
            setpoints = [self._setpoint(setpoint)] * batch.num_envs
        else:
            setpoints = [self._setpoint(one) for one in setpoint]
        states: Any
        if laws.reads_sensors:
            states = batch.readings() if laws.is_batched else [batch.readings(i) for i in range(batch.num_envs)]
        elif laws.is_batched:
            states = batch.estimates() if observes_estimates(batch) else batch.states()
        else:
            seen = batch.estimate if observes_estimates(batch) else batch.state
            states = [seen(i) for i in range(batch.num_envs)]
        return _limited(laws.torques(states, setpoints) / batch.max_wheel_torque)

    def _setpoint(self, parts: Mapping[str, Any]) -> Setpoint:
        return Setpoint(**parts_for(self._laws.name, self._laws.follows, parts))

    def ended(self, mask: npt.NDArray[np.bool_]) -> None:
        """As `Actor`."""
        self._laws.reset(mask)


def _limited(actions: npt.ArrayLike) -> Actions:
    return np.clip(np.asarray(actions, dtype=np.float32), -1.0, 1.0)
