"""A batch whose robots move in another engine; commands, observations, rewards and ends come from the task."""

from collections.abc import Callable, Mapping
from typing import Any, Final, Protocol, cast

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import did_you_mean
from ballbot_rs._core import Batch, Params, Terrain
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._extras import require
from ballbot_rs.envs.family import has_several_robots

Array = npt.NDArray[np.float64]

#: Names of the engines.
ENGINES: Final = ("mujoco",)

#: Parameters that the engines' models do not have.
NOT_SIMULATED: Final = (
    "ball_viscous_friction",
    "floor_rolling_friction",
    "floor_spinning_friction",
    "roller_friction",
    "roller_friction_slope",
    "roller_ripple",
    "payload_mass",
)

#: Parameters of a floor that moves in the course of an episode.
MOVING_FLOOR: Final = ("floor_tilt_amplitude", "floor_acceleration")

#: Parameters of static friction, which the engines' models approximate by a slow slip.
STATIC_FRICTION: Final = ("wheel_static_friction", "floor_static_friction", "friction_critical_velocity")


class EngineRobot(Protocol):
    """One robot in an engine."""

    def move(self, row: Array) -> None:
        """Continues from a state, a row as `State.to_array` (32)."""

    def push(self, push: Array) -> None:
        """Pushes the body over the next time step: impulse (N·s), its moment about the CoM (N·m·s), inertial, (6)."""

    def step(self, torques: Array, steps: int) -> None:
        """Advances by time steps under wheel torques (3, N·m)."""

    def row(self) -> Array:
        """The present state, as `State.to_array` (32)."""


class EngineBatch:
    """A `Batch` whose robots move in another engine.

    The motors are ideal, and friction has only dynamic coefficients. Attributes not defined here come from the `Batch`.

    Args:
        batch: the robots' task.
        engine: one of `ENGINES`.

    Raises:
        ValueError: an unknown engine, or a batch with motors or events that the engine does not have.
        ModuleNotFoundError: the engine is not installed.
    """

    def __init__(self, batch: Batch, engine: str) -> None:
        if batch.terrain is not None and has_several_robots(batch):
            raise InvalidInputError(f"{engine} simulates several robots only on level ground")
        self._inner: Any = batch
        self._make = _maker(engine, batch.terrain)
        self.engine = engine
        _check(batch, engine)
        _check_robot(batch.params(0), engine)
        self._robots: list[tuple[Params, EngineRobot]] = []

    def __getattr__(self, name: str) -> Any:
        # Not during construction or unpickling.
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self._inner, name)

    def rollout(self, *_: Any, **__: Any) -> None:
        """Not available: the core does not step the robots.

        Raises:
            TypeError: always.
        """
        raise TypeError(f"the robots move in {self.engine}: step them one step at a time")

    def step(self, actions: npt.ArrayLike) -> tuple[Array, ...]:
        """As `Batch.step`."""
        # The batch cannot be queried while it waits for the motion.
        self._renew()
        limits = np.array([[params.max_wheel_torque] for params, _ in self._robots])
        torques = np.clip(np.asarray(actions, dtype=np.float64), -1.0, 1.0) * self._inner.action_torques[:, None]
        torques = np.clip(torques, -limits, limits)
        steps = self._inner.substeps

        def motion(states: Array, pushes: Array) -> Array:
            moved = np.empty_like(states)
            for i, (_, robot) in enumerate(self._robots):
                robot.move(states[i])
                if pushes[i].any():
                    robot.push(pushes[i])
                robot.step(torques[i], steps)
                moved[i] = robot.row()
            return moved

        found: tuple[Array, ...] = self._inner.step_with(actions, motion)
        return found

    def _renew(self) -> None:
        """Makes missing robots, and remakes robots whose parameters have changed."""
        for i in range(self._inner.num_envs):
            params = self._inner.params(i)
            if i == len(self._robots):
                self._robots.append(self._made(params))
            elif params != self._robots[i][0]:
                self._robots[i] = self._made(params)

    def _made(self, params: Params) -> tuple[Params, EngineRobot]:
        _check_robot(params, self.engine)
        return params, self._make(params, self._inner.sim_dt)


def in_engine(batch: Batch, engine: str) -> Batch:
    """The batch with its robots in another engine, with the interface of a `Batch`.

    Raises as `EngineBatch`.
    """
    return cast("Batch", EngineBatch(batch, engine))


def _maker(engine: str, terrain: Terrain | None) -> Callable[[Params, float], EngineRobot]:
    if engine not in ENGINES:
        hint = did_you_mean(engine, ENGINES)
        raise InvalidInputError(f"unknown engine '{engine}': expected one of {', '.join(ENGINES)}{hint}")
    with require("the engine MuJoCo", "mujoco"):
        from ballbot_rs.engines.mujoco_robot import MujocoRobot, accurate
    from ballbot_rs.engines.robot_geometry import robot_geometry

    return lambda params, sim_dt: MujocoRobot(robot_geometry(params), accurate(sim_dt), terrain)


def _check(batch: Batch, engine: str) -> None:
    options: Mapping[str, Any] = batch.options
    if options["actuators"]:
        raise InvalidInputError(f"the robots of {engine} have ideal motors: leave out actuators")
    for event in options["events"]:
        term = event["term"]
        if term in (*NOT_SIMULATED, *STATIC_FRICTION) or term.startswith("actuators."):
            raise InvalidInputError(f"{engine} does not simulate {term}, which an event changes")
        if term in MOVING_FLOOR:
            raise InvalidInputError(f"{engine} has no time of an episode, so it has no {term}")
        if term == "force":
            raise InvalidInputError(f"{engine} has no force over time, as an event has: use the term 'push'")
        if event["mode"] in ("interval", "at") and term != "push":
            raise InvalidInputError(f"{engine} does not change {term} within an episode, as an event does")


def _check_robot(params: Params, engine: str) -> None:
    for name in NOT_SIMULATED:
        if (value := getattr(params, name)) != 0.0:
            raise InvalidInputError(f"{engine} does not simulate {name} = {value}: it must be 0")
    for name in MOVING_FLOOR:
        if any(getattr(params, name)):
            raise InvalidInputError(
                f"{engine} has no time of an episode, so {name} = {getattr(params, name)} must be zeros"
            )
