"""Controllers and policies on the same starts, and the numbers by which they are compared."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Batch, Lqr, Pid
from ballbot_rs.batch_owner import check_count, check_seed
from ballbot_rs.registration import BALANCE, check_id

Observations = npt.NDArray[np.float32]
Actions = npt.NDArray[np.float32]

#: Controllers by name; anything else is the path of a policy.
CONTROLLERS = ("pid", "lqr", "zero")

#: The paper's PID has a derivative filter of 327 rad/s, which 100 Hz cannot sample: it runs at its own rate.
PID_CONTROL_DT = 0.002

#: Where things stand in a row of `Batch.states`.
_BALL_POSITION = slice(0, 2)
_BODY_QUATERNION = slice(16, 20)


class BatchController(Protocol):
    """Chooses the actions of all robots at once."""

    def __call__(self, observations: Observations) -> npt.ArrayLike:
        """Actions, shape (n, 3), for observations, shape (n, 16)."""


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


class _Feedback:
    """A controller of this package on every robot of a batch."""

    def __init__(self, batch: Batch, make: Callable[[], Lqr | Pid]) -> None:
        self._batch = batch
        self._controllers = [make() for _ in range(batch.num_envs)]

    def __call__(self, observations: Observations) -> npt.ArrayLike:  # noqa: ARG002
        position = self._batch.setpoint
        torques = [
            controller(self._batch.state(i), position=position) for i, controller in enumerate(self._controllers)
        ]
        return np.asarray(torques) / self._batch.max_wheel_torque


def _feedback(name: str, batch: Batch) -> BatchController:
    # The environment clips each torque at its own limit; a controller that knows it keeps their direction.
    params = batch.params.replace(max_wheel_torque=batch.max_wheel_torque)
    control_dt = batch.control_dt
    return _Feedback(batch, lambda: Pid(params, control_dt) if name == "pid" else Lqr(params, control_dt))


def _policy(path: Path, env_id: str) -> tuple[BatchController, dict[str, Any]]:
    try:
        from ballbot_rs.training.policy import load_policy
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"a policy file needs {error.name}: install it with `pip install 'ballbot-rs[train]'`",
            name=error.name,
        ) from error
    model, metadata = load_policy(path, env_id)
    return lambda observations: model.predict(observations, deterministic=True)[0], metadata["env_options"]


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
) -> list[Result]:
    """Runs episodes of one task from the starts that `seed` gives, the same for every controller.

    Args:
        controllers: each "pid" (at 500 Hz, unless a `control_dt` is given), "lqr", "zero", or the path of a policy file
            or of a training run.
        env_id: the environment.
        episodes: how many; episode i is that of an environment seeded with seed + i.
        seed: of the first episode.
        num_threads: threads that step the robots; None takes all cores.
        env_options: arguments of the environment, over those that the policies were trained with.

    Raises:
        ValueError: a name that is not known, a number out of range, a policy for another environment, or policies
            that were trained with different arguments of the environment.
        FileNotFoundError: there is no policy at that path.
    """
    check_id(env_id)
    check_count("episodes", episodes)
    seed = check_seed(seed)
    policies = {name: _policy(Path(name), env_id) for name in controllers if name not in CONTROLLERS}
    options: dict[str, Any] = {}
    for name, (_, trained_with) in policies.items():
        if options and trained_with != options:
            raise ValueError(f"{name} was trained with {trained_with}, another policy with {options}: not one task")
        options = trained_with
    options = {**options, **(env_options or {})}
    results = []
    for name in controllers:
        batch = Batch(episodes, "same_step", num_threads, seed, **options)
        if name == "pid" and "control_dt" not in options:
            batch = Batch(episodes, "same_step", num_threads, seed, **{**options, **_sampled_for_pid(batch)})
        if name in policies:
            act = policies[name][0]
        elif name == "zero":
            act = _zero
        else:
            act = _feedback(name, batch)
        results.append(_run(name, batch, act))
    return results


def _zero(observations: Observations) -> npt.ArrayLike:
    return np.zeros((len(observations), 3), np.float32)


def _sampled_for_pid(batch: Batch) -> dict[str, Any]:
    control_dt = max(round(PID_CONTROL_DT / batch.sim_dt), 1) * batch.sim_dt
    seconds = batch.max_episode_steps * batch.control_dt
    return {"control_dt": control_dt, "max_episode_steps": round(seconds / control_dt)}


def _run(name: str, batch: Batch, act: BatchController) -> Result:
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
        if not running.any():
            break
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
