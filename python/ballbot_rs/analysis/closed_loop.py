"""The closed loop of a controller and the robots of a batch, for analysis, scenarios and identification."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Batch, Controller, Reference, State
from ballbot_rs.analysis.actors import Actions, Actor
from ballbot_rs.analysis.drawn_pushes import is_push
from ballbot_rs.envs._batch_env import task_metrics

Array = npt.NDArray[np.float64]

#: A setpoint of each robot over time, or parts that do not change, each with one row per robot.
Setpoints: TypeAlias = Sequence[Reference] | Mapping[str, Array]

#: Called with the number of a step.
Hook: TypeAlias = Callable[[int], None]

#: Records of contacts, by the names of `Batch.contacts`; like the states, they have a row before the first step.
CONTACTS: Final = ("wheel_normal_forces", "wheel_tractions", "wheel_slip_speeds")


class Step(NamedTuple):
    """A control step of all robots."""

    actions: Actions
    rewards: Array
    terminated: npt.NDArray[np.bool_]
    truncated: npt.NDArray[np.bool_]


class ClosedLoop:
    """A controller on all robots of a batch, which continues with each call.

    Args:
        batch: the robots; call `reset` first.
        controller: an actor, or a controller of the core, which `rows` runs without Python in the loop.
    """

    def __init__(self, batch: Batch, controller: Controller | Actor) -> None:
        self._batch, self._controller = batch, controller
        self._observations = np.empty((0, 0), dtype=np.float32)
        self._done = 0

    def reset(self, *, seeds: Sequence[int | None] | None = None, starts: Sequence[State | None] | None = None) -> None:
        """Begins an episode of each robot, as `Batch.reset`."""
        self._observations = self._batch.reset(seeds=seeds, starts=starts)
        if self._done and not isinstance(self._controller, Controller):
            # The batch has the memory of a controller of the core.
            self._controller.ended(np.ones(self._batch.num_envs, dtype=bool))
        self._done = 0

    def steps(
        self,
        count: int,
        setpoint: Callable[[int], Any] | None = None,
        *,
        before_decision: Hook | None = None,
        before_motion: Hook | None = None,
    ) -> Iterator[Step]:
        """Control steps of an actor, made one by one while they are iterated.

        Args:
            count: their number.
            setpoint: a setpoint for the actor; None is the task's.
            before_decision: called before the actor chooses actions, which may push robots.
            before_motion: called after it, before the robots move.
        """
        act: Any = self._controller
        for _ in range(count):
            number = self._done
            if before_decision is not None:
                before_decision(number)
            actions = act(self._observations, None if setpoint is None else setpoint(number))
            if before_motion is not None:
                before_motion(number)
            self._observations, rewards, terminated, truncated = self._batch.step(actions)
            self._done += 1
            yield Step(actions, rewards, terminated, truncated)
            ended = terminated | truncated
            if ended.any():
                act.ended(ended)

    def rows(
        self,
        count: int,
        record: Sequence[str],
        setpoints: Setpoints | None = None,
        impulses: Array | None = None,
        points: Array | None = None,
    ) -> dict[str, Array]:
        """Control steps of any controller, recorded as by `Batch.rollout`, where `impulses` and `points` are explained.

        Args:
            count: number of steps.
            record: names; for an actor only `states`, `CONTACTS` and names that `_recorded` has.
            setpoints: of the robots; None is the task's.
            impulses: pushes, shape (count, n, 3), N·s.
            points: their points, shape (n, 3), m.
        """
        batch, first = self._batch, self._done
        if isinstance(self._controller, Controller):
            self._done += count
            start = batch.control_dt * first
            return batch.rollout(
                self._controller, count, setpoints, record, impulses=impulses, points=points, start_time=start
            )

        def push(number: int) -> None:
            if impulses is not None:
                now = impulses[number - first]
                for i in np.flatnonzero(now.any(axis=-1)).tolist():
                    batch.push(i, now[i], None if points is None else points[i])

        rows: dict[str, list[Any]] = {name: [] for name in record}
        contacts = [name for name in record if name in CONTACTS]

        def write_states() -> None:
            rows["states"].append(batch.states())
            if contacts:
                found = batch.contacts()
                for name in contacts:
                    rows[name].append(found[name])

        others = [name for name in record if name != "states" and name not in CONTACTS]
        is_pushed = "push_counts" in record and any(map(is_push, batch.draws()))
        write_states()
        for step in self.steps(count, self._parts_over_time(setpoints), before_decision=push):
            for name in others:
                rows[name].append(self._recorded(name, step, is_pushed=is_pushed))
            write_states()
        return {name: np.array(values) for name, values in rows.items()}

    def _recorded(self, name: str, step: Step, *, is_pushed: bool) -> Any:
        batch = self._batch
        if name == "torques":
            return step.actions.astype(np.float64) * batch.action_torques[:, None]
        if name == "success":
            return batch.endings()[0]
        if name == "metrics":
            return task_metrics(batch)
        if name == "push_counts":
            return [batch.push_count(i) if is_pushed else 0.0 for i in range(batch.num_envs)]
        return getattr(step, name)

    def _parts_over_time(self, setpoints: Setpoints | None) -> Callable[[int], Any] | None:
        """The parts of each robot's setpoint by the number of the step."""
        if setpoints is None:
            return None
        if isinstance(setpoints, Mapping):
            fixed = [{name: values[i] for name, values in setpoints.items()} for i in range(self._batch.num_envs)]
            return lambda _: fixed
        each = {id(one): one for one in setpoints}

        def parts(number: int) -> Any:
            time = float(self._batch.control_dt * number)
            found = {key: one(time) for key, one in each.items()}
            return [found[id(one)] for one in setpoints]

        return parts
