"""Simulated logs: a balancing robot under torques and setpoints that excite all its motions."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import check_seed, real_array
from ballbot_rs._core import Batch, Lqr, Params, State
from ballbot_rs._errors import DivergedError, InvalidInputError
from ballbot_rs._keywords import named
from ballbot_rs._progress import Progress, no_progress
from ballbot_rs._robot import Robot, params_of
from ballbot_rs._state_rows import BALL_POSITION, BODY_QUATERNION, body_axes_of
from ballbot_rs.identification.logs.log import SensorLog

Array = npt.NDArray[np.float64]

#: Standard deviations of usual sensors: encoders with 2000 ticks per turn, and MEMS IMUs at 100 Hz.
NOISE: Final[Mapping[str, float]] = {"wheel_angle": 1e-3, "gyro": 5e-3, "acceleration": 0.05}
#: Longest log, s.
MAX_SECONDS: Final = 3600.0
#: Frequencies of the multisine, Hz, and the peak of its sum as a fraction of the torque at which wheels slip.
FREQUENCIES: Final = (0.3, 0.7, 1.1, 1.7, 2.3, 3.1, 4.3, 5.9, 7.9)
MULTISINE: Final = 0.3
#: Setpoints: period of their steps, s, each uniform within ± m and ± rad.
STEP_EVERY: Final = 2.0
POSITION: Final = 0.15
YAW: Final = 0.8


@named
def record_log(
    robot: Robot | None = None,
    seconds: float = 20.0,
    *,
    actuators: Mapping[str, Any] | str | None = None,
    controller_robot: Robot | None = None,
    model: str = "contact",
    sim_dt: float = 0.002,
    control_dt: float = 0.01,
    imu_position: Sequence[float] = (0.0, 0.0, 0.0),
    noise: Mapping[str, float] | None = NOISE,
    excitation: float = 1.0,
    pose: bool = False,
    seed: int = 0,
    progress: Progress = no_progress,
) -> SensorLog:
    """A log of a simulated robot, balanced by LQR and excited by a torque multisine and setpoint steps.

    ```python
    log = bb.record_log("kugle", seconds=4.0, actuators={"delay": 0.01})
    log.write("log.csv")
    ```

    The multisine has nine frequencies from 0.3 to 7.9 Hz, of equal amplitude, with separate phases for each wheel.
    Position and yaw step to new setpoints every 2 s. Commands are limited to 0.9 times the torque at which a wheel of
    the upright robot slips.

    Args:
        robot: as in `simulate`; None is the paper's.
        seconds: duration, s.
        actuators: its motors, as `actuators=` of an environment.
        controller_robot: the robot that LQR is designed for; None is `robot`.
        model: of the simulation.
        sim_dt: time step of the model, s.
        control_dt: time between two rows, s.
        imu_position: position of the accelerometer in the body frame, m.
        noise: standard deviations of white noise: `wheel_angle` (rad), `gyro` (rad/s), `acceleration` (m/s²); None or a
            missing key means no noise.
        excitation: scale factor of multisine and steps.
        pose: whether the log also has attitude and position, exact, as if from motion capture.
        seed: of phases, setpoints and noise.
        progress: called with the number of rows done and their total.

    Raises:
        ValueError: a number out of range, or an unknown name.
        DivergedError: the robot falls; the message has the time.
    """
    if not 0.0 < seconds <= MAX_SECONDS:
        raise InvalidInputError(f"seconds = {seconds} is out of range: it must be above 0 and at most {MAX_SECONDS:g}")
    if not 0.0 <= excitation <= 10.0:
        raise InvalidInputError(f"excitation = {excitation} is out of range: it must be from 0 to 10")
    spread = _spread(noise)
    place = real_array("imu_position is", imu_position, "three finite numbers").astype(np.float64)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise InvalidInputError(f"imu_position is {imu_position}, expected three finite numbers")
    rng = np.random.default_rng(check_seed(seed))
    if not control_dt > 0.0:
        raise InvalidInputError(f"control_dt = {control_dt} is out of range: it must be above 0")
    rows = max(round(seconds / control_dt), 1) + 1
    options: dict[str, Any] = {
        "robot": params_of(robot),
        "model": model,
        "sim_dt": sim_dt,
        "control_dt": control_dt,
    }
    more: dict[str, Any] = {"actuators": actuators, "max_episode_steps": rows + 1, "fall_tilt": np.pi / 2}
    batch = Batch(1, autoreset="disabled", num_threads=1, **more, **options)
    params, limit = batch.nominal_params(0), batch.max_wheel_torque
    lqr = Lqr(params if controller_robot is None else params_of(controller_robot), control_dt, max_torque=limit)
    times: Array = np.asarray(control_dt * np.arange(rows), dtype=np.float64)
    sines = excitation * MULTISINE * limit * _multisine(times, rng)
    count = int(max(seconds, times[-1]) / STEP_EVERY) + 1
    steps = rng.uniform(-1.0, 1.0, (count, 3)) * [POSITION, POSITION, YAW] * excitation
    states, torques = np.empty((rows, 32)), np.empty((rows, 3))

    batch.reset(starts=[State.at_equilibrium(params)])
    for row in range(rows):
        state = batch.state(0)
        states[row] = state.to_array()
        setpoint = steps[int(times[row] / STEP_EVERY)]
        desired = lqr(state, position=setpoint[:2], yaw=float(setpoint[2])) + sines[row]
        action = np.clip(desired / limit, -1.0, 1.0).astype(np.float32)
        torques[row] = action.astype(np.float64) * limit
        _, _, terminated, _ = batch.step(action[None])
        if terminated[0]:
            raise DivergedError(f"the robot falls at {times[row]:g} s: lower the excitation of {excitation:g}")
        progress(row + 1, rows)
    log = _measured(times, torques, states, params, place, spread, rng)
    if not pose:
        return log
    return dataclasses.replace(log, attitude=states[:, BODY_QUATERNION], position=states[:, BALL_POSITION])


def _spread(noise: Mapping[str, float] | None) -> dict[str, float]:
    spread = dict.fromkeys(NOISE, 0.0)
    for name, value in (noise or {}).items():
        if name not in spread:
            raise InvalidInputError(f"unknown sensor {name!r} in noise: expected {', '.join(NOISE)}")
        if not (np.isfinite(value) and value >= 0.0):
            raise InvalidInputError(f"noise of {name} is {value}, it must be finite and at least 0")
        spread[name] = float(value)
    return spread


def _multisine(times: Array, rng: np.random.Generator) -> Array:
    """Sums of sines with random phases for three wheels, with peak 1, shape (n, 3)."""
    phases = rng.uniform(0.0, 2.0 * np.pi, (3, len(FREQUENCIES)))
    angles = 2.0 * np.pi * times[:, None, None] * np.array(FREQUENCIES) + phases
    sines = np.sin(angles).sum(axis=-1)
    scaled: Array = sines / np.abs(sines).max(axis=0).clip(min=1e-12)
    return scaled


def _measured(
    times: Array,
    torques: Array,
    states: Array,
    robot: Params,
    place: Array,
    spread: Mapping[str, float],
    rng: np.random.Generator,
) -> SensorLog:
    axes = body_axes_of(states)
    velocity = states[:, 20:23] + np.einsum("nij,nj->ni", axes, np.cross(states[:, 23:26], place))
    change = np.zeros_like(velocity)
    change[1:] = np.diff(velocity, axis=0) / np.diff(times)[:, None]
    change -= robot.gravity_vector
    # As from an integrating IMU: in the attitude halfway through the interval.
    halfway = states.copy()
    halfway[1:, 16:20] += states[:-1, 16:20]
    halfway[:, 16:20] /= np.linalg.norm(halfway[:, 16:20], axis=1, keepdims=True)
    force = np.einsum("nji,nj->ni", body_axes_of(halfway), change)
    exact = {"wheel_angle": states[:, 26:29], "gyro": states[:, 23:26], "acceleration": force}
    read = {name: values + spread[name] * rng.standard_normal(values.shape) for name, values in exact.items()}
    return SensorLog(times, torques, read["wheel_angle"], read["gyro"], read["acceleration"])
