"""Episodes of a controller as data for imitation and offline learning."""

from __future__ import annotations

import dataclasses
import importlib
from collections.abc import Mapping
from os import PathLike
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from typing_extensions import Unpack

from ballbot_rs._arrays import keep_copies
from ballbot_rs._checks import check_bounded, check_seed
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._extras import require
from ballbot_rs._keywords import named
from ballbot_rs._progress import Progress, no_progress
from ballbot_rs.analysis import exports
from ballbot_rs.analysis.actors import make_actor
from ballbot_rs.analysis.episodes import check_episodes
from ballbot_rs.control.resolve import Source, common_options, common_task, find
from ballbot_rs.envs.options import TaskOptions
from ballbot_rs.envs.registration import env_id_of
from ballbot_rs.envs.vector_env import BallbotVectorEnv

Array = npt.NDArray[Any]

#: Most numbers of all observations.
MAX_NUMBERS: Final = 10**9


@dataclasses.dataclass(frozen=True, repr=False)
class Dataset:
    """Episodes one after another; its arrays are read-only.

    ```python
    data = bb.record_dataset("lqr", episodes=3, max_episode_steps=50)
    print(data.observations.shape, data.rewards[data.starts[0] : data.starts[1]].sum())
    ```

    Episode i has rows `starts[i]` to `starts[i + 1]`.

    Each row is a step, except the last row of an episode: the final observation, with zero action and reward.
    """

    controller: str
    #: Id of the environment, and options that make it.
    env_id: str
    env_options: Mapping[str, Any]
    seed: int
    #: First row of each episode, and the number of rows, shape (n + 1,).
    starts: Array
    #: Shape (rows, m), float32.
    observations: Array
    #: Within [-1, 1], shape (rows, 3), float32.
    actions: Array
    #: Shape (rows,), float64.
    rewards: Array
    #: Whether a step ended the episode, shape (rows,).
    terminations: Array
    truncations: Array
    #: The infos of the environment at each row, by key, shape (rows,): of the reset or step that led to it.
    infos: Mapping[str, Array]

    def __post_init__(self) -> None:
        options = self.env_options
        keep_copies(self)
        object.__setattr__(self, "env_options", dict(options))

    def __len__(self) -> int:
        return len(self.starts) - 1

    def __repr__(self) -> str:
        steps = len(self.rewards) - len(self)
        return f"<Dataset of {self.controller} in {self.env_id}: {len(self)} episodes, {steps} steps>"

    def to_npz(self, path: str | PathLike[str]) -> None:
        """Writes the arrays, compressed, for `numpy.load`; infos as `infos_` and their key.

        Raises:
            ValueError: a suffix other than .npz.
            OSError: the file cannot be written; an earlier one stays as it is.
        """
        names = ("starts", "observations", "actions", "rewards", "terminations", "truncations")
        infos = {f"infos_{key}": values for key, values in self.infos.items()}
        exports.write_npz({**{name: getattr(self, name) for name in names}, **infos}, path)

    def to_minari(self, dataset_id: str, **metadata: Any) -> Any:
        """Creates a dataset of Minari, with infos and the environment to evaluate in; returns its `MinariDataset`.

        Args:
            dataset_id: for example "ballbot/balance-lqr-v0"; it must not exist yet.
            metadata: further arguments of `minari.create_dataset_from_buffers`, as `author` and `description`.

        Raises:
            ModuleNotFoundError: minari is not installed.
            ValueError: an id that exists or that Minari rejects.
        """
        with require("a dataset of Minari", "minari"):
            minari = importlib.import_module("minari")
            buffer = importlib.import_module("minari.data_collector.episode_buffer").EpisodeBuffer
        import gymnasium

        episodes = []
        for i, (first, last) in enumerate(zip(self.starts[:-1], self.starts[1:], strict=True)):
            rows, steps = slice(first, last), slice(first, last - 1)
            episodes.append(
                buffer(
                    id=i,
                    seed=self.seed + i,
                    observations=self.observations[rows],
                    actions=self.actions[steps],
                    rewards=self.rewards[steps],
                    terminations=self.terminations[steps],
                    truncations=self.truncations[steps],
                    infos={key: values[rows] for key, values in self.infos.items()},
                )
            )
        env = gymnasium.make(self.env_id, **self.env_options)
        try:
            given = {"algorithm_name": self.controller, **metadata}
            return minari.create_dataset_from_buffers(dataset_id, buffer=episodes, env=env, eval_env=env, **given)
        finally:
            env.close()


@named
def record_dataset(
    controller: Source,
    *,
    episodes: int = 100,
    noise: float = 0.0,
    task: str | None = None,
    seed: int = 0,
    num_threads: int | None = None,
    progress: Progress = no_progress,
    **options: Unpack[TaskOptions],
) -> Dataset:
    """Records episodes of a task under a controller, all robots at once, as its environment returns them.

    ```python
    data = bb.record_dataset("lqr", episodes=3, noise=0.05, events="mild", max_episode_steps=50)
    data.to_npz("episodes.npz")
    ```

    Args:
        controller: as in `compare`, at the rate and torque limit of the environment.
        episodes: their number; episode i is the episode of the environment reset with seed + i.
        noise: standard deviation of Gaussian noise added to the actions, for states beyond the nominal closed loop.
        task: as in `compare`.
        seed: of the first episode, and of the noise.
        num_threads: threads that step the robots; None uses all cores.
        progress: called with the number of steps done and the largest possible number.
        options: as in `compare`.

    Raises:
        ValueError: a number out of range, or as `compare`.
        TypeError, ControllerError: as `compare`.
    """
    check_episodes(episodes)
    seed, noise = check_seed(seed), check_bounded("noise", noise, 0.0, 1.0)
    found = find(controller, task=task, env_options=options)
    chosen, env_options = common_task([found], task), common_options([found], options)
    env = BallbotVectorEnv(episodes, task=chosen, num_threads=num_threads, **env_options)
    batch = env._batch
    steps, width = batch.max_episode_steps, env.single_observation_space.shape
    if episodes * steps * (width or (1,))[0] > MAX_NUMBERS:
        raise InvalidInputError(
            f"{episodes} episodes of {steps} steps have more than {MAX_NUMBERS} numbers: record fewer at a time"
        )
    act, rng = make_actor(found, batch), np.random.default_rng(seed)
    observation, info = env.reset(seed=seed)
    keys = [key for key in info if not key.startswith("_")]
    rows: list[tuple[Array, ...]] = []
    infos: list[list[Array]] = [[info[key] for key in keys]]
    running = np.ones(episodes, dtype=bool)
    lengths = np.zeros(episodes, dtype=np.int64)
    while running.any():
        action = act(observation)
        if noise:
            action = np.clip(action + rng.normal(0.0, noise, action.shape), -1.0, 1.0).astype(np.float32)
        after, reward, terminated, truncated, info = env.step(action)
        rows.append((observation, action, reward, terminated, truncated))
        infos.append([info[key] for key in keys])
        lengths += running
        ended = terminated | truncated
        # The following step of these begins their next episodes, which are not kept.
        running &= ~ended
        if ended.any():
            act.ended(ended)
        observation = after
        progress(len(rows), steps)
    nothing = (np.zeros_like(part) for part in rows[-1][1:])
    rows.append((observation, *nothing))
    # Rows of an episode up to the observation after its last step.
    kept = np.arange(len(rows)) <= lengths[:, None]
    last = np.zeros_like(kept)
    last[np.arange(episodes), lengths] = True

    def flat(parts: list[Array], *, zero_at_end: bool = False) -> Array:
        values = np.swapaxes(np.array(parts), 0, 1)[kept]
        if zero_at_end:
            values[last[kept]] = 0
        return values

    names = ("observations", "actions", "rewards", "terminations", "truncations")
    arrays = {name: flat([row[i] for row in rows], zero_at_end=name != "observations") for i, name in enumerate(names)}
    return Dataset(
        controller=found.name,
        env_id=f"ballbot_rs:{env_id_of(chosen)}",
        env_options=env_options,
        seed=seed,
        starts=np.concatenate([[0], np.cumsum(lengths + 1)]),
        infos={key: flat([row[i] for row in infos]) for i, key in enumerate(keys)},
        **arrays,
    )
