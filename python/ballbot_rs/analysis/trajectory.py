"""One robot under one controller: states, contacts and torques over time."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import check_seed
from ballbot_rs._core import Contacts, Params, State
from ballbot_rs.analysis.rollout import batch_for, run_one
from ballbot_rs.control.resolve import Source, common_options, find
from ballbot_rs.envs.registration import DEFAULT_TASK

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Push:
    """An impulse on the body at a time."""

    #: Inertial frame, N·s.
    impulse: tuple[float, float, float]
    #: s.
    time: float = 1.0


@dataclasses.dataclass(frozen=True)
class Trajectory:
    """Rows at the times of the controller's decisions; torques hold from a row to the next."""

    controller: str
    model: str
    params: Params
    #: s, shape (n,).
    times: Array
    states: Sequence[State]
    #: Forces during the time step before the row.
    contacts: Sequence[Contacts]
    #: Of the wheels, as commanded, N·m, shape (n, 3); the last row repeats the one before.
    torques: Array
    #: What events had drawn at each row, by term, shape (n,) or (n, k), as `Batch.draws`; NaN where nothing was. Empty
    #: without events.
    draws: Mapping[str, Array]
    #: States as the task observes them, up to a fall; empty where it observes the true ones.
    estimates: Sequence[State]
    #: Time at which the robot counted as fallen and its motors were switched off, s; None if it never did.
    fell_at: float | None

    def of_states(self, name: str) -> Array:
        """An attribute of all states, for example `tilt`."""
        return np.array([getattr(state, name) for state in self.states])

    def of_estimates(self, name: str) -> Array:
        """An attribute of all estimates."""
        return np.array([getattr(state, name) for state in self.estimates])

    def of_contacts(self, name: str) -> Array:
        """An attribute of all contacts, for example `wheel_normal_forces`."""
        return np.array([getattr(contacts, name) for contacts in self.contacts])


def run(
    controller: Source,
    *,
    seconds: float = 5.0,
    tilt: tuple[float, float] = (0.05, 0.0),
    yaw: float = 0.0,
    push: Push | None = None,
    task: str | None = None,
    env_options: Mapping[str, Any] | None = None,
    seed: int = 0,
) -> Trajectory:
    """Runs a controller on a robot that starts at rest, tilted.

    The robot is that of the task; once the task counts it as fallen its motors are off. A model that cannot lie on
    the floor ends there.

    Args:
        controller: a name, a path or an object, as in `compare`.
        seconds: simulated time.
        tilt: initial tilt components, rad.
        yaw: initial heading, rad.
        push: on the body.
        task: name of the task, as in `compare`.
        env_options: options of the environment, over those that a policy was trained with.
        seed: of the events.

    Raises:
        ValueError: a number out of range, or as `compare`.
        TypeError: an argument of the wrong type.
    """
    if not 0.0 < seconds <= 3600.0:
        raise ValueError(f"seconds = {seconds} is out of range: it must be above 0 and at most 3600")
    if push is not None and not isinstance(push, Push):
        raise TypeError(f"push must be a Push, not {type(push).__name__}")
    if push is not None and not 0.0 <= push.time < seconds:
        raise ValueError(f"a push at {push.time} s is out of range: it must be from 0 to before the end, {seconds} s")
    seed = check_seed(seed)
    found = find(controller, task=task, env_options=env_options)
    # Only a fall ends the episode: lengths in steps are for the task's own rate.
    options = {**common_options([found], env_options), "max_episode_steps": None}
    batch = batch_for(
        found,
        1,
        task=task or DEFAULT_TASK,
        num_threads=1,
        seed=seed,
        options=options,
        given=env_options or (),
        autoreset="disabled",
    )
    steps = max(round(seconds / batch.control_dt), 1)
    pushes = {} if push is None else {min(round(push.time / batch.control_dt), steps - 1): push.impulse}
    # The robot that events make for the episode to come.
    batch.reset(seeds=[seed])
    start = State.at_equilibrium(batch.params(0), tilt=tilt, yaw=yaw)
    done = run_one(batch, found, steps, start, pushes, seed)
    last = done.torques[-1:] if len(done.torques) else np.zeros((1, 3))
    return Trajectory(
        controller=found.name,
        model=batch.model,
        params=batch.params(0),
        times=np.array([row * batch.control_dt for row in range(len(done.states))]),
        states=done.states,
        contacts=done.contacts,
        torques=np.concatenate([done.torques, last]),
        draws={term: np.array([row[term] for row in done.draws]) for term in done.draws[0]},
        estimates=done.estimates,
        fell_at=None if done.fell_at is None else done.fell_at * batch.control_dt,
    )
