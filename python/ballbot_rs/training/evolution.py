"""Evolution of small policies with CMA-ES: each robot of a generation has its own policy, and is stepped in Rust.

Needs neither torch nor Stable-Baselines3.
"""

import dataclasses
import itertools
import time
from collections.abc import Iterator, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs import _toml
from ballbot_rs._checks import check_bounded, check_count, check_options
from ballbot_rs._core import Batch
from ballbot_rs._extras import require
from ballbot_rs._progress import Progress, no_progress
from ballbot_rs.control import network_file, policy_file, policy_size
from ballbot_rs.envs._batch_env import new_batch, resolved_options, without_curriculum
from ballbot_rs.envs.family import are_several
from ballbot_rs.envs.registration import task_of
from ballbot_rs.training import run_folder
from ballbot_rs.training.config import TrainConfig
from ballbot_rs.training.run_folder import Evaluations
from ballbot_rs.training.seeds import EVALUATION_SEEDS, JUDGED, first_seed
from ballbot_rs.training.symmetry import linear_policies, of_batch

Array = npt.NDArray[np.float64]

#: The name in a configuration.
ALGORITHM: Final = "CMA"
#: Steps after which a run ends once its best policy succeeds often enough, and after which it ends in any case.
TIMESTEPS: Final = {"total_timesteps": 20_000_000, "max_timesteps": 100_000_000}
#: Keys of the configuration of another algorithm that hold for evolution, too.
_SHARED: Final = ("env_id", "num_threads", "env")
#: Steps of trials for each step of an evaluation.
_TRIALS_PER_JUDGED: Final = 1
#: Fraction of the robots that survive their trials from which the mean policy is evaluated.
_SURVIVING: Final = 0.25
#: Variation of combinations of observations, as a fraction of the largest, below which they are noise.
_LEAST_VARIATION: Final = 0.03
#: Rows of an observation above which a full covariance takes longer than the robots.
_MOST_ROWS: Final = 200
#: The largest variation of robots that stay at rest.
_AT_REST: Final = 1e-5
#: Time between two writings of the best policy, s.
_WRITE_SECONDS: Final = 5.0


@dataclasses.dataclass(frozen=True)
class Settings:
    """The table `algorithm_arguments` of a configuration."""

    #: Policies of a generation of the first search; each further search has twice as many.
    population: int = 16
    #: Starts from which each policy of a generation is tried; they are the same for all.
    starts: int = 4
    #: Initial standard deviation of the sums of a layer, for inputs of 1 or, if `symmetric`, for observations of random
    #: policies.
    sigma: float = 0.5
    #: Cost per step of numbers of a policy whose mean square is 1. Without it actions tend to switch between -1 and 1.
    decay: float = 1e-3
    #: Length of the first trials as a fraction of an episode; it grows while most robots survive.
    first_trial: float = 0.25
    #: Steps after which the first search is given up for another; each further search has twice as many.
    search_steps: int = 3_000_000
    #: Whether only linear policies that turn and mirror with the robot are searched, for robots with three equal wheels
    #: 120 degrees apart; None: where there are such policies, of at most 200 rows, and the center of mass is above the
    #: center of the ball.
    symmetric: bool | None = None

    def __post_init__(self) -> None:
        if self.symmetric is not None and not isinstance(self.symmetric, bool):
            raise TypeError(f"symmetric = {self.symmetric!r} is not a boolean")
        for name, least in (("population", 4), ("starts", 1), ("search_steps", 1)):
            if check_count(name, getattr(self, name)) < least:
                raise ValueError(f"{name} = {getattr(self, name)}, it must be at least {least}")
        check_bounded("sigma", self.sigma, 1e-6, 1e3)
        check_bounded("decay", self.decay, 0.0, 1.0)
        check_bounded("first_trial", self.first_trial, 1e-3, 1.0)

    @classmethod
    def of(cls, config: TrainConfig) -> "Settings":
        """The settings of a configuration.

        Raises:
            ValueError: an unknown name, or a number out of range.
        """
        try:
            check_options(
                "algorithm_arguments", config.algorithm_arguments, [one.name for one in dataclasses.fields(cls)]
            )
            return cls(**config.algorithm_arguments)
        except (TypeError, ValueError) as error:
            raise ValueError(f"algorithm_arguments: {error}") from error


def adapted(text: str) -> str:
    """The configuration of another algorithm with CMA-ES in its place: the same task and the same required success."""
    table = _toml.loads(text)
    kept: dict[str, Any] = {name: table[name] for name in _SHARED if name in table}
    success = table.get("evaluation", {}).get("success")
    evaluation = {"episodes": JUDGED} if success is None else {"episodes": JUDGED, "success": success}
    return _toml.dumps({**kept, "algorithm": ALGORITHM, **TIMESTEPS, "evaluation": evaluation})


Layers = list[tuple[Array, Array]]


class Networks:
    """All networks of one shape: the numbers are the weights and biases of their layers.

    Args:
        widths: of the observation, of each hidden layer, and of the action.
    """

    def __init__(self, widths: Sequence[int]) -> None:
        self._layers = list(itertools.pairwise(widths))
        #: Length of the vector of numbers.
        self.size = sum(outputs * (inputs + 1) for inputs, outputs in self._layers)

    def network(self, numbers: Array) -> Layers:
        """Weights (n, outputs, inputs) and biases (n, outputs) of each layer, from numbers (n, `size`)."""
        found, rest = [], numbers
        for inputs, outputs in self._layers:
            layer, rest = np.split(rest, [outputs * (inputs + 1)], axis=1)
            layer = layer.reshape(-1, outputs, inputs + 1) / np.sqrt(inputs)
            found.append((layer[..., 1:], layer[..., 0]))
        return found


class Symmetric:
    """Linear policies that turn and mirror with the robot: the numbers are their coordinates.

    Args:
        basis: policies that span the space, of shape (`size`, 3, observations).
    """

    def __init__(self, basis: Array) -> None:
        self._basis = basis
        self.size = len(basis)

    def network(self, numbers: Array) -> Layers:
        """As `Networks.network`."""
        return [(np.tensordot(numbers, self._basis, axes=1), np.zeros((len(numbers), 3)))]

    def scaled(self, observations: Array) -> "Symmetric":
        """The same policies in other coordinates: random coordinates of 1 give independent actions of about 1.

        Args:
            observations: typical ones, of shape (n, observations). Combinations of them that hardly vary count as if
                they varied by `_LEAST_VARIATION` of the largest; if none varies, the coordinates stay.
        """
        actions = np.tensordot(observations, self._basis, axes=(1, 2)).reshape(-1, self.size, 3)
        values, vectors = np.linalg.eigh(np.einsum("nio,njo->ij", actions, actions) / (3 * len(observations)))
        if values[-1] < _AT_REST**2:
            return self
        values = np.maximum(values, _LEAST_VARIATION**2 * values[-1])
        scale = (vectors / np.sqrt(self.size * values)) @ vectors.T
        return Symmetric(np.tensordot(scale, self._basis, axes=1))


def _symmetric_basis(batch: Batch, hidden: list[int]) -> Array:
    """The basis of the symmetric policies for the robot of a batch.

    Raises:
        ValueError: there are none, or too many for a full covariance.
    """
    if hidden:
        raise ValueError(f"only linear policies can be symmetric, but net_arch = {hidden}")
    if (rows := batch.observation_len) > _MOST_ROWS:
        raise ValueError(f"an observation has {rows} rows, but at most {_MOST_ROWS} are allowed: use a shorter history")
    return linear_policies(of_batch(batch))


@dataclasses.dataclass(frozen=True)
class Judged:
    """A policy with its episodes of nominal robots, each array of shape (episodes,)."""

    numbers: Array
    #: Steps of the run before them.
    timesteps: int
    returns: Array
    lengths: Array
    successes: Array

    @property
    def rank(self) -> tuple[float, float]:
        """The higher, the better the policy."""
        return float(self.successes.mean()), float(self.returns.mean())


class Evolution:
    """The search of a run.

    Args:
        config: its configuration.
        seed: of the run.

    Raises:
        ValueError: the configuration is invalid for the environment or for CMA-ES.
        ModuleNotFoundError: cmaes is missing.
    """

    def __init__(self, config: TrainConfig, seed: int) -> None:
        with require("evolution", "evolution"):
            import cmaes
        self._cmaes = cmaes
        self._config, self._seed = config, seed
        self._settings = Settings.of(config)
        self._task = task_of(config.env_id)
        if are_several(config.env.get("robot")):
            raise ValueError("robot: evolution tries each policy on one robot, not on several")
        one = new_batch(1, task=self._task, num_threads=1, options=config.env)
        self._options = resolved_options(one, config.env)
        nominal = {name: value for name, value in without_curriculum(config.env).items() if name != "events"}
        self._nominal = new_batch(
            config.evaluation.episodes, task=self._task, num_threads=config.num_threads, options=nominal
        )
        if self._nominal.stage is not None:
            raise ValueError(f"{self._task} has a part in Python: evolution steps robots in Rust only")
        unknown = set(config.policy) - {"net_arch"}
        policy_size.check_net_arch(config.policy, self._nominal.observation_len)
        hidden = config.policy.get("net_arch", [])
        if unknown or not isinstance(hidden, list) or not all(isinstance(width, int) for width in hidden):
            raise ValueError(f"policy = {config.policy}: evolution accepts only net_arch, a list of widths of layers")
        #: Steps of all robots, evaluations included.
        self.timesteps = 0
        self._space = self._space_of(hidden)
        self.judged: list[Judged] = []
        self.best: Judged | None = None

    def _space_of(self, hidden: list[int]) -> Networks | Symmetric:
        """The policies to search, with hidden layers of the given widths."""
        expected = self._settings.symmetric
        # A robot whose center of mass is off the mast needs biases, which no symmetry allows.
        leans = any(self._nominal.nominal_params(0).body_com_offset)
        if expected or (expected is None and not leans):
            try:
                return Symmetric(_symmetric_basis(self._nominal, hidden))
            except ValueError as error:
                if expected:
                    raise ValueError(f"algorithm_arguments: symmetric = True: {error}") from error
        return Networks([self._nominal.observation_len, *hidden, 3])

    def _scaled(self, space: Symmetric) -> Symmetric:
        """The policies in coordinates that are scaled with the observations of random ones."""
        robots = self._robots(self._settings.population)
        # Sums of `sigma` for inputs of 1.
        spread = self._settings.sigma * np.sqrt(3.0 / space.size)
        random = spread * np.random.default_rng(self._seed).standard_normal((self._settings.population, space.size))
        robots.reset(seeds=[first_seed(self._seed) + i for i in range(robots.num_envs)])
        steps = self._first_trial(robots)
        policies = space.network(np.repeat(random, self._settings.starts, axis=0))
        observations = robots.rollout(policies=policies, steps=steps, record=["observations"])["observations"]
        self.timesteps += steps * robots.num_envs
        return space.scaled(observations.reshape(-1, robots.observation_len).astype(float))

    def _robots(self, population: int) -> Batch:
        """A robot for each start of each policy of a generation."""
        count = population * self._settings.starts
        return new_batch(count, task=self._task, num_threads=self._config.num_threads, options=self._config.env)

    def _first_trial(self, robots: Batch) -> int:
        """Steps of the first trials."""
        return max(round(self._settings.first_trial * robots.max_episode_steps), 1)

    @property
    def is_over(self) -> bool:
        """Whether the run has reached its aim, or its largest number of steps."""
        if self.best is None:
            return False
        success, required = self.best.rank[0], self._config.evaluation.success
        reached = self.timesteps >= self._config.total_timesteps and success >= (required or 0.0)
        return success == 1.0 or reached or self.timesteps >= self._config.most_timesteps

    def run(self) -> Iterator[Judged]:
        """Searches until `is_over`; gives each evaluation."""
        if isinstance(self._space, Symmetric):
            self._space = self._scaled(self._space)
        for search in itertools.count():
            yield from self._search(search)
            if self.is_over:
                return

    def _search(self, search: int) -> Iterator[Judged]:
        """A search from zero weights, until the run is over or the search is given up."""
        settings, starts = self._settings, self._settings.starts
        population = settings.population << search
        rng = np.random.default_rng((self._seed, search))
        # The symmetric policies are few enough for a full covariance.
        method = self._cmaes.CMA if isinstance(self._space, Symmetric) else self._cmaes.SepCMA
        optimizer = method(
            mean=np.zeros(self._space.size),
            sigma=settings.sigma,
            seed=int(rng.integers(2**32)),
            population_size=population,
        )
        robots = self._robots(population)
        episode, trial = robots.max_episode_steps, self._first_trial(robots)
        end, due = self.timesteps + (settings.search_steps << search), 0
        hardest: list[int] = []
        while self.timesteps < end and not optimizer.should_stop():
            candidates = np.array([optimizer.ask() for _ in range(population)])
            seeds = first_seed(self._seed) + rng.integers(EVALUATION_SEEDS, size=starts)
            seeds[: len(hardest)] = hardest
            robots.reset(seeds=np.tile(seeds, population).tolist())
            found = robots.episodes(self._space.network(np.repeat(candidates, starts, axis=0)), trial)
            self.timesteps += int(found["lengths"].sum())
            costs = -found["returns"].reshape(population, starts).mean(axis=1)
            costs += settings.decay * trial * np.square(candidates).mean(axis=1)
            optimizer.tell(list(zip(candidates, costs.tolist(), strict=True)))
            falls = found["terminated"].reshape(population, starts).sum(axis=0)
            # Few random starts come close to a fall: a start that does is kept until no policy falls from it.
            hardest = [int(seeds[falls.argmax()])] if trial == episode and falls.any() else []
            surviving = 1.0 - found["terminated"].mean()
            if surviving >= 0.5:
                trial = min(round(1.5 * trial) + 1, episode)
            is_last = self.timesteps >= self._config.most_timesteps
            if (self.timesteps >= due and surviving >= _SURVIVING) or is_last:
                judged = self._judge(optimizer.mean)
                steps = _TRIALS_PER_JUDGED * int(judged.lengths.sum())
                due = self.timesteps + max(steps, self._config.evaluation.every_timesteps)
                yield judged
                if self.is_over:
                    return

    def _judge(self, numbers: Array) -> Judged:
        first, count = first_seed(self._seed) + EVALUATION_SEEDS, self._nominal.num_envs
        self._nominal.reset(seeds=list(range(first, first + count)))
        network = self._space.network(numbers[None])
        found = self._nominal.episodes([(weights[0], biases[0]) for weights, biases in network])
        judged = Judged(
            numbers.copy(),
            self.timesteps,
            found["returns"],
            found["lengths"].astype(float),
            found["success"].astype(float),
        )
        self.timesteps += int(found["lengths"].sum())
        if self.best is None or judged.rank > self.best.rank:
            self.best = judged
        self.judged.append(judged)
        return judged

    def write(self, folder: Path) -> None:
        """Writes the best policy and all evaluations into a run.

        Raises:
            OSError: a file cannot be written.
        """
        if self.best is None:
            return
        described = policy_file.metadata(self._task, self._options, ALGORITHM, {"cmaes": metadata.version("cmaes")})
        network = [(weights[0], biases[0]) for weights, biases in self._space.network(self.best.numbers[None])]
        network_file.write(folder / policy_file.BEST_OF_RUN, network, described)
        columns = zip(*((j.timesteps, j.returns, j.lengths, j.successes) for j in self.judged), strict=True)
        Evaluations(*(np.array(column, dtype=float) for column in columns)).save(folder)


def train(
    config: TrainConfig,
    text: str,
    folder: Path,
    *,
    seed: int = 0,
    overwrite: bool = False,
    progress: Progress = no_progress,
) -> Path:
    """Searches a policy that succeeds, and returns its file.

    Args:
        config: the configuration.
        text: its TOML text, kept in the folder.
        folder: the run folder; must not exist yet or be empty.
        seed: of the search and of its environments.
        overwrite: whether to delete an earlier run in `folder`.
        progress: called with the number of steps done and the steps after which a run usually ends.

    Raises:
        FileExistsError: the folder has an earlier run.
        ValueError: the configuration does not fit the environment or CMA-ES, or another process trains in the folder.
        ModuleNotFoundError: cmaes or onnx is missing.
        OSError: a file cannot be written.
    """
    run_folder.check(folder, overwrite)
    evolution = Evolution(config, seed)
    with run_folder.held(folder):
        run_folder.begin(folder, text, seed, overwrite=overwrite, versions={"cmaes": metadata.version("cmaes")})
        started = written = time.perf_counter()
        try:
            for _ in evolution.run():
                progress(evolution.timesteps, max(config.total_timesteps, evolution.timesteps))
                if time.perf_counter() - written > _WRITE_SECONDS:
                    evolution.write(folder)
                    written = time.perf_counter()
        finally:
            run_folder.add_time(folder, evolution.timesteps, time.perf_counter() - started)
            evolution.write(folder)
        if evolution.best is not None and config.evaluation.success is not None:
            record = run_folder.read_record(folder)
            reached, required = evolution.best.rank[0], float(config.evaluation.success)
            run_folder.write_record(folder, {**record, "success": reached, "required_success": required})
    return folder / policy_file.BEST_OF_RUN
