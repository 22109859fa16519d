"""Small networks in ONNX policies, read and written without torch."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs import _files
from ballbot_rs._extras import require
from ballbot_rs.control.onnx_policy import PREFIX

#: Versions of the operators and of the file, which onnxruntime 1.20 reads.
_OPSET: Final = 20
_IR_VERSION: Final = 10

#: Weights (outputs, inputs) and biases (outputs,) of each layer: tanh between layers, actions limited to ±1.
Network = Sequence[tuple[npt.NDArray[np.floating[Any]], npt.NDArray[np.floating[Any]]]]


def write(path: Path, network: Network, metadata: Mapping[str, Any]) -> None:
    """Writes a policy.

    Args:
        path: the ONNX file.
        network: the layers, from the observation to the action.
        metadata: the fields of `onnx_policy.FIELDS`.

    Raises:
        ModuleNotFoundError: onnx is not installed.
        OSError: the file cannot be written; an earlier one stays as it is.
    """
    with require("writing an ONNX policy", "evolution"):
        from onnx import TensorProto, helper, numpy_helper

    def constant(name: str, numbers: npt.ArrayLike) -> str:
        constants.append(numpy_helper.from_array(np.asarray(numbers, np.float32), name))
        return name

    constants: list[Any] = []
    nodes, value = [], "observation"
    for k, (weights, biases) in enumerate(network):
        if k > 0:
            nodes.append(helper.make_node("Tanh", [value], [f"hidden_{k}"]))
            value = f"hidden_{k}"
        given = [value, constant(f"weights_{k}", weights), constant(f"biases_{k}", biases)]
        value = f"sum_{k}"
        nodes.append(helper.make_node("Gemm", given, [value], transB=1))
    nodes.append(helper.make_node("Clip", [value, constant("least", -1.0), constant("most", 1.0)], ["action"]))

    def rows(name: str, width: int) -> Any:
        return helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", width])

    inputs, outputs = rows("observation", network[0][0].shape[1]), rows("action", len(network[-1][1]))
    graph = helper.make_graph(nodes, "policy", [inputs], [outputs], constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", _OPSET)], ir_version=_IR_VERSION)
    for field, one in metadata.items():
        model.metadata_props.add(key=PREFIX + field, value=json.dumps(one))
    _files.write(path, model.SerializeToString(deterministic=True))


def read(path: Path) -> Network:
    """The layers of a policy, from the observation to the action.

    Raises:
        ValueError: its network is not a chain of dense layers with tanh between them, and actions limited to ±1.
        ModuleNotFoundError: onnx is not installed.
    """
    with require("a policy as a controller", "export"):
        import onnx
    to_array, attribute = onnx.numpy_helper.to_array, onnx.helper.get_attribute_value
    graph = onnx.load(path).graph
    constants = {tensor.name: to_array(tensor) for tensor in graph.initializer}
    for node in graph.node:
        if node.op_type == "Constant" and node.attribute[0].name == "value":
            constants[node.output[0]] = to_array(attribute(node.attribute[0]))
    nodes = [node for node in graph.node if node.op_type != "Constant"]
    kinds = [node.op_type for node in nodes]
    # Each operator takes what the one before makes.
    values = [graph.input[0].name, *(node.output[0] for node in nodes)]
    is_chain = [node.input[0] for node in nodes] == values[:-1] and graph.output[0].name == values[-1]
    is_known = kinds == ["Gemm", *["Tanh", "Gemm"] * (kinds.count("Gemm") - 1), "Clip"]
    if is_chain and is_known and _numbers(nodes[-1], constants) == [-1.0, 1.0]:
        layers = [
            _dense(node, {one.name: attribute(one) for one in node.attribute}, constants) for node in nodes[:-1:2]
        ]
        if all(layer is not None for layer in layers):
            return [layer for layer in layers if layer is not None]
    raise ValueError(
        f"{path} has the operators {', '.join(kinds)}: a policy that is a controller is a chain of dense layers with "
        "tanh between them, and actions limited to ±1"
    )


def _numbers(node: Any, constants: Mapping[str, npt.NDArray[Any]]) -> list[float]:
    return [float(constants[name]) for name in node.input[1:] if name in constants and constants[name].size == 1]


def _dense(
    node: Any, given: Mapping[str, Any], constants: Mapping[str, npt.NDArray[Any]]
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]] | None:
    """Weights and biases of a layer; None if they are not constants of the file."""
    names = list(node.input[1:])
    if given.get("transA", 0) or len(names) != 2 or not set(names) <= set(constants):
        return None
    weights = constants[names[0]] * given.get("alpha", 1.0)
    return weights if given.get("transB", 0) else weights.T, constants[names[1]] * given.get("beta", 1.0)
