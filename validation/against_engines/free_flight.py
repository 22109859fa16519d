r"""The bot thrown into the air.

No contact, no control: the bot alone tumbles for half a second at about 4 rad/s while constant torques spin its
wheels up to 100 rad/s, so that only inertias, gyroscopic torques and the integrator are left. The reference is
MuJoCo's Runge-Kutta method on the URDF at steps of 1 ms. Ours step by semi-implicit Euler, whose error is
proportional to the step $h$: the error of $2x_{h/2} - x_h$, extrapolated to a step of zero, must be far smaller.
"""

from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from ballbot_rs.engines.robot_geometry import Array
from validation.against_engines.engine_list import COLORS, CONTACT, RIGID, ROLLING
from validation.claim import Claim
from validation.engines.installed import missing
from validation.engines.our_robot import OurRobot
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SECONDS, _SAMPLES = 0.5, 50
_TORQUES = np.array([0.01, 0.02, -0.03])
_STEPS = (2e-3, 1e-3, 5e-4, 2.5e-4)
#: Error limits of each part of the state, relative to its size: at the smallest step, and extrapolated from the two
#: smallest steps.
_LIMITS = {CONTACT: (1e-3, 1e-6), RIGID: (1e-3, 1e-6)}
_PARTS = {"origin": slice(0, 3), "attitude": slice(3, 7), "rate": slice(7, 10), "wheel speeds": slice(10, 13)}


def run() -> Findings:
    """Throws the bot in each engine."""
    if reason := missing("mujoco"):
        return Findings([], missing=(f"MuJoCo is {reason}",))
    from validation.against_engines.mujoco_rolling import MujocoRolling

    params = bb.Params.paper()
    exact = MujocoRolling(params, 1e-3, touching=False)
    start = bb.State(
        [0.0, 0.0, params.ball_radius],
        body_position=[0.0, 0.0, 2.0],
        body_velocity=[0.1, 0.0, 1.0],
        body_angular_velocity=[1.0, 2.0, 3.0],
        wheel_speeds=[30.0, -20.0, 5.0],
    )
    exact.reset(start)
    rates = [start.body_angular_velocity]
    for _ in range(_SAMPLES):
        exact.step(_TORQUES, round(_SECONDS / _SAMPLES / exact.sim_dt))
        rates.append(exact.state().body_angular_velocity)
    reference = _numbers(exact.state())

    claims, errors = [], {}
    for model, (limit, extrapolated_limit) in _LIMITS.items():
        ends = [_thrown(OurRobot(model, params, step), start) for step in _STEPS]
        errors[model] = [_error(end, reference) for end in ends]
        extrapolated = _error(2.0 * ends[-1] - ends[-2], reference)
        what = f"{model}: state after {_SECONDS} s apart from MuJoCo's, "
        claims += [
            Claim(what + f"h = {1e3 * _STEPS[-1]} ms", errors[model][-1], 0.0, limit, absolute=True),
            Claim(what + "extrapolated", extrapolated, 0.0, extrapolated_limit, absolute=True),
        ]
        errors[model].append(extrapolated)

    def draw(fig: "Figure") -> None:
        left, right = fig.subplots(1, 2)
        times = np.linspace(0.0, _SECONDS, _SAMPLES + 1)
        left.plot(times, np.array(rates), color=COLORS[ROLLING])
        for axis, name in enumerate("xyz"):
            left.annotate(rf"$\Omega_{name}$", (times[-1], rates[-1][axis]), xytext=(4, 0), textcoords="offset points")
        for model, found in errors.items():
            marker = {"marker": "o", "markersize": 9 if model == CONTACT else 4, "fillstyle": "none"}
            right.loglog(1e3 * np.array(_STEPS), found[:-1], color=COLORS[model], label=model, **marker)
            right.axhline(found[-1], color=COLORS[model], linestyle=":", label=f"{model}, extrapolated")
        left.set(xlabel="time (s)", ylabel="rate, body frame (rad/s)")
        right.set(xlabel="step (ms)", ylabel="largest relative difference")
        right.set_xticks([1e3 * step for step in _STEPS], [f"{1e3 * step:g}" for step in _STEPS])
        right.minorticks_off()
        right.legend()

    return Findings(claims, draw)


def _numbers(state: bb.State) -> Array:
    attitude = state.body_quaternion * np.sign(state.body_quaternion[0])
    return np.concatenate([state.body_position, attitude, state.body_angular_velocity, state.wheel_speeds])


def _thrown(robot: OurRobot, start: bb.State) -> Array:
    robot.reset(start)
    robot.step(_TORQUES, round(_SECONDS / robot.sim_dt))
    return _numbers(robot.state())


def _error(found: Array, reference: Array) -> float:
    """Largest error over the parts of the state, each relative to its size."""
    return max(
        float(np.linalg.norm(found[part] - reference[part]) / np.linalg.norm(reference[part]))
        for part in _PARTS.values()
    )
