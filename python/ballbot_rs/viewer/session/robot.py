"""One robot: an environment until it touches the floor, an unpowered robot from then on."""

import contextlib
import math
from typing import Any

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import seed_at
from ballbot_rs._core import ACTUATOR_OPTIONS, Ballbot, Contacts, Params, State, Terrain
from ballbot_rs._errors import DivergedError
from ballbot_rs._quaternions import conjugate, product, to_vertical
from ballbot_rs.analysis.lying import lying_robot
from ballbot_rs.envs._batch_env import metric_names, task_metrics
from ballbot_rs.viewer.session.setup import Setup

FloatArray = npt.NDArray[np.float64]

#: Why a robot cannot continue, as returned by `step`.
LEFT, DIVERGED = "left its ground", "left the range of the simulation"


class Robot:
    """Robot `index` of a setup; call `start` or `continue_from` first.

    Raises:
        ValueError: invalid robot, motors, sensors or events.
    """

    def __init__(self, setup: Setup, index: int) -> None:
        self._setup = setup
        self._batch = setup.batch(index)
        self._seed = seed_at(setup.seed, index)
        #: Number of the present episode, from 1, which alone determines its samples.
        self.episode = 0
        self._lying: Ballbot | None = None
        self._is_commanded = False
        #: Position of the ball when the present command was given, m.
        self.begin = np.zeros(2)

    def start(self, tilt: npt.ArrayLike) -> None:
        """Begins the next episode, with its samples: at rest, tilted from the equilibrium, at the origin or on a tile.

        Raises:
            ValueError: a tilt that the robot cannot have; then nothing has changed.
        """
        before = self._batch.snapshot(0)
        self._batch.reset(seeds=[seed_of(self._seed, self.episode + 1)])
        try:
            start = self._sampled_start(tilt)
        finally:
            self._batch.restore(0, before)
        self._begin(start)

    def _sampled_start(self, tilt: npt.ArrayLike) -> State:
        """The sampled robot at rest; on uneven ground on the sampled tile."""
        start = State.at_equilibrium(self._batch.params(0), tilt)
        if self._setup.terrain is None:
            return start
        x, y = self._batch.state(0).ball_position[:2]
        moved = start.replace(
            ball_position=start.ball_position + np.array([x, y, 0.0]),
            body_position=start.body_position + np.array([x, y, 0.0]),
        )
        return self._batch.on_ground(moved)

    def _begin(self, start: State) -> None:
        self._batch.reset(seeds=[seed_of(self._seed, self.episode + 1)], starts=[start])
        self.episode += 1
        self._lying = None
        self._is_commanded = False
        self._note_begin()

    def _note_begin(self) -> None:
        self.begin = self._batch.state(0).ball_position[:2].copy()

    def restart(self, tilt: npt.ArrayLike, episode: int | None = None) -> None:
        """The same with the tilt of another robot; a robot that cannot have it begins in equilibrium.

        Args:
            tilt: as in `start`.
            episode: number of the episode; None is the next.
        """
        if episode is not None:
            self.episode = episode - 1
        try:
            self.start(tilt)
        except ValueError:
            self.start((0.0, 0.0))

    def continue_from(self, other: "Robot", tilt: npt.ArrayLike) -> None:
        """Begins another robot's episode, with its samples, at that robot's state.

        Slip is removed if the model has none; if the model cannot have the state at all, the robot restarts with a
        tilt. Delayed torques in the motors are lost; an estimate restarts at the true state.
        """
        self.episode = other.episode - 1
        if not self._begin_at(other.params, other.state):
            self.restart(tilt)

    def _begin_at(self, params: Params, state: State) -> bool:
        """Begins the next episode in a state of a robot, without slip where the model has none; or not at all."""
        terrain = self._setup.terrain
        can_roll = terrain is None or math.isinf(terrain.size[0])
        for candidate in (state, *([without_slip(params, state, terrain)] if can_roll else [])):
            with contextlib.suppress(ValueError):
                self._begin(candidate)
                return True
        return False

    def begin_episode(self) -> None:
        """Begins the next episode, with its samples, at the robot's position; a robot that lies waits for `start`.

        A robot whose sampled parameters do not allow this state starts in equilibrium.
        """
        if self._lying is None and not self._begin_at(self.params, self.state):
            self.start((0.0, 0.0))

    def set_command(self, command: npt.ArrayLike) -> None:
        """Sets the task's command, which holds to the end of the episode; a robot that lies ignores it.

        Raises:
            ValueError: the task has no such command.
        """
        if self._lying is None:
            self._batch.set_command(0, command)
            self._is_commanded = True
            self._note_begin()

    def set_params(self, params: Params) -> None:
        """Replaces the nominal parameters for the events, except the shape.

        Raises:
            ValueError: invalid parameters; then nothing has changed.
        """
        self._batch.set_params(0, params)
        if self._lying is not None:
            self._lying.set_params(self._batch.params(0))

    def step(self, torques: FloatArray, steps: int) -> str | None:
        """Time steps under commanded torques, N·m. Returns None, or why it cannot continue: `LEFT` or `DIVERGED`.

        `steps` is a multiple of the setup's `substeps`. On the next tile of a terrain the next episode begins.
        """
        actions = np.asarray(torques / self._batch.max_wheel_torque, dtype=np.float32)[np.newaxis]
        for done in range(0, steps, self._setup.substeps):
            if self._lying is not None:
                try:
                    self._lying.step(np.zeros(3), steps - done)
                except DivergedError:
                    return DIVERGED
                return None
            _, _, terminated, truncated = self._batch.step(actions)
            if truncated[0] and not self._cross():
                return LEFT
            if terminated[0] and not self._continues(self._batch.ending(0)[1]):
                return DIVERGED
        return None

    def _continues(self, reason: str | None) -> bool:
        """Continues after the end of an episode: on the floor, or in the next episode where Python has ended it."""
        stage = self._batch.stage
        if stage is not None and reason in dict(stage.terminations) and self._begin_at(self.params, self.state):
            return True
        return reason != "diverged" and self._lie()

    def _cross(self) -> bool:
        """Begins the next episode on the robot's tile, with its manual command; False if there is no tile."""
        terrain, state = self._setup.terrain, self.state
        x, y = state.ball_position[:2].tolist()
        if terrain is None or not terrain.contains(x, y):
            return False
        command = self.command if self._is_commanded else None
        if not self._begin_at(self.params, state):
            return False
        if command is not None:
            self.set_command(command)
        return True

    def _lie(self) -> bool:
        """Continues unpowered; False for a state from which it cannot continue."""
        setup = self._setup
        state, payloads = self._batch.state(0), self._batch.payloads()[0]
        self._lying = lying_robot(self.params, setup.model, setup.sim_dt, setup.terrain, state, payloads)
        return self._lying is not None

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
        """The state for controllers: the last estimate of the episode, or the present state without sensors."""
        return self.state if self._setup.sensors is None else self._batch.estimate(0)

    @property
    def readings(self) -> dict[str, FloatArray]:
        """The last readings of its sensors."""
        return self._batch.readings(0)

    @property
    def observation(self) -> npt.NDArray[np.float32]:
        """The task's observation, shape (m,); for a robot that lies, at the end of the episode."""
        observation: npt.NDArray[np.float32] = self._batch.observations()[0]
        return observation

    @property
    def command(self) -> FloatArray:
        """The command of the task, shape (k,)."""
        return self._batch.command(0)

    @property
    def setpoint(self) -> dict[str, Any]:
        """The task's setpoint for a law, by part."""
        return self._batch.setpoint(0)

    @property
    def drawing(self) -> FloatArray:
        """Points of the line that a task in Python draws, shape (k, 2), m."""
        stage = self._batch.stage
        found = None if stage is None else stage.drawing()
        return np.empty((0, 2)) if found is None else found[0]

    def click(self, point: FloatArray) -> None:
        """Gives a click on the floor to the task in Python, m; a robot that lies ignores it."""
        if self._lying is None and self._batch.stage is not None:
            self._batch.stage.click(point)

    @property
    def metrics(self) -> dict[str, float]:
        """The metrics of the task for the episode so far."""
        return dict(zip(metric_names(self._batch.task), task_metrics(self._batch)[0].tolist(), strict=True))

    @property
    def contacts(self) -> Contacts:
        """Forces of the last time step."""
        return self._batch.contacts(0) if self._lying is None else self._lying.contacts

    @property
    def payloads(self) -> FloatArray:
        """Deflections of the payloads, as `Ballbot.payloads`."""
        return self._batch.payloads()[0] if self._lying is None else self._lying.payloads

    @property
    def params(self) -> Params:
        """The robot's parameters after changes and events."""
        return self._batch.params(0)

    @property
    def motors(self) -> dict[str, Any]:
        """The options of its motors that differ from ideal motors, in SI units."""
        options = self._batch.actuators(0)
        ideal = {option["name"]: option["default"] for option in ACTUATOR_OPTIONS}
        return {name: value for name, value in options.items() if not np.array_equal(value, ideal[name])}

    @property
    def draws(self) -> dict[str, FloatArray]:
        """Samples of the events, by term; NaN where nothing was sampled."""
        return {name: np.atleast_1d(value) for name, value in self._batch.draws(0).items()}


def seed_of(seed: int, episode: int) -> int:
    """Seed of an environment whose first episode is a robot's episode by number: samples do not depend on the past.

    The first episode has the seed itself.
    """
    if episode == 1:
        return seed
    return int(np.random.SeedSequence([seed, episode]).generate_state(1, np.uint64)[0])


def without_slip(params: Params, state: State, plane: Terrain | None) -> State:
    """The ball rolls with its velocity, attitude and rate of the body remain, and all parts are in contact.

    Args:
        params: the robot.
        state: any state.
        plane: the ground, a plane; None is level.
    """
    up = np.array([0.0, 0.0, 1.0]) if plane is None else plane.normal(0.0, 0.0)
    # From the inertial frame to a frame with the ground's normal as its z axis.
    level = to_vertical(up)
    there = conjugate(level)
    velocity = _turn(level, state.ball_velocity)
    found = State.rolling(params, velocity[:2], product(level, state.body_quaternion), state.body_angular_velocity)
    # The ground passes through the origin.
    position = state.ball_position + (params.ball_radius - state.ball_position @ up) * up
    return found.replace(
        ball_position=position,
        body_position=position,
        ball_quaternion=state.ball_quaternion,
        ball_velocity=_turn(there, found.ball_velocity),
        ball_angular_velocity=_turn(there, found.ball_angular_velocity),
        body_quaternion=state.body_quaternion,
        body_velocity=_turn(there, found.body_velocity),
        wheel_angles=state.wheel_angles,
    )


def _turn(quaternion: FloatArray, vector: FloatArray) -> FloatArray:
    return product(product(quaternion, np.append(0.0, vector)), conjugate(quaternion))[1:]
