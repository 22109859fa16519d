"""Controllers and policies compared over episodes from the same starts."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, overload

from typing_extensions import Unpack

from ballbot_rs._checks import check_count, check_seed
from ballbot_rs._core import Batch
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._keywords import named
from ballbot_rs._progress import Progress, no_progress
from ballbot_rs.analysis.checkpoint import Checkpoint, identity_of_controller
from ballbot_rs.analysis.result import Result, result_of
from ballbot_rs.analysis.rollout import batch_for
from ballbot_rs.analysis.study import Study
from ballbot_rs.analysis.sweep import Row, Sweep, at, full_names, numbered, options_at, points_of, run_points
from ballbot_rs.control.resolve import ResolvedController, Source, common_options, common_task, find, options_of
from ballbot_rs.engines.engine_batch import in_engine
from ballbot_rs.envs._batch_env import option_names
from ballbot_rs.envs.options import TaskOptions

#: Most episodes of a comparison.
MAX_EPISODES = 100_000


def check_episodes(episodes: int) -> int:
    """The number of episodes as an int.

    Raises:
        TypeError: it is not a whole number.
        ValueError: it is not from 1 to `MAX_EPISODES`.
    """
    count = check_count("episodes", episodes)
    if count > MAX_EPISODES:
        raise ValueError(f"episodes = {count}, it must be at most {MAX_EPISODES}")
    return count


@named
def evaluate(
    controller: Source,
    *,
    task: str | None = None,
    episodes: int = 100,
    seed: int = 1000,
    num_threads: int | None = None,
    engine: str | None = None,
    progress: Progress = no_progress,
    **options: Unpack[TaskOptions],
) -> Result:
    """The result of one controller.

    ```python
    print(bb.evaluate("lqr", robot="kugle", actuators="kugle", episodes=10).success_rate)
    ```

    Args:
        controller: as in `compare`, and so is every other argument.
        task: see there.
        episodes: see there.
        seed: see there.
        num_threads: see there.
        engine: see there.
        progress: see there.
        options: see there.

    Raises:
        TypeError, ValueError, ModuleNotFoundError, FileNotFoundError: as `compare`.
    """
    if "sweep" in options:
        raise TypeError(f"a sweep has several results: compare([{controller!r}], sweep=...)")
    shared: dict[str, Any] = {"engine": engine, "progress": progress, **options}
    results: list[Result] = compare(
        [controller], task=task, episodes=episodes, seed=seed, num_threads=num_threads, **shared
    )
    return results[0]


@overload
def compare(
    controllers: Sequence[Source],
    *,
    task: str | None = None,
    episodes: int = 100,
    seed: int = 1000,
    num_threads: int | None = None,
    engine: str | None = None,
    sweep: None = None,
    checkpoint: None = None,
    progress: Progress = no_progress,
    **options: Unpack[TaskOptions],
) -> list[Result]: ...


@overload
def compare(
    controllers: Sequence[Source],
    *,
    task: str | None = None,
    episodes: int = 100,
    seed: int = 1000,
    num_threads: int | None = None,
    engine: str | None = None,
    sweep: Sweep,
    checkpoint: str | PathLike[str] | None = None,
    progress: Progress = no_progress,
    **options: Unpack[TaskOptions],
) -> Study: ...


@named
def compare(
    controllers: Sequence[Source],
    *,
    task: str | None = None,
    episodes: int = 100,
    seed: int = 1000,
    num_threads: int | None = None,
    engine: str | None = None,
    sweep: Sweep | None = None,
    checkpoint: str | PathLike[str] | None = None,
    progress: Progress = no_progress,
    **options: Unpack[TaskOptions],
) -> list[Result] | Study:
    """Runs episodes of one task from starts that follow from `seed`, the same for every controller.

    ```python
    for result in bb.compare(["lqr", "lqi"], robot="kugle", events="mild", episodes=10):
        print(result.controller, result.success_rate)
    ```

    Args:
        controllers: each the name of a controller ("pid" runs at 500 Hz, unless `control_dt` is given;
            "zero" is zero torque), the path of a policy file (Stable-Baselines3 or ONNX) or of a training run, a
            `Controller`, or an object that maps a `State` to wheel torques in N·m (one that takes `position` gets the
            setpoint, m).
        task: name of the task; None is the policies' task, else "balance". Policy files without metadata need it or
            `options`.
        episodes: number of episodes; episode i is the episode of an environment seeded with seed + i.
        seed: of the first episode.
        num_threads: threads that step the robots; None uses all cores.
        engine: another engine in place of a model, "mujoco" or None; its motors are ideal.
        sweep: lists of values by name, all combinations of which are compared, or a list of points, each values by
            name. Names are options of the environment, "actuators.delay" for a part of one, "robot", parameters of the
            robot ("body_mass"), for which feedback laws are designed, or "events.body_mass", a number or a range that
            is unknown to all controllers. The episodes are the same at every point, and for any `num_threads`.
        checkpoint: file that keeps the points of a sweep that are done; a sweep that was interrupted continues from it.
        progress: called with the number of steps done and their total, or, of a sweep, of points.
        options: of the environment, as `robot`, `model`, `actuators` and `terrain`; they override the options that the
            policies were trained with. Without `max_wheel_torque`, feedback laws have the motors' limit and their own,
            not the policies' limit.

    Returns:
        A result for each controller, or, with a sweep, a `Study`.

    Raises:
        TypeError: a single name in place of a list of controllers, or a checkpoint without a sweep.
        ValueError: an unknown name, a number out of range, a policy for another environment, policies that were
            trained with different options of the environment, or a robot, motors or events that the engine does not
            simulate; points that are invalid, and a checkpoint of another study.
        ModuleNotFoundError: the engine is not installed.
        FileNotFoundError: there is no policy at that path.
        OSError: the checkpoint cannot be read or written.
    """
    if isinstance(controllers, str | Path):
        raise TypeError(f"controllers must be a list: [{str(controllers)!r}]")
    if checkpoint is not None and sweep is None:
        raise TypeError("checkpoint needs a sweep: pass its points as sweep=...")
    check_episodes(episodes)
    seed = check_seed(seed)
    found = [find(source, task=task, env_options=options) for source in controllers]
    shared_task = common_task(found, task)
    comparison = _Comparison(found, shared_task, episodes, seed, engine)
    if sweep is None:
        return comparison.results(options, num_threads, progress)
    points = points_of(sweep)
    names = full_names(points[0], option_names(shared_task))
    at_points = []
    for point in points:
        with at(point):
            at_points.append(options_at(point, names, options, common_options(found, options)))
            # Before the first point is run, and not after hours.
            comparison.batches(at_points[-1], 1)
    study = {
        "task": shared_task,
        "episodes": episodes,
        "seed": seed,
        "engine": engine,
        "controllers": [identity_of_controller(source) for source in controllers],
        "options": dict(options),
        "points": points,
    }

    labels = numbered([controller.name for controller in found])

    def work(point: int, num_threads: int | None, report: Progress) -> list[Row]:
        with at(points[point]):
            rows = [result.row() for result in comparison.results(at_points[point], num_threads, report)]
            return [{**row, "controller": name} for row, name in zip(rows, labels, strict=True)]

    rows = run_points(
        points,
        work,
        num_threads=num_threads,
        # An object in Python has one memory.
        is_parallel=all(controller.existing is None for controller in found),
        checkpoint=None if checkpoint is None else Checkpoint(checkpoint, study, len(points)),
        progress=progress,
    )
    return Study(tuple(points[0]), rows, task=shared_task)


@dataclasses.dataclass(frozen=True)
class _Comparison:
    """What `compare` runs, but for the options of the environment."""

    controllers: Sequence[ResolvedController]
    task: str
    episodes: int
    seed: int
    engine: str | None

    def batches(self, env_options: Mapping[str, Any], num_threads: int | None) -> list[Batch]:
        """The robots of each controller, in their model."""
        options = common_options(self.controllers, env_options)
        if self.engine is not None and "model" in env_options:
            raise InvalidInputError(f"engine = '{self.engine}' replaces model = '{options['model']}': leave one out")
        if self.engine is not None:
            # A policy may have been trained in a model that cannot represent the engine's states.
            options["model"] = "contact"
        return [
            batch_for(
                controller,
                self.episodes,
                task=self.task,
                num_threads=num_threads,
                seed=self.seed,
                options=options_of(controller, options, env_options),
                given=env_options,
            )
            for controller in self.controllers
        ]

    def results(self, env_options: Mapping[str, Any], num_threads: int | None, progress: Progress) -> list[Result]:
        """A result for each controller."""
        batches = self.batches(env_options, num_threads)
        if self.engine is not None:
            batches = [in_engine(batch, self.engine) for batch in batches]
        total = sum(batch.max_episode_steps for batch in batches)
        results: list[Result] = []
        before = 0
        for controller, batch in zip(self.controllers, batches, strict=True):

            def advance(step: int, before: int = before) -> None:
                progress(before + step, total)

            results.append(result_of(controller, batch, advance))
            before += batch.max_episode_steps
        return results
