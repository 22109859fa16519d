"""Units, signs and order of columns, checked against the motion that the torques cause.

Between two rows a torque changes the rates of body and wheels by fixed amounts, which follow from the robot; gravity
and friction act slowly. So fast changes of the gyroscope and of the wheels' speeds are linear functions of the impulse
of the torques. A unit, a sign or an order of columns changes these functions in ways that no robot does.
"""

from typing import Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Ballbot, Params, State
from ballbot_rs._errors import InvalidInputError
from ballbot_rs.identification.logs.clocks import fast, near, unexplained
from ballbot_rs.identification.logs.column_map import ColumnMap
from ballbot_rs.identification.logs.complaints import USUAL, Order, complaint
from ballbot_rs.identification.logs.log import COLUMNS, SensorLog
from ballbot_rs.identification.motors import MAX_DELAY

Array = npt.NDArray[np.float64]

#: Torques and duration of the motions from which the responses of a robot follow, N·m and s, and their time step, s.
_TORQUE: Final = 1e-3
_SECONDS: Final = 5e-3
_SIM_DT: Final = 1e-3
#: Least fraction of a quantity's fast changes that the torques must explain for a judgment.
LEAST_EXPLAINED: Final = 0.6
#: The map of a log that was read without one.
PLAIN: Final = {name: list(titles) for name, titles in COLUMNS.items() if name != "time"}


def check_log(log: SensorLog, params: Params, sim_dt: float = _SIM_DT) -> None:
    """Checks units, signs and order of torques, encoders and gyroscope, and the axis of gravity.

    Args:
        log: the log.
        params: the robot.
        sim_dt: time step of a robot with a payload, s, as short as its springs need.

    Raises:
        ValueError: columns that contradict each other by a unit, a sign or an order; the message names the columns,
            the evidence and the remedy. A log with too little motion to decide passes.
    """
    _check_gravity(log)
    responses = responses_of(params, min(_SIM_DT, sim_dt) if params.has_payload else _SIM_DT)
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
        own[name], of_torques[name] = Order.of(slope @ inverse), Order.of((inverse @ slope).T)
    bad = [name for name in own if not _as_expected(own[name], of_torques[name])]
    if not bad:
        return
    columns = ColumnMap.of({"columns": PLAIN}) if log.report is None else log.report.columns
    shared = _shared(of_torques["gyro"], of_torques["wheel_angles"])
    if len(bad) == 2 and shared is not None:
        raise InvalidInputError(complaint("torques", shared, columns, fraction))
    for name in bad:
        order = own[name]
        if order is not None and not order.as_expected:
            raise InvalidInputError(complaint(name, order, columns, fraction))


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
    return Order(first.places, 1.0 / factors)


def responses_of(params: Params, sim_dt: float = _SIM_DT) -> tuple[Array, Array]:
    """Changes of the body's rates and of the wheels' speeds per impulse of each wheel, upright, without friction.

    Returns:
        Two matrices of shape (3, 3), rad/s per N·m·s; a column per wheel.
    """
    resistances = ("ball_viscous", "wheel_viscous", "wheel_coulomb", "floor_rolling", "floor_spinning", "roller")
    smooth = params.replace(**{f"{name}_friction": 0.0 for name in resistances})
    robot = Ballbot(smooth, "spatial", sim_dt)
    steps = round(_SECONDS / sim_dt)
    torque = min(_TORQUE, params.max_wheel_torque)
    found = []
    for wheel in range(3):
        ends = []
        for sign in (1.0, -1.0):
            robot.reset(State.at_equilibrium(smooth))
            robot.step(sign * torque * np.eye(3)[wheel], steps)
            ends.append(np.concatenate([robot.state.body_angular_velocity, robot.state.wheel_speeds]))
        found.append((ends[0] - ends[1]) / (2.0 * torque * steps * sim_dt))
    both = np.stack(found, axis=-1)
    return both[:3], both[3:]


def _signals(log: SensorLog) -> tuple[Array, Array, Array] | None:
    """Fast changes of impulses, body rates and wheel speeds, each (n, 3); None if the torques explain too little.

    What friction of the wheels could cause is removed from all: it may exceed the torques. Motors may answer late: the
    torques are delayed by the time after which they explain most.
    """
    step = log.step
    begin, end = log.time[0] + 2.0 * step + MAX_DELAY, log.time[-1] - 2.0 * step
    times = begin + step * np.arange(max(int((end - begin) / step), 0))
    kept = near(log.time, times, step) & near(log.time, times - step, step) & near(log.time, times + step, step)
    if kept.sum() < 100:
        return None
    friction = _friction(log, times, step)[kept]

    def without_friction(changes: Array) -> Array:
        moved = changes[kept]
        return np.asarray(moved - friction @ np.linalg.lstsq(friction, moved, rcond=1e-9)[0])

    impulse = _cumulated(log.time, log.torques)
    middle = 0.5 * (log.gyro[1:] + log.gyro[:-1])
    rates = without_friction(fast(_mean_rates(log.time, _cumulated(log.time, middle, last=False), times, step), step))
    speeds = without_friction(fast(_mean_rates(log.time, log.wheel_angles, times, step), step))
    best: tuple[float, Array] = (0.0, np.zeros((0, 3)))
    effects = np.concatenate([rates, speeds], axis=1)
    for delay in np.arange(0.0, MAX_DELAY, step):
        # The mean of an integral over two steps.
        causes = without_friction(fast(_smoothed(log.time, impulse, times - delay, step), step))
        fraction = 1.0 - float(unexplained(causes, effects).mean())
        if fraction > best[0]:
            best = fraction, causes
    return (best[1], rates, speeds) if best[0] >= LEAST_EXPLAINED else None


def _friction(log: SensorLog, times: Array, step: float) -> Array:
    """Fast changes of the impulses of dry and viscous friction of the wheels, up to factors, shape (n, 6).

    Signs and sizes of the encoders' columns change only these factors.
    """
    dry = _cumulated(log.time, np.sign(np.diff(log.wheel_angles, axis=0)), last=False)
    impulses = (_smoothed(log.time, one, times, step) for one in (dry, log.wheel_angles))
    return np.concatenate([fast(one, step) for one in impulses], axis=1)


def _cumulated(time: Array, rates: Array, last: bool = True) -> Array:
    rows = rates[:-1] if last else rates
    return np.concatenate([np.zeros((1, 3)), np.cumsum(rows * np.diff(time)[:, None], axis=0)])


def _mean_rates(time: Array, integral: Array, places: Array, step: float) -> Array:
    """Mean rates over two steps around each place, shape (n, 3)."""
    ends = [np.stack([np.interp(places + side, time, one) for one in integral.T], axis=-1) for side in (step, -step)]
    return np.asarray((ends[0] - ends[1]) / (2.0 * step))


def _smoothed(time: Array, values: Array, places: Array, step: float) -> Array:
    """Means over two steps around each place."""
    integral = _cumulated(time, 0.5 * (values[1:] + values[:-1]), last=False)
    return _mean_rates(time, integral, places, step)


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
