"""One robot under one controller, along a reference, under pushes and forces."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from typing_extensions import Unpack

from ballbot_rs._checks import check_real, check_seed, real_array
from ballbot_rs._core import Batch, Reference, State
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._keywords import named
from ballbot_rs.analysis import pushes as impulses_of
from ballbot_rs.analysis.drawn_pushes import drawn_pushes
from ballbot_rs.analysis.pushes import Force, Push
from ballbot_rs.analysis.rollout import batch_for, run_one
from ballbot_rs.analysis.trajectory import Trajectory
from ballbot_rs.control.resolve import ResolvedController, Source, common_options, common_task, find
from ballbot_rs.control.setpoints import checked
from ballbot_rs.envs._batch_env import has_fall_tilt, option_names
from ballbot_rs.envs.family import check_room
from ballbot_rs.envs.options import TaskOptions

#: What a controller follows: a motion, parts of a setpoint by time (s), or constant parts.
Target: TypeAlias = Reference | Callable[[float], Mapping[str, Any]] | Mapping[str, Any]

#: Simulated time without a reference that ends, s.
SECONDS = 5.0

#: Largest component of the tilt at a start, rad: a robot that lies on its side.
MAX_TILT = math.pi / 2


@named
def simulate(
    controller: Source,
    *,
    reference: Target | None = None,
    pushes: Push | Sequence[Push] = (),
    forces: Force | Sequence[Force] = (),
    seconds: float | None = None,
    start: State | None = None,
    position: npt.ArrayLike | None = None,
    tilt: npt.ArrayLike = (0.0, 0.0),
    yaw: float | None = None,
    task: str | None = None,
    seed: int = 0,
    **options: Unpack[TaskOptions],
) -> Trajectory:
    """Runs a controller on one robot; the result can plot, record and export itself.

    ```python
    push = bb.Push((2.0, 0.0, 0.0), time=2.0)
    path = bb.simulate("lqr", robot="kugle", actuators="kugle", pushes=push)
    print(path.metrics())
    ```

    The robot begins at rest in equilibrium, except for its tilt. Once the task counts it as fallen its motors are off;
    a model whose robot cannot lie on the floor ends there. An episode that ends without a fall, as at the end of the
    ground, ends the trajectory.

    Args:
        controller: a name, a path, or a law or class of laws in Python, as in `compare`; also "tvlqr", for which
            `optimize_trajectory` plans the motion along a `Reference`, or to a constant position, from the state in
            which the robot starts.
        reference: a `Reference`, a function that returns parts of a setpoint at a time (s), or a dict of constant
            parts, such as {"position": (1.0, 0.0)}; parts that a controller does not follow are omitted. A `Reference`
            without `robot` is made for this robot; the function `lambda time: reference(time)` leaves it as it was
            made. None is the setpoint of the task.
        pushes: an impulse on the body, or several, at once or over a duration.
        forces: a constant force on the body, or several. Both act as impulses at the starts of control steps.
        seconds: simulated time; None: to the end of the reference (of its first turn at full speed for a circle or
            lemniscate), or 5 s without an end.
        start: initial state, in place of position, tilt and yaw.
        position: position of the ball over the ground, shape (2,), m; None is the start of the reference, or the origin
            without a reference or for constant parts.
        tilt: from the equilibrium, components (x, y), rad; on a slope added to the equilibrium lean there. Beyond the
            option `fall_tilt` of the task the robot counts as fallen from the start.
        yaw: heading, rad; None as for `position`.
        task: name of the task, as in `compare`.
        seed: of the events and sensors.
        options: of the environment, as `robot`, `model`, `actuators` and `terrain`; they override the options that a
            policy was trained with.

    Raises:
        ValueError: a number out of range, an unknown part of a setpoint, a `Reference` that this robot cannot follow
            or that was made for another robot, or as `compare`.
        TypeError: an argument of the wrong type or of an unknown name, or a reference that the controller cannot
            follow.
        ControllerError: a controller in Python failed.
    """
    given = dict(options)
    check_room(given.get("robot"), 1)
    seconds = simulated_seconds(seconds, reference)
    pushes, forces = impulses_of.checked(pushes, forces, seconds)
    seed = check_seed(seed)
    check_tilt(tilt)
    if reference is not None and not isinstance(reference, Reference):
        _target(reference)
    found = find(controller, task=task, env_options=given)
    planned = found.is_planned
    named = common_task([found], task)

    def batch_of(found: ResolvedController) -> Batch:
        # Only a fall ends the episode: lengths in steps are for the task's own rate.
        env_options = {**common_options([found], given), "max_episode_steps": None}
        return batch_for(
            found,
            1,
            task=named,
            num_threads=1,
            seed=seed,
            options=with_given_starts(env_options, named),
            given=given,
            autoreset="disabled",
        )

    batch = batch_of(found)
    if isinstance(reference, Reference):
        reference = reference.for_robot(batch.nominal_params(0))
    target = None if reference is None else _target(reference)
    begins = target(0.0) if target is not None and not isinstance(reference, Mapping) else {}
    if planned:
        # Other laws need not wait for this import.
        from ballbot_rs.optimal.trajectory import planned_law

        first = _start(batch, start, position, tilt, yaw, begins)
        found = find(planned_law(reference, start=first, seconds=seconds, options=given))
        batch = batch_of(found)
    steps = max(round(seconds / batch.control_dt), 1)
    # The robot that events make for the episode to come.
    batch.reset(seeds=[seed])
    done = run_one(
        batch,
        found,
        steps,
        _start(batch, start, position, tilt, yaw, begins),
        impulses_of.impulses(pushes, forces, steps, batch.control_dt),
        seed,
        # A planned law has the whole reference in it.
        None if target is None or planned else lambda step: target(step * batch.control_dt),
    )
    times = np.array([row * batch.control_dt for row in range(len(done.states))])
    draws = {term: np.array([row[term] for row in done.draws]) for term in done.draws[0]}
    last = done.torques[-1:] if len(done.torques) else np.zeros((1, 3))
    return Trajectory(
        controller=found.name,
        model=batch.model,
        params=batch.params(0),
        times=times,
        states=done.states,
        contacts=done.contacts,
        payloads=done.payloads,
        torques=np.concatenate([done.torques, last]),
        draws=draws,
        estimates=done.estimates,
        fell_at=None if done.fell_at is None else done.fell_at * batch.control_dt,
        setpoints=_setpoints(done.setpoints if target is None else [target(float(time)) for time in times]),
        terrain=batch.terrain,
        pushes=pushes,
        forces=forces,
        max_wheel_torque=batch.max_wheel_torque,
        commands=done.commands,
        task=named,
        control_dt=batch.control_dt,
        sim_dt=batch.sim_dt,
        fall_tilt=batch.options["fall_tilt"] if has_fall_tilt(named) else None,
        drawn_pushes=drawn_pushes(draws, times, batch.options["events"], batch.nominal_params(0).body_mass),
    )


def check_tilt(tilt: npt.ArrayLike) -> None:
    """Checks components of the tilt at a start.

    Raises:
        TypeError: they are not numbers.
        ValueError: one is beyond a right angle, as where degrees are given.
    """
    angles = real_array("tilt is", tilt, "components (x, y)")
    if (beyond := angles[np.abs(angles) > MAX_TILT]).size:
        value = f"{beyond[0]:g}"
        raise InvalidInputError(
            f"tilt = {value} is out of range: it must be within ±pi/2 rad; did you mean math.radians({value})?"
        )


def with_given_starts(options: Mapping[str, Any], task: str) -> dict[str, Any]:
    """Options of an environment that does not sample its starts: their range does not restrict the ground."""
    return {**({"reset_tilt": 0.0} if "reset_tilt" in option_names(task) else {}), **options}


def simulated_seconds(seconds: float | None, reference: Target | None = None) -> float:
    """Simulated time, s; None is until the reference ends or has gone around once, or `SECONDS`.

    Raises:
        TypeError: it is not a number.
        ValueError: it is out of range.
    """
    if seconds is None:
        ends = (reference.duration, reference.first_turn) if isinstance(reference, Reference) else ()
        seconds = next(filter(None, ends), SECONDS)
    seconds = check_real("seconds", seconds)
    if not 0.0 < seconds <= 3600.0:
        raise ValueError(f"seconds = {seconds} is out of range: it must be above 0 and at most 3600")
    return seconds


def _target(reference: Target) -> Callable[[float], dict[str, Any]]:
    """Checked parts of the setpoint by time, s."""
    if isinstance(reference, Mapping):
        parts = checked(reference)
        return lambda time: parts  # noqa: ARG005
    if not callable(reference):
        raise TypeError(f"reference must be a Reference, a function of time or a dict, not {type(reference).__name__}")
    at: Callable[[float], Mapping[str, Any]] = reference

    def target(time: float) -> dict[str, Any]:
        parts = at(time)
        if not isinstance(parts, Mapping):
            raise TypeError(f"the reference gave {parts!r} at {time:g} s: expected a dict of parts of a setpoint")
        return checked(parts)

    return target


def _start(
    batch: Batch,
    start: State | None,
    position: npt.ArrayLike | None,
    tilt: npt.ArrayLike,
    yaw: float | None,
    begins: Mapping[str, Any],
) -> State:
    if start is not None:
        if position is not None or yaw is not None or np.any(np.asarray(tilt)):
            raise TypeError("start is a whole state: leave out position, tilt and yaw")
        if not isinstance(start, State):
            raise TypeError(f"start must be a State, not {type(start).__name__}")
        return start
    heading = float(begins.get("yaw", 0.0)) if yaw is None else yaw
    state = State.at_equilibrium(batch.params(0), tilt=tilt, yaw=heading)
    place = begins.get("position") if position is None else checked({"position": position})["position"]
    if place is not None:
        away = np.append(place, 0.0)
        state = state.replace(ball_position=state.ball_position + away, body_position=state.body_position + away)
    return batch.on_ground(state)


def _setpoints(rows: Sequence[Mapping[str, Any]]) -> dict[str, npt.NDArray[np.float64]]:
    """Parts of the setpoint at all rows, always with the position."""
    names = dict.fromkeys(part for row in rows for part in row)
    # A part that is not named is zero.
    zeros = {part: np.zeros(np.shape(next(row[part] for row in rows if part in row))) for part in names}
    parts = {part: np.array([row.get(part, zeros[part]) for row in rows]) for part in names}
    return {"position": np.zeros((len(rows), 2)), **parts}
