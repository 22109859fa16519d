"""One robot under one controller, and everything that can be seen of it."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Ballbot, Contacts, DivergedError, Params, State
from ballbot_rs.control.resolve import Controller, common_options, find
from ballbot_rs.envs.registration import BALANCE

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
    #: Of the wheels, N·m, shape (n, 3); the last row repeats the one before.
    torques: Array
    #: Time at which the robot counted as fallen and its motors were switched off, s; None if it never did.
    fell_at: float | None

    def of_states(self, name: str) -> Array:
        """An attribute of all states, for example `tilt`."""
        return np.array([getattr(state, name) for state in self.states])

    def of_contacts(self, name: str) -> Array:
        """An attribute of all contacts, for example `wheel_normal_forces`."""
        return np.array([getattr(contacts, name) for contacts in self.contacts])


def run(
    controller: str | Controller,
    *,
    seconds: float = 5.0,
    tilt: tuple[float, float] = (0.05, 0.0),
    yaw: float = 0.0,
    push: Push | None = None,
    env_id: str = BALANCE,
    env_options: Mapping[str, Any] | None = None,
) -> Trajectory:
    """Runs a controller on a robot that starts at rest, tilted.

    The robot is that of the task; once the task counts it as fallen its motors are off. A model that cannot lie on
    the floor ends there.

    Args:
        controller: a name or a path, as `controllers.find` takes it.
        seconds: simulated time.
        tilt: initial tilt components, rad.
        yaw: initial heading, rad.
        push: on the body.
        env_id: the task.
        env_options: arguments of the environment, over those that a policy was trained with.

    Raises:
        ValueError: a number out of range, or as `controllers.find`.
    """
    if not 0.0 < seconds <= 3600.0:
        raise ValueError(f"seconds = {seconds} is out of range: it must be above 0 and at most 3600")
    if push is not None and not 0.0 <= push.time < seconds:
        raise ValueError(f"a push at {push.time} s is out of range: it must be from 0 to before the end, {seconds} s")
    found = find(controller, env_id) if isinstance(controller, str) else controller
    # Nothing ends an episode but a fall: lengths in steps are for the first, lower rate.
    options = {**common_options([found], env_options), "max_episode_steps": 10_000_000}
    batch = found.batch(1, 1, 0, options)
    act = found.on(batch)
    start = State.upright(batch.params, tilt=tilt, yaw=yaw)
    observations = batch.reset(starts=[start])
    robot = Ballbot(batch.params, batch.model, batch.sim_dt)
    robot.reset(start)
    substeps = round(batch.control_dt / batch.sim_dt)
    steps = max(round(seconds / batch.control_dt), 1)
    push_step = None if push is None else min(round(push.time / batch.control_dt), steps - 1)
    fell_at = None
    states, contacts, torques = [robot.state], [robot.contacts], []
    for step in range(steps):
        if fell_at is None:
            action = np.clip(np.asarray(act(observations), np.float32), -1.0, 1.0)
            torque = action[0].astype(float) * batch.max_wheel_torque
        else:
            torque = np.zeros(3)
        if push is not None and step == push_step:
            robot.push(push.impulse)
            batch.push(0, push.impulse)
        try:
            robot.step(torque, substeps)
        except DivergedError:
            fell_at = fell_at if fell_at is not None else step * batch.control_dt
            break
        torques.append(torque)
        states.append(robot.state)
        contacts.append(robot.contacts)
        if fell_at is None:
            observations, _, terminated, _ = batch.step(action)
            if terminated[0]:
                fell_at = (step + 1) * batch.control_dt
                if batch.model in ("planar", "spatial"):
                    break
    torques.append(torques[-1] if torques else np.zeros(3))
    return Trajectory(
        controller=found.name,
        model=batch.model,
        params=batch.params,
        times=np.array([row * batch.control_dt for row in range(len(states))]),
        states=states,
        contacts=contacts,
        torques=np.array(torques),
        fell_at=fell_at,
    )
