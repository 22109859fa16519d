"""Settings of training on Ray, and conversion of Stable-Baselines3's PPO configuration to RLlib's. Needs neither."""

import dataclasses
import socket
from collections.abc import Mapping
from typing import Any, Final

from ballbot_rs.envs.family import are_several
from ballbot_rs.training.config import TrainConfig

#: Most workers of a training run; docs/ray.md shows where more do not help.
MAX_WORKERS: Final = 1024

#: Arguments of Stable-Baselines3's PPO that RLlib's also has: its name there, and the default here.
ARGUMENTS: Final[Mapping[str, tuple[str, Any]]] = {
    "learning_rate": ("lr", 3e-4),
    "gamma": ("gamma", 0.99),
    "gae_lambda": ("lambda_", 0.95),
    "clip_range": ("clip_param", 0.2),
    "n_epochs": ("num_epochs", 10),
    "batch_size": ("minibatch_size", 64),
    "ent_coef": ("entropy_coeff", 0.0),
    "vf_coef": ("vf_loss_coeff", 0.5),
    "max_grad_norm": ("grad_clip", 0.5),
}
#: Default number of steps of each robot before an update.
DEFAULT_STEPS: Final = 2048

#: Time to reach the address of a cluster, s.
REACH_SECONDS: Final = 5.0


@dataclasses.dataclass(frozen=True)
class Ray:
    """Number of workers, and their cluster.

    Raises:
        ValueError: a number of workers out of range, or no address.
    """

    workers: int = 1
    #: HOST:PORT of a cluster; None starts a cluster in this process.
    address: str | None = None

    def __post_init__(self) -> None:
        if isinstance(self.workers, bool) or not isinstance(self.workers, int) or not 1 <= self.workers <= MAX_WORKERS:
            raise ValueError(f"workers = {self.workers!r} is out of range: it must be from 1 to {MAX_WORKERS}")
        if self.address is not None:
            host_and_port(self.address)

    def reach(self) -> None:
        """Checks that something listens at the address; Ray itself would try for minutes.

        Raises:
            ConnectionError: nothing listens there.
        """
        if self.address is None:
            return
        try:
            socket.create_connection(host_and_port(self.address), REACH_SECONDS).close()
        except OSError as error:
            raise ConnectionError(f"--ray-address {self.address}: no Ray cluster answers there: {error}") from error

    def robots_each(self, config: TrainConfig) -> int:
        """Number of robots of each worker.

        Raises:
            ValueError: the robots cannot be divided evenly, or differ.
        """
        if self.workers > 1 and are_several(config.env.get("robot")):
            raise ValueError(f"workers = {self.workers}: each worker would have only the first robots, expected 1")
        each, rest = divmod(config.num_envs, self.workers)
        if rest or each == 0:
            raise ValueError(
                f"num_envs = {config.num_envs} robots are not a multiple of {self.workers} workers: "
                "change --workers, or --set num_envs=..."
            )
        return each


def host_and_port(address: str) -> tuple[str, int]:
    """The parts of an address.

    Raises:
        ValueError: it is not HOST:PORT.
    """
    host, _, port = address.rpartition(":")
    if not host or "/" in host or not port.isdecimal() or not 1 <= int(port) <= 65535:
        raise ValueError(f"--ray-address {address} is not an address: expected HOST:PORT with a port from 1 to 65535")
    return host, int(port)


def arguments(config: TrainConfig, done: int = 0) -> dict[str, Any]:
    """Arguments of RLlib's `PPOConfig.training`.

    Args:
        config: the configuration.
        done: steps that the run has done; a falling rate continues from there.

    Raises:
        ValueError: a setting that RLlib's PPO does not have.
    """
    given = _checked(config)
    found = {theirs: given.get(ours, default) for ours, (theirs, default) in ARGUMENTS.items()}
    if "learning_rate" in config.schedule:
        left = max(config.total_timesteps - done, 1)
        rate = float(found["lr"]) * left / config.total_timesteps
        found["lr"] = [[0, rate], [left, 0.0]]
    return found


def steps_each(config: TrainConfig) -> int:
    """Steps of each robot before an update."""
    return int(config.algorithm_arguments.get("n_steps", DEFAULT_STEPS))


def _checked(config: TrainConfig) -> dict[str, Any]:
    """The arguments of the algorithm."""
    if config.algorithm != "PPO":
        raise ValueError(f"algorithm = {config.algorithm}: only PPO is available on Ray")
    given = config.arguments()
    # RLlib always normalizes advantages.
    if given.pop("normalize_advantage", True) is not True:
        raise ValueError(
            f"algorithm_arguments.normalize_advantage = {config.algorithm_arguments['normalize_advantage']!r}: "
            "PPO of RLlib always normalizes them"
        )
    known = {*ARGUMENTS, "n_steps"}
    for name, value in given.items():
        if name not in known:
            expected = ", ".join(sorted(known))
            raise ValueError(f"algorithm_arguments.{name} = {value!r}: not supported on Ray, expected {expected}")
    for name in config.schedule:
        if name != "learning_rate":
            raise ValueError(f"schedule.{name} = '{config.schedule[name]}': on Ray only learning_rate has a schedule")
    if "features_extractor_class" in config.policy:
        raise ValueError("policy.features_extractor_class is not supported on Ray")
    return given
