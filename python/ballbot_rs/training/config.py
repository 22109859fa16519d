"""The training configuration: one TOML file, checked as it is read."""

import dataclasses
import sys
from importlib import resources
from pathlib import Path
from typing import Any

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

from ballbot_rs.envs.registration import BALANCE, TASKS, check_id

ALGORITHMS = ("PPO", "SAC")


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """When and on how many episodes the policy is evaluated during training."""

    every_timesteps: int = 122_880
    episodes: int = 50


@dataclasses.dataclass(frozen=True)
class TrainConfig:
    """What `ballbot train` does; the fields are the keys of the TOML file."""

    env_id: str = BALANCE
    algorithm: str = "PPO"
    total_timesteps: int = 700_000
    num_envs: int = 128
    num_threads: int | None = None
    torch_threads: int = 1
    env: dict[str, Any] = dataclasses.field(default_factory=dict)
    evaluation: Evaluation = dataclasses.field(default_factory=Evaluation)
    algorithm_arguments: dict[str, Any] = dataclasses.field(default_factory=dict)
    schedule: dict[str, str] = dataclasses.field(default_factory=dict)
    policy: dict[str, Any] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        check_id(self.env_id)
        for name in ("env", "algorithm_arguments", "schedule", "policy"):
            if not isinstance(getattr(self, name), dict):
                raise ValueError(f"{name} = {getattr(self, name)!r} must be a table")
        if self.algorithm not in ALGORITHMS:
            raise ValueError(f"unknown algorithm '{self.algorithm}': expected one of {', '.join(ALGORITHMS)}")
        counts = {
            "total_timesteps": self.total_timesteps,
            "num_envs": self.num_envs,
            "torch_threads": self.torch_threads,
            "num_threads": 1 if self.num_threads is None else self.num_threads,
            "evaluation.every_timesteps": self.evaluation.every_timesteps,
            "evaluation.episodes": self.evaluation.episodes,
        }
        for name, value in counts.items():
            if not isinstance(value, int) or isinstance(value, bool) or value < 1:
                raise ValueError(f"{name} = {value!r} is out of range: it must be a whole number of at least 1")
        for name, kind in self.schedule.items():
            if kind != "linear":
                raise ValueError(f"schedule.{name} = '{kind}': expected 'linear'")
            if name not in self.algorithm_arguments:
                raise ValueError(f"schedule.{name} has no value of that name in algorithm_arguments")
            initial = self.algorithm_arguments[name]
            if not isinstance(initial, (int, float)):
                raise ValueError(f"algorithm_arguments.{name} = {initial!r}: a scheduled value must be a number")


def parse(text: str, source: str) -> TrainConfig:
    """A configuration from TOML text; `source` is what messages call it.

    Raises:
        ValueError: malformed TOML, a key that is not known, or a value out of range.
    """
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{source}: {error}") from error
    _check_keys(source, table, TrainConfig)
    if "evaluation" in table:
        if not isinstance(table["evaluation"], dict):
            raise ValueError(f"{source}: evaluation = {table['evaluation']!r} must be a table")
        _check_keys(f"{source}: [evaluation]", table["evaluation"], Evaluation)
        table["evaluation"] = Evaluation(**table["evaluation"])
    try:
        return TrainConfig(**table)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{source}: {error}") from error


def _check_keys(source: str, table: dict[str, Any], kind: type) -> None:
    known = [field.name for field in dataclasses.fields(kind)]
    for key in table:
        if key not in known:
            raise ValueError(f"{source}: unknown key '{key}': expected one of {', '.join(known)}")


def default_text(task: str) -> str:
    """The TOML text of a task's own configuration.

    Raises:
        ValueError: there is no such task.
    """
    if task not in TASKS:
        raise ValueError(f"unknown task '{task}': expected one of {', '.join(TASKS)}")
    return (resources.files(__package__) / "configs" / f"{task}.toml").read_text(encoding="utf-8")


def load(task: str, path: Path | None = None) -> tuple[TrainConfig, str]:
    """A task's configuration and its text, from `path` or the one that comes with the package.

    Raises:
        ValueError: as `parse`.
        OSError: the file cannot be read.
    """
    text = default_text(task)
    if path is not None:
        text = path.read_text(encoding="utf-8")
    return parse(text, f"{task}.toml" if path is None else str(path)), text


def with_timesteps(text: str, timesteps: int) -> str:
    """The text with another `total_timesteps`, so that what a run keeps is what it did."""
    kept = [line for line in text.splitlines() if not line.lstrip().startswith("total_timesteps")]
    return "\n".join([f"total_timesteps = {timesteps}", *kept]) + "\n"
