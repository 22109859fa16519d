"""How much each parameter of a robot changes its motion under a controller that was made without the change."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Params, State
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._progress import Progress, no_progress
from ballbot_rs._state_rows import tilt_components_of
from ballbot_rs.analysis import pushes as impulses_of
from ballbot_rs.analysis.actors import core_law, make_actor
from ballbot_rs.analysis.closed_loop import ClosedLoop
from ballbot_rs.analysis.pushes import Push
from ballbot_rs.analysis.rollout import batch_for
from ballbot_rs.control.resolve import Source, common_options, common_task, find
from ballbot_rs.envs.family import first_of
from ballbot_rs.identification.motors import Motors
from ballbot_rs.identification.parameters import BIASES, MOTORS, Robot, fitted, known_fields, unit_of

Array = npt.NDArray[np.float64]

#: The change of a parameter, as a fraction of its typical size: of its value, or of a small effect if it may be zero.
CHANGE: Final = 0.1
#: Step of the central differences, as a fraction of the change.
STEP: Final = 0.05
#: What changes, with its unit.
QUANTITIES: Final = {"tilt": "deg", "ball": "mm", "wheel load": "%", "torque": "mN·m"}
#: Parameters that are shown.
SHOWN: Final = 16
#: Control steps between two reports of progress.
CHUNK: Final = 20

_ROWS: Final = ("states", "wheel_normal_forces", "torques", "terminated")


@dataclasses.dataclass(frozen=True)
class Sensitivity:
    """Effects of changes of parameters on a motion, to first order: one row per parameter."""

    controller: str
    model: str
    #: For example `body_com_offset_x`.
    names: tuple[str, ...]
    #: The value of each in the robot, in its unit.
    values: Array
    #: The change of each, in its unit.
    changes: Array
    units: tuple[str, ...]
    #: Largest change over the motion, by `QUANTITIES`: of the tilt, of the ball's place, of a wheel's load relative to
    #: its load in equilibrium, and of a wheel's torque.
    effects: Mapping[str, Array]

    def largest(self, count: int = SHOWN) -> "Sensitivity":
        """The parameters with the largest effects, relative to the largest of each quantity, in this order."""
        sizes = np.max([effect / max(effect.max(), 1e-300) for effect in self.effects.values()], axis=0)
        order = np.argsort(-sizes, kind="stable")[:count]
        return dataclasses.replace(
            self,
            names=tuple(self.names[i] for i in order),
            values=self.values[order],
            changes=self.changes[order],
            units=tuple(self.units[i] for i in order),
            effects={name: effect[order] for name, effect in self.effects.items()},
        )

    def label(self, index: int) -> str:
        """A parameter and its change."""
        unit = f" {self.units[index]}" if self.units[index] else ""
        return f"{self.names[index]} +{self.changes[index]:.2g}{unit}"


def default_fields() -> tuple[str, ...]:
    """The parameters that are changed unless others are named: all with continuous effects, without a payload's."""
    left_out = (*MOTORS, *BIASES)
    return tuple(name for name in known_fields() if name not in left_out and not name.startswith("payload_"))


def collect(
    controller: Source,
    fields: Sequence[str] | None = None,
    *,
    robot: Params | None = None,
    tilt: npt.ArrayLike = (0.08, 0.05),
    yaw: float = 0.0,
    pushes: Push | Sequence[Push] = (),
    seconds: float = 4.0,
    task: str | None = None,
    env_options: Mapping[str, Any] | None = None,
    num_threads: int | None = None,
    progress: Progress = no_progress,
) -> Sensitivity:
    """Simulates the robot, and robots with each parameter slightly larger and smaller, under one controller.

    All start at rest with the tilt from their own equilibrium. The controller is made for the nominal robot.

    Args:
        controller: a name, a path or an object, as in `compare`.
        fields: parameters of `Params`, vectors with all their components; None takes `default_fields`. The result
            is without those that the model fixes, as `planar` the azimuths of the wheels.
        robot: whose parameters change; None is the nominal robot.
        tilt: components (x, y), rad.
        yaw: heading, rad.
        pushes: an impulse on the body, or several at one point of it.
        seconds: simulated time.
        task: name of the task, as in `compare`.
        env_options: options of the environment; they override the options that a policy was trained with.
        num_threads: threads that step the robots; None uses all cores.
        progress: called with the number of steps done and their total.

    Raises:
        ValueError: events or sensors, whose effects are random; pushes out of range or at several points; an unknown
            parameter; a robot that falls; or as `compare`.
    """
    several, _ = impulses_of.checked(pushes, (), seconds)
    places = list(dict.fromkeys(None if push.point is None else tuple(map(float, push.point)) for push in several))
    if len(places) > 1:
        points = " and ".join("the center of mass" if place is None else f"{place} m" for place in places)
        raise InvalidInputError(f"pushes are at {points}: sensitivities are for pushes at one point of the body")
    found = find(controller, task=task, env_options=env_options)
    options = dict(common_options([found], env_options))
    if options.get("events") or options.get("observation") == "sensors":
        raise InvalidInputError("sensitivities are for one robot and true states: leave out events and sensors")
    if "robot" in options:
        options["robot"] = first_of(options["robot"])
    task = common_task([found], task)

    def batch_of(count: int) -> Any:
        # No episode ends by time.
        more = {**options, "max_episode_steps": None}
        return batch_for(
            found, count, task=task, num_threads=num_threads, seed=0, options=more, given=env_options or ()
        )

    nominal = batch_of(1)
    base = Robot(nominal.nominal_params(0) if robot is None else robot, Motors.of(None))
    excluded = [name for name in fields or () if name in MOTORS or name in BIASES]
    if excluded:
        raise InvalidInputError(f"{excluded[0]} is not a parameter of the robot: expected one of {default_fields()}")
    unknowns = fitted(fields or default_fields(), base, nominal.sim_dt)
    sizes = CHANGE * STEP * unknowns.scales
    ends = np.array([unknowns.start - sizes, unknowns.start + sizes]).clip(unknowns.low, unknowns.high)
    batch = batch_of(1 + ends.size)
    # Made for the nominal robot, so before the others are changed.
    loop = ClosedLoop(batch, core_law(found, batch) or make_actor(found, batch))
    for i in range(batch.num_envs):
        batch.set_params(i, base.params)
    for sign, values in enumerate(ends):
        for j, value in enumerate(values):
            changed = np.where(np.arange(len(values)) == j, value, unknowns.start)
            try:
                batch.set_params(1 + sign * len(values) + j, unknowns.robot(changed, base).params)
            except InvalidInputError:
                # At a limit, such as the inertia of a thin shell, the difference is one-sided.
                ends[sign, j] = unknowns.start[j]
    spans = ends[1] - ends[0]
    free = np.flatnonzero(spans)
    if not len(free):
        raise InvalidInputError(f"the model {batch.model} allows no other values of {', '.join(unknowns.fields)}")
    rows = _rows(loop, batch, tilt, yaw, several, seconds, progress)
    effects = {}
    for name, numbers in rows.items():
        lower, higher = numbers[:, 1:].reshape(len(numbers), 2, len(spans), -1)[:, :, free].swapaxes(0, 1)
        slopes = (higher - lower) / spans[free, None]
        # Components of a vector together, wheels each for itself.
        sizes_of = np.linalg.norm(slopes, axis=-1) if name in ("tilt", "ball") else np.abs(slopes).max(axis=-1)
        effects[name] = sizes_of.max(axis=0) * CHANGE * unknowns.scales[free]
    return Sensitivity(
        controller=found.name,
        model=batch.model,
        names=tuple(unknowns.names[i] for i in free),
        values=unknowns.start[free],
        changes=CHANGE * unknowns.scales[free],
        units=tuple(unit_of(unknowns.places[i][0]) for i in free),
        effects=effects,
    )


def _rows(
    loop: ClosedLoop,
    batch: Any,
    tilt: npt.ArrayLike,
    yaw: float,
    pushes: Sequence[Push],
    seconds: float,
    progress: Progress,
) -> dict[str, Array]:
    """The quantities of all robots over time, shape (rows, n, components)."""
    n, steps = batch.num_envs, max(round(seconds / batch.control_dt), 1)
    robots = [batch.params(i) for i in range(n)]
    starts = [batch.on_ground(State.at_equilibrium(one, tilt=tilt, yaw=yaw), i) for i, one in enumerate(robots)]
    loop.reset(seeds=[0] * n, starts=starts)
    given = np.zeros((steps, n, 3))
    for step, parts in impulses_of.impulses(pushes, [], steps, batch.control_dt).items():
        given[step] = np.sum([impulse for impulse, _ in parts], axis=0)
    # All are at one point.
    place = pushes[0].point if pushes else None
    points = None if place is None else np.tile(place, (n, 1))
    states, loads, torques = [np.expand_dims(batch.states(), 0)], [], []
    for first in range(0, steps, CHUNK):
        count = min(CHUNK, steps - first)
        read = loop.rows(count, _ROWS, impulses=given[first : first + count], points=points)
        fallen = np.flatnonzero(read["terminated"].any(axis=1))
        if len(fallen):
            time = batch.control_dt * (first + fallen[0] + 1)
            raise InvalidInputError(f"a robot falls at {time:g} s: sensitivities need a motion that stays upright")
        # The first row is the last of the steps before.
        states.append(read["states"][1:])
        loads.append(read["wheel_normal_forces"][1:])
        torques.append(read["torques"])
        progress(first + count, steps)
    com = np.array([one.body_com for one in robots])
    return {
        "tilt": np.degrees(tilt_components_of(np.concatenate(states), com)),
        "ball": 1e3 * np.concatenate(states)[..., :2],
        "wheel load": 100.0 * np.concatenate(loads) / np.array(robots[0].equilibrium_wheel_loads),
        "torque": 1e3 * np.concatenate(torques),
    }
