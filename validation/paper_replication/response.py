"""Eqs. (1)-(6) under the paper's PID in continuous time, integrated here rather than by the simulator."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

import ballbot_rs as bb
from ballbot_rs.analysis.settling import settling_times
from validation.mechanics import Array

#: Section III-A.
PROPORTIONAL, INTEGRAL, DERIVATIVE, FILTER = 20.39, 56.57, 1.34, 327.0
VISCOUS_FRICTION = 49.849

#: Gives (position, tilt, their rates)' from (position, tilt, their rates) and a virtual torque.
Plant = Callable[[Array, float], Array]


class Analysis(NamedTuple):
    """Analysis of a step response: overshoot relative to the step, and 2 % settling time, s."""

    overshoot: float
    settling: float


def model_plant(friction: float, inertia: str = "as_printed") -> Plant:
    """The simulator's `PlanarModel`."""
    model = bb.PlanarModel(bb.Params.paper().replace(ball_viscous_friction=friction), inertia)
    return lambda x, torque: np.concatenate([x[2:], model.accelerations(x[:2], x[2:], torque)])


def written_out(friction: float) -> Plant:
    """Eqs. (1)-(6) in the paper's own symbols, with the numbers of Table II."""
    m_k, j_k, r_k, m_b, j_b, l = 1.437, 0.0112, 0.112, 2.228, 0.0583, 0.142  # noqa: E741
    j_w, r_w, g = 0.000149, 0.05, 9.81

    def rate(x: Array, torque: float) -> Array:
        _, theta, speed, theta_rate = x
        m11 = j_k / r_k**2 + j_w / r_w**2 + m_k + m_b
        m12 = m_b * l * np.cos(theta) - j_w * r_k / r_w**2
        m22 = j_b + m_b * l**2 + j_w * r_k**2 / r_w**2
        first = torque / r_w + m_b * l * np.sin(theta) * theta_rate**2 - friction * speed
        second = -torque * r_k / r_w + m_b * g * l * np.sin(theta)
        determinant = m11 * m22 - m12**2
        return np.array(
            [speed, theta_rate, (m22 * first - m12 * second) / determinant, (m11 * second - m12 * first) / determinant]
        )

    return rate


def linear_plant(friction: float) -> Plant:
    """`PlanarModel` linearized about rest upright."""
    a, b = bb.PlanarModel(bb.Params.paper().replace(ball_viscous_friction=friction)).linearize()
    return lambda x, torque: a @ x + b[:, 0] * torque


def closed_loop(plant: Plant, reference: float, start: Array, seconds: float, dt: float = 1e-4) -> Array:
    """Rows (position, tilt, their rates, integral, filter) every `dt`; `start` is the first row. By RK4."""

    def rate(y: Array) -> Array:
        return np.concatenate([plant(y[:4], -torque_of(y, reference)), _pid_rates(y, reference)])

    rows = [start]
    for _ in range(round(seconds / dt)):
        y = rows[-1]
        a = rate(y)
        b = rate(y + 0.5 * dt * a)
        c = rate(y + 0.5 * dt * b)
        d = rate(y + dt * c)
        rows.append(y + dt / 6.0 * (a + 2.0 * b + 2.0 * c + d))
    return np.array(rows)


def torque_of(y: Array, reference: float) -> float:
    """Torque of the PID; eq. (1) takes the opposite sign, since a positive torque tilts the mast away."""
    error = reference - y[1]
    return float(PROPORTIONAL * error + INTEGRAL * y[4] + DERIVATIVE * FILTER * (error - y[5]))


def _pid_rates(y: Array, reference: float) -> Array:
    error = reference - y[1]
    return np.array([error, FILTER * (error - y[5])])


def linear_tilt(friction: float, times: Array) -> Array:
    """Tilt after a unit step by the modes of the linear closed loop: a closed form, without integration."""
    zero = np.zeros(6)
    plant = linear_plant(friction)

    def rate(y: Array, reference: float) -> Array:
        return np.concatenate([plant(y[:4], -torque_of(y, reference)), _pid_rates(y, reference)])

    matrix = np.array([rate(unit, 0.0) for unit in np.eye(6)]).T
    drive = rate(zero, 1.0)
    # Position has no effect and would make the matrix singular.
    matrix, drive = matrix[1:, 1:], drive[1:]
    rest = -np.linalg.solve(matrix, drive)
    values, vectors = np.linalg.eig(matrix)
    weights = np.linalg.solve(vectors, -rest.astype(complex))
    tilt: Array = rest[0] + (vectors[0] * weights * np.exp(np.outer(times, values))).sum(axis=1).real
    return tilt


def analyze(tilts: Array, dt: float) -> Analysis:
    """Analyzes tilts every `dt` after a step of 1 rad."""
    return Analysis(float(tilts.max() - 1.0), float(settling_times(tilts - 1.0, 0.02, dt)))


def sampled_step(control_dt: float, seconds: float = 1.0, friction: float = VISCOUS_FRICTION) -> Array:
    """Rows (position, tilt, their rates) after a step of 1 rad: `Ballbot(model="planar")`, `Pid`, no torque limit."""
    limit = 1e5
    params = bb.Params.paper().replace(ball_viscous_friction=friction, max_wheel_torque=limit)
    robot = bb.Ballbot(params, model="planar", sim_dt=min(control_dt, 1e-3))
    pid = bb.Pid(params, control_dt, max_torque=limit)
    # Its derivative starts at the first error: without a sample before the step it would have no kick.
    pid(robot.state)
    rows = []
    for _ in range(round(seconds / control_dt)):
        state = robot.state
        rows.append(along_y(state))
        # A tilt about +x leans towards −y.
        robot.step(pid(state, tilt=(-1.0, 0.0)), steps=round(control_dt / robot.sim_dt))
    return np.array(rows)


def along_y(state: bb.State) -> Array:
    """(y, θ_x, their rates) of the paper's yz-plane."""
    rate = -state.body_angular_velocity[0]
    return np.array([state.ball_position[1], -state.tilt_components[0], state.ball_velocity[1], rate])
