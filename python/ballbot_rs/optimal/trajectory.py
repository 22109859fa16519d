"""Motions of least cost."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy.typing as npt

from ballbot_rs._checks import check_bounded, check_count
from ballbot_rs._core import Reference, State, Terrain
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._keywords import named
from ballbot_rs._robot import Robot
from ballbot_rs.optimal import solver
from ballbot_rs.optimal.law import TimeVaryingLqr
from ballbot_rs.optimal.plan import MOST_STEPS, Plan
from ballbot_rs.optimal.result import OptimizedTrajectory


@named
def optimize_trajectory(
    goal: Reference | State | npt.ArrayLike,
    *,
    robot: Robot | None = None,
    start: State | None = None,
    seconds: float | None = None,
    terrain: Terrain | str | None = None,
    initial: OptimizedTrajectory | Callable[[State], npt.ArrayLike] | None = None,
    friction: float = 0.98,
    max_torque: float | None = None,
    control_dt: float = 0.01,
    sim_dt: float = 0.001,
    iterations: int = 200,
    tolerance: float = 1e-3,
    progress: Callable[[int, float], None] | None = None,
) -> OptimizedTrajectory:
    """The motion of least cost from `start` to a goal, or along a reference, in the model `contact`.

    ```python
    found = bb.optimize_trajectory((0.2, 0.0), seconds=1.4, control_dt=0.02)
    print(found.reached, found.cost)
    ```

    By differential dynamic programming with torque limits, on the exact step derivatives. The cost penalizes torques
    and the distance from the reference, or from the goal with a weight that grows until the goal is reached.
    Traction beyond the limit is penalized but allowed. The result is a local optimum, the same for the same arguments.

    Args:
        goal: the last position of the ball, shape (2,), m, at rest with the heading of the start; the last state; or a
            reference, which is made for this robot.
        robot: as in `simulate`; None is the paper's.
        start: None is at rest, above the origin or at the start of the reference. A push acts in the step after
            `Ballbot.push`, so the state after this step is the start of a pushed robot.
        seconds: duration, rounded up to whole control steps; None is the duration of the reference.
        terrain: the ground, a `Terrain` or the name of a kind; None is level.
        initial: the first motion: another result for this robot, which is stretched to this duration, or a law. If it
            is None, or its robot falls, `Lqr` on a slow line to the goal, or along the reference.
        friction: fraction of the friction limit of the wheels above which traction costs.
        max_torque: limit of a torque, N·m; None is `Params.max_wheel_torque`.
        control_dt: time for which torques hold, s, a multiple of `sim_dt`.
        sim_dt: time step, s.
        iterations: maximum number of iterations.
        tolerance: expected improvement, relative to the cost, below which the optimizer has converged.
        progress: called with the iteration and the cost, which grows with the weight of the goal.

    Raises:
        ValueError: numbers out of range; a reference that the robot cannot follow; a start or goal whose body is not on
            its ball; a first motion that falls.
        TypeError: an argument of the wrong type.
        ControllerError: a law that was given as initial= failed.
    """
    check_count("iterations", iterations)
    check_bounded("tolerance", tolerance, 0.0, 1.0)
    check_bounded("friction", friction, 0.01, 1.0)
    plan = Plan(robot, terrain, control_dt, sim_dt, max_torque, friction)
    if isinstance(goal, Reference):
        goal = goal.for_robot(plan.params)
        seconds = goal.duration if seconds is None else seconds
    if seconds is None:
        raise InvalidInputError("seconds is needed: how long the motion may take")
    steps = math.ceil(check_bounded("seconds", seconds, control_dt, MOST_STEPS * control_dt) / control_dt - 1e-9)
    plan.begin(start, goal, steps)
    motion, derivatives = plan.first(initial)
    left, result = iterations, None
    for weight in plan.weights():
        result = solver.minimize(
            plan.plant,
            plan.cost(weight),
            motion,
            derivatives,
            iterations=left,
            tolerance=tolerance,
            progress=plan.counted(progress),
        )
        motion, derivatives, left = result.motion, result.derivatives, left - result.iterations
        stuck = result.iterations == 0 and not result.converged
        if plan.reached(motion) or left <= 0 or stuck:
            break
    assert result is not None, "there is a weight"
    return plan.result(result, iterations - left)


def planned_law(reference: object, *, start: State, seconds: float, options: Mapping[str, Any]) -> TimeVaryingLqr:
    """The law `tvlqr` from a state, along a reference or to a constant position, for an environment with `options`.

    Raises:
        TypeError: another reference.
        ValueError: as in `optimize_trajectory`, or a goal that is not reached in this time.
    """
    given = {name: options[name] for name in ("robot", "terrain", "control_dt", "sim_dt") if name in options}
    if isinstance(reference, Reference):
        seconds = min(seconds, reference.duration or seconds)
        return optimize_trajectory(reference, start=start, seconds=seconds, **given).law()
    if not (isinstance(reference, Mapping) and set(reference) == {"position"}):
        raise TypeError("tvlqr follows a Reference or moves to a constant position: pass one of them as reference=")
    found = optimize_trajectory(reference["position"], start=start, seconds=seconds, **given)
    if not found.reached:
        raise InvalidInputError(f"tvlqr does not reach {tuple(reference['position'])} m in {seconds:g} s: allow more")
    return found.law()
