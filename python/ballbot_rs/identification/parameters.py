"""The fitted numbers by name, their limits and typical sizes, and the robot that they describe."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import did_you_mean
from ballbot_rs._core import ACTUATOR_OPTIONS, PARAMETERS, Params
from ballbot_rs._errors import InvalidInputError
from ballbot_rs.identification.motors import LIMITS as MOTOR_LIMITS
from ballbot_rs.identification.motors import Motors

Array = npt.NDArray[np.float64]

#: Motor options that can be fitted.
MOTORS: Final = tuple(MOTOR_LIMITS)
#: Smallest fitted lag, in time steps of the model.
SHORTEST_LAG: Final = 0.5
#: Constant errors of the IMU, with their units and typical sizes.
BIASES: Final[Mapping[str, tuple[str, float]]] = {"gyro_bias": ("rad/s", 0.01), "acc_bias": ("m/s²", 0.1)}
#: Parameters of a load that an arm moves, of a second payload, and of a floor that moves or on which friction differs
#: from place to place.
NOT_IN_LOGS: Final = tuple(
    parameter["name"]
    for parameter in PARAMETERS
    if parameter["name"].startswith(
        (
            *("floor_friction_", "floor_patch_", "floor_tilt_", "floor_acceleration"),
            *("payload_amplitude", "payload_period", "payload_phases", "second_payload_"),
        )
    )
)
#: Parameters that a fit cannot find: the motor limit; the direction of a slope and the motion of a floor, since logs
#: have no heading; the motion of an arm, whose begin is not in logs; and the roller ripple, which is faster than the
#: steps of a log.
EXCLUDED: Final = ("max_wheel_torque", "floor_tilt", "roller_ripple", "roller_count", "roller_phases", *NOT_IN_LOGS)
#: Vectors of which only some components have an effect on a log: the ball carries what a payload does along z.
ALONG: Final[Mapping[str, Sequence[int]]] = {"payload_stiffness": (0, 1), "payload_damping": (0, 1)}
#: Components of vectors, as printed.
SUFFIXES: Final[Mapping[str, Sequence[str]]] = {
    "body_inertia": ("xx", "yy", "zz"),
    "body_products_of_inertia": ("xy", "xz", "yz"),
    "body_com_offset": ("x", "y"),
    "payload_position": ("x", "y", "z"),
    "payload_stiffness": ("x", "y", "z"),
    "payload_damping": ("x", "y", "z"),
    "gyro_bias": ("x", "y", "z"),
    "acc_bias": ("x", "y", "z"),
}
#: Numbers that may be negative.
SIGNED: Final = (
    "body_com_offset",
    "body_products_of_inertia",
    "wheel_azimuths",
    "wheel_zenith_offsets",
    "roller_angle",
    "payload_position",
    "gyro_bias",
    "acc_bias",
)


@dataclasses.dataclass(frozen=True)
class Robot:
    """Everything that a fit may change."""

    params: Params
    motors: Motors
    gyro_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    acc_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclasses.dataclass(frozen=True)
class Fitted:
    """The numbers that are fitted, in the order of the fields; vectors count as their components."""

    #: As given.
    fields: tuple[str, ...]
    #: As printed, for example `body_inertia_zz`.
    names: tuple[str, ...]
    #: Field and component of each number; the component of a scalar is None.
    places: tuple[tuple[str, int | None], ...]
    low: Array
    high: Array
    #: Typical sizes: the units of differences and condition numbers.
    scales: Array
    #: Start values of the fit.
    start: Array

    def robot(self, values: Array, base: Robot) -> Robot:
        """The robot with these values.

        Raises:
            ValueError: they are not valid parameters.
        """
        changes: dict[str, Any] = {}
        for (field, component), value in zip(self.places, values.tolist(), strict=True):
            if component is None:
                changes[field] = value
            else:
                changes.setdefault(field, list(_value(base, field)))[component] = value
        params = {name: value for name, value in changes.items() if name not in MOTORS and name not in BIASES}
        motors = {name: _frozen(changes[name]) for name in MOTORS if name in changes}
        biases = {name: tuple(changes[name]) for name in BIASES if name in changes}
        return Robot(
            base.params.replace(**params) if params else base.params,
            dataclasses.replace(base.motors, **motors),
            **{"gyro_bias": base.gyro_bias, "acc_bias": base.acc_bias, **biases},
        )

    @staticmethod
    def number(robot: Robot, place: tuple[str, int | None]) -> float:
        """The number of a robot at a field and component."""
        return _number(robot, place)

    def bias_of(self, index: int) -> tuple[str, int] | None:
        """The IMU bias and axis of a number; None for numbers that affect the motion."""
        field, component = self.places[index]
        return None if field not in BIASES or component is None else (field, component)


#: No number is fitted.
NOTHING: Final = Fitted((), (), (), *(np.zeros(0) for _ in range(4)))


def _frozen(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def known_fields() -> tuple[str, ...]:
    """Names that `fields` may have."""
    params = tuple(name for name in Params.paper().to_dict() if name not in EXCLUDED)
    return (*params, *MOTORS, *BIASES)


def fitted(fields: Sequence[str], base: Robot, sim_dt: float) -> Fitted:
    """The numbers of the fields named.

    Raises:
        ValueError: an unknown name, a repeated name, or no name; a payload of a robot that has none.
    """
    if isinstance(fields, str):
        fields = (fields,)
    known = known_fields()
    if not fields:
        raise InvalidInputError("fields is empty: name at least one parameter")
    places: list[tuple[str, int | None]] = []
    for field in fields:
        if field not in known:
            raise InvalidInputError(
                f"unknown field {field!r}: expected one of {', '.join(known)}{did_you_mean(str(field), known)}"
            )
        if any(field == other for other, _ in places):
            raise InvalidInputError(f"fields names {field} twice")
        if field.startswith("payload_") and not base.params.has_payload:
            raise InvalidInputError(
                f"fields has {field}, but the robot has no payload: start from "
                "robot.with_payload(mass, position=..., stiffness=..., damping=...)"
            )
        value = _value(base, field)
        if isinstance(value, float):
            places.append((field, None))
        else:
            places += [(field, i) for i in ALONG.get(field, range(len(value)))]
    start = np.array([_number(base, place) for place in places])
    scales = np.array([_scale(base, field, value) for (field, _), value in zip(places, start, strict=True)])
    limits = np.array([_limits(field) for field, _ in places])
    for index, (field, _) in enumerate(places):
        if field == "lag":
            # A lag far below a time step has no effect, and no derivative.
            limits[index, 0] = SHORTEST_LAG * sim_dt
            start[index] = max(start[index], sim_dt)
    names = tuple(_printed(place) for place in places)
    return Fitted(tuple(fields), names, tuple(places), limits[:, 0], limits[:, 1], scales, start)


#: Units of everything that can be fitted.
_UNITS: Final[Mapping[str, str]] = {
    **{row["name"]: row["unit"] for row in (*PARAMETERS, *ACTUATOR_OPTIONS)},
    **{name: unit for name, (unit, _) in BIASES.items()},
}


def unit_of(field: str) -> str:
    """Unit of a field."""
    return _UNITS[field]


def _value(base: Robot, field: str) -> Any:
    if field in BIASES:
        return getattr(base, field)
    return getattr(base.motors if field in MOTORS else base.params, field)


def _number(base: Robot, place: tuple[str, int | None]) -> float:
    field, component = place
    value = _value(base, field)
    return float(value if component is None else value[component])


def _printed(place: tuple[str, int | None]) -> str:
    field, component = place
    if component is None:
        return field
    return f"{field}_{SUFFIXES[field][component] if field in SUFFIXES else component}"


def _limits(field: str) -> tuple[float, float]:
    if field in MOTORS:
        return MOTOR_LIMITS[field]
    return (-np.inf, np.inf) if field in SIGNED else (0.0, np.inf)


def _scale(base: Robot, field: str, value: float) -> float:
    """Typical size: the size of the value, or where it may be zero, the size of a small effect on this robot."""
    params = base.params
    weight = params.gravity * (params.body_mass + params.ball_mass)
    dry = 0.02 * weight * params.wheel_radius
    least = {
        "delay": 0.01,
        "lag": 0.01,
        "strength": 1.0,
        "body_com_offset": 0.05 * params.body_com_height,
        "body_products_of_inertia": 0.1 * float(np.mean(params.body_inertia)),
        "wheel_coulomb_friction": dry,
        "wheel_viscous_friction": dry / 10.0,
        "ball_viscous_friction": 0.02 * weight,
        "floor_rolling_friction": 0.02 * params.ball_radius,
        "floor_spinning_friction": 0.02 * params.ball_radius,
        "roller_friction": 0.05,
        "roller_friction_slope": 0.05,
        "wheel_preload": 0.1 * params.body_mass * params.gravity,
        "payload_damping": 0.2 * float(np.sqrt(params.payload_mass * np.max(params.payload_stiffness))),
        "payload_position": 0.2 * params.body_com_height,
        "wheel_zenith_offsets": 0.05,
        "wheel_azimuths": 0.1,
        "roller_angle": 0.1,
        **{name: typical for name, (_, typical) in BIASES.items()},
    }
    if field == "wheel_azimuths":
        return least[field]
    return max(abs(value), least.get(field, 0.0)) or 1.0
