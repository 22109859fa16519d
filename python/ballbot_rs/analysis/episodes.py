"""Controllers and policies on the same starts, and the numbers by which they are compared."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Batch
from ballbot_rs._progress import Progress
from ballbot_rs.control.resolve import BatchController, common_options, find
from ballbot_rs.envs._batch_env import check_count, check_seed
from ballbot_rs.envs.registration import BALANCE, check_id

#: Where things stand in a row of `Batch.states`.
_BALL_POSITION = slice(0, 2)
_BODY_QUATERNION = slice(16, 20)


@dataclasses.dataclass(frozen=True)
class Result:
    """How a controller did over a number of episodes."""

    controller: str
    #: Model of the robot.
    model: str
    #: Time between two actions, s.
    control_dt: float
    episodes: int
    #: Share of episodes that ended in success.
    success_rate: float
    #: Share of episodes that ran to their end.
    survival_rate: float
    #: Median time from which the tilt stays within 1 deg, s; None if in most episodes it never does.
    settling_time: float | None
    #: Root mean square of the tilt over all steps, rad.
    tilt_rms: float
    #: Mean over episodes of the largest distance of the ball from the setpoint, m.
    ball_excursion: float
    #: Root mean square of the wheel torques over all steps, N·m.
    torque_rms: float
    #: Mean reward of a step, a fallen robot's missing steps counted as zero.
    mean_reward: float


def evaluate(controller: str, **arguments: Any) -> Result:
    """The result of one controller; arguments as in `compare`."""
    return compare([controller], **arguments)[0]


def compare(
    controllers: Sequence[str],
    *,
    env_id: str = BALANCE,
    episodes: int = 100,
    seed: int = 1000,
    num_threads: int | None = None,
    env_options: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
) -> list[Result]:
    """Runs episodes of one task from the starts that `seed` gives, the same for every controller.

    Args:
        controllers: each "pid" (at 500 Hz, unless a `control_dt` is given), "lqr", "zero", or the path of a policy file
            (of Stable-Baselines3, or ONNX) or of a training run.
        env_id: the environment.
        episodes: how many; episode i is that of an environment seeded with seed + i.
        seed: of the first episode.
        num_threads: threads that step the robots; None takes all cores.
        env_options: arguments of the environment, over those that the policies were trained with.
        progress: told how many of how many steps are done.

    Raises:
        ValueError: a name that is not known, a number out of range, a policy for another environment, or policies
            that were trained with different arguments of the environment.
        FileNotFoundError: there is no policy at that path.
    """
    check_id(env_id)
    check_count("episodes", episodes)
    seed = check_seed(seed)
    found = [find(name, env_id) for name in controllers]
    options = common_options(found, env_options)
    batches = [controller.batch(episodes, num_threads, seed, options) for controller in found]
    total = sum(batch.max_episode_steps for batch in batches)
    results: list[Result] = []
    for i, (controller, batch) in enumerate(zip(found, batches, strict=True)):
        before = sum(batch.max_episode_steps for batch in batches[:i])

        def advance(step: int, before: int = before) -> None:
            if progress is not None:
                progress(before + step, total)

        results.append(_run(controller.name, batch, controller.on(batch), advance))
    return results


def _run(name: str, batch: Batch, act: BatchController, advance: Callable[[int], None]) -> Result:
    n, steps = batch.num_envs, batch.max_episode_steps
    running = np.ones(n, dtype=bool)
    success = np.zeros(n, dtype=bool)
    survived = np.zeros(n, dtype=bool)
    tilts = np.full((steps, n), np.nan)
    distances = np.full((steps, n), np.nan)
    squared_torques = np.full((steps, n), np.nan)
    returns = np.zeros(n)
    observations = batch.reset()
    for step in range(steps):
        actions = np.asarray(act(observations), dtype=np.float32)
        states = batch.states()
        tilts[step, running] = _tilt(states[running])
        away = states[running, _BALL_POSITION] - np.asarray(batch.setpoint)
        distances[step, running] = np.linalg.norm(away, axis=1)
        torques = np.clip(actions, -1.0, 1.0) * batch.max_wheel_torque
        squared_torques[step, running] = np.mean(torques[running] ** 2, axis=1)
        observations, rewards, terminated, truncated = batch.step(actions)
        returns[running] += rewards[running]
        ended = (terminated | truncated) & running
        if ended.any():
            success[ended] = batch.endings()[0][ended]
            survived[ended] = truncated[ended]
            running &= ~ended
        advance(step + 1)
        if not running.any():
            break
    advance(steps)
    median = float(np.median(_settling_times(tilts, survived, np.deg2rad(1.0), batch.control_dt)))
    return Result(
        controller=name,
        model=batch.model,
        control_dt=batch.control_dt,
        episodes=n,
        success_rate=float(success.mean()),
        survival_rate=float(survived.mean()),
        settling_time=median if np.isfinite(median) else None,
        tilt_rms=float(np.sqrt(np.nanmean(tilts**2))),
        ball_excursion=float(np.nanmax(distances, axis=0).mean()),
        torque_rms=float(np.sqrt(np.nanmean(squared_torques))),
        mean_reward=float(returns.mean()) / steps,
    )


def _tilt(states: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    w, x, y, z = states[:, _BODY_QUATERNION].T
    mast = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x)])
    up = 1 - 2 * (x * x + y * y)
    angle: npt.NDArray[np.float64] = np.arctan2(np.linalg.norm(mast, axis=0), up)
    return angle


def _settling_times(
    tilts: npt.NDArray[np.float64], survived: npt.NDArray[np.bool_], limit: float, control_dt: float
) -> npt.NDArray[np.float64]:
    """Time of the first step from which each column stays within `limit`; infinite where it never does."""
    outside = tilts > limit
    last_outside = np.where(outside.any(axis=0), len(tilts) - 1 - np.argmax(outside[::-1], axis=0), -1)
    settled = survived & (last_outside < len(tilts) - 1)
    return np.where(settled, (last_outside + 1) * control_dt, np.inf)
