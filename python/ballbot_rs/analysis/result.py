"""The result of one controller over episodes."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ballbot_rs import _short
from ballbot_rs._core import Batch
from ballbot_rs._state_rows import BALL_POSITION, tilt_of
from ballbot_rs.analysis import intervals
from ballbot_rs.analysis.rollout import rollout
from ballbot_rs.analysis.settling import censored_median, push_recovery_times, settling_times
from ballbot_rs.control.resolve import ResolvedController
from ballbot_rs.envs._batch_env import metric_names

#: Tilt within which a robot has settled, rad.
SETTLED_TILT = np.deg2rad(1.0)

#: Distance of the ball from the setpoint within which a robot has recovered unless its task has another, m.
RECOVERED_DISTANCE = 0.1

#: Most steps of all episodes of a comparison, which are kept in memory: 24 bytes each.
MAX_STEPS = 10**8


@dataclasses.dataclass(frozen=True, repr=False)
class Result:
    """Performance of a controller over a number of episodes.

    ```python
    result = bb.evaluate("lqr", robot="kugle", episodes=10)
    print(result.success_rate, result.tilt_rms)
    ```
    """

    controller: str
    #: Model of the robot, or name of another engine.
    model: str
    #: Time between two actions, s.
    control_dt: float
    #: Time step of the model, s: the option `sim_dt`, or less where the controller's period is not a multiple of it.
    sim_dt: float
    episodes: int
    #: Fraction of episodes that ended in success. With pushes it reflects the time of the last push, not the
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

    def row(self) -> dict[str, Any]:
        """One row for a table: numbers by name, `success_low` and `success_high` the interval of the success rate.

        Metrics of the task and the bounds of their intervals follow; None means no number.
        """
        tuples = ("success_interval", "recovery_limits", "metrics", "metric_intervals")
        tilt, distance = self.recovery_limits
        low, high = self.success_interval
        found = {name: value for name, value in vars(self).items() if name not in tuples}
        found |= {"success_low": low, "success_high": high, "recovery_tilt": tilt, "recovery_distance": distance}
        for name, value in self.metrics.items():
            bounds = self.metric_intervals[name] or (None, None)
            found |= {name: value, f"{name}_low": bounds[0], f"{name}_high": bounds[1]}
        return {name: None if value != value else value for name, value in found.items()}

    def _repr_html_(self) -> str:
        numbers = {name: value for name, value in vars(self).items() if not isinstance(value, (Mapping, tuple))}
        numbers |= self.metrics
        return _short.table([name.replace("_", " "), _short.number(value)] for name, value in numbers.items())


def result_of(controller: ResolvedController, batch: Batch, advance: Callable[[int], None]) -> Result:
    """The result of a controller in the first episode of each robot of a batch.

    Args:
        controller: on every robot.
        batch: the robots.
        advance: called with the number of steps done.

    Raises:
        ValueError: more than `MAX_STEPS` steps.
    """
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
    names = metric_names(batch.task)
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
