"""The setup of a session's robots: the options of the environments that simulate them.

A robot may change while it runs: factors and offsets on its nominal parameters, motors and sensors.
"""

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from ballbot_rs._checks import check_bounded, seed_at
from ballbot_rs._core import OBSERVATIONS, Batch, Params, Terrain, load_actuators
from ballbot_rs.envs._batch_env import has_fall_tilt, new_batch
from ballbot_rs.envs.registration import DEFAULT_TASK, description_of

#: The option `actuators` of an environment.
Motors = Mapping[str, Any] | str | None

#: The option `sensors` of an environment, in full; None where controllers take the true state.
Sensors = Mapping[str, Any] | None

#: Suffixes of the names of sensor errors.
ERRORS: Final = ("_noise", "_bias", "_walk")

#: Default sensors by the initial input of controllers: default sensors of environments, and published sensors.
DEFAULT_SENSORS = {"sensors": "exact", "ground_truth": "kugle"}

Events = Sequence[Mapping[str, Any]] | str | None

#: Parameters that two robots must have in common for a state to be valid for both.
SHAPE = (
    "ball_radius",
    "wheel_radius",
    "wheel_zenith",
    "wheel_azimuths",
    "wheel_zenith_offsets",
    "roller_angle",
    "body_com_height",
    "body_com_offset",
)

#: Options of an environment that a setup determines.
DECIDED = (
    "robot",
    "model",
    "control_dt",
    "sim_dt",
    "max_wheel_torque",
    "max_episode_steps",
    "fall_tilt",
    "actuators",
    "events",
    "sensors",
    "observation",
    "terrain",
)


@dataclasses.dataclass(frozen=True)
class Change:
    """A number that may be changed, in the unit of its label, and its range."""

    label: str
    low: float
    high: float
    step: float
    #: The neutral value.
    neutral: float
    hint: str


#: By name. Labels with × are factors; the others are offsets in mm and ms.
CHANGES: Final[Mapping[str, Change]] = {
    "wheel_friction": Change("Wheel friction (×)", 0.0, 2.0, 0.01, 1.0, "wheels on the ball, static and dynamic"),
    "floor_friction": Change("Floor friction (×)", 0.0, 2.0, 0.01, 1.0, "ball on the floor, static and dynamic"),
    "body_mass": Change("Body mass (×)", 0.1, 3.0, 0.01, 1.0, "and its inertia"),
    "com_height": Change("CoM height (×)", 0.5, 2.0, 0.01, 1.0, "of the center of mass above the ball's center"),
    "com_x": Change("CoM x (mm)", -100.0, 100.0, 0.5, 0.0, "offset of the center of mass from nominal"),
    "com_y": Change("CoM y (mm)", -100.0, 100.0, 0.5, 0.0, "offset of the center of mass from nominal"),
    "motor_strength": Change("Motor strength (×)", 0.0, 2.0, 0.01, 1.0, "fraction of the commanded torque"),
    "motor_delay": Change("Motor delay (ms)", 0.0, 100.0, 2.0, 0.0, "dead time: a whole number of model steps"),
    "motor_lag": Change("Motor lag (ms)", 0.0, 100.0, 1.0, 0.0, "time constant"),
    "sensor_noise": Change(
        "Sensor noise (×)", 0.0, 20.0, 0.1, 1.0, "noise, bias and its walk, of a controller that sees the estimate"
    ),
}


NEUTRAL: Final[Mapping[str, float]] = {name: change.neutral for name, change in CHANGES.items()}


def checked(values: Mapping[str, Any]) -> dict[str, float]:
    """The values as floats.

    Raises:
        ValueError: an unknown name, a value that is not a number, or a number out of range.
    """
    for name in values:
        if name not in CHANGES:
            raise ValueError(f"unknown change '{name}': expected one of {', '.join(CHANGES)}")
    return {name: check_bounded(name, value, CHANGES[name].low, CHANGES[name].high) for name, value in values.items()}


def changed_params(params: Params, values: Mapping[str, float]) -> Params:
    """A robot with changed parameters; proportional parameters scale together, as under events.

    Raises:
        ValueError: invalid parameters.
    """
    if all(values[name] == NEUTRAL[name] for name in NEUTRAL if not name.startswith(("motor_", "sensor_"))):
        return params
    wheels, floor, mass = (values[name] for name in ("wheel_friction", "floor_friction", "body_mass"))
    x, y = params.body_com_offset
    return params.replace(
        wheel_static_friction=wheels * params.wheel_static_friction,
        wheel_dynamic_friction=wheels * params.wheel_dynamic_friction,
        floor_static_friction=floor * params.floor_static_friction,
        floor_dynamic_friction=floor * params.floor_dynamic_friction,
        body_mass=mass * params.body_mass,
        body_inertia=[mass * moment for moment in params.body_inertia],
        body_products_of_inertia=[mass * product for product in params.body_products_of_inertia],
        body_com_height=values["com_height"] * params.body_com_height,
        body_com_offset=(x + 1e-3 * values["com_x"], y + 1e-3 * values["com_y"]),
    )


def changed_motors(motors: Motors, values: Mapping[str, float]) -> Motors:
    """The option `actuators` of an environment for changed motors.

    Raises:
        ValueError: as `load_actuators`.
    """
    if all(values[name] == NEUTRAL[name] for name in NEUTRAL if name.startswith("motor_")):
        return motors
    own: dict[str, Any] = dict(load_actuators(motors) if isinstance(motors, str) else motors or {})
    strength = np.broadcast_to(np.asarray(own.get("strength", 1.0), dtype=np.float64), (3,))
    return {
        **own,
        "strength": [values["motor_strength"] * share for share in strength.tolist()],
        "delay": own.get("delay", 0.0) + 1e-3 * values["motor_delay"],
        "lag": own.get("lag", 0.0) + 1e-3 * values["motor_lag"],
    }


def changed_sensors(sensors: Sensors, values: Mapping[str, float]) -> Sensors:
    """The sensors with changed errors."""
    if sensors is None:
        return None
    factor = values["sensor_noise"]
    return {name: factor * value if name.endswith(ERRORS) else value for name, value in sensors.items()}


def check_observation(observation: str) -> None:
    """Raises ValueError for a name that is not in `OBSERVATIONS`."""
    if observation not in OBSERVATIONS:
        raise ValueError(f"unknown observation '{observation}': expected one of {', '.join(OBSERVATIONS)}")


@dataclasses.dataclass(frozen=True)
class Setup:
    """A kind of robot, the model that simulates it, its changes and its events."""

    #: Name of the robot.
    name: str
    #: The robot without changes and events, for which controllers are made.
    nominal: Params
    model: str
    sim_dt: float
    #: Largest torque of a controller, N·m.
    max_torque: float
    #: As the options of an environment.
    motors: Motors = None
    events: Events = None
    #: Seed of robot 0; robot i has `seed + i`.
    seed: int = 0
    #: As in `setup.CHANGES`.
    changes: Mapping[str, float] = dataclasses.field(default_factory=lambda: NEUTRAL)
    #: Sensors whose readings give the estimated states for controllers; None: controllers take the true states.
    sensors: Sensors = None
    #: Model steps in a control step of the environment: from one sensor reading, or one action of a task other than
    #: balance, to the next.
    substeps: int = 1
    #: Name of the task.
    task: str = DEFAULT_TASK
    #: Its own options, and the observation of a policy; options that this setup determines are omitted.
    task_options: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    #: The ground; None is level.
    terrain: Terrain | None = None
    #: Parameters in place of `nominal` in the simulation; None: nominal.
    replaced: Params | None = None

    @functools.cached_property
    def params(self) -> Params:
        """The changed robot, the nominal robot of the events. Raises ValueError for invalid parameters."""
        return changed_params(self.replaced or self.nominal, self.changes)

    @property
    def changed_sensors(self) -> Sensors:
        """The sensors with changed errors."""
        return changed_sensors(self.sensors, self.changes)

    @property
    def options(self) -> dict[str, Any]:
        """Options of the environment of a robot: an episode ends only on the floor.

        The estimator is for the nominal robot, since a robot does not measure its changes.

        Raises:
            ValueError: invalid robot, motors or sensors.
        """
        estimates = self.sensors is not None
        decided = {
            "robot": self.nominal if estimates else self.params,
            "model": self.model,
            "control_dt": self.substeps * self.sim_dt,
            "sim_dt": self.sim_dt,
            "max_wheel_torque": self.max_torque,
            "max_episode_steps": None,
            "actuators": changed_motors(self.motors, self.changes),
            "events": self.events,
            "sensors": self.changed_sensors,
            "observation": "sensors" if estimates else "ground_truth",
            "terrain": self.terrain,
        }
        if has_fall_tilt(self.task):
            decided["fall_tilt"] = math.pi
        return {**self.task_options, **decided}

    def batch(self, index: int) -> Batch:
        """The environment of robot `index`.

        Raises:
            ValueError: invalid robot, motors, sensors or events.
        """
        seed = seed_at(self.seed, index)
        batch = new_batch(1, task=self.task, autoreset="disabled", num_threads=1, seed=seed, options=self.options)
        if self.sensors is not None and self.params != self.nominal:
            batch.set_params(0, self.params)
        return batch

    def differs_in_numbers_alone(self, other: "Setup") -> bool:
        """Whether `set_params` can change a moving robot to the other setup."""
        motors = [changed_motors(setup.motors, setup.changes) for setup in (self, other)]
        return (
            dataclasses.replace(self, changes=other.changes, seed=other.seed, replaced=other.replaced) == other
            and motors[0] == motors[1]
            and self.changed_sensors == other.changed_sensors
            and all(getattr(self.params, name) == getattr(other.params, name) for name in SHAPE)
        )


class Grounds:
    """Makes the ground, and keeps the last: large terrains take a second."""

    def __init__(self) -> None:
        self._key: Any = None
        self._made: Terrain | None = None

    def of(self, task: str, params: Params, given: Any) -> Terrain | None:
        """The ground of a robot in a task; None is level.

        Args:
            task: its name; some tasks have their own ground, which depends on the robot.
            params: the robot.
            given: the option `terrain` of an environment; None is the task's own.

        Raises:
            ValueError: invalid ground, or the robot cannot be on it.
        """
        if given is None and not description_of(task)["has_terrain"]:
            return None
        key = (task, params, given)
        if self._key is None or any(a is not b and a != b for a, b in zip(key, self._key, strict=True)):
            options = {"robot": params, "terrain": given}
            self._made = new_batch(1, task=task, num_threads=1, options=options).terrain
            self._key = key
        return self._made
