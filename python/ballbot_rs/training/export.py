"""A policy of Stable-Baselines3 as an ONNX file with metadata on its use, checked against its source."""

import contextlib
import io
import json
import logging
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import stable_baselines3
import torch
from stable_baselines3.common.base_class import BaseAlgorithm

from ballbot_rs import _files
from ballbot_rs._extras import require
from ballbot_rs.control import policy_file, sb3_policy, sb3_recurrent
from ballbot_rs.control.onnx_policy import PREFIX, OnnxPolicy
from ballbot_rs.control.sb3_recurrent import RecurrentModel
from ballbot_rs.envs.registration import task_of

#: Tolerance of exported actions relative to their source, number of observations in the check, and for recurrent
#: policies how many of these each robot sees.
TOLERANCE: Final = 1e-5
CHECKED: Final = 1000
IN_TIME: Final = 50


class _Action(torch.nn.Module):
    """The computation of `predict(observation, deterministic=True)`, without numpy and without a distribution."""

    def __init__(self, model: BaseAlgorithm) -> None:
        super().__init__()
        self._policy: Any = model.policy

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """The most likely action, within [-1, 1]."""
        policy = self._policy
        actor: Any = getattr(policy, "actor", None)
        if actor is not None and hasattr(actor, "get_action_dist_params"):
            mean = torch.tanh(actor.get_action_dist_params(observation)[0])
        elif actor is not None:
            mean = actor(observation)
        else:
            features = policy.extract_features(observation, policy.pi_features_extractor)
            mean = policy.action_net(policy.mlp_extractor.forward_actor(features))
            mean = torch.tanh(mean) if policy.squash_output else mean
        return mean.clamp(-1.0, 1.0)


class _Step(torch.nn.Module):
    """The computation of `predict` of a recurrent policy, deterministic: LSTM cells in their elementary operators.

    The state has the outputs of all cells, then their states.
    """

    def __init__(self, model: BaseAlgorithm) -> None:
        super().__init__()
        self._policy: Any = model.policy
        lstm: Any = model.policy.lstm_actor
        self._units: int = lstm.hidden_size
        cells = [
            (
                torch.cat([getattr(lstm, f"weight_{of}_l{k}") for of in ("ih", "hh")], dim=1),
                getattr(lstm, f"bias_ih_l{k}") + getattr(lstm, f"bias_hh_l{k}"),
            )
            for k in range(lstm.num_layers)
        ]
        self._weights = torch.nn.ParameterList([weights.detach() for weights, _ in cells])
        self._biases = torch.nn.ParameterList([biases.detach() for _, biases in cells])

    def forward(self, observation: torch.Tensor, state: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """The most likely action, within [-1, 1], and the next state."""
        policy = self._policy
        value = policy.extract_features(observation, policy.pi_features_extractor)
        parts = torch.split(state, self._units, dim=1)
        count = len(parts) // 2
        outputs, states = [], []
        for k, (weights, biases) in enumerate(zip(self._weights, self._biases, strict=True)):
            gates = torch.nn.functional.linear(torch.cat([value, parts[k]], dim=1), weights, biases)
            given, forget, new, output = torch.split(gates, self._units, dim=1)
            states.append(torch.sigmoid(forget) * parts[count + k] + torch.sigmoid(given) * torch.tanh(new))
            value = torch.sigmoid(output) * torch.tanh(states[-1])
            outputs.append(value)
        mean = policy.action_net(policy.mlp_extractor.forward_actor(value))
        mean = torch.tanh(mean) if policy.squash_output else mean
        return mean.clamp(-1.0, 1.0), torch.cat([*outputs, *states], dim=1)


def export(source: Path, target: Path, task: str | None = None, env_options: Mapping[str, Any] | None = None) -> float:
    """Writes the policy at `source` (a file or a run) to `target`; returns the largest difference of actions.

    Args:
        source: a file of Stable-Baselines3, or a training run.
        target: the ONNX file.
        task: name of the task; None is the task that the policy names.
        env_options: options of the environment, for a file without metadata; None rejects such a file.

    Raises:
        FileNotFoundError: there is no policy.
        ValueError: it is a policy for another task, or its ONNX form acts differently; nothing is written.
        ModuleNotFoundError: a package for the export is not installed.
        OSError: the file cannot be written; an earlier one stays as it is.
    """
    model, found = sb3_policy.load(source, task, env_options)
    if not _is_known(model):
        raise ValueError(f"{source}: a policy of {found['algorithm']} cannot be exported")
    memory = sb3_recurrent.of(model)
    if memory is not None:
        _check_cells(source, model)
    content = _with_metadata(
        _graph(model, memory),
        {**_metadata(found, task_of(found["env_id"])), **({} if memory is None else memory.metadata)},
    )
    with _files.replacing(target) as unchecked:
        unchecked.write_bytes(content)
        exported = OnnxPolicy(unchecked, task)
        difference = _difference(model, exported) if memory is None else _difference_in_time(memory, exported, model)
        if not difference <= TOLERANCE:
            raise ValueError(
                f"{sb3_policy.find_file(source)} and its ONNX form differ by {difference:.1e} > {TOLERANCE:.0e}"
            )
    return difference


def _is_known(model: BaseAlgorithm) -> bool:
    return hasattr(model.policy, "actor") or hasattr(model.policy, "mlp_extractor")


def _check_cells(source: Path, model: BaseAlgorithm) -> None:
    lstm: Any = model.policy.lstm_actor
    others = {"bidirectional": lstm.bidirectional, "proj_size": lstm.proj_size, "bias": not lstm.bias}
    for name, is_other in others.items():
        if is_other:
            raise ValueError(f"{source}: an LSTM with lstm_kwargs.{name} = {getattr(lstm, name)} cannot be exported")


def _graph(model: BaseAlgorithm, memory: RecurrentModel | None) -> Any:
    ends = (["observation"], ["action"]) if memory is None else (["observation", "state"], ["action", "next_state"])
    action = (_Action(model) if memory is None else _Step(model)).eval()
    # In the order of the inputs.
    examples = [torch.zeros((2, *_shape(model))), *([] if memory is None else [torch.zeros((2, memory.state_len))])]
    rows = torch.export.Dim("n")
    # The exporter prints its progress and warns of features that this network does not have.
    with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings(), _silent("torch.onnx", "onnxscript"):
        warnings.simplefilter("ignore")
        with require("exporting", "train", "export"):
            program = torch.onnx.export(
                action,
                tuple(examples),
                dynamo=True,
                input_names=ends[0],
                output_names=ends[1],
                dynamic_shapes=tuple({0: rows} for _ in examples),
                external_data=False,
                verbose=False,
            )
    assert program is not None
    return program.model_proto


@contextlib.contextmanager
def _silent(*names: str) -> Any:
    loggers = [logging.getLogger(name) for name in names]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


def _metadata(found: dict[str, Any], task: str) -> dict[str, Any]:
    versions = {
        "trained_with_ballbot_rs": found["ballbot_rs"],
        "stable_baselines3": stable_baselines3.__version__,
        "torch": str(torch.__version__),
    }
    return policy_file.metadata(task, found["env_options"], found["algorithm"], versions)


def _with_metadata(proto: Any, metadata: dict[str, Any]) -> bytes:
    """The graph with our metadata and without the exporter's, which has stack traces with paths of this machine."""
    for part in (proto.graph, *proto.graph.node, *proto.graph.value_info, *proto.graph.input, *proto.graph.output):
        part.ClearField("metadata_props")
        part.ClearField("doc_string")
    del proto.graph.value_info[:]
    del proto.metadata_props[:]
    for field, value in metadata.items():
        proto.metadata_props.add(key=PREFIX + field, value=json.dumps(value))
    content: bytes = proto.SerializeToString(deterministic=True)
    return content


def _shape(model: BaseAlgorithm) -> tuple[int, ...]:
    shape = model.observation_space.shape
    assert shape is not None
    return shape


def _difference(model: BaseAlgorithm, exported: OnnxPolicy) -> float:
    """Largest difference over observations of all magnitudes: a robot at rest, balancing, and at the bounds."""
    rng = np.random.default_rng(0)
    space: Any = model.observation_space
    spread = 10.0 ** rng.uniform(-2.0, 1.0, (CHECKED, 1))
    rows: npt.NDArray[np.float32] = np.clip(
        spread * rng.standard_normal((CHECKED, *_shape(model))), space.low, space.high
    ).astype(np.float32)
    expected = model.predict(rows, deterministic=True)[0]
    return float(np.abs(exported.act(rows) - expected).max())


def _difference_in_time(memory: RecurrentModel, exported: OnnxPolicy, model: BaseAlgorithm) -> float:
    """Largest difference of actions and next states, these relative if above 1, over sequences of such observations."""
    rng = np.random.default_rng(0)
    space: Any = model.observation_space
    robots = CHECKED // IN_TIME
    spread = 10.0 ** rng.uniform(-2.0, 1.0, (robots, 1))
    states = memory.initial_state(robots)
    largest = 0.0
    for _ in range(IN_TIME):
        rows = np.clip(spread * rng.standard_normal((robots, *_shape(model))), space.low, space.high)
        # From the same states: a network may amplify a difference from step to step.
        found, after = exported.step(rows.astype(np.float32), states)
        expected, states = memory.step(rows.astype(np.float32), states)
        off = np.abs(after - states) / np.maximum(np.abs(states), 1.0)
        largest = max(largest, float(np.abs(found - expected).max()), float(off.max()))
    return largest
