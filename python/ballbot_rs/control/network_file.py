"""Small networks as ONNX policies, written without torch."""

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
