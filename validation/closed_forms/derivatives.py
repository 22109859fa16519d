r"""Derivatives of a step.

`Ballbot.jacobian` against central differences of the step itself, of fourth order, of a robot that leans, turns and
slips: with a large step $h$ the difference is wrong by $h^4$, with a small one by rounding, $\epsilon/h$, and between
them it agrees to the digits that a difference has. In coordinates of rolling the derivative of the robot at rest is
the linear model, whose unstable pole is $\lambda$ of the fall above, and its response to torques, with the error of
the time step. The products of 200 motions with vectors, forward and reverse, give one number.
"""

from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.engines.rotations import product
from validation.mechanics import Array, unstable_pole
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_STEPS = np.logspace(-9, -1, 49)
_SPAN = 0.01
_TORQUES = np.array([0.6, -0.1, 0.2])


def run() -> Findings:
    """Compares with differences, with the linear model, and forward with reverse."""
    errors = errors_of_differences()
    params = bb.Params.paper()
    pole = unstable_pole(params)
    a, _ = rolling(params, 1e-4)
    found = float(np.log(np.abs(np.linalg.eigvals(a)).max()) / _SPAN)
    coarse, fine = (torque_error(params, rolling(params, dt)[1]) for dt in (1e-3, 1e-4))
    forward, reverse = products(params)
    claims = [
        Claim(
            "smallest error of differences, relative to the largest derivative of a velocity by a position",
            float(errors.min()),
            0.0,
            1e-9,
            absolute=True,
        ),
        Claim("order of their error", order(errors), 4.0, 0.02),
        Claim("unstable pole of the robot at rest", found, pole, 1e-6, "1/s"),
        Claim("error of the response to torques, time steps 1 ms and 0.1 ms, ratio", coarse / fine, 10.0, 0.01),
        Claim("forward and reverse product of 200 motions", reverse, forward, 1e-10),
    ]

    def draw(fig: "Figure") -> None:
        axes = fig.subplots()
        axes.loglog(_STEPS, errors, label="central differences")
        axes.loglog(_STEPS, errors[-1] * (_STEPS / _STEPS[-1]) ** 4, linestyle=":", label="h⁴")
        axes.set(xlabel="step h of the difference (rad)", ylabel="relative error", ylim=(1e-13, 1))
        axes.legend()

    return Findings(claims, draw)


def order(errors: Array) -> float:
    """Growth of the error with the largest steps of the difference."""
    return float(np.log(errors[-4] / errors[-7]) / np.log(_STEPS[-4] / _STEPS[-7]))


def errors_of_differences() -> Array:
    """Largest error of the state after a step by the body's rotation about x, per step of the difference."""
    params = bb.Params.paper().replace(wheel_dynamic_friction=0.3, wheel_static_friction=0.3)
    robot = bb.Ballbot(params)
    start = bb.State.at_rest(params, tilt=(0.05, -0.03), yaw=0.3)
    # Gaps of a few micrometers, so that no contact is about to change its mode.
    height = params.ball_radius + 2e-6
    lifted = (0.0, 0.0, height)

    def state(angle: float) -> bb.State:
        turn = np.array([np.cos(angle / 2), np.sin(angle / 2), 0.0, 0.0])
        return bb.State(
            lifted,
            ball_velocity=(0.1, -0.05, 0.0),
            ball_angular_velocity=(0.4, 1.0, 0.2),
            body_position=(0.0, 0.0, height + 3e-6),
            body_quaternion=product(np.array(start.body_quaternion), turn),
            body_angular_velocity=(0.1, 0.2, -0.3),
            wheel_speeds=(2.0, -3.0, 1.0),
        )

    def after(angle: float) -> Array:
        robot.reset(state(angle))
        robot.step(_TORQUES)
        end = robot.state
        return np.concatenate([end.ball_velocity, end.body_velocity, end.body_angular_velocity, end.wheel_speeds])

    robot.reset(state(0.0))
    jacobian = robot.jacobian(_TORQUES)
    rows = [jacobian.states.index(name) for name in jacobian.states if _is_velocity(name)]
    exact = jacobian.A[rows, jacobian.states.index("body_rotation_x")]
    differences = np.array([(8 * (after(h) - after(-h)) - after(2 * h) + after(-2 * h)) / (12 * h) for h in _STEPS])
    errors: Array = np.abs(differences - exact).max(axis=1) / np.abs(jacobian.A[rows, :12]).max()
    return errors


def _is_velocity(name: str) -> bool:
    return name.startswith(("ball_velocity", "body_velocity", "body_angular_velocity", "wheel_speed"))


def rolling(params: bb.Params, sim_dt: float) -> tuple[Array, Array]:
    """Derivatives of the robot at rest over a span of time, in coordinates of rolling."""
    return bb.Ballbot(params, sim_dt=sim_dt).jacobian(np.zeros(3), round(_SPAN / sim_dt)).rolling()


def torque_error(params: bb.Params, by_torques: Array) -> float:
    """Largest deviation from the response of the linear model."""
    _, exact = bb.LinearModel(params).discretize(_SPAN)
    return float(np.abs(by_torques[:10] - exact).max())


def products(params: bb.Params) -> tuple[float, float]:
    """The change of a number by changes of start, torques and mass: by products forward and in reverse."""
    rng = np.random.default_rng(0)
    robot = bb.Ballbot(params)
    robot.push((0.3, 0.1, 0.0))
    motion = robot.jacobians(rng.uniform(-0.3, 0.3, (200, 3)), 1, ["body_mass"])
    state, torques, mass = rng.normal(size=30), rng.normal(size=(200, 3)), rng.normal(size=1)
    weights = rng.normal(size=(200, 30))
    by_state, by_torques, by_mass = motion.vjp(weights)
    forward = float((weights * motion.jvp(state, torques, mass)).sum())
    return forward, float(by_state @ state + (by_torques * torques).sum() + by_mass @ mass)
