"""The simulated robots of a session."""

import contextlib
import math

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Ballbot, Params, State
from ballbot_rs._errors import DivergedError
from ballbot_rs._state_rows import body_axes_of
from ballbot_rs.viewer.recording import Frame

FloatArray = npt.NDArray[np.float64]

#: How hard the page may pull, as a share of the robot's weight, and at which distance it does, m.
PULL_LIMIT = 0.2
PULL_DISTANCE = 0.4

#: From this tilt on a robot has fallen, rad, as it has once it touches the floor; models without slip have no floor.
FALLEN_TILT = math.radians(60.0)


class Robots:
    """Robots with the same parameters and model; the first is the one that plots show.

    Robot i starts with the chosen tilt turned by i/n of a circle, so that a batch covers all directions.
    """

    def __init__(self, name: str, params: Params, model: str, num_robots: int, sim_dt: float) -> None:
        self.name = name
        self.params = params
        self.model = model
        self.sim_dt = sim_dt
        self._robots = [Ballbot(params, model, sim_dt) for _ in range(num_robots)]
        self._start = np.zeros(2)
        self.applied = np.zeros((num_robots, 3))
        #: For how long each robot has been down, s; its motors are off.
        self.down_for = np.zeros(num_robots)

    def __len__(self) -> int:
        return len(self._robots)

    @property
    def states(self) -> list[State]:
        """States of all robots."""
        return [robot.state for robot in self._robots]

    def reset(self, tilt: npt.ArrayLike) -> None:
        """All robots at rest at the origin. Raises ValueError for a tilt that a robot cannot have."""
        start = np.asarray(tilt, dtype=np.float64)
        if start.shape != (2,) or not np.isfinite(start).all():
            raise ValueError(f"tilt = {tilt!r}: expected two finite angles")
        for index in range(len(self)):
            self._reset(index, start)
        self._start = start
        # A frame may hold the old ones.
        self.applied = np.zeros_like(self.applied)

    @property
    def fallen(self) -> npt.NDArray[np.bool_]:
        """Which robots are down, shape (n,)."""
        return self.down_for > 0.0

    def restart(self, index: int) -> None:
        """One robot at rest at the origin, tilted as at the last reset."""
        self._reset(index, self._start)

    def _reset(self, index: int, start: FloatArray) -> None:
        self.down_for[index] = 0.0
        angle = 2.0 * np.pi * index / len(self)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        self._robots[index].reset(State.at_equilibrium(self.params, turn @ start))

    def take_over(self, others: "Robots") -> None:
        """Goes on from where as many other robots are, as far as this model can: slip is left behind."""
        self._start = others._start
        self.down_for = others.down_for.copy()
        for index, (robot, state) in enumerate(zip(self._robots, others.states, strict=True)):
            for candidate in (state, _rolling(self.params, state)):
                with contextlib.suppress(ValueError):
                    robot.reset(candidate)
                    break
            else:
                self._reset(index, self._start)

    def push(self, impulse: npt.ArrayLike) -> None:
        """Gives every robot an impulse (inertial frame, N·s) at its centre of mass."""
        for robot in self._robots:
            robot.push(impulse)

    def pull(self, towards: FloatArray, seconds: float) -> None:
        """Pulls robot 0 at its centre of mass towards a point, for a time, with a limited force."""
        weight = self.params.body_mass * self.params.gravity
        force = weight * PULL_LIMIT * (towards - self.com) / PULL_DISTANCE
        force *= min(1.0, weight * PULL_LIMIT / max(float(np.linalg.norm(force)), 1e-12))
        self._robots[0].push(force * seconds)

    @property
    def com(self) -> FloatArray:
        """Where the centre of mass of robot 0's body is, m."""
        state = self._robots[0].state
        com: FloatArray = state.body_position + body_axes_of(state.to_array()) @ np.asarray(self.params.body_com)
        return com

    def step(self, torques: FloatArray, steps: int) -> list[int]:
        """Advances all robots; those that left the range of the numbers start anew, and are returned."""
        limit = self.params.max_wheel_torque
        self.applied = np.where(self.fallen[:, np.newaxis], 0.0, np.clip(torques, -limit, limit))
        lost = []
        for index, robot in enumerate(self._robots):
            try:
                robot.step(self.applied[index], steps)
            except DivergedError:
                self.restart(index)
                lost.append(index)
                continue
            if self.down_for[index] or robot.state.tilt > FALLEN_TILT or robot.contacts.bot_on_floor:
                self.down_for[index] += steps * self.sim_dt
        return lost

    def frame(self, time: float, setpoint: FloatArray | None, target: FloatArray | None) -> Frame:
        """What is to be shown."""
        first, contacts = self._robots[0].state, self._robots[0].contacts
        return Frame(
            robot=self.name,
            time=time,
            states=np.array([robot.state.to_array() for robot in self._robots]),
            torques=self.applied,
            tilt=first.tilt_components,
            loads=contacts.wheel_normal_forces,
            slip=contacts.wheel_slip_speeds,
            utilization=contacts.friction_utilization,
            setpoint=setpoint,
            target=target,
        )


def _rolling(params: Params, state: State) -> State:
    rolling = State.rolling(params, state.ball_velocity[:2], state.body_quaternion, state.body_angular_velocity)
    position = np.array([*state.ball_position[:2], params.ball_radius])
    return rolling.replace(
        ball_position=position,
        body_position=position,
        ball_quaternion=state.ball_quaternion,
        wheel_angles=state.wheel_angles,
    )
