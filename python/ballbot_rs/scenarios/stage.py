"""The robots of a scenario, and controllers that step them."""

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import seed_at
from ballbot_rs._core import Batch, Params
from ballbot_rs.analysis.actors import core_law, make_actor
from ballbot_rs.analysis.closed_loop import CONTACTS, ClosedLoop, Setpoints
from ballbot_rs.analysis.rollout import batch_for
from ballbot_rs.control.laws import takes_position
from ballbot_rs.control.policy_file import observation_layout
from ballbot_rs.control.resolve import ResolvedController
from ballbot_rs.envs._batch_env import option_names
from ballbot_rs.envs.registration import DEFAULT_TASK
from ballbot_rs.scenarios.metrics import UPRIGHT, Measures
from ballbot_rs.scenarios.scenario import Scenario
from ballbot_rs.scenarios.trial import Trial, trial

Array = npt.NDArray[np.float64]

#: Recorded by a rollout for the metrics.
_RECORD: Final = ("states", "torques", "terminated", *CONTACTS)

#: Longest episodes: only a fall ends them.
_ENDLESS: Final = 10**9

#: Rows of states that are kept in memory at once, and the fewest control steps.
_ROWS: Final = 8000
_FEWEST: Final = 50


def check_observes_balance(controller: ResolvedController) -> None:
    """Rejects a policy whose observations differ from the observations of a scenario's robots.

    Raises:
        ValueError: it was trained for a task whose observations differ from balancing.
    """
    if controller.task is not None and observation_layout(controller.task) != observation_layout(DEFAULT_TASK):
        raise ValueError(
            f"{controller.name} was trained for the task {controller.task}, whose observations differ from the "
            f"observations of {DEFAULT_TASK}, which scenarios have"
        )


class Stage:
    """The robots of a scenario, made once: similar controllers run on them one after another, on the same episodes.

    Args:
        controller: a policy or a feedback law, which determines rate and options.
        scenario: what happens to them.
        params: the robot.
        model: of it.
        seed: of everything random.
        num_threads: threads that step the robots; None takes all cores.
    """

    def __init__(
        self,
        controller: ResolvedController,
        scenario: Scenario,
        params: Params,
        *,
        model: str = "contact",
        seed: int = 0,
        num_threads: int | None = None,
    ) -> None:
        known = option_names(DEFAULT_TASK)
        options: dict[str, Any] = {
            # A policy of another task with the same observations has its own options.
            **{name: value for name, value in controller.env_options.items() if name in known},
            "model": model,
            "robot": params.to_dict(),
            "fall_tilt": math.radians(scenario.fall_tilt),
            "max_episode_steps": _ENDLESS,
            "actuators": dict(scenario.actuators) or None,
            "events": scenario.events or [],
        }
        if scenario.sensors is not None:
            options |= {"sensors": scenario.sensors, "observation": "sensors"}
        if controller.policy is None:
            options.pop("max_wheel_torque", None)

        def batch(count: int, threads: int | None) -> Batch:
            return batch_for(
                controller, count, task=DEFAULT_TASK, num_threads=threads, seed=seed, options=options, given=()
            )

        self.scenario = scenario
        # The rate of the controller determines the number of steps.
        self.episodes: Final[Trial] = trial(scenario, params, batch(1, 1).control_dt, seed=seed)
        options["robot"] = self.episodes.nominal.to_dict()
        self._batch: Final = batch(len(self.episodes), num_threads)
        # The parameters with which the batch was made.
        self._seeds = [seed_at(seed, i) for i in range(len(self.episodes))]

    def follow(self, controller: ResolvedController) -> Measures | None:
        """Runs the episodes under a controller; None if it cannot follow their motion."""
        batch, episodes = self._batch, self.episodes
        # Laws are made for the nominal robot.
        self._set_robots([episodes.nominal] * len(episodes))
        made = None if controller.policy is not None else controller.law(episodes.nominal, batch.control_dt)
        follows = made is not None and takes_position(made)
        if self.scenario.moves and not follows:
            return None
        loop = ClosedLoop(batch, core_law(controller, batch) or make_actor(controller, batch))
        self._set_robots(episodes.robots)
        loop.reset(seeds=self._seeds, starts=episodes.starts)
        com = np.array([batch.params(i).body_com for i in range(batch.num_envs)])
        friction = np.array([batch.params(i).wheel_dynamic_friction for i in range(batch.num_envs)])
        final_tilt = self.scenario.final_tilt
        upright = UPRIGHT if final_tilt is None else math.radians(final_tilt)
        measures = Measures(batch.num_envs, batch.control_dt, episodes.measure_from, com, friction, upright)
        setpoints: Setpoints | None = None
        if follows:
            setpoints = episodes.references or {"position": episodes.positions}
        at_once = max(_ROWS // len(episodes), _FEWEST)
        for first in range(0, episodes.steps, at_once):
            count = min(at_once, episodes.steps - first)
            impulses = None if episodes.impulses is None else episodes.impulses[first : first + count]
            times = np.asarray(batch.control_dt * np.arange(first, first + count + 1), dtype=np.float64)
            targets = _targets(episodes, times)
            rows = loop.rows(count, _RECORD, setpoints, impulses, episodes.points)
            measures.add(rows, **targets)
            if measures.fell.all():
                break
        return measures

    def _set_robots(self, robots: list[Params]) -> None:
        if all(robot is self.episodes.nominal for robot in self.episodes.robots):
            return
        for i, robot in enumerate(robots):
            self._batch.set_params(i, robot)


def _targets(episodes: Trial, times: Array) -> dict[str, Array]:
    """Desired ball positions and velocities, shape (len(times), n or 1, 2), and headings, (len(times), n or 1)."""
    if episodes.references is None:
        still = np.zeros((len(times), 1, 2))
        return {"position": still + episodes.positions, "velocity": still, "yaw": still[..., 0]}
    one_for_all = all(one is episodes.references[0] for one in episodes.references)
    samples = [one.sample(times) for one in (episodes.references[:1] if one_for_all else episodes.references)]
    return {name: np.stack([sample[name] for sample in samples], axis=1) for name in ("position", "velocity", "yaw")}
