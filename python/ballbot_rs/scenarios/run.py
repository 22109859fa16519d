"""Scenarios under controllers."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import check_seed
from ballbot_rs._core import Batch, Controller, Params
from ballbot_rs._progress import Progress, no_progress
from ballbot_rs.analysis.actors import core_law, make_actor
from ballbot_rs.analysis.rollout import CHUNK, batch_for
from ballbot_rs.control.laws import takes_position
from ballbot_rs.control.resolve import ResolvedController, Source, find
from ballbot_rs.envs.registration import DEFAULT_TASK
from ballbot_rs.scenarios.metrics import METRICS, Measures
from ballbot_rs.scenarios.scenario import Scenario, load, select
from ballbot_rs.scenarios.trial import Trial, trial

Array = npt.NDArray[np.float64]

#: What a rollout records for the metrics.
_RECORD = ("states", "torques", "terminated", "wheel_normal_forces", "wheel_tractions", "wheel_slip_speeds")

#: Longest episodes: nothing but a fall ends them.
_ENDLESS = 10**9


@dataclasses.dataclass(frozen=True)
class Outcome:
    """A scenario under a controller."""

    controller: str
    scenario: Scenario
    #: Numbers of each episode by name (`metrics.METRICS`), shape (n,).
    metrics: Mapping[str, Array]
    #: Which episodes are a success, shape (n,).
    success: npt.NDArray[np.bool_]
    #: Of a map, the largest number up to which all succeed, in each direction, shape (directions,); else empty.
    largest: Array

    @property
    def _fell(self) -> npt.NDArray[np.bool_]:
        return self.metrics["fell"].astype(bool)

    @property
    def score(self) -> float:
        """The number by which controllers are compared; not finite if a robot fell.

        Of a map the worst direction, of several directions the worst episode, of random episodes the mean of the worse
        half (CVaR 0.5).
        """
        if self.scenario.is_map:
            return float(self.largest.min())
        if self.scenario.score == "success":
            return float(self.success.mean())
        values = np.where(self._fell, np.inf, self.metrics[self.scenario.score])
        if self.scenario.seeds == 1:
            return float(values.max())
        if not np.isfinite(values).all():
            return math.inf
        return float(np.sort(values)[len(values) // 2 :].mean())

    @property
    def higher_is_better(self) -> bool:
        """Whether a larger score is the better one: largest tilts and pushes, shares of successes."""
        return self.scenario.is_map or self.scenario.score == "success"

    @property
    def success_rate(self) -> float:
        """Share of the episodes that are a success."""
        return float(self.success.mean())

    def interval(self) -> tuple[float, float]:
        """Wilson's 95 % interval of the share of successes."""
        z, n, p = 1.959964, len(self.success), self.success_rate
        center = (p + z * z / (2 * n)) / (1 + z * z / n)
        half = z / (1 + z * z / n) * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
        return max(center - half, 0.0), min(center + half, 1.0)

    def row(self) -> dict[str, Any]:
        """One row for a table or JSON: means over the episodes that did not fall, largest numbers, successes.

        None is no number: the score where a robot fell, a mean over no episode, or with one that never settled.
        """
        stood = ~self._fell
        means = {
            name: float(np.mean(self.metrics[name][stood])) if stood.any() else math.nan
            for name in METRICS
            if name != "fell"
        }
        return {
            "controller": self.controller,
            "scenario": self.scenario.id,
            "score": _finite(self.score),
            "success_rate": self.success_rate,
            "success_interval": list(self.interval()),
            "episodes": len(self.success),
            "falls": int((~stood).sum()),
            **({"largest": self.largest.tolist()} if self.scenario.is_map else {}),
            **{name: _finite(value) for name, value in means.items()},
        }


def _finite(value: float) -> float | None:
    """None in place of what JSON has no number for."""
    return value if math.isfinite(value) else None


def run_scenarios(
    controllers: "Source | list[Source] | tuple[Source, ...]",
    scenarios: str | Scenario | Sequence[str | Scenario] = (),
    *,
    file: str | Path | None = None,
    robot: Params | str | None = None,
    model: str = "contact",
    seed: int = 0,
    num_threads: int | None = None,
    progress: Progress = no_progress,
) -> list[Outcome]:
    """Runs scenarios under controllers, the same episodes for all of them.

    Args:
        controllers: one or more, each a name, a path or an object, as in `compare`.
        scenarios: ids ("S13-6s", or "S13" for all of them), or `Scenario`s, one or more; none are all.
        file: a TOML file of scenarios in place of those of this package.
        robot: parameters or a preset's name; None is the paper's.
        model: of the robot.
        seed: of everything random.
        num_threads: threads that step the robots; None takes all cores.
        progress: called with the number of scenarios done and their total.

    Returns:
        An outcome for each controller and scenario it can be asked for: a controller that follows no position, or a
        policy, is asked for no motion.

    Raises:
        ValueError: an unknown name, a malformed file, or a number out of range.
    """
    params = robot if isinstance(robot, Params) else Params.preset(robot or "paper")
    known = load(file)
    asked = [scenarios] if isinstance(scenarios, (str, Scenario)) else list(scenarios)
    named = [one for one in asked if isinstance(one, str)]
    chosen = [one for one in asked if isinstance(one, Scenario)]
    if named or not chosen:
        chosen += select(named, known)
    seed = check_seed(seed)
    sources = controllers if isinstance(controllers, (list, tuple)) else [controllers]
    found = [find(source) for source in sources]
    for what, names in (("scenarios", [one.id for one in chosen]), ("controllers", [one.name for one in found])):
        twice = [name for name in names if names.count(name) > 1]
        if twice:
            raise ValueError(f"two {what} are named '{twice[0]}': their outcomes could not be told apart")
    outcomes = []
    for count, (controller, scenario) in enumerate((c, s) for c in found for s in chosen):
        progress(count, len(found) * len(chosen))
        outcome = _run(controller, scenario, params, model, seed, num_threads)
        if outcome is not None:
            outcomes.append(outcome)
    progress(len(found) * len(chosen), len(found) * len(chosen))
    return outcomes


def _run(
    controller: ResolvedController,
    scenario: Scenario,
    params: Params,
    model: str,
    seed: int,
    num_threads: int | None,
) -> Outcome | None:
    options: dict[str, Any] = {
        **controller.env_options,
        "model": model,
        "params": params.to_dict(),
        "fall_tilt": math.radians(scenario.fall_tilt),
        "max_episode_steps": _ENDLESS,
        "actuators": dict(scenario.actuators) or None,
        "events": scenario.events or [],
    }
    if scenario.sensors is not None:
        options |= {"sensors": scenario.sensors, "observation": "sensors"}
    if controller.policy is None:
        options.pop("max_wheel_torque", None)
    # The rate of the controller decides about the number of steps.
    one = batch_for(controller, 1, task=DEFAULT_TASK, num_threads=1, seed=seed, options=options, given=())
    episodes = trial(scenario, params, one.control_dt, seed=seed)
    options["params"] = episodes.nominal.to_dict()
    batch = batch_for(
        controller, len(episodes), task=DEFAULT_TASK, num_threads=num_threads, seed=seed, options=options, given=()
    )
    made = None if controller.policy is not None else controller.law(episodes.nominal, batch.control_dt)
    follows = made is not None and takes_position(made)
    if scenario.moves and not follows:
        return None
    # Before the robots become others than those that the controller is made for.
    law = core_law(controller, batch) or _Python(controller, batch, follows)
    for i, robot in enumerate(episodes.robots):
        if robot is not episodes.nominal:
            batch.set_params(i, robot)
    measures = _follow(law, batch, episodes)
    metrics = measures.found()
    success = (
        ~metrics["fell"]
        & (metrics["final_tilt"] < _largest_final_tilt(scenario, episodes))
        & (metrics["final_error"] < scenario.final_distance)
        & (metrics["final_speed"] < scenario.final_speed)
    )
    return Outcome(controller.name, scenario, metrics, success, _largest(episodes, success))


def _largest_final_tilt(scenario: Scenario, episodes: Trial) -> float:
    if scenario.final_tilt is not None:
        return math.radians(scenario.final_tilt)
    endless = episodes.references is not None and episodes.references[0].duration is None
    return math.inf if endless else math.radians(2.0)


def _follow(law: "Controller | _Python", batch: Batch, episodes: Trial) -> Measures:
    observations = batch.reset(starts=episodes.starts)
    if isinstance(law, _Python):
        law.start(observations)
    com = np.array([batch.params(i).body_com for i in range(batch.num_envs)])
    friction = np.array([batch.params(i).wheel_dynamic_friction for i in range(batch.num_envs)])
    measures = Measures(batch.num_envs, batch.control_dt, episodes.measure_from, com, friction)
    for first in range(0, episodes.steps, CHUNK):
        count = min(CHUNK, episodes.steps - first)
        impulses = None if episodes.impulses is None else episodes.impulses[first : first + count]
        times = np.asarray(batch.control_dt * np.arange(first, first + count + 1), dtype=np.float64)
        position, velocity = _targets(episodes, times)
        if isinstance(law, Controller):
            setpoints: Any = episodes.references
            if setpoints is None and takes_position(law):
                setpoints = {"position": episodes.positions}
            rows = batch.rollout(law, count, setpoints, _RECORD, impulses=impulses, start_time=first * batch.control_dt)
        else:
            rows = law.steps(count, impulses, episodes, times)
        measures.add(rows, position, velocity)
        if measures.fell.all():
            break
    return measures


class _Python:
    """A policy or a law in Python on a batch, step by step."""

    def __init__(self, controller: ResolvedController, batch: Batch, follows: bool) -> None:
        self._act = make_actor(controller, batch)
        self._follows = follows
        self._batch = batch
        self._observations = np.empty((0, 0), dtype=np.float32)

    def start(self, observations: npt.NDArray[np.float32]) -> None:
        """Begins at the first observations."""
        self._observations = observations

    def steps(self, count: int, impulses: Array | None, episodes: Trial, times: Array) -> dict[str, Array]:
        """The rows of a rollout, whose steps begin at `times`."""
        batch = self._batch
        rows: dict[str, list[Array]] = {name: [] for name in _RECORD}

        def write() -> None:
            rows["states"].append(batch.states())
            contacts = batch.contacts()
            for name in _RECORD[3:]:
                rows[name].append(np.asarray(contacts[name]))

        write()
        for step in range(count):
            if impulses is not None:
                for i in np.flatnonzero(impulses[step].any(axis=-1)).tolist():
                    batch.push(i, impulses[step, i])
            actions = self._act(self._observations, self._setpoint(episodes, float(times[step])))
            self._observations, _, terminated, _ = batch.step(actions)
            rows["torques"].append(actions.astype(np.float64) * batch.max_wheel_torque)
            rows["terminated"].append(np.asarray(terminated))
            write()
        return {name: np.array(values) for name, values in rows.items()}

    def _setpoint(self, episodes: Trial, time: float) -> Any:
        if not self._follows:
            return None
        if episodes.references is None:
            return [{"position": position} for position in episodes.positions]
        found = {id(one): one(time) for one in {id(one): one for one in episodes.references}.values()}
        return [found[id(one)] for one in episodes.references]


def _targets(episodes: Trial, times: Array) -> tuple[Array, Array]:
    """Where the balls should be and how fast, shape (len(times), n or 1, 2)."""
    if episodes.references is None:
        still = np.zeros((len(times), 1, 2))
        return still + episodes.positions, still
    one_for_all = all(one is episodes.references[0] for one in episodes.references)
    samples = [one.sample(times) for one in (episodes.references[:1] if one_for_all else episodes.references)]
    return tuple(np.stack([sample[name] for sample in samples], axis=1) for name in ("position", "velocity"))  # type: ignore[return-value]


def _largest(episodes: Trial, success: npt.NDArray[np.bool_]) -> Array:
    if not episodes.scenario.is_map:
        return np.empty(0)
    failed = ~success.reshape(len(episodes.numbers), -1)
    first = np.where(failed.any(axis=0), failed.argmax(axis=0), len(failed))
    # Below the first number nothing is known.
    return np.concatenate([[0.0], episodes.numbers])[first]
