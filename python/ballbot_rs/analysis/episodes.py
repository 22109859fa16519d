"""Controllers and policies compared over episodes from the same starts."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ballbot_rs import _short
from ballbot_rs._checks import check_count, check_seed
from ballbot_rs._core import Batch
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._progress import Progress, no_progress
from ballbot_rs._state_rows import BALL_POSITION, tilt_of
from ballbot_rs.analysis import intervals
from ballbot_rs.analysis.rollout import batch_for, rollout
from ballbot_rs.analysis.settling import censored_median, push_recovery_times, settling_times
from ballbot_rs.control.resolve import ResolvedController, Source, common_options, common_task, find, options_of
from ballbot_rs.engines.engine_batch import in_engine
from ballbot_rs.envs.registration import description_of

#: Tilt within which a robot has settled, rad.
SETTLED_TILT = np.deg2rad(1.0)

#: Distance of the ball from the setpoint within which a robot has recovered unless its task has another, m.
RECOVERED_DISTANCE = 0.1

#: Most episodes of a comparison, and most steps of all of them, which are kept in memory: 24 bytes each.
MAX_EPISODES = 100_000
MAX_STEPS = 10**8


@dataclasses.dataclass(frozen=True, repr=False)
class Result:
    """How a controller did over a number of episodes."""

    controller: str
    #: Model of the robot, or name of another engine.
    model: str
    #: Time between two actions, s.
    control_dt: float
    #: Time step of the model, s: the option `sim_dt`, or less where the controller's period is not a multiple of it.
    sim_dt: float
    episodes: int
    #: Fraction of episodes that ended in success. With pushes it measures the time of the last push, not the
    #: controller: judge by `survival_rate`, `recovery_time` and `ball_rms`.
    success_rate: float
    #: Wilson 95 % interval of that fraction.
    success_interval: tuple[float, float]
    #: Fraction of episodes that ran to their end.
    survival_rate: float
    #: Median time from which the tilt stays within 1 deg, s; None if it never does in most episodes.
    settling_time: float | None
    #: Pushes by events and the task, in all episodes.
    pushes: int
    #: Median time from a push until tilt and ball are back within `recovery_limits` and stay there up to the next push
    #: or the end, for at least 1 s; s. Times cut short by the next push count as censored (Kaplan and Meier), a fall
    #: as never. None if fewer than half recover, without pushes, and for tasks without the option `setpoint`.
    recovery_time: float | None
    #: Tilt (rad) and distance of the ball from the setpoint (m) within which a robot has recovered, as for a success.
    recovery_limits: tuple[float, float]
    #: Root mean square of the tilt over all steps, rad.
    tilt_rms: float
    #: Mean over episodes of the largest distance of the ball from the setpoint, m.
    ball_excursion: float
    #: Root mean square of the distance of the ball from the setpoint over all steps, m.
    ball_rms: float
    #: Root mean square of the commanded wheel torques over all steps, N·m.
    torque_rms: float
    #: Mean reward of a step, a fallen robot's missing steps counted as zero.
    mean_reward: float
    #: Metrics of the task by name, means over the episodes that ran to their end; None without such an episode.
    metrics: Mapping[str, float | None]
    #: 95 % intervals of these means, by bootstrap over episodes; None for fewer than two.
    metric_intervals: Mapping[str, tuple[float, float] | None]

    def __repr__(self) -> str:
        return (
            f"<Result of {self.controller} on {self.model}: {self.episodes} episodes, success {self.success_rate:.0%}, "
            f"upright {self.survival_rate:.0%}, mean reward {self.mean_reward:.4g}, "
            f"sim_dt {1e3 * self.sim_dt:.4g} ms>"
        )

    def _repr_html_(self) -> str:
        numbers = {name: value for name, value in vars(self).items() if not isinstance(value, (Mapping, tuple))}
        numbers |= self.metrics
        return _short.table([name.replace("_", " "), _short.number(value)] for name, value in numbers.items())


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


def evaluate(controller: Source, **arguments: Any) -> Result:
    """The result of one controller; arguments as in `compare`."""
    return compare([controller], **arguments)[0]


def compare(
    controllers: Sequence[Source],
    *,
    task: str | None = None,
    episodes: int = 100,
    seed: int = 1000,
    num_threads: int | None = None,
    env_options: Mapping[str, Any] | None = None,
    engine: str | None = None,
    progress: Progress = no_progress,
) -> list[Result]:
    """Runs episodes of one task from starts that follow from `seed`, the same for every controller.

    Args:
        controllers: each the name of a controller ("pid" runs at 500 Hz, unless `env_options` has a `control_dt`;
            "zero" is zero torque), the path of a policy file (Stable-Baselines3 or ONNX) or of a training run, a
            `Controller`, or an object that maps a `State` to wheel torques in N·m (one that takes `position` gets the
            setpoint, m).
        task: name of the task; None is the policies' task, else "balance". Policy files without metadata need it or
            `env_options`.
        episodes: number of episodes; episode i is the episode of an environment seeded with seed + i.
        seed: of the first episode.
        num_threads: threads that step the robots; None takes all cores.
        env_options: options of the environment; they override the options that the policies were trained with. Without
            `max_wheel_torque`, feedback laws have the motors' limit and their own, not the policies' limit.
        engine: another engine in place of a model, "mujoco" or None; its motors are ideal.
        progress: called with the number of steps done and their total.

    Raises:
        TypeError: a single name in place of a list of controllers.
        ValueError: an unknown name, a number out of range, a policy for another environment, policies that were
            trained with different options of the environment, or a robot, motors or events that the engine does not
            simulate.
        ModuleNotFoundError: the engine is not installed.
        FileNotFoundError: there is no policy at that path.
    """
    if isinstance(controllers, str | Path):
        raise TypeError(f"controllers must be a list: [{str(controllers)!r}]")
    check_episodes(episodes)
    seed = check_seed(seed)
    found = [find(source, task=task, env_options=env_options) for source in controllers]
    options = common_options(found, env_options)
    shared_task = common_task(found, task)
    if engine is not None and "model" in (env_options or {}):
        raise InvalidInputError(f"engine = '{engine}' replaces model = '{options['model']}': leave one out")
    if engine is not None:
        # A policy may have been trained in a model that cannot represent the engine's states.
        options["model"] = "contact"
    batches = [
        batch_for(
            controller,
            episodes,
            task=shared_task,
            num_threads=num_threads,
            seed=seed,
            options=options_of(controller, options, env_options),
            given=env_options or (),
        )
        for controller in found
    ]
    if engine is not None:
        batches = [in_engine(batch, engine) for batch in batches]
    total = sum(batch.max_episode_steps for batch in batches)
    results: list[Result] = []
    before = 0
    for controller, batch in zip(found, batches, strict=True):

        def advance(step: int, before: int = before) -> None:
            progress(before + step, total)

        results.append(_run(controller, batch, advance))
        before += batch.max_episode_steps
    return results


def _run(controller: ResolvedController, batch: Batch, advance: Callable[[int], None]) -> Result:
    n, steps = batch.num_envs, batch.max_episode_steps
    if n * steps > MAX_STEPS:
        raise ValueError(f"{n} episodes of {steps} steps are {n * steps} in all, more than {MAX_STEPS}")
    setpoint = np.asarray(batch.options.get("setpoint", (0.0, 0.0)))
    running = np.ones(n, dtype=bool)
    success = np.zeros(n, dtype=bool)
    survived = np.zeros(n, dtype=bool)
    tilts = np.full((steps, n), np.nan)
    distances = np.full((steps, n), np.nan)
    squared_torques = np.full((steps, n), np.nan)
    pushed = np.zeros((steps, n), dtype=np.bool_)
    push_counts = np.zeros(n)
    names = [metric["name"] for metric in description_of(batch.task)["metrics"]]
    last = np.full((n, len(names)), np.nan)
    returns = np.zeros(n)
    for chunk in rollout(batch, controller, steps):
        ended = chunk.terminated | chunk.truncated
        # Before a step: no earlier step has ended the first episode.
        still = running & (np.cumsum(ended, axis=0) - ended == 0)
        rows = slice(chunk.first, chunk.first + len(chunk))
        tilts[rows] = np.where(still, tilt_of(chunk.states, chunk.com), np.nan)
        away = np.linalg.norm(chunk.states[..., BALL_POSITION][..., :2] - setpoint, axis=-1)
        distances[rows] = np.where(still, away, np.nan)
        squared_torques[rows] = np.where(still, np.mean(chunk.torques**2, axis=-1), np.nan)
        counts = np.concatenate([push_counts[None], chunk.push_counts])
        pushed[rows] = (np.diff(counts, axis=0) > 0) & still
        push_counts = counts[-1]
        returns += np.where(still, chunk.rewards, 0.0).sum(axis=0)
        success |= (chunk.success & still).any(axis=0)
        ran = chunk.truncated & ~chunk.terminated & still
        survived |= ran.any(axis=0)
        for step, robot in np.argwhere(ran):
            last[robot] = chunk.metrics[step, robot]
        running &= ~ended.any(axis=0)
        advance(rows.stop)
        if not running.any():
            break
    advance(steps)
    settling = np.where(survived, settling_times(tilts, SETTLED_TILT, batch.control_dt), np.inf)
    median = float(np.median(settling))
    limits = _recovery_limits(batch)
    recovery = _recovery_time(tilts, distances, pushed, survived, limits, batch) if pushed.any() else math.inf
    metrics = {name: column[np.isfinite(column)] for name, column in zip(names, last.T, strict=True)}
    return Result(
        controller=controller.name,
        model=getattr(batch, "engine", batch.model),
        control_dt=batch.control_dt,
        sim_dt=batch.sim_dt,
        episodes=n,
        success_rate=float(success.mean()),
        success_interval=intervals.of_share(float(success.mean()), n),
        survival_rate=float(survived.mean()),
        settling_time=median if np.isfinite(median) else None,
        pushes=int(pushed.sum()),
        recovery_time=recovery if math.isfinite(recovery) else None,
        recovery_limits=limits,
        tilt_rms=float(np.sqrt(np.nanmean(tilts**2))),
        ball_excursion=float(np.nanmax(distances, axis=0).mean()),
        ball_rms=float(np.sqrt(np.nanmean(distances**2))),
        torque_rms=float(np.sqrt(np.nanmean(squared_torques))),
        mean_reward=float(returns.mean()) / steps,
        metrics={name: float(values.mean()) if len(values) else None for name, values in metrics.items()},
        metric_intervals={
            name: intervals.of_mean(values) if len(values) > 1 else None for name, values in metrics.items()
        },
    )


def _recovery_limits(batch: Batch) -> tuple[float, float]:
    options = batch.options
    radius = options.get("success_radius") or options.get("position_scale") or RECOVERED_DISTANCE
    return float(options.get("success_tilt") or SETTLED_TILT), float(radius)


def _recovery_time(
    tilts: npt.NDArray[np.float64],
    distances: npt.NDArray[np.float64],
    pushed: npt.NDArray[np.bool_],
    survived: npt.NDArray[np.bool_],
    limits: tuple[float, float],
    batch: Batch,
) -> float:
    """Median over the pushes of all episodes, s; infinite for a task whose setpoint is not an option."""
    if "setpoint" not in batch.options:
        return math.inf
    lengths = np.isfinite(tilts).sum(axis=0)
    outside = (tilts > limits[0]) | (distances > limits[1])
    found = [
        push_recovery_times(outside[:length, i], pushed[:length, i], not survived[i], batch.control_dt)
        for i, length in enumerate(lengths.tolist())
    ]
    times, known = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return censored_median(times, known)
