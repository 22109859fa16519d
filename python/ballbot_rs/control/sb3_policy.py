"""Policy files of Stable-Baselines3: their metadata, saving and loading."""

import importlib
import zipfile
from collections.abc import Mapping
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.save_util import load_from_zip_file
from stable_baselines3.common.vec_env import unwrap_vec_normalize

from ballbot_rs import __version__
from ballbot_rs.control import policy_file
from ballbot_rs.envs.registration import env_id_of
from ballbot_rs.envs.spaces import action_space, observation_space

#: Modules with algorithms for continuous actions, and their names; policies with a memory of their own are left out.
ALGORITHMS: Final = {
    "stable_baselines3": ("PPO", "A2C", "SAC", "TD3", "DDPG"),
    "sb3_contrib": ("TQC", "TRPO", "CrossQ", "ARS"),
}

#: The attribute of a saved model that holds its metadata.
METADATA: Final = "ballbot_metadata"


def algorithms() -> dict[str, type[BaseAlgorithm]]:
    """Algorithms by name, those of sb3-contrib where it is installed."""
    found: dict[str, type[BaseAlgorithm]] = {}
    for module, names in ALGORITHMS.items():
        try:
            loaded = importlib.import_module(module)
        except ModuleNotFoundError:
            continue
        found.update({name: getattr(loaded, name) for name in names if hasattr(loaded, name)})
    return found


def metadata(task: str, algorithm: str, env_options: Mapping[str, Any]) -> dict[str, Any]:
    """The metadata of a policy file; `env_options` are all options of the environment."""
    return {
        "env_id": env_id_of(task),
        "algorithm": algorithm,
        "env_options": dict(env_options),
        "observation": policy_file.observation_layout(task),
        "ballbot_rs": __version__,
    }


def save(model: BaseAlgorithm, path: str | PathLike[str]) -> Path:
    """Saves a model of Stable-Baselines3 with the task that it was trained for; every command takes such a file.

    Args:
        model: trained on a `BallbotVecEnv`, or on environments of `gymnasium.make`.
        path: the file; `.zip` is added unless it ends so.

    Returns:
        The file.

    Raises:
        ValueError: an environment that is not of this package or that changes observations or actions (VecNormalize,
            VecFrameStack, ...), an algorithm that is not known, or a model without environment.
    """
    known = algorithms()
    algorithm = next((name for name, kind in known.items() if isinstance(model, kind)), None)
    if algorithm is None:
        raise ValueError(f"unknown algorithm '{type(model).__name__}', expected one of {', '.join(known)}")
    env = model.get_env()
    if env is not None:
        try:
            (task,), (options,) = env.get_attr("task", [0]), env.get_attr("task_options", [0])
        except AttributeError:
            raise ValueError("the model's environment is not one of ballbot_rs") from None
        if unwrap_vec_normalize(env) is not None:
            raise ValueError("VecNormalize's statistics are not part of a policy file: train without it")
        spaces = observation_space(task, options["scale_observations"]), action_space()
        if (model.observation_space, model.action_space) != spaces:
            raise ValueError(
                f"a wrapper has changed the spaces: {model.observation_space} to {model.action_space}, "
                f"expected {spaces[0]} to {spaces[1]}"
            )
        setattr(model, METADATA, metadata(task, algorithm, options))
    elif not isinstance(getattr(model, METADATA, None), dict):
        raise ValueError("the model has no environment to take the task from: model.set_env(...) gives it one")
    file = Path(fspath(path))
    if file.suffix != ".zip":
        file = file.with_name(f"{file.name}.zip")
    file.parent.mkdir(parents=True, exist_ok=True)
    model.save(file)
    return file


def find_file(path: Path) -> Path:
    """The policy file that `path` means: itself, or the best one of a run's folder.

    Raises:
        FileNotFoundError: there is none.
    """
    candidate = path / "best_model.zip" if path.is_dir() else path
    if candidate.is_file():
        return candidate
    raise FileNotFoundError(f"no policy at {path}: neither a policy file nor a run with best_model.zip in it")


def act(model: BaseAlgorithm, observations: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """The policy's actions, computed on one thread: for small networks a second one costs more than it brings."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        actions: npt.NDArray[np.float32] = model.predict(observations, deterministic=True)[0]
    finally:
        torch.set_num_threads(threads)
    return actions


def load(path: Path, task: str, env_options: Mapping[str, Any] | None = None) -> tuple[BaseAlgorithm, dict[str, Any]]:
    """A policy for a task with its metadata, in which `env_options` are complete.

    The file may hold pickled code: load only files that you trust.

    Args:
        path: the file, or the folder of a training run.
        task: name of the task.
        env_options: options of the environment, for a file without metadata; None refuses such a file.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is no policy file, or one for another environment or another layout of observations.
    """
    path = find_file(path)
    if not zipfile.is_zipfile(path):
        raise ValueError(f"{path} is not a policy file of Stable-Baselines3")
    try:
        data, _, _ = load_from_zip_file(path, device="cpu")
    except ModuleNotFoundError as error:
        raise ValueError(
            f"{path} needs {error.name}, which is not installed. Policies that `ballbot train` saved before 0.2.0 "
            "scale observations with a module of that version: export them as ONNX with it, or train anew"
        ) from error
    except (ValueError, KeyError, AttributeError, OSError) as error:
        raise ValueError(f"{path} is not a policy file of Stable-Baselines3: {error}") from error
    found = (data or {}).get(METADATA)
    if found is None and data and env_options is not None:
        return _load_unnamed(path, data, task, env_options)
    if not isinstance(found, dict):
        raise ValueError(
            f"{path} does not say which environment it was trained on: name the task, "
            f"or save it with ballbot_rs.save; expected {env_id_of(task)}"
        )
    expected = metadata(task, str(found.get("algorithm")), {})
    for field, value in expected.items():
        if not isinstance(found.get(field), type(value)):
            raise ValueError(f"{path} does not say its {field}: it is no policy file of ballbot_rs")
    for field, is_same in (
        ("env_id", found["env_id"] == expected["env_id"]),
        ("observation", policy_file.fits(found["observation"], task)),
    ):
        if not is_same:
            raise ValueError(
                f"{path} was trained for another environment: "
                f"{field} is {found.get(field)!r}, expected {expected[field]!r}"
            )
    known = algorithms()
    if found["algorithm"] not in known:
        raise ValueError(f"{path}: unknown algorithm '{found['algorithm']}', expected one of {', '.join(known)}")
    try:
        model = known[found["algorithm"]].load(path, device="cpu")
    except (ValueError, KeyError, AttributeError, RuntimeError) as error:
        raise ValueError(f"{path} holds no {found['algorithm']} policy that can be loaded: {error}") from error
    return model, {**found, "env_options": policy_file.completed(task, found["env_options"])}


def _load_unnamed(
    path: Path, data: dict[str, Any], task: str, env_options: Mapping[str, Any]
) -> tuple[BaseAlgorithm, dict[str, Any]]:
    spaces = data.get("observation_space"), data.get("action_space")
    known = {scaled: (observation_space(task, scaled), action_space()) for scaled in (True, False)}
    scaled = next((scaled for scaled, those in known.items() if spaces == those), None)
    if scaled is None:
        raise ValueError(
            f"{path} was trained for another environment: it maps {spaces[0]} to {spaces[1]}, "
            f"expected {known[True][0]} to {known[True][1]}"
        )
    # Observations without scaling are those of a policy from before 0.2.0, unless the options say more.
    options = {"scale_observations": True, **env_options} if scaled else dict(env_options)
    name = _algorithm_of(data)
    found = {**metadata(task, name, {}), "env_options": policy_file.completed(task, options)}
    try:
        return algorithms()[name].load(path, device="cpu"), found
    except (ValueError, KeyError, AttributeError, RuntimeError) as error:
        raise ValueError(f"{path} holds no {name} policy that can be loaded: {error}") from error


def _algorithm_of(data: dict[str, Any]) -> str:
    """The algorithm that wrote a file. Those that share their policy's class act alike."""
    module = getattr(data.get("policy_class"), "__module__", "")
    for name in algorithms():
        if f".{name.lower()}." in module:
            return name
    return "PPO" if "clip_range" in data else "A2C"
