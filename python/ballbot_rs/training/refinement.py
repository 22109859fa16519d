"""Evolution of a policy for any robot after its fit: it recovers from more of what the law just recovers from.

A fit averages over what observations do not show, so near the limits of a robot the policy commands too little torque
on some robots and too much on others. CMA-ES (Hansen, "The CMA evolution strategy: a tutorial", 2016) changes few
numbers of a policy with tied weights (`training.tied`): the last layer, and gains of the hidden units, of the rows of
an observation and of its ages. Each policy of a generation is tried on robots of the training's kind:

- released at tilts, and pushed, by fractions of what the law that is given the robot recovers from;
- in whole episodes that begin as the task's do, with the events and limits of `Refinement.episodes`; what counts is
  where they end, and how still the ball rests before.

Most robots are easy, so policies can be tried on some of them: those on which the mean of the search currently does
worst, and others in turn. Each generation has other starts and other noise, too: policies tried on the same starts all
along fell from starts between them.
"""

import importlib
import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from stable_baselines3.common.base_class import BaseAlgorithm

from ballbot_rs import _files
from ballbot_rs._core import SAME_ROBOT, Batch, Controller, Params, State
from ballbot_rs._extras import require
from ballbot_rs._state_rows import BALL_VELOCITY
from ballbot_rs.control.sb3_policy import tanh_network
from ballbot_rs.envs._batch_env import new_batch
from ballbot_rs.envs.family import number_of, robots_of
from ballbot_rs.envs.registration import DEFAULT_TASK, task_of
from ballbot_rs.envs.spaces import history_ages
from ballbot_rs.scenarios.scale import Scale
from ballbot_rs.training.config import Refinement, TrainConfig
from ballbot_rs.training.seeds import first_seed
from ballbot_rs.training.symmetry import kinds, linear_policies
from ballbot_rs.training.tied import ORBIT, Ties, linear_layers

Array = npt.NDArray[np.float64]
#: Weights and biases of each layer, from observations to actions.
Network = list[tuple[Array, Array]]

#: Azimuths of tilts and pushes, rad: towards a wheel and between two wheels, where policies fall first, midway, and one
#: more. Each generation has the last two turned by the golden angle, and each robot the last one.
AZIMUTHS: Final = np.radians([0.0, 60.0, 30.0, 75.0])
_TURNING: Final = 2
_GOLDEN_ANGLE: Final = np.pi * (3.0 - np.sqrt(5.0))
#: Of the largest tilt and push from which the law recovers. Each generation has them lower, by a part of the gap to the
#: next lower one.
FRACTIONS: Final = np.array([0.5, 0.65, 0.75, 0.85, 0.9, 0.95])
_GAPS: Final = np.diff(FRACTIONS, prepend=0.35)
_GOLDEN_RATIO: Final = (np.sqrt(5.0) - 1.0) / 2.0
#: Starts of each robot.
_STARTS: Final = 2 * len(FRACTIONS) * len(AZIMUTHS)
#: Time in which a robot recovers or falls, s, and of slow robots, whose scale of time relative to the paper's robot is
#: above `SLOW`: they fall later, after they have rocked more and more. All in trials of 8 s take longer and gave no
#: better policies.
SECONDS: Final = 2.6
SLOW_SECONDS: Final = 6.5
SLOW: Final = 1.7

#: Most robots of a family.
MOST: Final = 10_000

#: The law's limits are searched up to these multiples of the holdable lean and the capture impulse.
_MOST: Final = 1.6
#: Passes of the search; each divides an interval by the number of fractions.
_PASSES: Final = 3
#: Pushes do not count where the law withstands less than this fraction of the capture impulse.
_LEAST_PUSH: Final = 0.1

#: Episodes of each robot in place, one for each of its neighbors.
_EPISODES: Final = SAME_ROBOT
#: The last fifth of an episode, in which the ball should rest, has this many parts; its speed is measured before each.
_RESTS: Final = 5
#: Speed of the ball that counts half as much as rest on the paper's robot, m/s.
_ROCKING: Final = 0.008
#: Weights of the parts of the objective.
_WEIGHTS: Final = {
    "tilt limit": 3.5,
    "tilt starts": 1.0,
    "push limit": 5.0,
    "push starts": 1.0,
    "upright": 2.0,
    "in place": 4.5,
    "at rest": 2.0,
}
#: Factor of the actions afterwards. On robots that were not tried, policies fall from too little torque more often than
#: from too much.
MARGIN: Final = 1.025
#: Every so many generations the mean is tried on all robots, and the hardest are chosen again.
_EVERY: Final = 4


def refine(
    model: BaseAlgorithm,
    trials: "Trials",
    ties: Ties,
    seed: int,
    tell: Callable[[str], None],
    record: Path | None = None,
) -> None:
    """Replaces the actor of a fitted policy by the average policy of the evolution's last half, if it is better.

    Its actions are larger by `MARGIN`.

    Args:
        model: of PPO, with a fitted actor.
        trials: of its configuration, with the limits of the teacher measured.
        ties: between the weights of the actor.
        seed: of the evolution.
        tell: called with the parts of the objective.
        record: a file that keeps the objective of each policy. An interrupted evolution from the same fit continues
            after the generations in it, as if it had not been interrupted.

    Raises:
        ValueError: the record is damaged.
        OSError: it cannot be read or written.
    """
    settings = trials.settings
    network = network_of(model)
    space = Space(network, ties, trials.ages)
    optimizer = trials.cmaes.CMA(
        mean=np.zeros(space.size), sigma=settings.sigma, seed=seed, population_size=settings.population
    )

    def tried(numbers: Array, what: str) -> float:
        parts = trials.on_all(space.network(numbers))
        value = float(objective(parts))
        tell(f"{what}: {value:.3f}, {_text(parts)}")
        return value

    fit, means = tried(optimizer.mean, "the fit"), []
    values = [] if record is None or not record.exists() else _read(record, settings.population)
    known = len(values)
    for generation in range(1, settings.generations + 1):
        candidates = [optimizer.ask() for _ in range(settings.population)]
        if generation > known:
            trials.begin(generation)
            values.append([float(objective(trials.parts(space.network(one)))) for one in candidates])
            if record is not None:
                _files.write(record, json.dumps(values))
        optimizer.tell([(one, -value) for one, value in zip(candidates, values[generation - 1], strict=True)])
        means.append(optimizer.mean.copy())
        if generation % _EVERY == 0 and generation + _EVERY > known:
            tried(optimizer.mean, f"refined for {generation} generations")
    # What the last means have by chance of the robots that they were tried on averages out.
    average = np.mean(means[settings.generations // 2 :], axis=0)
    if tried(average, "the average of the last half of the generations") < fit:
        tell("the fit stays")
        return
    policy: Any = model.policy
    layers = [*linear_layers(policy.mlp_extractor.policy_net), policy.action_net]
    with torch.no_grad():
        for layer, (weights, _) in zip(layers, space.network(average), strict=True):
            layer.weight.copy_(torch.as_tensor(weights, dtype=torch.float32))
        for parameter in policy.action_net.parameters():
            parameter.mul_(MARGIN)


def _read(record: Path, population: int) -> list[list[float]]:
    """The objective of each policy of the generations so far."""
    try:
        values = np.array(json.loads(record.read_text(encoding="utf-8")), dtype=np.float64)
        if values.ndim != 2 or values.shape[1] != population or not np.isfinite(values).all():
            raise ValueError(f"its shape is {values.shape}, expected (generations, {population}) finite numbers")
    except (ValueError, TypeError) as error:
        raise ValueError(f"{record} is damaged: {error}; delete it to refine from the beginning") from error
    found: list[list[float]] = values.tolist()
    return found


def objective(parts: Mapping[str, Any]) -> Any:
    """What the evolution maximizes, of all robots or of each."""
    return sum(weight * parts[name] for name, weight in _WEIGHTS.items())


def _means(measured: Mapping[str, Array]) -> dict[str, float]:
    """Means over the robots; 1 where no robot has a limit."""
    counted = {name: values[~np.isnan(values)] for name, values in measured.items()}
    return {name: float(values.mean()) if values.size else 1.0 for name, values in counted.items()}


def _text(parts: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:.3f}" for name, value in parts.items())


def network_of(model: BaseAlgorithm) -> Network:
    """The layers of an actor.

    Raises:
        ValueError: they are not hidden layers with tanh between them, or too many weights.
    """
    found = tanh_network(model)
    if found is None or len(found) < 2:
        raise ValueError("[refinement]: the policy needs hidden layers with tanh between them, at most 8192 weights")
    return [(np.asarray(weights, np.float64), np.asarray(biases, np.float64)) for weights, biases in found]


class Space:
    """What the evolution changes: numbers that are zero for the fitted network.

    Args:
        network: of the fit.
        ties: between its weights.
        ages: how many observations it is given together.
    """

    def __init__(self, network: Network, ties: Ties, ages: int) -> None:
        self._network = network
        last = network[-1][0]
        sixes = last.shape[1] // ORBIT
        self._basis = linear_policies(ties.of_last_layer)
        self._coefficients = np.einsum("bij,ikj->kb", self._basis, last.reshape(3, sixes, ORBIT))
        self._typical = np.sqrt(np.square(self._coefficients).mean(axis=1, keepdims=True))
        rows = network[0][0].shape[1] // ages
        #: Of the rows of one observation.
        self._kinds = kinds(ties.pairs)[:rows]
        inner = [len(biases) // ORBIT for _, biases in network[:-1]]
        self._sizes = [self._coefficients.size, *inner, int(self._kinds.max()) + 1, ages]

    @property
    def size(self) -> int:
        """How many numbers there are."""
        return sum(self._sizes)

    def network(self, numbers: Array) -> Network:
        """The network of some numbers."""
        change, *inner, of_kinds, of_ages = np.split(numbers, np.cumsum(self._sizes)[:-1])
        scales = np.exp(of_ages[:, None] + of_kinds[self._kinds]).ravel()
        layers = []
        for (weights, biases), gains in zip(self._network[:-1], inner, strict=True):
            layers.append((weights * np.exp(np.repeat(gains, ORBIT))[:, None] * scales, biases))
            scales = np.ones(len(biases))
        coefficients = self._coefficients + change.reshape(self._coefficients.shape) * self._typical
        last = np.einsum("kb,bij->ikj", coefficients, self._basis).reshape(3, -1)
        return [*layers, (last, self._network[-1][1])]


class _Starts(NamedTuple):
    """Robots that are released or pushed."""

    batch: Batch
    #: Their places among the starts of all robots.
    places: npt.NDArray[np.int64]
    #: Length of their trials.
    steps: int


class Trials:
    """What each policy is tried on, the same for all.

    Args:
        config: whose environment the robots have.
        settings: the robots.
        seed: of the noise of their sensors, and of the starts in place.

    Raises:
        ValueError: another task than balance, a policy without a teacher or without ties, invalid robots or events,
            fewer robots than those to keep.
    """

    def __init__(self, config: TrainConfig, settings: Refinement, seed: int) -> None:
        _check(config)
        with require("[refinement]", "train"):
            self.cmaes = importlib.import_module("cmaes")
        self.settings = settings
        self._config, self._first_seed = config, first_seed(seed)
        self._fall_tilt = config.env.get("fall_tilt", np.inf)
        robots = [robot for i, spec in enumerate(settings.robots) for robot in _sampled(i, spec)]
        if settings.hardest is not None and settings.hardest + settings.others > len(robots):
            raise ValueError(
                f"refinement.hardest = {settings.hardest} and refinement.others = {settings.others} are more than "
                f"the {len(robots)} robots of refinement.robots"
            )
        self._all = robots
        self._hardest = np.arange(len(robots))
        self._make(self._hardest, 0)

    def _make(self, kept: npt.NDArray[np.int64], generation: int) -> None:
        """Makes the environments of some robots in a generation."""
        self._robots = [self._all[i] for i in kept]
        self._azimuths = np.tile(AZIMUTHS, (len(kept), 1))
        self._azimuths[:, -1] += _GOLDEN_ANGLE * kept
        self._azimuths[:, -_TURNING:] += _GOLDEN_ANGLE * generation
        self._fractions = FRACTIONS - _GAPS * (_GOLDEN_RATIO * generation % 1.0)
        self._rocking = _ROCKING * np.array([robot.scale("m/s") for robot in self._robots])
        slow = np.array([robot.scale("s") > SLOW for robot in self._robots])
        groups = ((~slow, SECONDS), (slow, SLOW_SECONDS))
        self._starts = [self._starts_of(of, seconds) for of, seconds in groups if of.any()]
        settings = self.settings.episode_options
        self._whole = [self._batch_of_kind(i, options) for i, options in enumerate(settings)]
        (rows,) = {one.batch.observation_len for one in self._starts}
        for options, one in zip(settings, self._whole, strict=True):
            if one.observation_len != rows:
                raise ValueError(
                    f"refinement.episodes: the observation with {options} has {one.observation_len} rows, "
                    f"expected {rows}"
                )
        count = len(kept) * max(_STARTS, _EPISODES)
        seeds = self._first_seed + generation * count
        self._seeds = np.arange(seeds, seeds + count)

    def _starts_of(self, these: npt.NDArray[np.bool_], seconds: float) -> _Starts:
        """The starts of these of the robots, shape (robots,)."""
        batch = self._batch(_STARTS, [robot for robot, is_one in zip(self._robots, these, strict=True) if is_one])
        places = np.arange(len(these) * _STARTS).reshape(-1, _STARTS)[these].ravel()
        return _Starts(batch, places, math.ceil(seconds / batch.control_dt))

    def _batch_of_kind(self, i: int, options: Mapping[str, Any]) -> Batch:
        try:
            return self._batch(_EPISODES, self._robots, **options)
        except (TypeError, ValueError) as error:
            raise ValueError(f"refinement.episodes[{i}]: {error}") from error

    def _batch(self, episodes: int, robots: list[Params], **options: Any) -> Batch:
        """Environments for a number of episodes of each robot."""
        env = {name: value for name, value in self._config.env.items() if name not in ("reset_tilt", "events")}
        each = [robot for robot in robots for _ in range(episodes // SAME_ROBOT)]
        return new_batch(
            len(each) * SAME_ROBOT,
            task=task_of(self._config.env_id),
            num_threads=self._config.num_threads,
            options={**env, "robot": each, **options},
            seed=self._first_seed,
        )

    def measure(self, law: Controller) -> None:
        """Measures from how much a law recovers; the starts are fractions of it.

        Raises:
            ValueError: the law cannot be designed for a robot, or a robot cannot be pushed by as much as it may recover
                from.
        """
        scales = [Scale.of(robot) for robot in self._robots]
        sizes = np.array([[one.holdable_lean for one in scales], [one.capture_impulse for one in scales]])
        most = _MOST * sizes
        most[0] = np.minimum(most[0], self._fall_tilt)
        try:
            limits = self._limits(law, most)
        except ValueError as error:
            raise ValueError(f"refinement.robots: {error}") from error
        self._of_all = limits, np.array([np.ones(len(scales), dtype=bool), limits[1] > _LEAST_PUSH * sizes[1]])
        self._place(self._hardest)

    def on_all(self, network: Network) -> dict[str, float]:
        """The `parts` of a policy on all robots, in generation 0; after `measure`.

        Generations that begin later have the robots on which this policy does worst.
        """
        self._begin_with(np.arange(len(self._all)), 0)
        measured = self._measured(network)
        hardest = self.settings.hardest
        if hardest is not None:
            # Without a limit, a robot is easy.
            by_robot = {name: np.nan_to_num(values, nan=1.0) for name, values in measured.items()}
            self._hardest = np.argsort(objective(by_robot), kind="stable")[:hardest]
        return _means(measured)

    def begin(self, generation: int) -> None:
        """Takes the robots, the starts and the noise of a generation; generation 0 is for comparisons."""
        at_once = self.settings.others
        rest = np.setdiff1d(np.arange(len(self._all)), self._hardest)
        others = np.roll(rest, -generation * at_once)[:at_once]
        self._begin_with(np.sort(np.concatenate([self._hardest, others])), generation)

    def _begin_with(self, kept: npt.NDArray[np.int64], generation: int) -> None:
        self._make(kept, generation)
        self._place(kept)

    def _place(self, kept: npt.NDArray[np.int64]) -> None:
        """Sets the starts of the present robots from their limits."""
        # Only where it counts is there a limit.
        sizes, self._counts = (of_all[:, kept] for of_all in self._of_all)
        self._tilts, self._impulses = self._tilts_and_pushes(sizes[..., None] * self._fractions)

    @property
    def ages(self) -> int:
        """How many observations a policy is given together."""
        return len(history_ages(self._whole[0].history))

    def parts(self, network: Network) -> dict[str, float]:
        """The parts of the objective for a policy, each from 0 to 1; 1 where no robot has a limit."""
        return _means(self._measured(network))

    def _measured(self, network: Network) -> dict[str, Array]:
        """The parts of each robot, of shape (robots,); NaN where there is no limit."""
        recovered = self._recovered(network)
        limit = np.concatenate([[0.0], self._fractions])[_first(recovered)]
        found: dict[str, Array] = {}
        for kind, counts, limits, starts in zip(
            ("tilt", "push"), self._counts, limit, recovered.mean(axis=(2, 3)), strict=True
        ):
            found[f"{kind} limit"] = np.where(counts, limits, np.nan)
            found[f"{kind} starts"] = np.where(counts, starts, np.nan)
        ended = [self._ended(batch, network) for batch in self._whole]

        def share(name: str) -> Array:
            of_robots: Array = np.average([one[name] for one in ended], axis=0, weights=self.settings.weights)
            return of_robots

        return {**found, **{name: share(name) for name in ("upright", "in place", "at rest")}}

    def _ended(self, batch: Batch, network: Network) -> dict[str, Array]:
        """How whole episodes end, each of shape (robots,)."""
        batch.reset(seeds=self._seeds[: batch.num_envs].tolist())
        steps = max(1, batch.max_episode_steps // (5 * _RESTS))
        ended = batch.episodes(network, max(0, batch.max_episode_steps - _RESTS * steps))
        upright, squares = np.ones(batch.num_envs, dtype=bool), np.zeros(batch.num_envs)
        for _ in range(_RESTS):
            # An episode that ends early is followed by another, which does not count.
            upright &= ~(ended["terminated"] | ended["truncated"])
            squares += np.square(batch.states()[:, BALL_VELOCITY]).sum(axis=1) / _RESTS
            ended = batch.episodes(network, steps)
        upright &= ~ended["terminated"]
        found = {
            "upright": upright,
            "in place": upright & ended["success"],
            "at rest": upright / (1.0 + np.sqrt(squares) / np.repeat(self._rocking, _EPISODES)),
        }
        return {name: values.reshape(len(self._robots), -1).mean(axis=1) for name, values in found.items()}

    def _recovered(self, network: Network) -> npt.NDArray[np.bool_]:
        """Which starts the policy recovers from, of shape (2, robots, fractions, azimuths)."""

        def fallen(batch: Batch, steps: int) -> npt.NDArray[np.bool_]:
            found: npt.NDArray[np.bool_] = batch.episodes(network, steps)["terminated"]
            return found

        return self._upright(self._tilts, self._impulses, fallen)

    def _limits(self, law: Controller, most: Array) -> Array:
        """Largest tilts (rad) and pushes (N·s) up to which the law recovers in all azimuths, of shape (2, robots)."""
        low, high = np.zeros_like(most), most
        steps = np.arange(1, len(FRACTIONS) + 1) / len(FRACTIONS)

        def fallen(batch: Batch, steps: int) -> npt.NDArray[np.bool_]:
            found = np.zeros(batch.num_envs, dtype=bool)
            for _ in range(steps):
                found |= batch.step(batch.control(law, privileged=True, drawn=True))[2]
            return found

        for _ in range(_PASSES):
            grid = low[..., None] + (high - low)[..., None] * steps
            within = _first(self._upright(*self._tilts_and_pushes(grid), fallen))[..., None]
            bounds = np.concatenate([low[..., None], grid, high[..., None]], axis=-1)
            low, high = (np.take_along_axis(bounds, within + up, axis=-1)[..., 0] for up in (0, 1))
        return low

    def _tilts_and_pushes(self, sizes: Array) -> tuple[list[State], Array]:
        """Starts and impulses (N·s) of tilts (rad) and pushes of these sizes, of shape (2, robots, fractions)."""
        cos, sin = np.cos(self._azimuths), np.sin(self._azimuths)
        starts = []
        for robot, tilts, *directions in zip(self._robots, sizes[0], cos, sin, strict=True):
            axes = [(-tilt * s, tilt * c) for tilt in tilts.tolist() for c, s in zip(*directions, strict=True)]
            starts += [_leaning(robot, axis) for axis in axes] + [_leaning(robot, (0.0, 0.0))] * len(axes)
        impulses = np.zeros((len(self._robots), 2, len(FRACTIONS), len(AZIMUTHS), 3))
        impulses[:, 1, :, :, 0] = sizes[1][..., None] * cos[:, None, :]
        impulses[:, 1, :, :, 1] = sizes[1][..., None] * sin[:, None, :]
        return starts, impulses.reshape(-1, 3)

    def _upright(
        self, starts: list[State], impulses: Array, fallen: Callable[[Batch, int], npt.NDArray[np.bool_]]
    ) -> npt.NDArray[np.bool_]:
        """Which robots have not fallen after their starts, of shape (2, robots, fractions, azimuths).

        Args:
            starts: of all robots.
            impulses: pushes at the starts, N·s.
            fallen: gives which robots of a batch fall in a number of steps.
        """
        found = np.empty(len(starts), dtype=bool)
        for batch, places, steps in self._starts:
            batch.reset(seeds=self._seeds[places].tolist(), starts=[starts[place] for place in places])
            for i, impulse in enumerate(impulses[places]):
                if impulse.any():
                    batch.push(i, impulse)
            found[places] = ~fallen(batch, steps)
        return np.swapaxes(found.reshape(len(self._robots), 2, len(FRACTIONS), len(AZIMUTHS)), 0, 1)


def _sampled(i: int, spec: Mapping[str, Any]) -> list[Params]:
    """The robots of family `i` of the settings."""
    try:
        count = number_of(spec)
        if count > MOST:
            raise ValueError(f"robot.family = {count} is out of range: it must be at most {MOST}")
        return robots_of(spec, SAME_ROBOT * count)
    except (TypeError, ValueError) as error:
        raise ValueError(f"refinement.robots[{i}]: {error}") from error


def _first(recovered: npt.NDArray[np.bool_]) -> npt.NDArray[np.int64]:
    """How many of the smallest sizes are recovered from in all azimuths, from the shape (..., sizes, azimuths)."""
    count: npt.NDArray[np.int64] = np.logical_and.accumulate(recovered.all(axis=-1), axis=-1).sum(axis=-1)
    return count


def _leaning(robot: Params, tilt: tuple[float, float]) -> State:
    return State.at_equilibrium(robot, tilt=tilt)


def _check(config: TrainConfig) -> None:
    layers = config.policy.get("net_arch")
    hidden = layers.get("pi", []) if isinstance(layers, Mapping) else layers
    holds = {
        f"env_id = '{config.env_id}'": task_of(config.env_id) == DEFAULT_TASK,
        f"algorithm = '{config.algorithm}'": config.algorithm == "PPO",
        f"symmetric = {config.symmetric!r}": config.symmetric is True,
        "there is no [teacher]": config.teacher is not None,
        f"policy.net_arch = {layers!r}": hidden != [],
    }
    for what, is_right in holds.items():
        if not is_right:
            raise ValueError(
                f"[refinement]: {what}: expected PPO of {DEFAULT_TASK}, symmetric = true, a teacher, and hidden layers"
            )
