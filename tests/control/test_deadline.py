"""An ONNX policy with a loop without end is ended, and other policies are not."""

import json

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs._assets import path
from ballbot_rs.cli import main
from ballbot_rs.control import deadline, onnx_policy

onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")


@pytest.fixture
def looping(tmp_path):
    """A policy file whose model adds zero 2**62 times."""
    helper, kinds = onnx.helper, onnx.TensorProto
    body = helper.make_graph(
        [helper.make_node("Identity", ["go"], ["on"]), helper.make_node("Add", ["a", "zero"], ["b"])],
        "body",
        [
            helper.make_tensor_value_info("i", kinds.INT64, []),
            helper.make_tensor_value_info("go", kinds.BOOL, []),
            helper.make_tensor_value_info("a", kinds.FLOAT, None),
        ],
        [helper.make_tensor_value_info("on", kinds.BOOL, []), helper.make_tensor_value_info("b", kinds.FLOAT, None)],
        [helper.make_tensor("zero", kinds.FLOAT, [], [0.0])],
    )
    graph = helper.make_graph(
        [
            helper.make_node("Slice", ["observation", "from", "to", "axis"], ["sliced"]),
            helper.make_node("Loop", ["times", "true", "sliced"], ["action"], body=body),
        ],
        "endless",
        [helper.make_tensor_value_info("observation", kinds.FLOAT, ["n", 16])],
        [helper.make_tensor_value_info("action", kinds.FLOAT, ["n", 3])],
        [
            helper.make_tensor("times", kinds.INT64, [], [2**62]),
            helper.make_tensor("true", kinds.BOOL, [], [True]),
            *(helper.make_tensor(name, kinds.INT64, [1], [value]) for name, value in (("from", 0), ("to", 3))),
            helper.make_tensor("axis", kinds.INT64, [1], [1]),
        ],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    for name, value in bb.OnnxPolicy(path("policies/balance.onnx")).metadata.items():
        model.metadata_props.add(key=f"{onnx_policy.PREFIX}{name}", value=json.dumps(value))
    file = tmp_path / "endless.onnx"
    onnx.save(model, file)
    return file


def test_a_loop_without_end_is_ended(looping, monkeypatch, capsys):
    monkeypatch.setattr(onnx_policy, "CALL_LIMIT", 0.1)
    policy = bb.OnnxPolicy(looping)
    for _ in range(2):
        with pytest.raises(TimeoutError, match=r"endless\.onnx was aborted: it ran for more than 0\.101 s"):
            policy.act(np.zeros(16))
    assert main(["evaluate", "--controller", str(looping), "--episodes", "1"]) == 1
    assert capsys.readouterr().err == f"ballbot: {looping} was aborted: it ran for more than 0.101 s\n"
    # One that ends is not touched by it.
    assert bb.OnnxPolicy(path("policies/balance.onnx")).act(np.zeros(16)).shape == (3,)


def test_other_errors_stay_what_they_are():
    class Options:
        terminate = False

    def fail(_):
        raise KeyError("x")

    with pytest.raises(KeyError, match="x"):
        deadline.run(1.0, Options(), fail)
    assert deadline.run(1.0, Options(), lambda options: options.terminate) is False
    assert deadline._running == {}
