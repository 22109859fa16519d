"""A simulated robot under the paper's PID, recorded."""

from dataclasses import dataclass

import numpy as np

import ballbot_rs as bb
from ballbot_rs.analysis.settling import settling_times
from validation.mechanics import Array
from validation.search import largest

#: The paper's torque map and ours: eq. (8), and the power-conserving map.
MAPS = ("as_printed", "consistent")
#: Torque of the paper's wheels, N·m (Fig. 6c).
PRINTED_TORQUE = 5.0
#: A robot that leans this far has fallen, rad.
FALLEN = np.radians(45.0)

_SIM_DT = 1e-3


@dataclass(frozen=True)
class Run:
    """One row per control step, at its start; the forces are at its end."""

    times: Array
    #: Angle between mast and vertical, rad.
    tilt: Array
    #: (θ_x, θ_y), rad.
    tilts: Array
    positions: Array
    velocities: Array
    torques: Array
    loads: Array
    slips: Array
    fell: bool

    def time_within(self, degrees: float) -> float:
        """Time from which the tilt stays within a bound; infinite if it does not."""
        if self.fell:
            return float("inf")
        return float(settling_times(self.tilt, np.radians(degrees), self.times[1] - self.times[0]))


def balance(
    model: str,
    tilts: tuple[float, float],
    *,
    mapping: str = "consistent",
    max_torque: float | None = None,
    control_dt: float = 1e-3,
    seconds: float = 4.0,
) -> Run:
    """The robot of Table II from rest at (θ_x, θ_y) in degrees; `max_torque` None is the traction limit."""
    params = bb.Params.paper()
    robot = bb.Ballbot(params, model=model, sim_dt=_SIM_DT)
    # A tilt about +x leans towards −y.
    robot.reset(bb.State.at_rest(robot.params, tilt=(-np.radians(tilts[0]), np.radians(tilts[1]))))
    pid = bb.Pid(params, control_dt, mapping=mapping, max_torque=max_torque)
    rows: list[Array] = []
    fell = False
    for k in range(round(seconds / control_dt)):
        state = robot.state
        torques = pid(state)
        try:
            robot.step(torques, steps=round(control_dt / _SIM_DT))
        except bb.DivergedError:
            fell = True
            break
        contacts = robot.contacts
        about_x, about_y = state.tilt_components
        rows.append(
            np.array(
                [
                    k * control_dt,
                    state.tilt,
                    -about_x,
                    about_y,
                    *state.ball_position[:2],
                    *state.ball_velocity[:2],
                    *torques,
                    *contacts.wheel_normal_forces,
                    *contacts.wheel_slip_speeds,
                ]
            )
        )
        if state.tilt > FALLEN or contacts.bot_on_floor:
            fell = True
            break
    x = np.array(rows)
    return Run(x[:, 0], x[:, 1], x[:, 2:4], x[:, 4:6], x[:, 6:8], x[:, 8:11], x[:, 11:14], x[:, 14:17], fell)


def recovers(model: str, tilts: tuple[float, float], mapping: str, max_torque: float | None, control_dt: float) -> bool:
    """Whether the tilt is within 0.5 deg after 1.5 s."""
    params = bb.Params.paper()
    robot = bb.Ballbot(params, model=model, sim_dt=_SIM_DT)
    robot.reset(bb.State.at_rest(robot.params, tilt=(-np.radians(tilts[0]), np.radians(tilts[1]))))
    pid = bb.Pid(params, control_dt, mapping=mapping, max_torque=max_torque)
    steps = round(control_dt / _SIM_DT)
    for _ in range(round(1.5 / control_dt)):
        state = robot.state
        if state.tilt > FALLEN:
            return False
        try:
            robot.step(pid(state), steps=steps)
        except bb.DivergedError:
            return False
    return bool(robot.state.tilt < np.radians(0.5))


def largest_recovered(model: str, mapping: str, max_torque: float | None, control_dt: float = 1e-3) -> float:
    """Largest tilt from which the PID recovers, the worst of four directions, by bisection to 0.1 deg."""
    worst = 40.0
    for direction in ((1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (-0.5, 0.866)):

        def back(tilt: float, to: tuple[float, float] = direction) -> bool:
            return recovers(model, (tilt * to[0], tilt * to[1]), mapping, max_torque, control_dt)

        if not back(worst):
            worst = largest(back, 0.0, worst, to=0.1)
        if worst == 0.0:
            break
    return worst
