"""Changes of a robot while it runs: factors and offsets on its nominal parameters, motors and sensors."""

import dataclasses
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from ballbot_rs._core import Params, load_actuators
from ballbot_rs.viewer.bounds import check_bounded

#: The option `actuators` of an environment.
Motors = Mapping[str, Any] | str | None

#: The option `sensors` of an environment, in full; None where controllers take the true state.
Sensors = Mapping[str, Any] | None

#: Suffixes of the names of sensor errors.
ERRORS: Final = ("_noise", "_bias", "_walk")


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
    "com_x": Change("CoM x (mm)", -100.0, 100.0, 0.5, 0.0, "of the center of mass, off its own place"),
    "com_y": Change("CoM y (mm)", -100.0, 100.0, 0.5, 0.0, "of the center of mass, off its own place"),
    "motor_strength": Change("Motor strength (×)", 0.0, 2.0, 0.01, 1.0, "share of the commanded torque"),
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
