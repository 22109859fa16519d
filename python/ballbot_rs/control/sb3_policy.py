"""Policy files of Stable-Baselines3: their metadata, saving and loading."""

import importlib
import io
import warnings
import zipfile
from collections.abc import Mapping
from os import PathLike, fspath
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import FlattenExtractor
from stable_baselines3.common.vec_env import unwrap_vec_normalize

from ballbot_rs import __version__, _files, _interrupts
from ballbot_rs._extras import require
from ballbot_rs._keywords import named
from ballbot_rs.control import policy_file, policy_size, sb3_archive
from ballbot_rs.control.network_file import Network
from ballbot_rs.envs.registration import DEFAULT_TASK, env_id_of
from ballbot_rs.envs.spaces import action_space, history_ages, observation_space, observation_width

#: Modules with algorithms for continuous actions, and their names.
ALGORITHMS: Final = {
    "stable_baselines3": ("PPO", "A2C", "SAC", "TD3", "DDPG"),
    "sb3_contrib": ("TQC", "TRPO", "CrossQ", "ARS", policy_size.RECURRENT),
}

#: The attribute of a saved model that holds its metadata.
METADATA: Final = "ballbot_metadata"

#: The largest weight of a network that robots are stepped with in Rust, and how many weights it has at most: each robot
#: has a copy, so larger networks are slower than in torch.
_LARGEST_WEIGHT: Final = 1e9
_MOST_WEIGHTS: Final = 8192


def algorithms() -> dict[str, type[BaseAlgorithm]]:
    """Algorithms by name, including sb3-contrib where it is installed."""
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


@named
def save(model: BaseAlgorithm, path: str | PathLike[str]) -> Path:
    """Saves a model of Stable-Baselines3 with the task that it was trained for; every command accepts such a file.

    ```python
    from stable_baselines3 import PPO

    model = PPO("MlpPolicy", bb.BallbotVecEnv(8, robot="kugle"), n_steps=16, batch_size=64)
    model.learn(128)
    print(bb.evaluate(bb.save(model, "policy.zip"), episodes=3))
    ```

    Args:
        model: trained on a `BallbotVecEnv`, or on environments of `gymnasium.make`.
        path: the file; `.zip` is added if missing.

    Returns:
        The file.

    Raises:
        ValueError: an environment that is not of this package or that changes observations or actions (VecNormalize,
            VecFrameStack, ...), an unknown algorithm, or a model without environment.
        OSError: the file cannot be written.
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
            raise ValueError("the model's environment is not from ballbot_rs") from None
        if unwrap_vec_normalize(env) is not None:
            raise ValueError("VecNormalize's statistics are not part of a policy file: train without it")
        spaces = observation_space(task, options), action_space()
        if (model.observation_space, model.action_space) != spaces:
            raise ValueError(
                f"a wrapper has changed the spaces: {model.observation_space} to {model.action_space}, "
                f"expected {spaces[0]} to {spaces[1]}{_instead(model.observation_space, spaces[0], options)}"
            )
        setattr(model, METADATA, metadata(task, algorithm, options))
    elif not isinstance(getattr(model, METADATA, None), dict):
        raise ValueError("the model has no environment to take the task from: model.set_env(...) gives it one")
    file = Path(fspath(path))
    if file.suffix != ".zip":
        file = file.with_name(f"{file.name}.zip")
    write(model, file)
    return file


def _instead(found: Any, expected: Any, options: Mapping[str, Any]) -> str:
    """What a message recommends in place of a wrapper that stacks observations; empty for other spaces."""
    times, rest = divmod(int(np.prod(found.shape)), int(np.prod(expected.shape)))
    if times < 2 or rest:
        return ""
    count = times * len(history_ages(options["history"]))
    return f"; instead of a wrapper, the option history={count} of the environment stacks observations"


def write(model: BaseAlgorithm, file: Path, extra: Mapping[str, bytes] = MappingProxyType({})) -> None:
    """Writes a model as Stable-Baselines3 does, but atomically.

    Args:
        model: the model.
        file: the file to write.
        extra: further content of the archive, by name.

    Raises:
        OSError: the file cannot be written.
    """
    content = io.BytesIO()
    # torch writes by calling Python from C++, which ends the process if a call raises.
    with _interrupts.held_back():
        model.save(content)
    with zipfile.ZipFile(content, "a") as archive:
        for name, other in extra.items():
            archive.writestr(name, other)
    _files.write(file, content.getvalue())


def find_file(path: Path) -> Path:
    """The policy file that `path` means: itself, or the best policy in a run's folder.

    Raises:
        FileNotFoundError: there is none.
    """
    candidate = path / "best_model.zip" if path.is_dir() else path
    if candidate.is_file():
        return candidate
    raise FileNotFoundError(f"no policy at {path}: neither a policy file nor a run with best_model.zip in it")


def act(model: BaseAlgorithm, observations: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """The policy's actions, computed on one thread: for small networks a second thread costs more than it gains."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        actions: npt.NDArray[np.float32] = model.predict(observations, deterministic=True)[0]
    finally:
        torch.set_num_threads(threads)
    return actions


def tanh_network(model: BaseAlgorithm) -> Network | None:
    """The layers from observations to actions, for `Batch.episodes`; None unless they are dense with tanh between them.

    A model with a state or squashed actions has none, nor has a network of more than 8192 weights, or with weights that
    are not numbers within ±1e9.
    """
    policy: Any = model.policy
    if type(policy) is not ActorCriticPolicy or type(policy.features_extractor) is not FlattenExtractor:
        return None
    hidden: list[Any] = list(policy.mlp_extractor.policy_net)
    dense, between = [*hidden[::2], policy.action_net], hidden[1::2]
    if policy.squash_output or len(dense) != len(between) + 1:
        return None
    if any(type(layer) is not torch.nn.Linear for layer in dense) or any(type(f) is not torch.nn.Tanh for f in between):
        return None
    layers = [(layer.weight.detach().numpy(), layer.bias.detach().numpy()) for layer in dense]
    are_few = sum(weights.size for weights, _ in layers) <= _MOST_WEIGHTS
    within = all(bool((np.abs(numbers) <= _LARGEST_WEIGHT).all()) for layer in layers for numbers in layer)
    return layers if are_few and within else None


def load(
    path: Path, task: str | None = None, env_options: Mapping[str, Any] | None = None
) -> tuple[BaseAlgorithm, dict[str, Any]]:
    """A policy for a task with its metadata, in which `env_options` are complete.

    A file of `ballbot_rs.save` or `ballbot train` is loaded without running code in it. A file with a custom policy
    class, or without metadata, is unpickled, which runs its code; a `UserWarning` names the file.

    Args:
        path: the file, or the folder of a training run.
        task: name of the task; None is the task that the file names, or balancing for a file without metadata.
        env_options: options of the environment, for a file without metadata; None rejects such a file.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is not a policy file, is damaged, or is for another environment or another layout of
            observations. This is checked before anything is unpickled.
        ModuleNotFoundError: sb3-contrib is not installed, which made the policy.
    """
    path = find_file(path)
    data = sb3_archive.read(path)
    found = data.get(METADATA)
    if found is None and env_options is not None:
        return _load_unnamed(path, data, task or DEFAULT_TASK, env_options)
    if not isinstance(found, dict):
        raise ValueError(
            f"{path} does not name the environment it was trained on: name the task, "
            f"or save it with ballbot_rs.save; expected {env_id_of(task or DEFAULT_TASK)}"
        )
    if not isinstance(found.get("env_id"), str):
        raise ValueError(f"{path} does not name its env_id: it is not a policy file of ballbot_rs")
    task = policy_file.task_in(path, found["env_id"], task)
    expected = metadata(task, str(found.get("algorithm")), {})
    for field, value in expected.items():
        if not isinstance(found.get(field), type(value)):
            raise ValueError(f"{path} does not name its {field}: it is not a policy file of ballbot_rs")
    if not policy_file.fits(found["observation"], task):
        raise ValueError(
            f"{path} was trained for another environment: "
            f"observation is {found['observation']!r}, expected {expected['observation']!r}"
        )
    known = algorithms()
    if found["algorithm"] in ALGORITHMS["sb3_contrib"]:
        with require(f"a policy of {found['algorithm']}", "train"):
            importlib.import_module("sb3_contrib")
    if found["algorithm"] not in known:
        raise ValueError(f"{path}: unknown algorithm '{found['algorithm']}', expected one of {', '.join(known)}")
    options = policy_file.completed(task, found["env_options"])
    replaced, unknown = sb3_archive.without_pickles(data, known[found["algorithm"]])
    replaced["observation_space"] = observation_space(task, options)
    replaced["action_space"] = action_space()
    if unknown:
        if "policy_class" in unknown:
            _check_class(path, data["policy_class"], found["algorithm"])
        _warn_of_code(path, f"custom {' and '.join(unknown)}")
    _check_size(path, replaced.get("policy_kwargs", data.get("policy_kwargs")), task, options, found["algorithm"])
    return _unpacked(path, found["algorithm"], replaced), {**found, "env_options": options}


def _load_unnamed(
    path: Path, data: Mapping[str, Any], task: str, env_options: Mapping[str, Any]
) -> tuple[BaseAlgorithm, dict[str, Any]]:
    known = {
        scaled: (observation_space(task, {**env_options, "scale_observations": scaled}), action_space())
        for scaled in (True, False)
    }
    spaces = [data.get(f"{kind}_space") for kind in ("observation", "action")]
    for space, expected in zip(spaces, known[True], strict=True):
        shape = space.get("_shape") if isinstance(space, dict) else None
        if shape != list(expected.shape or ()):
            raise ValueError(
                f"{path} was trained for another environment: it has a space of shape {shape}, expected {expected}"
            )
    name = _algorithm_of(data)
    _check_size(path, data.get("policy_kwargs"), task, env_options, name)
    _warn_of_code(path, "no metadata of ballbot_rs")
    model = _unpacked(path, name, {})
    found_spaces = model.observation_space, model.action_space
    scaled = next((scaled for scaled, those in known.items() if found_spaces == those), None)
    if scaled is None:
        raise ValueError(
            f"{path} was trained for another environment: it maps {found_spaces[0]} to {found_spaces[1]}, "
            f"expected {known[True][0]} to {known[True][1]}"
        )
    # Observations without scaling mean a policy from before 0.2.0, unless the options state otherwise.
    options = {"scale_observations": True, **env_options} if scaled else dict(env_options)
    return model, {**metadata(task, name, {}), "env_options": policy_file.completed(task, options)}


def _warn_of_code(path: Path, why: str) -> None:
    warnings.warn(
        f"{path} has {why}: loading it runs code that is in the file, so load it only if you trust its origin. "
        "Files of ballbot_rs.save with a usual policy, and ONNX files, load without running code",
        UserWarning,
        stacklevel=3,
    )


def _check_class(path: Path, described: Mapping[str, Any], algorithm: str) -> None:
    module = described.get("__module__")
    for name, kind in algorithms().items():
        if name != algorithm and module in {known.__module__ for known in kind.policy_aliases.values()}:
            raise ValueError(f"{path} holds no {algorithm} policy: its policy_class is of {module}")


def _check_size(path: Path, policy_arguments: Any, task: str, options: Mapping[str, Any], algorithm: str) -> None:
    if isinstance(policy_arguments, dict):
        try:
            policy_size.check(policy_arguments, observation_width(task, options), algorithm)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None


def _unpacked(path: Path, algorithm: str, replaced: dict[str, Any]) -> BaseAlgorithm:
    """The model in a file, with some of its values replaced."""
    try:
        return algorithms()[algorithm].load(path, device="cpu", custom_objects=replaced)
    except ModuleNotFoundError as error:
        raise ValueError(
            f"{path} needs {error.name}, which is not installed. Policies that `ballbot train` saved before 0.2.0 "
            "scale observations with a module of that version: export them as ONNX with it, or train again"
        ) from error
    # The exceptions of a damaged or foreign file have no common base class.
    except Exception as error:
        raise ValueError(f"{path} holds no {algorithm} policy that can be loaded: {error}") from error


def _algorithm_of(data: Mapping[str, Any]) -> str:
    """The algorithm that wrote a file. Algorithms with the same policy class act alike."""
    kind = data.get("policy_class")
    module = str(kind.get("__module__")) if isinstance(kind, dict) else ""
    if ".recurrent." in module and policy_size.RECURRENT in algorithms():
        return policy_size.RECURRENT
    for name in algorithms():
        if f".{name.lower()}." in module:
            return name
    return "PPO" if "clip_range" in data else "A2C"
