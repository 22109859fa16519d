"""Scenarios under controllers."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from os import PathLike, fspath
from pathlib import Path
from typing import Any, overload

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import check_seed
from ballbot_rs._core import Params, load_actuators
from ballbot_rs._keywords import named
from ballbot_rs._progress import Progress, no_progress
from ballbot_rs._robot import Robot, params_of
from ballbot_rs.analysis.checkpoint import Checkpoint, identity_of_controller
from ballbot_rs.analysis.study import Study
from ballbot_rs.analysis.sweep import Row, Sweep, at, full_names, points_of, run_points
from ballbot_rs.control.resolve import ResolvedController, Source, find
from ballbot_rs.envs.options import Actuators
from ballbot_rs.scenarios.matrix import factor_and_unit
from ballbot_rs.scenarios.metrics import METRICS, UPRIGHT
from ballbot_rs.scenarios.outcome import Outcome
from ballbot_rs.scenarios.scenario import Scenario, load, select
from ballbot_rs.scenarios.stage import Stage, check_observes_balance
from ballbot_rs.scenarios.sweep import NAMES, at_point
from ballbot_rs.scenarios.trial import Trial

Array = npt.NDArray[np.float64]


@overload
def run_scenarios(
    controllers: Source | list[Source] | tuple[Source, ...],
    scenarios: str | Scenario | Sequence[str | Scenario] = (),
    *,
    file: str | Path | None = None,
    robot: Robot | None = None,
    model: str = "contact",
    actuators: Actuators | Mapping[str, Any] | str | PathLike[str] | None = None,
    sensors: str | PathLike[str] | None = None,
    events: str | PathLike[str] | None = None,
    seed: int = 0,
    num_threads: int | None = None,
    sweep: None = None,
    checkpoint: None = None,
    progress: Progress = no_progress,
) -> list[Outcome]: ...


@overload
def run_scenarios(
    controllers: Source | list[Source] | tuple[Source, ...],
    scenarios: str | Scenario | Sequence[str | Scenario] = (),
    *,
    file: str | Path | None = None,
    robot: Robot | None = None,
    model: str = "contact",
    actuators: Actuators | Mapping[str, Any] | str | PathLike[str] | None = None,
    sensors: str | PathLike[str] | None = None,
    events: str | PathLike[str] | None = None,
    seed: int = 0,
    num_threads: int | None = None,
    sweep: Sweep,
    checkpoint: str | PathLike[str] | None = None,
    progress: Progress = no_progress,
) -> Study: ...


@named
def run_scenarios(
    controllers: Source | list[Source] | tuple[Source, ...],
    scenarios: str | Scenario | Sequence[str | Scenario] = (),
    *,
    file: str | Path | None = None,
    robot: Robot | None = None,
    model: str = "contact",
    actuators: Actuators | Mapping[str, Any] | str | PathLike[str] | None = None,
    sensors: str | PathLike[str] | None = None,
    events: str | PathLike[str] | None = None,
    seed: int = 0,
    num_threads: int | None = None,
    sweep: Sweep | None = None,
    checkpoint: str | PathLike[str] | None = None,
    progress: Progress = no_progress,
) -> list[Outcome] | Study:
    """Runs scenarios under controllers, the same episodes for all of them.

    ```python
    for outcome in bb.run_scenarios(["lqr", "lqi"], "S13-6s", robot="kugle"):
        print(outcome.controller, outcome.score)
    ```

    Args:
        controllers: one or more, each a name, a path or an object, as in `compare`.
        scenarios: ids ("S13-6s", or "S13" for all of them), or `Scenario`s, one or more; empty means all.
        file: a TOML file of scenarios in place of the package's scenarios.
        robot: `Params`, the name of a preset, the path of a TOML file, or a dict of parameters; None is the paper's.
        model: of the robot.
        actuators: motors in place of the scenarios' own: options, a name, or a TOML file; {} is ideal motors.
        sensors: name or TOML file of sensors in place of the scenarios' own.
        events: name or TOML file of events in place of the scenarios' own.
        seed: of everything random.
        num_threads: threads that step the robots; None uses all cores.
        sweep: as in `compare`: points of parameters of the robot, "robot", "model", parts of the motors as
            "actuators.delay", and numbers of the scenarios as "push".
        checkpoint: as in `compare`.
        progress: called with the number of scenarios done and their total, or, of a sweep, of points.

    Returns:
        An outcome for each controller and scenario, or, with a sweep, a `Study` of them. A motion is skipped for a
        policy, or for a controller that does not follow a position: `skipped` of its outcome has the reason, and it has
        no episode.

    Raises:
        ValueError: an unknown name, a malformed file, a number out of range, or as `compare`.
        TypeError: sensors or events that are neither a name nor a path, or as `compare`.
    """
    if checkpoint is not None and sweep is None:
        raise TypeError("checkpoint needs a sweep: pass its points as sweep=...")
    params = params_of(robot)
    known = load(file)
    requested = [scenarios] if isinstance(scenarios, (str, Scenario)) else list(scenarios)
    named = [one for one in requested if isinstance(one, str)]
    chosen = [one for one in requested if isinstance(one, Scenario)]
    if named or not chosen:
        chosen += select(named, known)
    motors = actuators if actuators is None or isinstance(actuators, Mapping) else load_actuators(actuators)
    conditions: dict[str, Any] = {
        "actuators": motors,
        "sensors": _text("sensors", sensors),
        "events": _text("events", events),
    }
    changes = {name: value for name, value in conditions.items() if value is not None}
    chosen = [dataclasses.replace(one, **changes) for one in chosen]
    seed = check_seed(seed)
    sources = controllers if isinstance(controllers, (list, tuple)) else [controllers]
    found = [find(source) for source in sources]
    for one in found:
        check_observes_balance(one)
    for what, names in (("scenarios", [one.id for one in chosen]), ("controllers", [one.name for one in found])):
        twice = [name for name in names if names.count(name) > 1]
        if twice:
            raise ValueError(f"two {what} are named '{twice[0]}': their outcomes could not be distinguished")
    if sweep is None:
        return _outcomes(found, chosen, params, model, seed, num_threads, progress)
    points = points_of(sweep)
    full = full_names(points[0], NAMES)
    cases = []
    for point in points:
        with at(point):
            cases.append(at_point(point, full, chosen, params, model))
            # Before the first point is run, and not after hours.
            for controller in found:
                Stage(controller, cases[-1][0][0], cases[-1][1], model=cases[-1][2], seed=seed, num_threads=1)
    study = {
        "scenarios": [dataclasses.asdict(one) for one in chosen],
        "robot": params,
        "model": model,
        "seed": seed,
        "controllers": [identity_of_controller(source) for source in sources],
        "points": points,
    }

    def work(point: int, num_threads: int | None, report: Progress) -> list[Row]:
        with at(points[point]):
            return [_row(one) for one in _outcomes(found, *cases[point], seed, num_threads, report)]

    rows = run_points(
        points,
        work,
        num_threads=num_threads,
        is_parallel=all(controller.existing is None for controller in found),
        checkpoint=None if checkpoint is None else Checkpoint(checkpoint, study, len(points)),
        progress=progress,
    )
    return Study(tuple(points[0]), rows, "score", units={one.id: factor_and_unit(one) for one in chosen})


def _text(name: str, given: str | PathLike[str] | None) -> str | None:
    if given is None:
        return None
    if not isinstance(given, (str, PathLike)):
        raise TypeError(f"{name} must be a name or the path of a TOML file, not {type(given).__name__}")
    return fspath(given)


def _outcomes(
    controllers: Sequence[ResolvedController],
    scenarios: Sequence[Scenario],
    params: Params,
    model: str,
    seed: int,
    num_threads: int | None,
    progress: Progress,
) -> list[Outcome]:
    outcomes = []
    total = len(controllers) * len(scenarios)
    for count, (controller, scenario) in enumerate((c, s) for c in controllers for s in scenarios):
        progress(count, total)
        stage = Stage(controller, scenario, params, model=model, seed=seed, num_threads=num_threads)
        outcomes.append(outcome_on(stage, controller))
    progress(total, total)
    return outcomes


def _row(outcome: Outcome) -> Row:
    """The row of an outcome in a study, whose rows have the same columns."""
    row = outcome.row()
    low, high = row.pop("success_interval")
    row.pop("largest", None)
    return {**row, "success_low": low, "success_high": high, "skipped": row.get("skipped")}


def outcome_on(stage: Stage, controller: ResolvedController) -> Outcome:
    """A controller on the robots of a scenario, or why it is skipped."""
    measures = stage.follow(controller)
    scenario, episodes = stage.scenario, stage.episodes
    if measures is None:
        kind = "it follows no position" if controller.policy is None else "a policy follows no motion"
        nothing = np.empty(0)
        return Outcome(
            controller.name,
            scenario,
            dict.fromkeys(METRICS, nothing),
            nothing.astype(bool),
            nothing,
            f"the scenario is a motion, and {kind}",
        )
    metrics = measures.found()
    success = (
        ~metrics["fell"]
        & (metrics["final_tilt"] < _largest_final_tilt(scenario, episodes))
        & (np.isfinite(metrics["recovery_time"]) | (not scenario.is_map))
        & (metrics["final_error"] < scenario.final_distance)
        & (metrics["final_speed"] < scenario.final_speed)
        & (metrics["final_yaw_error"] <= math.radians(scenario.final_yaw))
    )
    return Outcome(controller.name, scenario, metrics, success, _largest(episodes, success))


def _largest_final_tilt(scenario: Scenario, episodes: Trial) -> float:
    if scenario.final_tilt is not None:
        return math.radians(scenario.final_tilt)
    endless = episodes.references is not None and episodes.references[0].duration is None
    return math.inf if endless else UPRIGHT


def _largest(episodes: Trial, success: npt.NDArray[np.bool_]) -> Array:
    if not episodes.scenario.is_map:
        return np.empty(0)
    failed = ~success.reshape(len(episodes.numbers), -1)
    first = np.where(failed.any(axis=0), failed.argmax(axis=0), len(failed))
    # Nothing is known below the first number.
    return np.concatenate([[0.0], episodes.numbers])[first]
