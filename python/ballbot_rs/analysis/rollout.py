"""Controllers on the robots of a batch: the batch for a controller, chunks of rows, and one robot in detail."""

import dataclasses
import math
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Batch, Contacts, State
from ballbot_rs._errors import DivergedError, InvalidInputError
from ballbot_rs.analysis.actors import core_law, make_actor, observes_estimates
from ballbot_rs.analysis.closed_loop import ClosedLoop
from ballbot_rs.analysis.lying import lying_robot
from ballbot_rs.analysis.pushes import Impulse
from ballbot_rs.control.resolve import ResolvedController
from ballbot_rs.envs._batch_env import new_batch
from ballbot_rs.envs.family import are_several

Array = npt.NDArray[np.float64]

#: Models without a floor under the body: a fallen robot cannot lie.
WITHOUT_FLOOR: Final = ("planar", "spatial")

#: Control steps that are kept in memory at once.
CHUNK: Final = 50

#: Tolerance, in time steps, for a controller's period to count as a multiple of the time step.
ROUNDING: Final = 1e-6

_RECORD: Final = ("states", "torques", "rewards", "terminated", "truncated", "success", "metrics", "push_counts")


@dataclasses.dataclass(frozen=True)
class Chunk:
    """Control steps of all robots of a batch; the first axis is time, the second the robot."""

    #: Number of the first step, from 0.
    first: int
    #: Before each step, shape (k, n, 32), rows as `State.to_array`.
    states: Array
    #: Of the wheels, as commanded, N·m, shape (k, n, 3).
    torques: Array
    #: Shape (k, n).
    rewards: Array
    #: Shape (k, n).
    terminated: npt.NDArray[np.bool_]
    #: Shape (k, n).
    truncated: npt.NDArray[np.bool_]
    #: Whether an episode that ended with a step was a success, shape (k, n).
    success: npt.NDArray[np.bool_]
    #: Of the task, of the episode that a step belongs to, shape (k, n, metrics).
    metrics: Array
    #: Pushes from events and the task on each robot in its episode, up to the end of the step, shape (k, n).
    push_counts: Array
    #: CoM of each robot in its first episode, body frame, m, shape (n, 3).
    com: Array

    def __len__(self) -> int:
        return len(self.rewards)


def batch_for(
    controller: ResolvedController,
    num_envs: int,
    *,
    task: str,
    num_threads: int | None,
    seed: int,
    options: Mapping[str, Any],
    given: Container[str] | None = None,
    autoreset: str = "same_step",
) -> Batch:
    """Robots at the control rate of the controller unless the options name a rate.

    Some options may come from a policy and not from the caller: a `control_dt` that is not in `given` (None: all are)
    does not override the rate of a controller that has one. A time step that was not requested is shortened so that it
    divides the controller's period.

    A feedback law has its own torque limit; unless the options name a limit, the batch has the limit of the motors, or,
    if it has several robots, the default of each.

    Raises:
        ValueError: options out of range, or a requested time step that does not divide the controller's period.
    """
    if controller.policy is None and options.get("max_wheel_torque") is None:
        limit = None
        if not are_several(options.get("robot")):
            limit = new_batch(1, task=task, num_threads=1, options=options).nominal_params(0).max_wheel_torque
        options = {**options, "max_wheel_torque": limit, "scale_by_robot": False}

    def batch(options: Mapping[str, Any]) -> Batch:
        return new_batch(num_envs, task=task, autoreset=autoreset, num_threads=num_threads, seed=seed, options=options)

    asked_for = options if given is None else given
    if controller.control_dt is None or ("control_dt" in options and "control_dt" in asked_for):
        return batch(options)
    usual = new_batch(1, task=task, num_threads=1, options=options)
    control_dt, sim_dt = controller.control_dt, usual.sim_dt
    substeps = math.ceil(control_dt / sim_dt - ROUNDING)
    if abs(control_dt / sim_dt - substeps) > ROUNDING:
        if "sim_dt" in options and "sim_dt" in asked_for:
            raise InvalidInputError(
                f"{controller.name} has control_dt = {control_dt:g} s, which is not a multiple of "
                f"sim_dt = {sim_dt:g} s: leave out sim_dt, or name a control_dt"
            )
        sim_dt = control_dt / substeps
    steps = options.get("max_episode_steps", usual.max_episode_steps)
    # The episodes last as long as at the task's rate.
    steps = None if steps is None else max(round(steps * usual.control_dt / control_dt), 1)
    return batch({**options, "control_dt": control_dt, "sim_dt": sim_dt, "max_episode_steps": steps})


def rollout(
    batch: Batch, controller: ResolvedController, steps: int, starts: Sequence[State | None] | None = None
) -> Iterator[Chunk]:
    """Steps a controller on all robots of a batch, starting with their first episodes.

    Args:
        batch: the robots; they are reset first.
        controller: on every robot; controllers of the core run without Python in the loop.
        steps: number of control steps.
        starts: states to start from; None samples them.
    """
    # The core has no other engines, and no metrics of tasks in Python.
    law = core_law(controller, batch) if isinstance(batch, Batch) and not _has_metrics(batch) else None
    loop = ClosedLoop(batch, law or make_actor(controller, batch))
    loop.reset(starts=starts)
    # Before the next episode samples other robots.
    com = np.array([batch.params(i).body_com for i in range(batch.num_envs)])
    for first in range(0, steps, CHUNK):
        length = min(CHUNK, steps - first)
        found: dict[str, Any] = loop.rows(length, _RECORD)
        found["states"] = found["states"][:-1]
        found["success"] &= found["terminated"] | found["truncated"]
        # A single number per robot has no axis in the core.
        found["metrics"] = found["metrics"].reshape(length, batch.num_envs, -1)
        yield Chunk(first, **found, com=com)


def _has_metrics(batch: Batch) -> bool:
    return batch.stage is not None and batch.stage.metrics is not None


@dataclasses.dataclass(frozen=True)
class Run:
    """One robot; rows are at the controller's decisions, the last row is the end."""

    states: Sequence[State]
    #: During the time step before the row.
    contacts: Sequence[Contacts]
    #: As `Batch.payloads`, shape (n, 2, 6); shape (0, 2, 6) of a robot without payload.
    payloads: Array
    #: From a row to the next row, as commanded, N·m, shape (n - 1, 3).
    torques: Array
    #: Samples of the events at each row, by term, as `Batch.draws`.
    draws: Sequence[Mapping[str, Any]]
    #: States as the task observes them at each row up to a fall; empty where it observes the true states.
    estimates: Sequence[State]
    #: Command of the task at each row up to a fall, shape (m, k).
    commands: Array
    #: Setpoint of the task at each row, by part; the last setpoint stays after a fall.
    setpoints: Sequence[Mapping[str, Any]]
    #: Row at which the task counted the robot as fallen and its motors were switched off.
    fell_at: int | None


def run_one(
    batch: Batch,
    controller: ResolvedController,
    steps: int,
    start: State,
    pushes: Mapping[int, Sequence[Impulse]] | None = None,
    seed: int | None = None,
    setpoint: Callable[[int], Mapping[str, Any]] | None = None,
) -> Run:
    """Runs a controller on a batch of one robot; after a fall the motors are off.

    Args:
        batch: one robot, not reset by itself.
        controller: on this robot.
        steps: number of control steps.
        start: initial state.
        pushes: impulses on the body by the number of the step that starts with them.
        seed: reseeds the random numbers of events; None continues with them.
        setpoint: parts of the setpoint by the number of the step; None is the task's.
    """
    pushes = pushes or {}
    loop = ClosedLoop(batch, make_actor(controller, batch))
    loop.reset(seeds=[seed], starts=[start])
    states, contacts, draws = [batch.state(0)], [batch.contacts(0)], [batch.draws(0)]
    payloads, carried = [batch.payloads()[0]], batch.params(0).has_payload
    estimates, commands, setpoints = _estimates(batch), [_command(batch)], [batch.setpoint(0)]
    torques: list[Array] = []
    fell_at = None

    def push(number: int) -> None:
        for impulse, point in pushes.get(number, ()):
            batch.push(0, impulse, point)

    for number, step in enumerate(loop.steps(steps, setpoint, before_motion=push)):
        if batch.ending(0)[1] == "diverged":
            fell_at = number
            break
        torques.append(step.actions[0].astype(float) * batch.max_wheel_torque)
        states.append(batch.state(0))
        contacts.append(batch.contacts(0))
        payloads.append(batch.payloads()[0])
        draws.append(batch.draws(0))
        estimates += _estimates(batch)
        commands.append(_command(batch))
        setpoints.append(batch.setpoint(0))
        if step.terminated[0]:
            fell_at = number + 1
            _lie(batch, states, contacts, payloads, torques, steps, pushes)
            # No event fires on a robot that lies, and no task changes its setpoint.
            draws += [draws[-1]] * (len(states) - len(draws))
            setpoints += [setpoints[-1]] * (len(states) - len(setpoints))
            break
        if step.truncated[0]:
            # The end of the ground, or of a task that sets its own last step.
            break
    # Events load and unload robots.
    carried = carried or batch.params(0).has_payload or bool(np.any(payloads))
    return Run(
        states=states,
        contacts=contacts,
        payloads=np.array(payloads if carried else []).reshape(-1, 2, 6),
        torques=np.array(torques).reshape(-1, 3),
        draws=draws,
        estimates=estimates,
        commands=np.array(commands),
        setpoints=setpoints,
        fell_at=fell_at,
    )


def _estimates(batch: Batch) -> list[State]:
    """The present estimate of the only robot, if its task observes estimates."""
    return [batch.estimate(0)] if observes_estimates(batch) else []


def _command(batch: Batch) -> Array:
    """The present command of the only robot's task; empty without a command."""
    return np.array(batch.command(0), dtype=np.float64)


def _lie(
    batch: Batch,
    states: list[State],
    contacts: list[Contacts],
    payloads: list[Array],
    torques: list[Array],
    steps: int,
    pushes: Mapping[int, Sequence[Impulse]],
) -> None:
    """Continues after a fall, motors off, to the end of the time; without the batch, since the episode has ended."""
    if batch.model in WITHOUT_FLOOR:
        return
    robot = lying_robot(batch.params(0), batch.model, batch.sim_dt, batch.terrain, states[-1], payloads[-1])
    if robot is None:
        return
    for step in range(len(torques), steps):
        for impulse, point in pushes.get(step, ()):
            robot.push(impulse, point)
        try:
            robot.step(np.zeros(3), batch.substeps)
        except DivergedError:
            return
        torques.append(np.zeros(3))
        states.append(robot.state)
        contacts.append(robot.contacts)
        payloads.append(robot.payloads)
