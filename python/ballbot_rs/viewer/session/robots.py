"""The simulated robots of a session."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Params, State
from ballbot_rs._state_rows import body_axes_of, tilt_components_of, tilt_of
from ballbot_rs.viewer.session.recording import Frame
from ballbot_rs.viewer.session.robot import Robot
from ballbot_rs.viewer.session.setup import Setup

FloatArray = npt.NDArray[np.float64]

#: Largest pull from the page, as a fraction of the robot's weight, and the distance at which it is reached, m.
PULL_LIMIT = 0.2
PULL_DISTANCE = 0.4

#: Tilt from the equilibrium beyond which a robot has fallen, rad, in addition to touching the floor; models without
#: slip have no floor.
FALLEN_TILT = math.radians(60.0)


class Robots:
    """Robots of one setup, each with its own samples; plots show the first.

    Robot i starts with the chosen tilt rotated by i/n of a circle, so that a batch covers all directions.

    Raises:
        ValueError: invalid robot, motors, sensors or events.
    """

    def __init__(self, setup: Setup, num_robots: int) -> None:
        self.setup = setup
        self._robots = [Robot(setup, index) for index in range(num_robots)]
        self._start = np.zeros(2)
        #: Numbers of the episodes that individually restarted robots begin; None: their next episodes.
        self.restart_episodes: list[int] | None = None
        self.applied = np.zeros((num_robots, 3))
        #: For how long each robot has been down, s; its motors are off.
        self.down_for = np.zeros(num_robots)

    def __len__(self) -> int:
        return len(self._robots)

    def __getitem__(self, index: int) -> Robot:
        return self._robots[index]

    def __iter__(self) -> Iterator[Robot]:
        return iter(self._robots)

    @property
    def name(self) -> str:
        """Name of the robot."""
        return self.setup.name

    @property
    def model(self) -> str:
        """Name of the model."""
        return self.setup.model

    @property
    def states(self) -> list[State]:
        """States of all robots."""
        return [robot.state for robot in self]

    @property
    def seen(self) -> list[State]:
        """The states for controllers: estimates with sensors, else the true states."""
        return [robot.seen for robot in self]

    @property
    def readings(self) -> list[dict[str, FloatArray]]:
        """Readings of the sensors of all robots."""
        return [robot.readings for robot in self]

    @property
    def observations(self) -> npt.NDArray[np.float32]:
        """The task's observation of each robot, shape (n, m)."""
        return np.array([robot.observation for robot in self])

    @property
    def commands(self) -> FloatArray:
        """The task's command for each robot, shape (n, k)."""
        return np.array([robot.command for robot in self])

    @property
    def setpoints(self) -> list[dict[str, Any]]:
        """The task's setpoint for a law on each robot, by part."""
        return [robot.setpoint for robot in self]

    def reset(self, tilt: npt.ArrayLike) -> None:
        """All robots at rest at the origin. Raises ValueError for a tilt that a robot cannot have."""
        start = np.asarray(tilt, dtype=np.float64)
        if start.shape != (2,) or not np.isfinite(start).all():
            raise ValueError(f"tilt = {tilt!r}: expected two finite angles")
        for index in range(len(self)):
            self[index].start(self._turned(start, index))
            self.down_for[index] = 0.0
        self._start = start
        # A frame may hold the old arrays.
        self.applied = np.zeros_like(self.applied)

    @property
    def fallen(self) -> npt.NDArray[np.bool_]:
        """Which robots are down, shape (n,)."""
        return self.down_for > 0.0

    @property
    def episodes(self) -> list[int]:
        """Numbers of the robots' episodes, from 1."""
        return [robot.episode for robot in self]

    def restart(self, index: int) -> None:
        """One robot at rest at the start of its episode, tilted as at the last reset if possible."""
        episode = None if self.restart_episodes is None else self.restart_episodes[index]
        self[index].restart(self._turned(self._start, index), episode)
        self.down_for[index] = 0.0

    def _turned(self, start: FloatArray, index: int) -> FloatArray:
        angle = 2.0 * np.pi * index / len(self)
        turned: FloatArray = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ start
        return turned

    def become(self, setup: Setup) -> "Robots":
        """The same number of robots with another setup of the same kind, at the same places: these objects or new.

        Raises:
            ValueError: invalid robot, motors, sensors or events; then these robots are unchanged.
        """
        if self.setup.differs_in_numbers_alone(setup):
            try:
                for robot in self:
                    robot.set_params(setup.params)
            except ValueError:
                for robot in self:
                    robot.set_params(self.setup.params)
                raise
            self.setup = setup
            return self
        others = Robots(setup, len(self))
        others._start = self._start
        others.continue_from(self)
        return others

    def continue_from(self, others: "Robots") -> None:
        """Puts each robot into the episode and state of the other batch's robot with the same number."""
        for index, robot in enumerate(self):
            robot.continue_from(others[index], self._turned(self._start, index))
            self.down_for[index] = others.down_for[index]

    def pull(self, towards: FloatArray, seconds: float) -> None:
        """Pulls robot 0 at its center of mass towards a point, for a time, with a limited force."""
        self[0].push(pull_of(self[0].params, self.com, towards) * seconds)

    @property
    def com(self) -> FloatArray:
        """Center of mass of robot 0's body, m."""
        return com_of(self[0].params, self[0].state)

    def step(self, torques: FloatArray, steps: int) -> dict[int, str]:
        """Advances all robots; robots that cannot continue restart, and are returned with the reasons."""
        limit = self.setup.max_torque
        self.applied = np.where(self.fallen[:, np.newaxis], 0.0, np.clip(torques, -limit, limit))
        lost = {}
        for index, robot in enumerate(self):
            reason = robot.step(self.applied[index], steps)
            if reason is not None:
                self.restart(index)
                lost[index] = reason
        tilts = tilt_of(self._rows(), [robot.params.body_com for robot in self])
        down = self.fallen | (tilts > FALLEN_TILT) | [robot.is_down for robot in self]
        self.down_for[down] += steps * self.setup.sim_dt
        return lost

    def _rows(self) -> FloatArray:
        return np.array([robot.state.to_array() for robot in self])

    def _loads(self) -> list[tuple[Params, FloatArray]]:
        """Robots with their payloads, of which events may load some."""
        every = [robot.params for robot in self]
        carry = any(params.has_payload for params in every)
        return [(params, robot.payloads) for params, robot in zip(every, self, strict=True)] if carry else []

    def frame(self, time: float, **shown: Any) -> Frame:
        """The frame to show, with the fields in `shown`."""
        states, params = self._rows(), self[0].params
        seen = None if self.setup.sensors is None else self[0].seen
        return Frame(
            robot=self.name,
            time=time,
            states=states,
            torques=self.applied,
            tilt=tilt_components_of(states[0], params.body_com),
            estimated_tilt=None if seen is None else tilt_components_of(seen.to_array(), params.body_com),
            contacts=self[0].contacts,
            params=params,
            loads=self._loads(),
            terrain=self.setup.terrain,
            **shown,
        )


def com_of(params: Params, state: State) -> FloatArray:
    """Center of mass of a robot's body, inertial frame, m."""
    com: FloatArray = state.body_position + body_axes_of(state.to_array()) @ np.asarray(params.body_com)
    return com


def pull_of(params: Params, com: FloatArray, towards: FloatArray) -> FloatArray:
    """The limited force that pulls a body's center of mass towards a point, inertial frame, N."""
    weight = params.body_mass * params.gravity
    force = weight * PULL_LIMIT * (towards - com) / PULL_DISTANCE
    limited: FloatArray = force * min(1.0, weight * PULL_LIMIT / max(float(np.linalg.norm(force)), 1e-12))
    return limited
