"""Policy files: what the network sees, what a file says of itself, and how it is loaded."""

import zipfile
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
import torch
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.save_util import load_from_zip_file
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

from ballbot_rs import __version__
from ballbot_rs._core import OBSERVATION

CLASSES: dict[str, type[BaseAlgorithm]] = {"PPO": PPO, "SAC": SAC}

#: The attribute of a saved model that says what it was trained for.
METADATA = "ballbot_metadata"

#: Typical values while a robot balances, in the rows' own units: what the network sees is the observation less the
#: value of a robot at rest, over these.
TYPICAL = np.array([0.1] * 3 + [1.0] * 3 + [5.0] * 3 + [0.1] * 2 + [0.2] * 2 + [0.5] * 3, dtype=np.float32)
AT_REST = np.array([0.0, 0.0, -1.0] + [0.0] * 13, dtype=np.float32)


class ScaledObservation(BaseFeaturesExtractor):
    """Brings the rows of an observation to magnitudes near one, with constants rather than statistics.

    A policy then needs nothing but its own file, and sees the same at its first step as at its last.
    """

    at_rest: torch.Tensor
    gain: torch.Tensor

    def __init__(self, observation_space: gymnasium.Space[Any]) -> None:
        super().__init__(observation_space, features_dim=len(TYPICAL))
        self.register_buffer("at_rest", torch.as_tensor(AT_REST))
        self.register_buffer("gain", torch.as_tensor(1.0 / TYPICAL))

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Scaled observations, cut off at ten times the typical magnitude."""
        return ((observations - self.at_rest) * self.gain).clamp(-10.0, 10.0)


def metadata(env_id: str, algorithm: str, env_options: dict[str, Any]) -> dict[str, Any]:
    """What a policy file says of itself."""
    return {
        "env_id": env_id,
        "algorithm": algorithm,
        "env_options": env_options,
        "observation": [name for name, _, _ in OBSERVATION],
        "ballbot_rs": __version__,
    }


def find_policy(path: Path) -> Path:
    """The policy file that `path` means: itself, or the best one of a run's folder.

    Raises:
        FileNotFoundError: there is none.
    """
    candidate = path / "best_model.zip" if path.is_dir() else path
    if candidate.is_file():
        return candidate
    raise FileNotFoundError(f"no policy at {path}: neither a policy file nor a run with best_model.zip in it")


def act(model: BaseAlgorithm, observations: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """The policy's actions, on one thread: two would wait for each other, fifty times as long as they work."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        actions: npt.NDArray[np.float32] = model.predict(observations, deterministic=True)[0]
    finally:
        torch.set_num_threads(threads)
    return actions


def load_policy(path: Path, env_id: str) -> tuple[BaseAlgorithm, dict[str, Any]]:
    """A policy for `env_id` with its metadata. The file may hold pickled code: load only files that you trust.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is no policy file, or one for another environment or another layout of observations.
    """
    path = find_policy(path)
    if not zipfile.is_zipfile(path):
        raise ValueError(f"{path} is not a policy file of Stable-Baselines3")
    try:
        data, _, _ = load_from_zip_file(path, device="cpu")
    except (ValueError, KeyError, AttributeError, OSError) as error:
        raise ValueError(f"{path} is not a policy file of Stable-Baselines3: {error}") from error
    found = (data or {}).get(METADATA)
    if not isinstance(found, dict):
        raise ValueError(f"{path} does not say which environment it was trained on; expected {env_id}")
    expected = metadata(env_id, str(found.get("algorithm")), {})
    for field, value in expected.items():
        if not isinstance(found.get(field), type(value)):
            raise ValueError(f"{path} does not say its {field}: it is no policy file of ballbot_rs")
    for field in ("env_id", "observation"):
        if found.get(field) != expected[field]:
            raise ValueError(
                f"{path} was trained for another environment: "
                f"{field} is {found.get(field)!r}, expected {expected[field]!r}"
            )
    if found["algorithm"] not in CLASSES:
        raise ValueError(f"{path}: unknown algorithm '{found['algorithm']}', expected one of {', '.join(CLASSES)}")
    try:
        return CLASSES[found["algorithm"]].load(path, device="cpu"), found
    except (ValueError, KeyError, AttributeError, RuntimeError) as error:
        raise ValueError(f"{path} holds no {found['algorithm']} policy that can be loaded: {error}") from error
