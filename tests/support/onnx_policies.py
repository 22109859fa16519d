"""ONNX policies for tests."""

import json

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

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


def recurrent_policy(target, units=5, cells=1, hidden=(), task="balance", seed=0, **options):
    """A random policy of a task with LSTM cells and then dense layers, in their elementary operators."""
    batch = new_batch(1, task=task, num_threads=1, options=options)
    rng, value, width = np.random.default_rng(seed), "observation", batch.observation_len
    nodes, constants, outputs, states, made = [], [], [], [], 0

    def node(kind, given, **attributes):
        nonlocal made
        made += 1
        nodes.append(helper.make_node(kind, given, [f"v{made}"], **attributes))
        return f"v{made}"

    def split(of, count):
        nodes.append(helper.make_node("Split", [of], [f"{of}_{i}" for i in range(count)], axis=1, num_outputs=count))
        return nodes[-1].output

    def layer(of, inputs, count, size):
        for name, shape in ((f"w{made}", (count, inputs)), (f"b{made}", (count,))):
            numbers = size * rng.standard_normal(shape) / (np.sqrt(inputs) if len(shape) == 2 else 1.0)
            constants.append(numpy_helper.from_array(numbers.astype(np.float32), name))
        return node("Gemm", [of, f"w{made}", f"b{made}"], transB=1)

    parts = split("state", 2 * cells)
    for k in range(cells):
        joined = node("Concat", [value, parts[k]], axis=1)
        gates = split(layer(joined, width + units, 4 * units, 1.5), 4)
        kept = node("Mul", [node("Sigmoid", [gates[1]]), parts[cells + k]])
        added = node("Mul", [node("Sigmoid", [gates[0]]), node("Tanh", [gates[2]])])
        states.append(node("Add", [kept, added]))
        value = node("Mul", [node("Sigmoid", [gates[3]]), node("Tanh", [states[-1]])])
        outputs.append(value)
        width = units
    for count in hidden:
        value, width = node("Tanh", [layer(value, width, count, 1.5)]), count
    last = layer(value, width, 3, 0.6)
    constants += [numpy_helper.from_array(np.float32(limit), name) for limit, name in ((-1.0, "low"), (1.0, "high"))]
    nodes.append(helper.make_node("Clip", [last, "low", "high"], ["action"]))
    nodes.append(helper.make_node("Concat", [*outputs, *states], ["next_state"], axis=1))
    ends = {
        "observation": batch.observation_len,
        "state": 2 * cells * units,
        "action": 3,
        "next_state": 2 * cells * units,
    }
    made_ends = [helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", size]) for name, size in ends.items()]
    graph = helper.make_graph(nodes, "recurrent", made_ends[:2], made_ends[2:], constants)
    model = helper.make_model(graph, ir_version=10, opset_imports=[helper.make_opsetid("", 20)])
    helper.set_model_props(model, _metadata(batch, task, options))
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
    helper.set_model_props(model, _metadata(batch, task, options))
    onnx.save(model, target)
    return target


def _metadata(batch, task, options):
    known = {
        "env_id": env_id_of(task),
        "env_options": resolved_options(batch, options),
        "observation": observation_layout(task),
        "max_wheel_torque": batch.max_wheel_torque,
        "control_dt": batch.control_dt,
        "algorithm": "none",
        "versions": {},
    }
    return {PREFIX + name: json.dumps(value) for name, value in known.items()}
