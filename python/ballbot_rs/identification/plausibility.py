"""Units, signs and order of columns, checked against the motion that the torques cause.

Between two rows a torque changes the rates of body and wheels by fixed amounts, which follow from the robot; gravity
and friction act slowly. So fast changes of the gyroscope and of the wheels' speeds are linear functions of the impulse
of the torques. A unit, a sign or an order of columns changes these functions in ways that no robot does.
"""

import dataclasses
from typing import Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Ballbot, Params, State
from ballbot_rs._errors import InvalidInputError
from ballbot_rs.identification.clocks import fast, mean_rates, near, unexplained
from ballbot_rs.identification.log import COLUMNS, SensorLog
from ballbot_rs.identification.motors import MAX_DELAY

Array = npt.NDArray[np.float64]

#: Torques and duration of the steps from which the responses of a robot follow, N·m and s.
_TORQUE: Final = 1e-3
_STEPS: Final = 5
_SIM_DT: Final = 1e-3
#: Least fraction of a quantity's fast changes that the torques must explain for a judgment.
LEAST_EXPLAINED: Final = 0.6
#: Largest part of a column that belongs to other columns, relative to its own.
MAX_MIXING: Final = 0.5
#: Factors that a robot with other parameters may have; beyond them a unit is wrong.
USUAL: Final = (0.25, 4.0)
#: Factors of usual mistakes, their relative tolerance, and what to write in a column map.
TOLERANCE: Final = 1.6
KNOWN: Final = {
    "gyro": ((180.0 / np.pi, "deg/s", 'gyro = "deg/s"'),),
    "wheel_angles": ((180.0 / np.pi, "deg", 'wheel_angles = "deg"'), (0.5 / np.pi, "turns", 'wheel_angles = "turn"')),
    "torques": ((1e3, "mN·m", 'torques = "mNm"'),),
}
SI: Final = {"gyro": "rad/s", "wheel_angles": "rad", "torques": "N·m"}
NAMES: Final = {"gyro": "the gyroscope", "wheel_angles": "the encoders", "torques": "the torques"}


@dataclasses.dataclass(frozen=True)
class Order:
    """A matrix with one large number in each row and column."""

    #: Column of the large number of each row, shape (3,).
    places: npt.NDArray[np.int64]
    #: These numbers, shape (3,).
    factors: Array

    @classmethod
    def of(cls, matrix: Array) -> "Order | None":
        """The order of a matrix; None if its rows mix columns."""
        places = np.argmax(np.abs(matrix), axis=1)
        factors = matrix[np.arange(3), places]
        if len(set(places.tolist())) < 3:
            return None
        rest = np.sqrt(np.maximum((matrix**2).sum(axis=1) - factors**2, 0.0))
        return cls(places, factors) if (rest <= MAX_MIXING * np.abs(factors)).all() else None

    @property
    def in_place(self) -> bool:
        """Whether every column is where it belongs."""
        return bool((self.places == np.arange(3)).all())

    @property
    def as_expected(self) -> bool:
        """Whether order, signs and sizes are as expected; a unit scales all columns alike."""
        low, high = USUAL
        return self.in_place and bool(
            self.factors.min() > 0.0 and self.factors.min() < high and self.factors.max() > low
        )


def check_log(log: SensorLog, params: Params) -> None:
    """Checks units, signs and order of torques, encoders and gyroscope, and the axis of gravity.

    Raises:
        ValueError: columns that contradict each other by a unit, a sign or an order; the message names the columns,
            the evidence and the remedy. A log with too little motion for a judgment passes.
    """
    _check_gravity(log)
    responses = responses_of(params)
    signals = _signals(log)
    if signals is None:
        return
    impulses, rates, speeds = signals
    fraction = 1.0 - float(unexplained(impulses, np.concatenate([rates, speeds], axis=1)).mean())
    own, of_torques = {}, {}
    for name, measured, response in (("gyro", rates, responses[0]), ("wheel_angles", speeds, responses[1])):
        slope = np.linalg.lstsq(impulses, measured, rcond=1e-9)[0].T
        inverse = np.linalg.inv(response)
        # What exchanges and scales the columns of the sensor, or the torques, to give this function.
        own[name], of_torques[name] = Order.of(slope @ inverse), Order.of(inverse @ slope)
    bad = [name for name in own if not _as_expected(own[name], of_torques[name])]
    if not bad:
        return
    shared = _shared(of_torques["gyro"], of_torques["wheel_angles"])
    if len(bad) == 2 and shared is not None:
        raise InvalidInputError(_complaint("torques", shared, fraction))
    for name in bad:
        order = own[name]
        if order is not None and not order.as_expected:
            raise InvalidInputError(_complaint(name, order, fraction))


def _as_expected(*orders: Order | None) -> bool:
    return any(order is not None and order.as_expected for order in orders)


def _shared(first: Order | None, second: Order | None) -> Order | None:
    """The order of the torques that both sensors show; None if they differ."""
    if first is None or second is None or (first.places != second.places).any():
        return None
    ratios = first.factors / second.factors
    if ratios.min() < USUAL[0] or ratios.max() > USUAL[1]:
        return None
    factors = np.sign(first.factors) * np.sqrt(first.factors * second.factors)
    places = np.argsort(first.places)
    return Order(places, 1.0 / factors[places])


def responses_of(params: Params) -> tuple[Array, Array]:
    """Changes of the body's rates and of the wheels' speeds per impulse of each wheel, upright, without friction.

    Returns:
        Two matrices of shape (3, 3), rad/s per N·m·s; a column per wheel.
    """
    resistances = ("ball_viscous", "wheel_viscous", "wheel_coulomb", "floor_rolling", "floor_spinning", "roller")
    smooth = params.replace(**{f"{name}_friction": 0.0 for name in resistances})
    robot = Ballbot(smooth, "spatial", _SIM_DT)
    torque = min(_TORQUE, params.max_wheel_torque)
    found = []
    for wheel in range(3):
        ends = []
        for sign in (1.0, -1.0):
            robot.reset(State.at_equilibrium(smooth))
            robot.step(sign * torque * np.eye(3)[wheel], _STEPS)
            ends.append(np.concatenate([robot.state.body_angular_velocity, robot.state.wheel_speeds]))
        found.append((ends[0] - ends[1]) / (2.0 * torque * _STEPS * _SIM_DT))
    both = np.stack(found, axis=-1)
    return both[:3], both[3:]


def _signals(log: SensorLog) -> tuple[Array, Array, Array] | None:
    """Fast changes of impulses, body rates and wheel speeds, each (n, 3); None if the torques explain too little.

    Motors may answer late: the torques are delayed by the time after which they explain most.
    """
    step = log.step
    begin, end = log.time[0] + 2.0 * step + MAX_DELAY, log.time[-1] - 2.0 * step
    times = begin + step * np.arange(max(int((end - begin) / step), 0))
    kept = near(log.time, times, step) & near(log.time, times - step, step) & near(log.time, times + step, step)
    if kept.sum() < 100:
        return None
    impulse = _cumulated(log.time, log.torques)
    middle = 0.5 * (log.gyro[1:] + log.gyro[:-1])
    rates = fast(mean_rates(log.time, _cumulated(log.time, middle, last=False), times, step), step)[kept]
    speeds = fast(mean_rates(log.time, log.wheel_angles, times, step), step)[kept]
    best: tuple[float, Array] = (0.0, np.zeros((0, 3)))
    effects = np.concatenate([rates, speeds], axis=1)
    for delay in np.arange(0.0, MAX_DELAY, step):
        # The mean of an integral over two steps.
        causes = fast(_smoothed(log.time, impulse, times - delay, step), step)[kept]
        fraction = 1.0 - float(unexplained(causes, effects).mean())
        if fraction > best[0]:
            best = fraction, causes
    return (best[1], rates, speeds) if best[0] >= LEAST_EXPLAINED else None


def _cumulated(time: Array, rates: Array, last: bool = True) -> Array:
    rows = rates[:-1] if last else rates
    return np.concatenate([np.zeros((1, 3)), np.cumsum(rows * np.diff(time)[:, None], axis=0)])


def _smoothed(time: Array, values: Array, places: Array, step: float) -> Array:
    """Means over two steps around each place."""
    integral = _cumulated(time, 0.5 * (values[1:] + values[:-1]), last=False)
    return mean_rates(time, integral, places, step)


def _complaint(name: str, order: Order, fraction: float) -> str:
    titles = COLUMNS[name]
    evidence = f"the torques explain {100 * fraction:.0f} % of the fast changes of gyroscope and encoders"
    if name == "torques":
        evidence = f"gyroscope and encoders agree with each other, and {evidence}"
    size = float(np.exp(np.mean(np.log(np.abs(order.factors)))))
    if not order.in_place:
        listed = ", ".join(f'"{titles[place]}"' for place in np.argsort(order.places))
        found = ", ".join(f"{titles[i]} is {titles[place]}" for i, place in enumerate(order.places) if i != place)
        return f"the order of {NAMES[name]} looks wrong: {found} ({evidence}); in a column map {name} = [{listed}]"
    if (order.factors < 0.0).any():
        signs = np.where(order.factors < 0.0, -1, 1).tolist()
        found = ", ".join(title for title, sign in zip(titles, signs, strict=True) if sign < 0)
        return f"the sign of {found} looks wrong ({evidence}); in a column map, [scale] {name} = {signs}"
    for factor, unit, text in KNOWN[name]:
        if 1.0 / TOLERANCE < size / factor < TOLERANCE:
            return (
                f"{name} looks like {unit}, not {SI[name]}: {', '.join(titles)} show {size:.3g} times the expected "
                f"changes ({evidence}); in a column map, [units] {text}"
            )
    ticks = f", as encoders with {2.0 * np.pi * size:.3g} ticks per turn" if name == "wheel_angles" and size > 1 else ""
    return (
        f"the unit of {NAMES[name]} looks wrong: {', '.join(titles)} show {size:.3g} times the expected changes{ticks} "
        f"({evidence}); give {SI[name]}, or the robot's own parameters"
    )


def _check_gravity(log: SensorLog) -> None:
    if log.accelerations is None:
        return
    mean = log.accelerations.mean(axis=0)
    axis = int(np.argmax(np.abs(mean)))
    if axis != 2 or mean[axis] < 0.0:
        title, sign = COLUMNS["accelerations"][axis], "" if mean[axis] > 0.0 else "minus "
        listed = ", ".join(f"{value:.3g}" for value in mean.tolist())
        raise InvalidInputError(
            f"the axes of the accelerometer look wrong: the mean of {', '.join(COLUMNS['accelerations'])} is "
            f"({listed}) m/s², but at rest upright it is (0, 0, 9.81) m/s²: z looks like {sign}{title}"
        )
