"""Closed loops of controllers on batches: the one place where robots are stepped for analysis."""

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Ballbot, Batch, Contacts, DivergedError, State
from ballbot_rs.control.resolve import Controller
from ballbot_rs.envs._batch_env import new_batch

Array = npt.NDArray[np.float64]

#: Models without a floor under the body: a robot that has fallen cannot lie.
WITHOUT_FLOOR: Final = ("planar", "spatial")

_Act: TypeAlias = Callable[[npt.NDArray[np.float32]], npt.NDArray[np.float32]]


@dataclasses.dataclass(frozen=True)
class Frame:
    """One control step of all robots of a batch."""

    #: Number of the step, from 0.
    step: int
    #: Before the step, shape (n, 32), rows as `State.to_array`.
    states: Array
    #: Within [-1, 1], shape (n, 3).
    actions: npt.NDArray[np.float32]
    #: Shape (n,).
    rewards: Array
    #: Shape (n,).
    terminated: npt.NDArray[np.bool_]
    #: Shape (n,).
    truncated: npt.NDArray[np.bool_]
    #: Whether an episode that ended with this step was a success, shape (n,).
    success: npt.NDArray[np.bool_]


def batch_for(
    controller: Controller,
    num_envs: int,
    *,
    task: str,
    num_threads: int | None,
    seed: int,
    options: Mapping[str, Any],
) -> Batch:
    """Robots that are reset as soon as they fall, sampled at the rate of the controller unless the options name one."""

    def batch(options: Mapping[str, Any]) -> Batch:
        return new_batch(num_envs, task=task, num_threads=num_threads, seed=seed, options=options)

    if controller.control_dt is None or "control_dt" in options:
        return batch(options)
    usual = new_batch(1, task=task, num_threads=1, options=options)
    control_dt = max(round(controller.control_dt / usual.sim_dt), 1) * usual.sim_dt
    steps = options.get("max_episode_steps", usual.max_episode_steps)
    # The episodes last as long as at the task's own rate.
    steps = None if steps is None else round(steps * usual.control_dt / control_dt)
    return batch({**options, "control_dt": control_dt, "max_episode_steps": steps})


def rollout(
    batch: Batch, controller: Controller, steps: int, starts: Sequence[State | None] | None = None
) -> Iterator[Frame]:
    """Steps a controller on all robots of a batch, from their first episodes on.

    Args:
        batch: the robots; they are reset first.
        controller: on every robot.
        steps: number of control steps.
        starts: states to start from; None draws them.
    """
    act = _bind(controller, batch)
    observations = batch.reset(starts=starts)
    for step in range(steps):
        states = batch.states()
        actions = act(observations)
        observations, rewards, terminated, truncated = batch.step(actions)
        ended = terminated | truncated
        success = batch.endings()[0] & ended if ended.any() else np.zeros_like(ended)
        yield Frame(step, states, actions, rewards.astype(np.float64), terminated, truncated, success)


@dataclasses.dataclass(frozen=True)
class Run:
    """One robot; rows are at the controller's decisions, the last one is the end."""

    states: Sequence[State]
    #: During the time step before the row.
    contacts: Sequence[Contacts]
    #: From a row to the next one, N·m, shape (n - 1, 3).
    torques: Array
    #: Row at which the task counted the robot as fallen and its motors were switched off.
    fell_at: int | None


def run_one(
    batch: Batch, controller: Controller, steps: int, start: State, pushes: Mapping[int, npt.ArrayLike] | None = None
) -> Run:
    """Runs a controller on a batch of one robot; after a fall with the motors off.

    Args:
        batch: one robot.
        controller: on this robot.
        steps: number of control steps.
        start: first state.
        pushes: impulses on the body, N·s, by the number of the step that begins with them.
    """
    act = _bind(controller, batch)
    observations = batch.reset(starts=[start])
    # A batch neither tells its contacts nor goes on after a fall: this robot, with the same torques, does both.
    robot = Ballbot(batch.params, batch.model, batch.sim_dt)
    robot.reset(start)
    substeps = round(batch.control_dt / batch.sim_dt)
    states, contacts, torques = [robot.state], [robot.contacts], []
    fell_at = None
    for step in range(steps):
        action = act(observations) if fell_at is None else np.zeros((1, 3), np.float32)
        torque = action[0].astype(float) * batch.max_wheel_torque
        impulse = (pushes or {}).get(step)
        if impulse is not None:
            robot.push(impulse)
            batch.push(0, impulse)
        try:
            robot.step(torque, substeps)
        except DivergedError:
            fell_at = step if fell_at is None else fell_at
            break
        torques.append(torque)
        states.append(robot.state)
        contacts.append(robot.contacts)
        if fell_at is None:
            observations, _, terminated, _ = batch.step(action)
            if terminated[0]:
                fell_at = step + 1
                if batch.model in WITHOUT_FLOOR:
                    break
    return Run(states, contacts, np.array(torques).reshape(-1, 3), fell_at)


def _bind(controller: Controller, batch: Batch) -> _Act:
    """Actions within [-1, 1] of a controller on the robots of a batch."""
    if controller.policy is not None:
        policy = controller.policy
        return lambda observations: _limited(policy(observations))
    # The environment clips each torque at its own limit; a controller that has this limit keeps their direction.
    params = batch.params.replace(max_wheel_torque=batch.max_wheel_torque)
    laws = controller.laws(batch.num_envs, params, batch.control_dt)

    def act(observations: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:  # noqa: ARG001
        torques = [law(batch.state(i), batch.setpoint) for i, law in enumerate(laws)]
        return _limited(np.asarray(torques, dtype=np.float64) / batch.max_wheel_torque)

    return act


def _limited(actions: npt.ArrayLike) -> npt.NDArray[np.float32]:
    return np.clip(np.asarray(actions, dtype=np.float32), -1.0, 1.0)
