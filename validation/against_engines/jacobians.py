r"""Derivatives of a step, in `contact`, MuJoCo and MuJoCo XLA.

One robot, three states, and the derivatives of a step of 1 ms by each method, compared with the true derivatives of the
step of the same engine: MuJoCo's soft contacts make its step another function than ours. So this is about how well
derivatives can be had, not about which engine is right, nor about time. For `contact` the truth is `Ballbot.jacobian`,
itself compared with a difference of fourth order: the dotted line, which is what rounding leaves of that difference.
MuJoCo has no exact derivative; its truth is a difference of fourth order of its step, with the solver run to the end,
and the table shows by how much half the steps change it.

Compared are the 15 velocities after a step by the body's rotation, by velocities and by torques; an error is the
largest, relative to the largest entry of its kind. A difference has one step for all of them (rad, m/s, rad/s, N·m), as
in `mjd_transitionFD`. Lifting the ball or the body is left out, as both steps have kinks close to there: `contact` is
one-sided, and MuJoCo's contacts open.

The robot is the paper's with wheel friction 0.3, at yaw 0, where MuJoCo lays its friction directions along the wheels:
upright at rest; leaning and turning while it rolls; and the same with a torque under which a wheel slips; each 20 ms
after its start. MuJoCo's solver has 100 iterations and tolerance 0, or its default tolerance $10^{-8}$, until then and
in the step. MuJoCo XLA is differentiated by JAX's `jacfwd` in double precision.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

import ballbot_rs as bb
from ballbot_rs.engines.robot_geometry import Array, robot_geometry
from validation.against_engines.engine_list import COLORS, CONTACT
from validation.claim import Claim
from validation.engines import rotations
from validation.engines.installed import missing
from validation.page import table
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from validation.against_engines.differentiated import Contact, Mujoco, Steps

#: Relative errors by method: one per step of a difference, or one number where there is no step.
Errors = dict[str, Array]

#: Of differences, and the one that is usual with `mjd_transitionFD`.
_STEPS, _USUAL = np.logspace(-10, -1, 37), 1e-6
_FRICTION = 0.3
_TORQUES = {
    "upright, at rest": np.zeros(3),
    "rolling": np.array([0.1, -0.05, 0.05]),
    "a wheel slips": np.array([0.17, -0.05, 0.05]),
}
#: Steps of differences of fourth order by rotation, velocity and torque: of `contact`, of MuJoCo at rest and in motion.
_OURS, _AT_REST, _MOVING = (1e-3, 3e-4, 1e-3), (1.4e-4, 4e-6, 1.4e-4), (1.4e-3, 1.4e-4, 1.4e-3)
_DEFAULT_TOLERANCE = 1e-8
#: Of the body, in which no wheel touches the ball, m.
_LIFT = 1e-3

_EXACT, _CENTRAL, _FORWARD = "Ballbot.jacobian", "contact, central", "contact, forward"
_AUTOMATIC, _THEIRS, _THEIRS_FORWARD = "MuJoCo XLA, jacfwd", "mjd_transitionFD, central", "mjd_transitionFD, forward"
_STOPPED, _AUTOMATIC_STOPPED = "mjd_transitionFD, default tolerance", "MuJoCo XLA, jacfwd, default tolerance"
_TRUTH = "truth for MuJoCo, against half the steps"
_DASHED = (0, (3, 1.5))
_LINES: dict[str, tuple[str, Any]] = {
    _CENTRAL: (COLORS[CONTACT], "-"),
    _FORWARD: (COLORS[CONTACT], _DASHED),
    _THEIRS: ("#d9480f", "-"),
    _THEIRS_FORWARD: ("#d9480f", _DASHED),
    _STOPPED: ("#868e96", "-"),
    _AUTOMATIC: ("#5f3dc4", ":"),
    _EXACT: (COLORS[CONTACT], ":"),
}


def run() -> Findings:
    """Differentiates every state by every method."""
    reasons = {"MuJoCo": missing("mujoco"), "MuJoCo XLA": missing("mujoco.mjx")}
    if absent := tuple(f"{engine} is {reason}" for engine, reason in reasons.items() if reason):
        return Findings([], missing=absent)
    from validation.against_engines.mjx_jacobian import differentiator

    params = bb.Params.paper().replace(wheel_dynamic_friction=_FRICTION, wheel_static_friction=_FRICTION)
    automatic = differentiator()
    found, claims = {}, []
    for name, torques in _TORQUES.items():
        start = _leaning(params) if torques.any() else bb.State.at_rest(params)
        steps = _MOVING if torques.any() else _AT_REST
        found[name] = errors = _ours(params, start, torques) | _theirs(params, start, torques, steps, automatic)
        what = f"{_EXACT}, {name}: from a difference of fourth order"
        claims.append(Claim(what, errors[_EXACT].item(), 0.0, 1e-9, absolute=True))
        what = f"{_CENTRAL} differences, {name}: smallest error"
        claims.append(Claim(what, float(errors[_CENTRAL].min()), 0.0, 1e-8, absolute=True))

    def draw(fig: "Figure") -> None:
        _draw(fig, found)

    text = f"{_table(found)}\n\n{_explain(params, automatic)}"
    return Findings(claims, draw, text, (8.5, 3.9))


def _leaning(params: bb.Params) -> bb.State:
    """A robot that leans, turns, and rolls without slip."""
    leaning = bb.State.at_rest(params, tilt=(0.02, -0.03))
    ball_rate, rate = np.array([0.4, 1.0, 0.2]), np.array([0.1, 0.2, -0.3])
    velocity = np.cross(ball_rate, (0.0, 0.0, params.ball_radius))
    relative = rotations.matrix(leaning.body_quaternion).T @ ball_rate - rate
    return bb.State(
        leaning.ball_position, velocity, ball_rate, leaning.body_quaternion, rate,
        robot_geometry(params).wheel_map @ relative, body_position=leaning.body_position, body_velocity=velocity,
    )  # fmt: skip


def _ours(params: bb.Params, start: bb.State, torques: Array) -> Errors:
    from validation.against_engines.differentiated import Contact, error, fourth_order

    robot = Contact(params, start, torques)
    return {
        _CENTRAL: _by_step(robot, robot.exact, central=True),
        _FORWARD: _by_step(robot, robot.exact, central=False),
        _EXACT: np.array([error(fourth_order(robot, _OURS), robot.exact)]),
    }


def _theirs(
    params: bb.Params, start: bb.State, torques: Array, steps: "Steps", automatic: Callable[..., Array]
) -> Errors:
    from validation.against_engines.differentiated import Mujoco, error, fourth_order

    stopped, robot = (Mujoco(params, start, torques, tolerance) for tolerance in (_DEFAULT_TOLERANCE, 0.0))
    truth = fourth_order(robot, steps)
    errors = {
        _THEIRS: _by_step(robot, truth, central=True),
        _THEIRS_FORWARD: _by_step(robot, truth, central=False),
        _TRUTH: np.array([error(fourth_order(robot, (steps[0] / 2, steps[1] / 2, steps[2] / 2)), truth)]),
        _AUTOMATIC: np.array([error(automatic(robot.model, robot.data), truth)]),
    }
    # A difference of the same state, by a solver that is run to the end.
    stopped.model.opt.tolerance = 0.0
    truth = fourth_order(stopped, steps)
    stopped.model.opt.tolerance = _DEFAULT_TOLERANCE
    errors[_STOPPED] = _by_step(stopped, truth, central=True)
    errors[_AUTOMATIC_STOPPED] = np.array([error(automatic(stopped.model, stopped.data), truth)])
    return errors


def _by_step(robot: "Contact | Mujoco", truth: Array, *, central: bool) -> Array:
    from validation.against_engines.differentiated import error

    return np.array([error(robot.difference(step, central=central), truth) for step in _STEPS])


def _table(found: dict[str, Errors]) -> str:
    """The errors at the usual step, and the smallest with its step."""
    usual = int(np.abs(_STEPS - _USUAL).argmin())
    lines = []
    for method in next(iter(found.values())):
        cells = []
        for errors in found.values():
            values = errors[method]
            if len(values) == 1:
                cells.append(f"{values.item():.0e}")
                continue
            best = int(values.argmin())
            cells.append(f"{values[usual]:.0e}; {values[best]:.0e} at {_STEPS[best]:.0e}")
        lines.append([method, *cells])
    return table(["relative error with a step of 1e-6; the smallest, and its step", *found], lines)


def _explain(params: bb.Params, automatic: Callable[..., Array]) -> str:
    from ballbot_rs.engines.mujoco_robot import BODY_POSITION
    from validation.against_engines.differentiated import Mujoco

    robot = Mujoco(params, _leaning(params), _TORQUES["rolling"], 0.0)
    near, usual, far = (robot.heights(step) for step in (1e-7, 1e-6, 1e-5))
    errors = [float(np.abs(heights - near).max() / np.abs(near).max()) for heights in (usual, far)]
    depths = 1e6 * np.array([robot.depths.min(), robot.depths.max()])
    robot.data.qpos[BODY_POSITION] += (0.0, 0.0, _LIFT)
    holes = np.isnan(automatic(robot.model, robot.data)).mean()
    return f"""Kinks end the valleys on the right: contacts open there, and at rest the rollers of MuJoCo's wheels
change between stick and slip, as their friction cannot be below 1e-5. At rest the gaps of `contact` are zero, and where
rounding changes one, a forward difference has a spike. A solver that starts from the last solution and stops at the
default tolerance leaves a part of a change unsolved; no step of the difference cures that, but `tolerance="0"` does, or
`warmstart="disable"`.

MuJoCo's contacts are {depths[0]:.1f} to {depths[1]:.1f} µm deep while the robot rolls. By the heights of ball and body,
which are left out, a central difference with a step of 1e-6 m has an error of {errors[0]:.0e} of the largest entry,
with 1e-5 m {errors[1]:.0f} times the entry. Where no wheel touches the ball, {holes:.0%} of the entries of `jacfwd` are
NaN: MuJoCo XLA differentiates $\\sqrt{{0}}$ in the elliptic cone of an open contact. `jax.grad` raises a `ValueError`:
JAX cannot reverse the loop of its solver ([issue 2259](https://github.com/google-deepmind/mujoco/issues/2259))."""


def _draw(fig: "Figure", found: dict[str, Errors]) -> None:
    for axes, (name, errors) in zip(fig.subplots(1, len(found), sharey=True), found.items(), strict=True):
        for method, (color, dash) in _LINES.items():
            values = errors[method]
            y = np.full(len(_STEPS), values.item()) if len(values) == 1 else values
            axes.loglog(_STEPS, y, color=color, linestyle=dash, label=method)
        axes.set(title=name, xlabel="step of the difference", xlim=(_STEPS[0], _STEPS[-1]), ylim=(1e-13, 1e2))
        axes.set_xticks(np.logspace(-9, -1, 5))
    axes = fig.axes[0]
    axes.set(ylabel="relative error", yticks=np.logspace(-12, 2, 8))
    handles, labels = axes.get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside upper center", ncols=4, columnspacing=1.2)
