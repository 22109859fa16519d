"""Policies as C99: equal to onnxruntime, and to the environment before and after the network."""

import json
import re

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

import ballbot_rs as bb
from ballbot_rs.control.onnx_policy import PREFIX, OnnxPolicy
from ballbot_rs.deployment import policy_header
from ballbot_rs.envs.spaces import history_ages
from tests.support.c_code import CPolicy
from tests.support.onnx_policies import SHIPPED, recurrent_policy
from tests.support.paths import ROOT

TOLERANCE = 1e-6
VELOCITY = SHIPPED.with_name("velocity.onnx")
OLD = ROOT / "tests" / "control" / "policy_0_1_0.onnx"


def observations(size, count=1000):
    """Observations of all magnitudes, within the bounds of the environment."""
    rng = np.random.default_rng(5)
    spread = 10.0 ** rng.uniform(-2.0, 1.0, (count, 1))
    return np.clip(spread * rng.standard_normal((count, size)), -10.0, 10.0).astype(np.float32)


def policy_of(target, nodes, constants, *, rows=16, **options):
    """A policy of these nodes, from "observation" to "action", with the metadata of the policy in the package."""
    metadata = {prop.key: prop.value for prop in onnx.load(SHIPPED).metadata_props}
    known = json.loads(metadata[PREFIX + "env_options"])
    metadata[PREFIX + "env_options"] = json.dumps({**known, **options})
    graph = helper.make_graph(
        nodes,
        "policy",
        [helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["n", rows])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, ["n", 3])],
        [numpy_helper.from_array(np.asarray(value, dtype=np.float32), name) for name, value in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=10)
    for key, value in metadata.items():
        model.metadata_props.add(key=key, value=value)
    onnx.save(model, target)
    return target


def difference(folder, file, real="double"):
    """The largest difference from onnxruntime's actions, and onnxruntime's actions."""
    policy = OnnxPolicy(file)
    rows = observations(policy._rows)
    expected = policy.act(rows)
    return np.abs(CPolicy(folder, policy_header(file), real).act(rows) - expected).max(), expected


@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("file", [SHIPPED, OLD], ids=["shipped", "0.1.0"])
def test_a_policy_in_c_acts_as_onnxruntime(file, real, tmp_path):
    found, expected = difference(tmp_path, file, real)
    print(f"{file.name} in {real}: largest difference of an action {found:.1e}")
    assert found < TOLERANCE
    assert 0.005 < (np.abs(expected) == 1.0).mean() < 0.9
    assert expected.std() > 0.1


LAYER = helper.make_node("MatMul", ["observation", "w"], ["layer"])
LAST = helper.make_node("Gemm", ["hidden", "v", "c"], ["action"], alpha=0.5, beta=2.0)


@pytest.mark.parametrize(
    "nodes",
    [
        [helper.make_node("Tanh", ["layer"], ["hidden"])],
        [helper.make_node("Relu", ["layer"], ["hidden"])],
        [helper.make_node("LeakyRelu", ["layer"], ["hidden"], alpha=0.2)],
        [helper.make_node("LeakyRelu", ["layer"], ["hidden"])],
        [helper.make_node("Elu", ["layer"], ["hidden"], alpha=0.7)],
        [helper.make_node("Sigmoid", ["layer"], ["hidden"])],
        [helper.make_node("Identity", ["layer"], ["hidden"])],
        [helper.make_node("Clip", ["layer", "", "half"], ["hidden"])],
        [helper.make_node("Clip", ["layer", "half"], ["hidden"])],
        [helper.make_node("Add", ["layer", "b"], ["sum"]), helper.make_node("Sub", ["half", "sum"], ["hidden"])],
        [helper.make_node("Mul", ["layer", "b"], ["part"]), helper.make_node("Div", ["part", "half"], ["hidden"])],
        [
            helper.make_node("Split", ["layer"], ["one", "two", "three"], axis=1, num_outputs=3),
            helper.make_node("Tanh", ["two"], ["tanh"]),
            helper.make_node("Concat", ["three", "tanh", "one"], ["hidden"], axis=-1),
        ],
        [
            helper.make_node("Constant", [], ["sizes"], value_ints=[1, 4]),
            helper.make_node("Split", ["layer", "sizes"], ["one", "four"], axis=1),
            helper.make_node("Mul", ["four", "one"], ["scaled"]),
            helper.make_node("Concat", ["scaled", "one"], ["hidden"], axis=1),
        ],
        # SiLU, and a constant within the graph.
        [
            helper.make_node("Sigmoid", ["layer"], ["gate"]),
            helper.make_node("Mul", ["layer", "gate"], ["gated"]),
            helper.make_node("Constant", [], ["one"], value_float=1.5),
            helper.make_node("Add", ["gated", "one"], ["hidden"]),
        ],
    ],
    ids=lambda nodes: "-".join(node.op_type for node in nodes),
)
def test_each_operator_matches_onnxruntime(nodes, tmp_path):
    rng = np.random.default_rng(6)
    constants = {
        "w": rng.normal(0.0, 0.2, (16, 5)),
        "b": rng.normal(0.0, 1.0, (1, 5)),
        "half": 0.5,
        "v": rng.normal(0.0, 0.1, (5, 3)),
        "c": rng.normal(0.0, 0.1, 3),
    }
    file = policy_of(tmp_path / "p.onnx", [LAYER, *nodes, LAST], constants)
    policy = OnnxPolicy(file)
    rows = observations(16)
    expected = np.clip(policy.act(rows), -1.0, 1.0)
    found = CPolicy(tmp_path, policy_header(file)).act(rows)
    assert np.abs(found - expected).max() < TOLERANCE
    assert expected.std() > 0.01


def test_an_unknown_operator_is_named(tmp_path):
    nodes = [LAYER, helper.make_node("Sin", ["layer"], ["hidden"]), LAST]
    constants = {"w": np.ones((16, 5)), "v": np.ones((5, 3)), "c": np.zeros(3)}
    file = policy_of(tmp_path / "sine.onnx", nodes, constants)
    message = f"{file}: the operator Sin cannot be written as C: expected one of Tanh, Relu"
    with pytest.raises(ValueError, match=re.escape(message)):
        policy_header(file)


def test_parts_along_the_rows_of_a_batch_are_named(tmp_path):
    nodes = [LAYER, helper.make_node("Concat", ["layer", "layer"], ["hidden"], axis=0), LAST]
    constants = {"w": np.ones((16, 5)), "v": np.ones((5, 3)), "c": np.zeros(3)}
    file = policy_of(tmp_path / "p.onnx", nodes, constants)
    with pytest.raises(ValueError, match="the operator Concat along an axis other than the numbers"):
        policy_header(file)


@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize(("units", "cells", "hidden"), [(6, 1, ()), (5, 3, (4,))])
def test_a_recurrent_policy_in_c_acts_as_onnxruntime(units, cells, hidden, real, tmp_path):
    file = recurrent_policy(tmp_path / "p.onnx", units, cells, hidden)
    policy, header = OnnxPolicy(file), policy_header(file)
    assert f"#define BALLBOT_POLICY_STATE {2 * units * cells}\n" in header
    in_c = CPolicy(tmp_path, header, real)
    expected, rows = [], observations(16, 400)
    state = policy.initial_state()
    for seen in rows:
        action, state = policy.step(seen, state)
        expected.append(action)
    found = in_c.act(rows)
    print(f"{cells} cells of {units} units in {real}: largest difference {np.abs(found - expected).max():.1e}")
    assert np.abs(found - expected).max() < TOLERANCE
    assert np.std(expected) > 0.1
    # Reset, it acts as at first; without a reset the state continues.
    assert np.abs(in_c.act(rows[:1]) - expected[0]).max() > 1e-3
    in_c.reset()
    assert np.abs(in_c.act(rows[:1]) - expected[0]).max() < TOLERANCE


def test_steps_of_a_recurrent_policy_in_c_match_the_environment(tmp_path):
    file = recurrent_policy(tmp_path / "p.onnx", cells=2, history=[0, 2], max_wheel_torque=0.3)
    policy, in_c = OnnxPolicy(file), CPolicy(tmp_path, policy_header(file))
    scaled = bb.BalanceEnv(history=[0, 2], max_wheel_torque=0.3)
    plain = bb.BalanceEnv(scale_observations=False, max_wheel_torque=0.3)
    steps = 0
    for seed in range(6):
        seen, rows, over = scaled.reset(seed=seed)[0], plain.reset(seed=seed)[0], False
        state = policy.initial_state()
        in_c.reset()
        while not over:
            action, state = policy.step(seen, state)
            np.testing.assert_allclose(in_c.step(rows), 0.3 * action, atol=2.0 * TOLERANCE)
            seen, rows, over = scaled.step(action)[0], *plain.step(action)[:3:2]
            steps += 1
    assert steps > 100


@pytest.mark.parametrize("integral_rate", [0.0, 5.0])
@pytest.mark.parametrize("history", [1, 3, [0, 1, 4, 9]])
def test_steps_in_c_match_the_environment(history, integral_rate, tmp_path):
    """The same episode, seen scaled by onnxruntime and in units by C."""
    rng = np.random.default_rng(7)
    size = 16 * len(history_ages(history))
    constants = {"v": rng.normal(0.0, 0.05, (size, 3)), "c": rng.normal(0.0, 0.1, 3)}
    nodes = [helper.make_node("Gemm", ["observation", "v", "c"], ["action"])]
    # Far enough for all limits of the integral.
    options = {"integral_rate": integral_rate, "max_wheel_torque": 0.3}
    far = {"setpoint": (0.7, -0.5)} if integral_rate else {}
    file = policy_of(tmp_path / "p.onnx", nodes, constants, rows=size, history=history, **options)
    policy, in_c = OnnxPolicy(file), CPolicy(tmp_path, policy_header(file))
    scaled = bb.BalanceEnv(history=history, **options, **far)
    plain = bb.BalanceEnv(scale_observations=False, max_wheel_torque=0.3, **far)
    largest = steps = 0
    for seed in range(10):
        seen, rows, over = scaled.reset(seed=seed)[0], plain.reset(seed=seed)[0], False
        in_c.reset()
        while not over:
            action = np.clip(policy.act(seen), -1.0, 1.0)
            np.testing.assert_allclose(in_c.step(rows), 0.3 * action, atol=TOLERANCE)
            seen, rows, over = scaled.step(action)[0], *plain.step(action)[:3:2]
            largest, steps = max(largest, np.abs(seen).max()), steps + 1
    assert steps > 100
    assert largest > 3.0


def test_a_scaled_policy_in_c_is_for_the_robot_that_is_named(tmp_path):
    rng = np.random.default_rng(8)
    constants = {"v": rng.normal(0.0, 0.05, (16, 3)), "c": rng.normal(0.0, 0.1, 3)}
    nodes = [helper.make_node("Gemm", ["observation", "v", "c"], ["action"])]
    options = {"scale_by_robot": True, "integral_rate": 4.0, "max_wheel_torque": None}
    several = policy_of(tmp_path / "p.onnx", nodes, constants, params={"family": 3}, **options)
    with pytest.raises(ValueError, match="trained on several robots: name the robot"):
        policy_header(several)
    policy = OnnxPolicy(several)
    for robot in ("kugle", "rezero"):
        folder = tmp_path / robot
        folder.mkdir()
        text = policy_header(several, robot=robot)
        assert f"Scaled to the robot '{robot}'." in text
        in_c = CPolicy(folder, text)
        scaled, plain = (
            bb.BalanceEnv(robot=robot, scale_by_robot=True, scale_observations=is_scaled, integral_rate=rate)
            for is_scaled, rate in ((True, 4.0), (False, 0.0))
        )
        seen, rows, over = scaled.reset(seed=3)[0], plain.reset(seed=3)[0], False
        in_c.reset()
        while not over:
            action = np.clip(policy.act(seen), -1.0, 1.0)
            torques = scaled.max_wheel_torque * action
            np.testing.assert_allclose(in_c.step(rows), torques, rtol=1e-5, atol=TOLERANCE * scaled.max_wheel_torque)
            seen, rows, over = scaled.step(action)[0], *plain.step(action)[:3:2]
    with pytest.raises(ValueError, match="drives the robot that it was trained on"):
        policy_header(SHIPPED, robot="kugle")


def test_rows_are_saturated_and_nan_is_zero_as_in_the_environment(tmp_path):
    weights = np.zeros((16, 3))
    weights[[3, 6, 9], [0, 1, 2]] = 0.05
    nodes = [helper.make_node("Gemm", ["observation", "v", "c"], ["action"])]
    file = policy_of(tmp_path / "p.onnx", nodes, {"v": weights, "c": np.zeros(3)}, max_wheel_torque=1.0)
    rows = np.zeros(16)
    rows[[3, 6, 9]] = 1e3, -1e3, np.nan
    # Scaled observations end at ±10.
    np.testing.assert_allclose(CPolicy(tmp_path, policy_header(file)).step(rows), [0.5, -0.5, 0.0], atol=1e-6)


def test_rows_from_a_state_match_the_task(tmp_path):
    in_c = CPolicy(tmp_path, policy_header(SHIPPED))
    env = bb.BalanceEnv(scale_observations=False, setpoint=(0.3, -0.2))
    for seed in range(5):
        rows = env.reset(seed=seed)[0]
        in_c.reset()
        for _ in range(30):
            found = in_c.observe(env.state, (0.3, -0.2))
            np.testing.assert_allclose(found, rows, atol=1e-5)
            rows = env.step(in_c.step(found) / env.max_wheel_torque)[0]
    assert np.abs(rows[[6, 7, 8, 13, 14, 15]]).min() > 0.0


def test_rows_from_a_state_and_a_commanded_velocity_match_the_task(tmp_path):
    """The setpoint's velocity is in the inertial frame, the task's command in the heading frame."""
    in_c = CPolicy(tmp_path, policy_header(VELOCITY))
    env = bb.VelocityEnv(scale_observations=False)
    for seed in range(5):
        rows = env.reset(seed=seed)[0]
        in_c.reset()
        for _ in range(50):
            x, y, yaw_rate = env.command
            w, _, _, z = env.state.body_quaternion
            cos, sin = (w * w - z * z) / (w * w + z * z), 2.0 * w * z / (w * w + z * z)
            found = in_c.observe(env.state, velocity=(cos * x - sin * y, sin * x + cos * y), yaw_rate=yaw_rate)
            np.testing.assert_allclose(found, rows, atol=1e-5)
            rows = env.step(in_c.step(found) / env.max_wheel_torque)[0]
    assert np.abs(rows[[5, 9, 10, 11, 12, 13, 14, 15, 16]]).min() > 0.0
