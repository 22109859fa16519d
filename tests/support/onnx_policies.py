"""ONNX policies for tests."""

import onnx
from onnx import TensorProto, helper

from tests.support.paths import ASSETS

SHIPPED = ASSETS / "policies" / "balance.onnx"


def looping_policy(target, trips=2**62):
    """The shipped policy behind a loop of so many turns."""
    model = onnx.load(SHIPPED)
    number = lambda name, kind: helper.make_tensor_value_info(name, kind, [])  # noqa: E731
    body = helper.make_graph(
        [
            helper.make_node("Identity", ["goes_on"], ["still_goes_on"]),
            helper.make_node("Sin", ["before"], ["after"]),
        ],
        "turn",
        [number("turn", TensorProto.INT64), number("goes_on", TensorProto.BOOL), number("before", TensorProto.FLOAT)],
        [number("still_goes_on", TensorProto.BOOL), number("after", TensorProto.FLOAT)],
    )
    first = model.graph.input[0].name
    constants = [
        helper.make_node("Constant", [], ["trips"], value_int=trips),
        helper.make_node("ReduceSum", [first], ["sum"], keepdims=0),
        helper.make_node("Constant", [], ["always"], value=helper.make_tensor("always", TensorProto.BOOL, [], [True])),
        helper.make_node("Loop", ["trips", "always", "sum"], ["looped"], body=body),
        helper.make_node("Constant", [], ["nothing"], value_float=0.0),
        helper.make_node("Mul", ["looped", "nothing"], ["vanishes"]),
        helper.make_node("Add", [first, "vanishes"], ["passed"]),
    ]
    for node in model.graph.node:
        for i, name in enumerate(node.input):
            if name == first:
                node.input[i] = "passed"
    nodes = [*constants, *model.graph.node]
    del model.graph.node[:]
    model.graph.node.extend(nodes)
    onnx.save(model, target)
    return target
