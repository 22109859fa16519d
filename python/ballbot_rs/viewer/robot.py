"""One robot: an environment as long as it does not touch the floor, and a robot without current from then on."""

import contextlib
from typing import Any

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import ACTUATOR_OPTIONS, Ballbot, Contacts, Params, State
from ballbot_rs._errors import DivergedError
from ballbot_rs.viewer.setup import Setup

FloatArray = npt.NDArray[np.float64]


class Robot:
    """Robot `index` of a setup; `start` or `go_on_from` comes first.

    Raises:
        ValueError: the robot, its motors, sensors or events cannot be.
    """

    def __init__(self, setup: Setup, index: int) -> None:
        self._setup = setup
        self._batch = setup.batch(index)
        #: Number of the present episode, from 1 on; its draws depend on it.
        self._episode = 0
        self._lying: Ballbot | None = None
        #: Where the ball was when the present command was given, m.
        self.begin = np.zeros(2)

    def start(self, tilt: npt.ArrayLike) -> None:
        """Begins the next episode, with its draws: at rest, tilted from the equilibrium, at the origin or on a tile.

        Raises:
            ValueError: a tilt that the robot cannot have; nothing has changed then.
        """
        before = self._batch.snapshot(0)
        self._batch.reset()
        try:
            start = self._start_of_draws(tilt)
        finally:
            self._batch.restore(0, before)
        self._batch.reset(starts=[start])
        self._begun(self._episode + 1)

    def _start_of_draws(self, tilt: npt.ArrayLike) -> State:
        """At rest, of the robot that was drawn; on uneven ground on the tile that was drawn."""
        start = State.at_equilibrium(self._batch.params(0), tilt)
        if self._setup.terrain is None:
            return start
        x, y = self._batch.state(0).ball_position[:2]
        moved = start.replace(
            ball_position=start.ball_position + np.array([x, y, 0.0]),
            body_position=start.body_position + np.array([x, y, 0.0]),
        )
        return self._batch.on_ground(moved)

    def _begun(self, episode: int) -> None:
        self._episode = episode
        self._lying = None
        self._note_begin()

    def _note_begin(self) -> None:
        self.begin = self._batch.state(0).ball_position[:2].copy()

    def start_anew(self, tilt: npt.ArrayLike) -> None:
        """The same with a tilt that another robot has had; one that cannot have it begins in equilibrium."""
        try:
            self.start(tilt)
        except ValueError:
            self.start((0.0, 0.0))

    def go_on_from(self, other: "Robot", tilt: npt.ArrayLike) -> None:
        """Begins the episode that another robot is in, with its draws, where that robot is.

        Slip is left behind where the model has none; a state that it cannot have at all makes the robot start anew,
        with a tilt. Torques under way in the motors are lost; an estimate begins anew at the true state.
        """
        state = other.state
        for _ in range(other._episode - 1 if self._setup.events else 0):
            self._batch.reset()
        if not self._begin_at(other.params, state):
            self.start_anew(tilt)
        self._episode = other._episode

    def _begin_at(self, params: Params, state: State) -> bool:
        """Begins the next episode in a state of a robot, without its slip where it cannot have that; or not at all."""
        rolling = [] if self._setup.terrain is not None else [_rolling(params, state)]
        for candidate in (state, *rolling):
            with contextlib.suppress(ValueError):
                self._batch.reset(starts=[candidate])
                self._begun(self._episode + 1)
                return True
        return False

    def begin_episode(self) -> None:
        """Begins the next episode, with its draws, where the robot is; one that lies waits for `start`.

        A robot that events draw such that it cannot be there starts in equilibrium.
        """
        if self._lying is None and not self._begin_at(self.params, self.state):
            self.start((0.0, 0.0))

    def set_command(self, command: npt.ArrayLike) -> None:
        """Gives a command of the task, which holds to the end of the episode; a robot that lies takes none.

        Raises:
            ValueError: the task has no such command.
        """
        if self._lying is None:
            self._batch.set_command(0, command)
            self._note_begin()

    def set_params(self, params: Params) -> None:
        """Replaces the parameters from which events draw, those of the shape excepted.

        Raises:
            ValueError: there can be no such robot; nothing has changed then.
        """
        self._batch.set_params(0, params)
        if self._lying is not None:
            self._lying.set_params(self._batch.params(0))

    def step(self, torques: FloatArray, steps: int) -> bool:
        """Time steps under commanded torques, N·m; False if the robot has left its ground, or the range of the numbers.

        `steps` is a multiple of the setup's `substeps`.
        """
        actions = np.asarray(torques / self._batch.max_wheel_torque, dtype=np.float32)[np.newaxis]
        for done in range(0, steps, self._setup.substeps):
            if self._lying is not None:
                try:
                    self._lying.step(np.zeros(3), steps - done)
                except DivergedError:
                    return False
                return True
            _, _, terminated, truncated = self._batch.step(actions)
            if truncated[0]:
                return False
            if terminated[0]:
                if self._batch.ending(0)[1] == "diverged":
                    return False
                self._lying = Ballbot(self.params, self._setup.model, self._setup.sim_dt, self._setup.terrain)
                self._lying.reset(self._batch.state(0))
        return True

    def push(self, impulse: npt.ArrayLike) -> None:
        """Gives the body an impulse (inertial frame, N·s) at its center of mass."""
        if self._lying is not None:
            self._lying.push(impulse)
        else:
            self._batch.push(0, impulse)

    @property
    def is_down(self) -> bool:
        """Whether it has touched the floor in this episode."""
        return self._lying is not None

    @property
    def state(self) -> State:
        """The present state."""
        return self._batch.state(0) if self._lying is None else self._lying.state

    @property
    def seen(self) -> State:
        """The state as controllers take it: the last estimate of the episode, or the present state without sensors."""
        return self.state if self._setup.sensors is None else self._batch.estimate(0)

    @property
    def observation(self) -> npt.NDArray[np.float32]:
        """What the task observes, shape (m,): that of the end of the episode for a robot that lies."""
        observation: npt.NDArray[np.float32] = self._batch.observations()[0]
        return observation

    @property
    def command(self) -> FloatArray:
        """The command of the task, shape (k,)."""
        return self._batch.command(0)

    @property
    def setpoint(self) -> dict[str, Any]:
        """What the task asks of a law, by part."""
        return self._batch.setpoint(0)

    @property
    def metrics(self) -> dict[str, float]:
        """The metrics of the task for the episode so far."""
        return self._batch.metrics(0)

    @property
    def contacts(self) -> Contacts:
        """Forces of the last time step."""
        return self._batch.contacts(0) if self._lying is None else self._lying.contacts

    @property
    def params(self) -> Params:
        """The robot that changes and events make."""
        return self._batch.params(0)

    @property
    def motors(self) -> dict[str, Any]:
        """The options of its motors that are not those of ideal ones, in SI units."""
        options = self._batch.actuators(0)
        ideal = {option["name"]: option["default"] for option in ACTUATOR_OPTIONS}
        return {name: value for name, value in options.items() if not np.array_equal(value, ideal[name])}

    @property
    def draws(self) -> dict[str, FloatArray]:
        """What events have drawn, by term; NaN where nothing was."""
        return {name: np.atleast_1d(value) for name, value in self._batch.draws(0).items()}


def _rolling(params: Params, state: State) -> State:
    rolling = State.rolling(params, state.ball_velocity[:2], state.body_quaternion, state.body_angular_velocity)
    position = np.array([*state.ball_position[:2], params.ball_radius])
    return rolling.replace(
        ball_position=position,
        body_position=position,
        ball_quaternion=state.ball_quaternion,
        wheel_angles=state.wheel_angles,
    )
