"""ONNX policies for tests."""

import json

import numpy as np
import onnx
from onnx import TensorProto, helper

from ballbot_rs.control.onnx_policy import PREFIX
from ballbot_rs.control.policy_file import observation_layout
from ballbot_rs.envs._batch_env import new_batch, resolved_options
from ballbot_rs.envs.registration import env_id_of
from tests.support.paths import ASSETS

SHIPPED = ASSETS / "policies" / "balance.onnx"


def looping_policy(target, trips=2**62):
    """The shipped policy after a loop with this number of iterations."""
    model = onnx.load(SHIPPED)
    number = lambda name, kind: helper.make_tensor_value_info(name, kind, [])  # noqa: E731
    body = helper.make_graph(
        [
            helper.make_node("Identity", ["continues"], ["still_continues"]),
            helper.make_node("Sin", ["before"], ["after"]),
        ],
        "turn",
        [number("turn", TensorProto.INT64), number("continues", TensorProto.BOOL), number("before", TensorProto.FLOAT)],
        [number("still_continues", TensorProto.BOOL), number("after", TensorProto.FLOAT)],
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


def tiny_policy(target, task, gain=0.0, **options):
    """A random linear policy of a task; `gain` scales its weights, 0 disables them."""
    batch = new_batch(1, task=task, num_threads=1, options=options)
    rows = batch.observation_len
    weights = gain * np.random.default_rng(0).standard_normal((rows, 3))
    graph = helper.make_graph(
        [
            helper.make_node("MatMul", ["observation", "weights"], ["sum"]),
            helper.make_node("Tanh", ["sum"], ["action"]),
        ],
        "tiny",
        [helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["n", rows])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, ["n", 3])],
        [helper.make_tensor("weights", TensorProto.FLOAT, [rows, 3], weights.astype(np.float32).ravel())],
    )
    opset = [helper.make_opsetid("", 17)]
    model = helper.make_model(graph, ir_version=8, opset_imports=opset)
    known = {
        "env_id": env_id_of(task),
        "env_options": resolved_options(batch, options),
        "observation": observation_layout(task),
        "max_wheel_torque": batch.max_wheel_torque,
        "control_dt": batch.control_dt,
        "algorithm": "none",
        "versions": {},
    }
    helper.set_model_props(model, {PREFIX + name: json.dumps(value) for name, value in known.items()})
    onnx.save(model, target)
    return target
