"""Linear models about any state."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import check_bounded
from ballbot_rs._core import Ballbot, State
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._keywords import named
from ballbot_rs._robot import Robot, params_of

Array = npt.NDArray[np.float64]

#: Largest distance of the body from its place on the ball, m.
APART = 0.01


@named
def linearize(
    robot: Robot | None = None,
    state: State | None = None,
    wheel_torques: npt.ArrayLike | None = None,
    *,
    dt: float = 0.01,
    sim_dt: float = 0.001,
) -> tuple[Array, Array]:
    """The linear model of the next `dt` seconds about any state on a plane floor: leaning, driving, turning, slipping.

    ```python
    A, B = bb.linearize("kugle", dt=0.01)
    print(np.abs(np.linalg.eigvals(A)).max())
    ```

    Returns A (11, 11) and B (11, 3): the change of the state is x' = A x + B u in the coordinates `Jacobian.ROLLING`,
    for changes u of the torques, N·m. If the robot leaves the state, the model is about the motion that begins there.

    Args:
        robot: as in `simulate`; None is the paper's.
        state: None is at rest in equilibrium; on a slope (`floor_tilt`) the equilibrium there.
        wheel_torques: about which to linearize, shape (3,), N·m; None holds the robot at rest.
        dt: s, a multiple of `sim_dt`.
        sim_dt: time step of the model `contact`, s.

    Raises:
        ValueError: numbers out of range; a body that is not on its ball; the bot touches the floor, or the ball its
            body.
        DivergedError: the state leaves the simulation's bounds.
    """
    simulated = Ballbot(params_of(robot), "contact", sim_dt)
    substeps = steps_of("dt", dt, sim_dt)
    params = simulated.params
    if state is None:
        state = State.at_equilibrium(params, tilt=params.slope_lean())
    check_on_ball("state", state)
    simulated.reset(state)
    torques = params.holding_torques(state.yaw) if wheel_torques is None else wheel_torques
    return simulated.jacobian(torques, substeps).rolling()


def check_on_ball(name: str, state: State) -> None:
    """Raises TypeError for what is not a state, and ValueError for a body that is apart from its ball."""
    if not isinstance(state, State):
        raise TypeError(f"{name} = {state!r} is not a State")
    apart = float(np.linalg.norm(state.body_position - state.ball_position))
    if apart > APART:
        raise InvalidInputError(
            f"{name}: the body is {apart:g} m from its place on the ball, at most {APART} m: move body_position with "
            "ball_position"
        )


def steps_of(name: str, dt: float, sim_dt: float) -> int:
    """The number of time steps in `dt`. Raises ValueError unless it is whole."""
    number = check_bounded(name, dt, sim_dt, 1.0) / sim_dt
    if abs(number - round(number)) > 1e-6:
        raise ValueError(f"{name} = {dt} is not a multiple of sim_dt = {sim_dt}")
    return round(number)
