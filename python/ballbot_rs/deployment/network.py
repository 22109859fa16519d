"""The network of an ONNX file as C99."""

import dataclasses
from collections.abc import Callable
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._extras import require
from ballbot_rs.deployment.c_text import number, single_array

#: Elementwise operators, as expressions in x and the operator's attribute alpha.
_OF_ONE: Final[dict[str, tuple[str, float]]] = {
    "Tanh": ("ballbot_tanh(x)", 0.0),
    "Relu": ("x > 0 ? x : 0", 0.0),
    "LeakyRelu": ("x > 0 ? x : {alpha} * x", 0.01),
    "Elu": ("x > 0 ? x : {alpha} * (ballbot_exp(x) - 1)", 1.0),
    "Sigmoid": ("1 / (1 + ballbot_exp(-x))", 0.0),
    "Identity": ("x", 0.0),
}
_OF_TWO: Final = {"Add": "+", "Sub": "-", "Mul": "*", "Div": "/"}

#: The operators that can be written as C.
OPERATORS: Final = (*_OF_ONE, *_OF_TWO, "Clip", "Concat", "Constant", "Gemm", "MatMul", "Split")


@dataclasses.dataclass
class _Vector:
    """A result in C: the name and length of an array."""

    name: str
    size: int


@dataclasses.dataclass
class _Writer:
    """Writes the nodes in order."""

    constants: dict[str, npt.NDArray[Any]]
    vectors: dict[str, _Vector]
    definitions: str = ""
    arrays: list[str] = dataclasses.field(default_factory=list)
    body: str = ""
    made: int = 0

    def node(self, node: Any, attributes: dict[str, Any]) -> None:
        """Writes a node."""
        kind = node.op_type
        if kind == "Constant":
            self.constants[node.output[0]] = np.asarray(_constant(attributes))
        elif kind in ("Gemm", "MatMul"):
            self._layer(node, attributes)
        elif kind == "Clip":
            low, high = (self._scalar(name) for name in (*node.input[1:], "", "")[:2])
            above = "x" if low is None else f"ballbot_max(x, {low})"
            self._each(node, above if high is None else f"ballbot_min({above}, {high})")
        elif kind == "Concat":
            self._join(node, attributes)
        elif kind == "Split":
            self._split(node, attributes)
        elif kind in _OF_ONE:
            expression, alpha = _OF_ONE[kind]
            self._each(node, expression.format(alpha=f"(ballbot_real){number(attributes.get('alpha', alpha))}"))
        elif kind in _OF_TWO:
            self._pair(node, _OF_TWO[kind])
        else:
            raise ValueError(f"the operator {kind} cannot be written as C: expected one of {', '.join(OPERATORS)}")

    def _new(self, node: Any, size: int) -> _Vector:
        vector = _Vector(f"h{self.made}", size)
        self.made += 1
        self.arrays.append(f"    ballbot_real {vector.name}[{size}];")
        self.vectors[node.output[0]] = vector
        return vector

    def _vector(self, node: Any, name: str) -> _Vector:
        if name in self.vectors:
            return self.vectors[name]
        raise ValueError(
            f"the operator {node.op_type} of {name!r} cannot be written as C: it is not a vector of the network"
        )

    def _scalar(self, name: str) -> str | None:
        if not name:
            return None
        value = self.constants[name]
        if value.size != 1:
            raise ValueError(f"the operator Clip with bounds of shape {value.shape} cannot be written as C")
        return f"(ballbot_real){number(float(value.reshape(())))}"

    def _define(self, values: npt.NDArray[Any], of: str) -> str:
        name = f"BALLBOT_POLICY_{of}{self.made}"
        self.definitions += single_array(name, values)
        return name

    def _layer(self, node: Any, attributes: dict[str, Any]) -> None:
        given = self._vector(node, node.input[0])
        if attributes.get("transA", 0) or node.input[1] not in self.constants:
            raise ValueError(f"the operator {node.op_type} of {list(node.input)} cannot be written as C")
        weight = self.constants[node.input[1]].astype(float) * attributes.get("alpha", 1.0)
        rows = weight if attributes.get("transB", 0) else weight.T
        if rows.ndim != 2 or rows.shape[1] != given.size:
            raise ValueError(
                f"the operator {node.op_type} has weights of shape {weight.shape} for {given.size} numbers"
            )
        bias = np.zeros(len(rows))
        if len(node.input) > 2 and node.input[2]:
            bias = np.broadcast_to(self.constants[node.input[2]].astype(float).reshape(-1), bias.shape)
        weights = self._define(rows, "WEIGHTS")
        biases = self._define(bias * attributes.get("beta", 1.0), "BIAS")
        out = self._new(node, len(rows))
        self.body += _loop(
            out.size,
            f"{out.name}[i] = ballbot_policy_sum({weights}[i], {given.name}, {given.size}) + {biases}[i];",
        )

    def _each(self, node: Any, expression: str) -> None:
        given = self._vector(node, node.input[0])
        out = self._new(node, given.size)
        self.body += _loop(out.size, f"const ballbot_real x = {given.name}[i];", f"{out.name}[i] = {expression};")

    def _join(self, node: Any, attributes: dict[str, Any]) -> None:
        _check_axis(node, attributes)
        parts = [self._vector(node, name) for name in node.input]
        out, first = self._new(node, sum(part.size for part in parts)), 0
        for part in parts:
            place = f"{first} + i" if first else "i"
            self.body += _loop(part.size, f"{out.name}[{place}] = {part.name}[i];")
            first += part.size

    def _split(self, node: Any, attributes: dict[str, Any]) -> None:
        _check_axis(node, attributes)
        given, count = self._vector(node, node.input[0]), len(node.output)
        if len(node.input) > 1 and node.input[1]:
            sizes = [int(size) for size in self.constants[node.input[1]].reshape(-1)]
        else:
            # The last part may be smaller.
            most = -(-given.size // count)
            sizes = [min(most, given.size - k * most) for k in range(count)]
        if sum(sizes) != given.size or len(sizes) != count or min(sizes) < 1:
            raise ValueError(f"the operator Split of {given.size} numbers into {sizes} cannot be written as C")
        first = 0
        for name, size in zip(node.output, sizes, strict=True):
            # A part is a place in the array.
            self.vectors[name] = _Vector(f"({given.name} + {first})", size)
            first += size

    def _pair(self, node: Any, operator: str) -> None:
        sizes = [self.vectors[name].size if name in self.vectors else self.constants[name].size for name in node.input]
        size = max(sizes)
        operands = [self._operand(name, size) for name in node.input]
        out = self._new(node, size)
        self.body += _loop(size, f"{out.name}[i] = {operands[0]} {operator} {operands[1]};")

    def _operand(self, name: str, size: int) -> str:
        vector = self.vectors.get(name)
        if vector is None:
            values = self.constants[name].reshape(-1)
            if values.size == 1:
                return f"(ballbot_real){number(float(values[0]))}"
            vector = _Vector(self._define(values, f"OPERAND{len(self.definitions)}_"), values.size)
        if vector.size not in (1, size):
            raise ValueError(f"vectors of {vector.size} and {size} numbers cannot be joined")
        return f"{vector.name}[{0 if vector.size == 1 else 'i'}]"


def _check_axis(node: Any, attributes: dict[str, Any]) -> None:
    if attributes.get("axis", 0) not in (1, -1):
        raise ValueError(f"the operator {node.op_type} along an axis other than the numbers cannot be written as C")


def _loop(size: int, *lines: str) -> str:
    body = "".join(f"        {line}\n" for line in lines)
    return f"    for (i = 0; i < {size}; i++) {{\n{body}    }}\n"


def _constant(attributes: dict[str, Any]) -> Any:
    for name in ("value", "value_float", "value_floats", "value_int", "value_ints"):
        if name in attributes:
            return attributes[name]
    raise ValueError(f"the operator Constant with {sorted(attributes)} cannot be written as C")


def network(content: bytes, rows: int, state_len: int = 0) -> tuple[str, str]:
    """Arrays of weights, and the function `ballbot_policy_act`, for the network of an ONNX file.

    Args:
        content: the file.
        rows: length of an observation.
        state_len: length of the state of a recurrent policy, which the function replaces by the next state.

    Raises:
        ValueError: an operator that cannot be written as C; the message names it.
        ModuleNotFoundError: onnx is not installed.
    """
    with require("a policy as C", "export"):
        import onnx
    graph = onnx.load_from_string(content).graph
    to_array: Callable[[Any], npt.NDArray[Any]] = onnx.numpy_helper.to_array
    writer = _Writer(
        constants={tensor.name: to_array(tensor) for tensor in graph.initializer},
        vectors={name: _Vector(name, size) for name, size in {"observation": rows, "state": state_len}.items() if size},
    )
    for node in graph.node:
        attributes = {one.name: onnx.helper.get_attribute_value(one) for one in node.attribute}
        if isinstance(attributes.get("value"), onnx.TensorProto):
            attributes["value"] = to_array(attributes["value"])
        try:
            writer.node(node, attributes)
        except KeyError as error:
            raise ValueError(f"the operator {node.op_type} reads {error}, which no operator makes") from None
    action = writer.vectors["action"]
    takes, keeps = "", []
    if state_len:
        takes = "ballbot_real *state, "
        keeps = _loop(state_len, f"state[i] = {writer.vectors['next_state'].name}[i];").splitlines()
    lines = [
        "/* The network: the action, within [-1, 1], of observations as the environment gives them, oldest first. */",
        *(["/* The state of the robot becomes its next state. */"] if state_len else []),
        f"static inline void ballbot_policy_act(const ballbot_real *observation, {takes}ballbot_real action[3])",
        "{",
        *writer.arrays,
        "    int i;",
        *writer.body.splitlines(),
        "    for (i = 0; i < 3; i++) {",
        f"        action[i] = ballbot_max(-1, ballbot_min(1, {action.name}[i]));",
        "    }",
        *keeps,
        "}",
    ]
    return writer.definitions, "\n".join(lines) + "\n"
