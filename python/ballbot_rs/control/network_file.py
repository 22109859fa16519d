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
    """The layers of a policy that is not recurrent, as `read_parts`.

    Raises:
        ValueError: a recurrent policy, and as `read_parts`.
        ModuleNotFoundError: onnx is not installed.
    """
    cells, layers = read_parts(path)
    if cells:
        raise ValueError(f"{path} is a recurrent policy, of {len(cells)} LSTM cells")
    return layers


def read_parts(path: Path) -> tuple[Network, Network]:
    """The LSTM cells of a policy, and its layers from them, or from the observation without cells, to the action.

    A cell of u units has weights (4u, inputs + u) and biases (4u,): input, forget, cell and output gates.

    Raises:
        ValueError: its network is not LSTM cells and then a chain of dense layers with tanh between them, and actions
            limited to ±1.
        ModuleNotFoundError: onnx is not installed.
    """
    with require("a policy as a controller", "export"):
        import onnx
    graph = onnx.load(path).graph
    found = _Terms(onnx)
    found.read(graph)
    ends = [found.named.get(end.name) for end in graph.output]
    cells = found.cells
    if found.layers and ends == found.expected(len(found.layers) - cells):
        return found.layers[:cells], found.layers[cells:]
    kinds = ", ".join(node.op_type for node in graph.node if node.op_type != "Constant")
    raise ValueError(
        f"{path} has the operators {kinds}: a policy that is a controller is a chain of dense layers with tanh between "
        "them, and actions limited to ±1, after LSTM cells if it is recurrent"
    )


class _Terms:
    """What the values of a graph are: equal terms have the same number, whatever they are named."""

    def __init__(self, onnx: Any) -> None:
        self._to_array, self._attribute = onnx.numpy_helper.to_array, onnx.helper.get_attribute_value
        self._numbers: dict[tuple[Any, ...], int] = {}
        self.named: dict[str, int] = {}
        self.layers: list[tuple[npt.NDArray[Any], npt.NDArray[Any]]] = []
        #: Number of LSTM cells, by the parts of the state.
        self.cells = 0

    def _term(self, *parts: Any) -> int:
        return self._numbers.setdefault(parts, len(self._numbers))

    def read(self, graph: Any) -> None:
        """Reads the nodes in order; what is unknown has no term."""
        constants = {tensor.name: self._to_array(tensor) for tensor in graph.initializer}
        # Files of IR version 3 list the weights as inputs, too.
        for end in graph.input:
            if end.name not in constants:
                self.named[end.name] = self._term(end.name)
        for node in graph.node:
            given = {one.name: self._attribute(one) for one in node.attribute}
            if node.op_type == "Constant" and "value" in given:
                constants[node.output[0]] = self._to_array(given["value"])
                continue
            terms = [self.named[name] for name in node.input if name in self.named]
            for i, name in enumerate(node.output):
                term = self._of(node, i, given, constants, terms)
                if term is not None:
                    self.named[name] = term

    def _of(
        self, node: Any, output: int, given: Mapping[str, Any], constants: Mapping[str, Any], terms: list[int]
    ) -> int | None:
        kind, count = node.op_type, len(node.output)
        rows = given.get("axis") in (1, -1)
        if kind == "Gemm" and len(terms) == 1:
            layer = _dense(node, given, constants)
            if layer is None:
                return None
            self.layers.append(layer)
            return self._term("layer", len(self.layers) - 1, *terms)
        if kind == "Split" and len(terms) == 1 and rows and _is_even(node, given, constants):
            if node.input[0] == "state":
                self.cells = count // 2
            return self._term("part", output, count, *terms)
        if kind == "Clip" and len(terms) == 1 and _numbers(node, constants) == [-1.0, 1.0]:
            return self._term("limited", *terms)
        if kind == "Concat" and len(terms) == len(node.input) and rows:
            return self._term("joined", *terms)
        if kind in ("Mul", "Add") and len(terms) == 2:
            return self._term(kind, *sorted(terms))
        if kind in ("Tanh", "Sigmoid") and len(terms) == 1:
            return self._term(kind, *terms)
        return None

    def expected(self, dense: int) -> list[int]:
        """The terms of the outputs: of LSTM cells and then dense layers."""
        term, count, cells = self._term, self.cells, []
        value, state = term("observation"), term("state")
        for k in range(count):
            own, before = (term("part", part, 2 * count, state) for part in (k, count + k))
            gates = term("layer", k, term("joined", value, own))
            taken, forget, new, output = (term("part", gate, 4, gates) for gate in range(4))
            kept = term("Mul", *sorted([term("Sigmoid", forget), before]))
            added = term("Mul", *sorted([term("Sigmoid", taken), term("Tanh", new)]))
            after = term("Add", *sorted([kept, added]))
            value = term("Mul", *sorted([term("Sigmoid", output), term("Tanh", after)]))
            cells.append((value, after))
        for k in range(dense):
            value = term("layer", count + k, term("Tanh", value) if k else value)
        action = term("limited", value)
        return (
            [action, term("joined", *(cell[0] for cell in cells), *(cell[1] for cell in cells))] if count else [action]
        )


def _is_even(node: Any, given: Mapping[str, Any], constants: Mapping[str, npt.NDArray[Any]]) -> bool:
    """Whether a Split has parts of one size: by their number, or by equal sizes."""
    sizes = constants.get(node.input[1]) if len(node.input) > 1 else None
    return "num_outputs" in given if sizes is None else len(set(sizes.tolist())) == 1


def _numbers(node: Any, constants: Mapping[str, npt.NDArray[Any]]) -> list[float]:
    return [float(constants[name]) for name in node.input[1:] if name in constants and constants[name].size == 1]


def _dense(
    node: Any, given: Mapping[str, Any], constants: Mapping[str, npt.NDArray[Any]]
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]] | None:
    """Weights and biases of a layer; None if they are not constants of the file."""
    # Exporters leave biases out that are zero.
    names = [name for name in node.input[1:] if name]
    if given.get("transA", 0) or not 1 <= len(names) <= 2 or not set(names) <= set(constants):
        return None
    weights = constants[names[0]] * given.get("alpha", 1.0)
    weights = weights if given.get("transB", 0) else weights.T
    biases = constants[names[1]] if len(names) == 2 else np.zeros(len(weights), dtype=weights.dtype)
    return weights, biases * given.get("beta", 1.0)
